"""Faults in a running bridge, injected by parameter and by service."""

import re

import numpy as np
import pytest
from bridge_client import BridgeClient, StartBridge, velocity_command
from sensor_msgs.msg import JointState

MOVING = [0.5, 0.0, 0.5, 0.5]

# Fault, what the diagnostics say, joints whose states still arrive, whether the board needs a
# power cycle: whoever hears no frame for board_timeout switches off, and keeps that error.
FAULTS = [
    ('lost_frames:0:0:1.0', 'board0: .* consecutive frames were bad', [2, 3], True),
    ('encoder_jump:1:1:20', 'encoder of joint4 jumped by (19|2[0-2])', [0, 1, 2], True),
    ('slow_bus:0', 'board0: exchanges take 2.00 ms', [0, 1, 2, 3], False),
    ('driver_error:1', r'board1: error 7 \(driver fault\)', [0, 1], True),
]


@pytest.fixture
def encoders() -> str:
    return 'absolute'


@pytest.fixture
def client(start_bridge: StartBridge, encoders: str, ros_node) -> BridgeClient:
    # Times that no other work on the machine reaches.
    start_bridge(encoders=encoders, command_timeout=0.2, stamp_age_max=0.2)
    client = BridgeClient(ros_node)
    client.make_ready()
    return client


def move(client: BridgeClient) -> None:
    """Have the arm follow a velocity, away from its limits."""

    def answer(state: JointState) -> JointState:
        away = np.where(np.array(state.position) > 0.6, -1.0, 1.0)
        away[1] = 1.0
        return velocity_command(state, (away * MOVING).tolist())

    client.answer = answer
    client.wait_for_mode('running')
    client.wait_for(lambda: abs(client.states[-1].velocity[0]) > 0.3)


def recover(client: BridgeClient, fault: str, align: bool) -> None:
    client.answer = None
    name, board = fault.split(':')[:2]
    if align:
        assert client.set_parameters(fault=f'power_cycle:{board}') == []
        assert client.call('disable').success
    elif name == 'slow_bus':
        assert client.set_parameters(fault=f'slow_bus:{board}:0:5e-5') == []
    client.wait_for(lambda: client.call('clear_fault').success)
    if align:
        client.wait_for(lambda: client.call('enable').success)
    client.wait_for_mode('ready')


def test_faults_stop_the_arm_and_are_reported(client: BridgeClient) -> None:
    """One of each kind; test/hardware/test_bridge_faults.py injects all of them."""
    for fault, text, heard, align in FAULTS:
        move(client)
        assert client.set_parameters(fault=fault) == []
        client.wait_for_mode('fault')
        client.wait_for(lambda: re.search(text, client.messages['arm']))  # noqa: B023
        assert client.diagnostics['arm']['mode'] == 'fault'
        client.wait_for(
            lambda: max(abs(client.states[-1].velocity[joint]) for joint in heard) < 0.05  # noqa: B023
        )
        recover(client, fault, align)


@pytest.mark.parametrize('encoders', ['incremental'])
def test_faults_by_service_and_bad_requests(client: BridgeClient) -> None:
    answer = client.call('inject_fault')
    assert not answer.success
    assert 'NAME[:BOARD' in answer.message
    (reason,) = client.set_parameters(fault='gremlins')
    assert 'choose one of bit_errors, lost_frames' in reason
    (reason,) = client.set_parameters(fault='dead_board:7')
    assert 'boards 0 to 1' in reason
    assert client.get_parameters('fault') == ['']
    assert client.set_parameters(fault='encoder_jump:0:0') == []
    client.wait_for_mode('fault')
    client.wait_for(lambda: 'the zero of joint1 is unknown' in client.call('clear_fault').message)
    assert client.call('disable').success
    client.wait_for(lambda: client.call('clear_fault').success)
    client.wait_for(lambda: client.call('home').success)
    client.wait_for_mode('ready')
    answer = client.call('inject_fault')
    assert answer.success
    assert answer.message == "encoder_jump:0:0: a motor's encoder count jumps [rad, motor side]"
    client.wait_for_mode('fault')


def test_a_fallen_arm_is_put_back_when_it_is_enabled(client: BridgeClient) -> None:
    start = np.array(client.states[-1].position)
    assert not client.call('put_back').success
    client.answer = lambda state: velocity_command(state, [0.0, -1.0, 0.0, 0.0])
    client.wait_for(lambda: client.states[-1].position[1] < 1.2)
    client.answer = None
    assert client.call('disable').success
    client.wait_for(lambda: client.states[-1].position[1] < -0.5)
    client.wait_for(lambda: abs(client.states[-1].velocity[1]) < 1e-3)  # on its stop
    answer = client.call('enable')
    assert answer.success
    assert 'reset to its initial configuration' in answer.message
    client.wait_for_mode('ready')
    assert client.states[-1].position == pytest.approx(start, abs=0.1)
    assert client.call('disable').success
    client.wait_for(lambda: client.call('put_back').success)
