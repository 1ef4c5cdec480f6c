"""Messages on the bridge's console."""

import re

from bridge_client import BridgeClient, StartBridge

from aerarm_ros.ros.process.node_process import NodeProcess


def modes(log: str) -> list[str]:
    """Return severity and mode of the lines about modes."""
    found = re.findall(r'\[(\w+)\] \[[\d.]+\] \[\w+\]: (idle|aligning|ready|fault|disc\w+)', log)
    return [f'{severity} {mode}' for severity, mode in found]


def test_modes_and_faults_are_logged_with_the_recovery_hint(
    client: BridgeClient, bridge: NodeProcess
) -> None:
    client.make_ready()
    assert client.call('e_stop').success
    client.wait_for(lambda: 'ERROR' in bridge.tail(50))
    log = bridge.tail(50)
    assert modes(log) == ['INFO idle', 'INFO aligning', 'INFO ready', 'ERROR fault']
    assert "fault: emergency stop: service e_stop. To recover: 'arm clear_fault'" in log
    assert client.call('clear_fault').success
    client.wait_for(lambda: modes(bridge.tail(50))[-1] == 'INFO ready')


def test_boards_that_do_not_answer_are_named_once(start_bridge: StartBridge, ros_node) -> None:
    bridge = start_bridge(fault='dead_board:0')
    client = BridgeClient(ros_node)
    client.wait_for(lambda: 'WARN disconnected' in modes(bridge.tail(50)))
    assert modes(bridge.tail(50)).count('WARN disconnected') == 1
    assert 'no answer from board0: check supply' in bridge.tail(50)
