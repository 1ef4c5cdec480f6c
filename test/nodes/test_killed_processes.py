"""After a kill, a stop or the loss of its device, the arm comes to rest with boards off."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
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
def spi_bridge(
    boards: SpiBoards, ros_domain: dict[str, str], tmp_path: Path
) -> Iterator[NodeProcess]:
    document = yaml.safe_load(resource('config', 'aerarm.yaml').read_text())
    for board in document['boards']:
        board['encoders'] = 'absolute'
    config = tmp_path / 'absolute.yaml'
    config.write_text(yaml.safe_dump(document))
    parameters = {**UNHURRIED, 'config': config}
    with NodeProcess(
        'hardware_bridge', (), parameters, boards.environment, tmp_path / 'log'
    ) as process:
        yield process


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


def test_the_real_bridge_over_spidev_until_a_device_vanishes(
    spi_bridge: NodeProcess, boards: SpiBoards, ros_node: Node
) -> None:
    client = BridgeClient(ros_node, 'hardware_bridge')
    client.make_ready()
    assert 'board1 on /dev/spidev0.1 at 8 MHz, mode 0: 50 of 50 answers' in spi_bridge.tail(50)
    assert [board['enabled'] for board in boards.report()] == [True, True]
    client.answer = lambda state: velocity_command(state, [0.4, 0.0, 0.4, 0.4])
    client.wait_for(lambda: client.states[-1].velocity[0] > 0.3)
    boards.vanish('/dev/spidev0.1')
    client.wait_for_mode('fault')
    client.wait_for(
        lambda: '/dev/spidev0.1 reports an error (Cannot send' in client.messages['arm']
    )
    client.wait_for(lambda: max(np.abs(client.states[-1].velocity[:2])) < 0.05)
    assert spi_bridge.stop(signal.SIGTERM) == 0
    told = boards.report()[0]
    assert (told['enabled'], told['error']) == (False, 0)
    boards.let_pass(BOARD_TIMEOUT)  # for the one that nobody reaches any more
    assert [board['enabled'] for board in boards.report()] == [False, False]


def test_a_device_that_comes_back_is_off_until_enabled_and_sigquit_switches_off(
    spi_bridge: NodeProcess, boards: SpiBoards, ros_node: Node
) -> None:
    client = BridgeClient(ros_node, 'hardware_bridge')
    client.wait_for_mode('idle')
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
    assert spi_bridge.stop(signal.SIGQUIT) == 0
    # Their time stands still without frames, so no time-out did this.
    last = boards.report()
    assert [(board['told_on'], board['enabled'], board['error']) for board in last] == [
        (False, False, 0)
    ] * 2
    assert [(board['gains'], board['current']) for board in last] == [(0.0, 0.0)] * 2


def test_when_the_bridge_is_killed_the_boards_switch_off(
    spi_bridge: NodeProcess, boards: SpiBoards, ros_node: Node
) -> None:
    client = BridgeClient(ros_node, 'hardware_bridge')
    client.make_ready()
    assert [board['enabled'] for board in boards.report()] == [True, True]
    os.kill(spi_bridge.pid, signal.SIGKILL)
    assert spi_bridge.wait(60.0) == -signal.SIGKILL
    assert [(board['enabled'], board['error']) for board in boards.report()] == [(True, 0)] * 2
    boards.let_pass(0.9 * BOARD_TIMEOUT)
    assert [board['enabled'] for board in boards.report()] == [True, True]
    boards.let_pass(0.2 * BOARD_TIMEOUT)
    # Error 2 is the SPI receive time-out.
    assert [(board['enabled'], board['error']) for board in boards.report()] == [(False, 2)] * 2


def test_a_bridge_that_is_restarted_knows_how_warm_the_motors_are(
    boards: SpiBoards, ros_domain: dict[str, str], tmp_path: Path, ros_node: Node
) -> None:
    file = tmp_path / 'state.json'
    parameters = {**UNHURRIED, 'state_file': file}

    def bridge(log: str) -> NodeProcess:
        return NodeProcess('hardware_bridge', (), parameters, boards.environment, tmp_path / log)

    client = BridgeClient(ros_node, 'hardware_bridge')
    with bridge('first') as process:
        client.wait_for_mode('unhomed')
        assert process.stop(signal.SIGTERM) == 0
    kept = json.loads(json.loads(file.read_text())['kept'])
    kept['heat'] |= {'windings': [108.0] * 4, 'housings': [95.0] * 4}
    file.write_text(sealed(json.dumps(kept)))
    with bridge('second'):
        client.wait_for_mode('unhomed')
        assert 'has cooled to' in client.call('home').message
