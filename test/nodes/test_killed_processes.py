"""After a kill, a stop or the loss of its device, the arm comes to rest with boards off."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
import spi_boards
import yaml
from bridge_client import BridgeClient, StartBridge, velocity_command
from rclpy.node import Node
from spi_boards import SpiBoards

from aerarm_ros.description.resources import resource
from aerarm_ros.hardware.boards.kept_zeros import sealed
from aerarm_ros.ros.process.node_process import NodeProcess, ros_environment

BOARD_TIMEOUT = 0.2  # [s]

# On boards whose time is that of the frames, and as patient as a bridge in real time can be: a
# host that sleeps for half a second is not what these tests are about.
UNHURRIED = {
    'board_timeout': BOARD_TIMEOUT,
    'state_age_max': 1.0,
    'bad_frames_max': 100,
    'command_timeout': 1.0,
    'stamp_age_max': 1.0,
    'exchange_time_max': 0.1,
    'state_file': '',
    'slow_exchanges_max': 1000,
    'velocity_factor': 4.0,
    'alignment_timeout': 60.0,
}


@pytest.fixture
def boards() -> Iterator[SpiBoards]:
    if spi_boards.missing():
        pytest.skip(spi_boards.missing())
    with SpiBoards(paced=True) as boards:
        yield boards


@pytest.fixture
def start_spi_bridge(
    boards: SpiBoards, ros_domain: dict[str, str], tmp_path: Path
) -> Iterator[Callable[..., NodeProcess]]:
    """Return a function that starts the real bridge on boards with absolute encoders."""
    document = yaml.safe_load(resource('config', 'aerarm.yaml').read_text())
    for board in document['boards']:
        board['encoders'] = 'absolute'
    config = tmp_path / 'absolute.yaml'
    config.write_text(yaml.safe_dump(document))
    with ExitStack() as stack:

        def start(**parameters: object) -> NodeProcess:
            given = {**UNHURRIED, 'config': config, **parameters}
            log = tmp_path / f'log{time.monotonic_ns()}'
            process = NodeProcess('hardware_bridge', (), given, boards.environment, log)
            return stack.enter_context(process)

        yield start


def test_when_the_controller_is_killed_the_arm_is_damped(
    start_bridge: StartBridge, ros_node: Node
) -> None:
    start_bridge(answer_timeout=0.5)
    client = BridgeClient(ros_node)
    client.make_ready()
    script = Path(__file__).with_name('velocity_controller.py')
    with subprocess.Popen([sys.executable, script], env=ros_environment()) as controller:
        try:
            client.wait_for(lambda: client.states[-1].velocity[0] > 0.3)
        finally:
            controller.kill()
    client.wait_for_mode('damping')
    client.wait_for(lambda: max(np.abs(client.states[-1].velocity)) < 0.05)
    client.wait_for(lambda: 'check that the controller runs' in client.messages['arm'])
    assert client.call('enable').success
    client.wait_for_mode('ready')
    # What it is given to carry weighs on its joints from then on.
    before = client.states[-1].effort[1]
    assert client.set_parameters(payload=[0.5, 0.1, 0.2, 0.0]) == []
    client.wait_for(lambda: abs(client.states[-1].effort[1] - before) > 0.5)
    (reason,) = client.set_parameters(payload=[0.5])
    assert 'must be a mass' in reason


def test_a_device_that_vanishes_is_opened_again_and_sigquit_switches_the_motors_off(
    start_spi_bridge: Callable[..., NodeProcess], boards: SpiBoards, ros_node: Node
) -> None:
    bridge = start_spi_bridge()
    client = BridgeClient(ros_node, 'hardware_bridge')
    client.wait_for_mode('idle')
    assert 'board1 on /dev/spidev0.1 at 8 MHz, mode 0: 50 of 50 answers' in bridge.tail(50)
    boards.vanish('/dev/spidev0.1')
    client.wait_for_mode('disconnected')
    client.wait_for(lambda: 'tries to open the device again' in client.messages['arm'])
    assert '/dev/spidev0.1 reports' in client.call('enable').message
    boards.come_back('/dev/spidev0.1')
    client.wait_for_mode('idle')
    assert [board['told_on'] for board in boards.report()] == [False, False]
    client.make_ready()
    assert [board['told_on'] for board in boards.report()] == [True, True]
    assert all(board['gains'] > 0.0 for board in boards.report())
    # A moving arm is stopped.
    client.answer = lambda state: velocity_command(state, [0.4, 0.0, 0.4, 0.4])
    client.wait_for(lambda: client.states[-1].velocity[0] > 0.3)
    boards.vanish('/dev/spidev0.1')
    client.wait_for_mode('fault')
    client.wait_for(
        lambda: '/dev/spidev0.1 reports an error (Cannot send' in client.messages['arm']
    )
    client.wait_for(lambda: max(np.abs(client.states[-1].velocity[:2])) < 0.05)
    assert bridge.stop(signal.SIGQUIT) == 0
    # Their time stands still without frames, so no time-out did this.
    told = boards.report()[0]
    assert (told['told_on'], told['enabled'], told['error']) == (False, False, 0)
    assert (told['gains'], told['current']) == (0.0, 0.0)
    boards.let_pass(BOARD_TIMEOUT)  # for the one that nobody reaches any more
    assert [board['enabled'] for board in boards.report()] == [False, False]


def test_when_the_bridge_is_killed_the_boards_switch_off_and_the_next_knows_their_heat(
    start_spi_bridge: Callable[..., NodeProcess], boards: SpiBoards, tmp_path: Path, ros_node: Node
) -> None:
    file = tmp_path / 'state.json'
    bridge = start_spi_bridge(state_file=file)
    client = BridgeClient(ros_node, 'hardware_bridge')
    client.make_ready()
    client.wait_for(file.exists)
    assert [board['enabled'] for board in boards.report()] == [True, True]
    os.kill(bridge.pid, signal.SIGKILL)
    assert bridge.wait(60.0) == -signal.SIGKILL
    assert [(board['enabled'], board['error']) for board in boards.report()] == [(True, 0)] * 2
    boards.let_pass(0.9 * BOARD_TIMEOUT)
    assert [board['enabled'] for board in boards.report()] == [True, True]
    boards.let_pass(0.2 * BOARD_TIMEOUT)
    # Error 2 is the SPI receive time-out.
    assert [(board['enabled'], board['error']) for board in boards.report()] == [(False, 2)] * 2

    kept = json.loads(json.loads(file.read_text())['kept'])
    kept['heat'] |= {'windings': [108.0] * 4, 'housings': [95.0] * 4}
    file.write_text(sealed(json.dumps(kept)))
    for number in (0, 1):
        boards.inject(f'power_cycle:{number}')
    client.modes.clear()
    start_spi_bridge(state_file=file)
    client.wait_for_mode('idle')
    assert 'has cooled to' in client.call('enable').message
