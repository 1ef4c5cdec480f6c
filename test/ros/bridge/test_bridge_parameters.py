"""Parameters of a running bridge: gains, real-time requests, and a busy parameter client."""

import re
from pathlib import Path
from types import SimpleNamespace

import pytest
from bridge_client import BridgeClient, StartBridge, velocity_command
from rclpy.node import Node

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.hardware.emulation.emulated_motor import EmulatedHeat
from aerarm_ros.hardware.transports.spidev_transport import SpidevTransport
from aerarm_ros.ros.bridge.bridge_parameters import AUTO, make_transport, state_file

STATISTICS = ('mean', 'std', 'p50', 'p99', 'p99.9', 'max')
REJECTED = [
    ('board_kp', [9.0], 'gains of the boards rejected: kp is .* carry 0 to 5.09'),
    ('board_kd', [0.1, 0.1], 'kd has 2 values: set 1 or 4'),
    ('board_kd', [-0.1], 'board_kd must be a list of finite numbers .* from 0'),
    ('board_kd', [0.0, 0.0, 0.0, 0.0], 'kd of joint1 is 0 A s/rad, .*: set kd to at least 0.1'),
    ('board_kp', 'stiff', 'DOUBLE_ARRAY'),
    ('board_ki', [1.0], 'integral_gain is .* profile uomodri_v3 can only carry 0 to 0'),
    ('period', 0.002, 'period'),
]


def test_gains_are_live_bad_ones_are_not_stored_and_energy_is_counted(client: BridgeClient) -> None:
    client.make_ready()
    for name, value, hint in REJECTED:
        before = client.get_parameters(name)
        (reason,) = client.set_parameters(**{name: value})
        assert re.search(hint, reason), reason
        assert client.get_parameters(name) == before
    # Without stiffness the arm gives way to its weight; damping lets it sink slowly.
    height = client.states[-1].position[1]
    assert client.set_parameters(board_kp=[0.0], board_kd=[0.2, 0.2, 0.1, 0.1]) == []
    assert client.get_parameters('board_kp', 'board_kd') == [[0.0], [0.2, 0.2, 0.1, 0.1]]
    client.answer = lambda state: velocity_command(state, [0.0, -0.5, 0.0, 0.0])
    client.wait_for(lambda: client.states[-1].position[1] < height - 0.3)
    assert client.set_parameters(board_kp=[], board_kd=[]) == []
    client.answer = lambda state: velocity_command(state, [0.0, 0.5, 0.0, 0.0])
    client.wait_for(lambda: client.states[-1].position[1] > height - 0.05)
    assert client.modes[-1] == 'running'
    client.wait_for(lambda: bool(client.messages['motors']))
    assert 'computed from current, resistance and speed' in client.messages['motors']
    client.wait_for(lambda: float(client.diagnostics['motors']['joint2 energy [J]']) > 0.1)
    motors = client.diagnostics['motors']
    parts = [float(motors[f'joint{k} energy [J]']) for k in (1, 2, 3, 4)]
    # As the motor of this arm (seed 3) is wound: without current joint 3 stays cold.
    true = EmulatedHeat.of_joint(load_arm_config().joints[2], 3).resistance
    assert float(motors['joint3 resistance [ohm]']) == pytest.approx(true, abs=1e-4)
    assert float(motors['energy [J]']) == pytest.approx(sum(parts), abs=0.3)
    # Stamped by the arm's time.
    stamp = client.states[-1].header.stamp
    assert stamp.sec + 1e-9 * stamp.nanosec - client.diagnosed < 5.0


def test_the_integral_gain_of_the_thesis_and_a_refused_real_time_request(
    start_bridge: StartBridge, ros_node: Node
) -> None:
    process = start_bridge(profile='laas_power', board_ki=[2.0], cpus=[1000])
    client = BridgeClient(ros_node)
    client.make_ready()
    client.wait_for(lambda: 'CPUs [1000] were refused' in process.tail(50))
    assert client.set_parameters(board_ki=[1.0, 2.0, 1.0, 2.0]) == []
    client.wait_for(lambda: 'motors' in client.diagnostics)
    assert 'voltages that the boards report' in client.messages['motors']
    # Their words carry voltages instead.
    assert not [key for key in client.diagnostics['motors'] if 'resistance' in key]


@pytest.mark.pace('keep_up')
def test_parameters_are_served_ten_times_a_second_while_the_loop_runs(client: BridgeClient) -> None:
    client.make_ready()
    client.answer = lambda state: velocity_command(state, [0.1, 0.0, 0.1, 0.1])
    client.wait_for_mode('running')
    client.wait_for(lambda: 'timing' in client.diagnostics)
    start = int(client.diagnostics['timing']['cycles'])
    for step in range(10):
        kd = [0.2 + 0.01 * step]
        assert client.set_parameters(board_kd=kd) == []
        assert client.get_parameters('board_kd', 'period', 'stall_time') == [kd, 0.001, 0.05]
        client.spin(0.1)
    client.wait_for(lambda: int(client.diagnostics['timing']['cycles']) > start + 500)
    timing = client.diagnostics['timing']
    for what in ('period', 'wake lateness', 'execution time', 'command age'):
        values = [float(timing[f'{what} {name} [us]']) for name in STATISTICS]
        assert values[2] <= values[3] <= values[4] <= values[5]
    assert 'fault' not in client.modes


def test_the_state_file_is_in_the_home_directory_unless_it_is_given(monkeypatch) -> None:
    values = SimpleNamespace(state_file=AUTO)
    monkeypatch.setenv('XDG_STATE_HOME', '/state')
    file = Path('/state/aerarm_ros/left.hardware_bridge.json')
    assert state_file(values, '/left/hardware_bridge', False) == file
    assert state_file(values, '/left/hardware_bridge', True) is None
    monkeypatch.delenv('XDG_STATE_HOME')

    def no_home() -> Path:
        raise RuntimeError('Could not determine home directory.')

    monkeypatch.setattr(Path, 'home', no_home)
    with pytest.raises(ValueError, match='set the parameter state_file'):
        state_file(values, '/left/hardware_bridge', False)
    assert state_file(SimpleNamespace(state_file='/zeros'), '/bridge', False) == Path('/zeros')


def test_a_module_alone_adds_a_transport(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = load_arm_config()
    assert isinstance(make_transport('spidev', config), SpidevTransport)
    spidev = 'aerarm_ros.hardware.transports.spidev_transport'
    for name, text in (
        ('my_bus', f'from {spidev} import SpidevTransport as make_transport'),
        ('syntax', 'def make_transport(:'),
        ('key', 'def make_transport(config):\n    return {}[config.name]'),
        ('bare', 'make_transport = object'),
        ('no_methods', 'make_transport = str'),
    ):
        (tmp_path / f'{name}.py').write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    assert isinstance(make_transport('my_bus', config), SpidevTransport)
    wrong = 'syntax', 'key', 'bare', 'no_methods'
    for name in ('', 'no_bus', 'no.bus', '.bus', 'json', '/dev/spidev0.0', *wrong):
        with pytest.raises(ValueError, match=f'the parameter transport is {name!r}'):
            make_transport(name, config)
