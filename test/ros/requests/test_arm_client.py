"""Client of the bridge's services in a node that no executor spins."""

from types import SimpleNamespace

import pytest
from answering_bridges import LIMIT, AnsweringBridges, quick_search, until_offered
from rclpy.node import Node
from std_srvs.srv import Trigger

from aerarm_ros.hardware.bridge_modes import ACTIONS
from aerarm_ros.ros.bridge.bridge_services import CycleRequests, NotActiveError
from aerarm_ros.ros.executors import BackgroundExecutor
from aerarm_ros.ros.requests.arm_client import HOLD, ArmAtEnd, ArmClient, ArmClientError

__all__ = ['quick_search']
pytestmark = pytest.mark.usefixtures('quick_search')


def test_with_two_bridges_only_stop_requests_go_to_both(ros_node: Node) -> None:
    client, bridges = ArmClient(ros_node), AnsweringBridges()
    names = ['fake_hardware', 'hardware_bridge']
    for name in names:
        bridges.add(name, ACTIONS)
        for action in ACTIONS:
            until_offered(ros_node, f'{name}/{action}')
    with BackgroundExecutor(bridges.node):
        several = 'found the bridges hardware_bridge and fake_hardware: stop all bridges but one'
        with pytest.raises(ArmClientError, match=several):
            client.call('clear_fault', 0.5)
        assert bridges.asked == []
        told = client.call('e_stop', LIMIT).split('; ')
    assert sorted(told) == [f'/{name}: done' for name in names]
    assert sorted(bridges.asked) == names


def test_two_bridges_of_one_name_are_reported_and_not_enabled(ros_node: Node) -> None:
    client, twins = ArmClient(ros_node), [AnsweringBridges(), AnsweringBridges()]
    for twin in twins:
        twin.add('fake_hardware', ACTIONS)
    until_offered(ros_node, 'fake_hardware/enable', 2)
    until_offered(ros_node, 'fake_hardware/e_stop', 2)
    problem = 'found 2 nodes named /fake_hardware: stop all but one'
    with BackgroundExecutor(twins[0].node), BackgroundExecutor(twins[1].node):
        with pytest.raises(ArmClientError, match=problem):
            client.call('enable', 0.5)
        assert [twin.asked for twin in twins] == [[], []]
        # Both are stopped, but only one can be heard.
        with pytest.raises(ArmClientError, match=problem):
            client.call('e_stop', LIMIT)
    assert all('fake_hardware' in twin.asked for twin in twins)


NOT_HELD = 'the bridge does not hold the arm at the end of this node'


def not_active() -> str:
    """Return what a bridge answers while no cycle is running."""
    with pytest.raises(NotActiveError) as caught:
        CycleRequests().ask(lambda cycle: pytest.fail('no cycle is running'))
    return str(caught.value)


@pytest.mark.parametrize(
    ('held', 'text', 'logged'),
    [
        (True, 'the arm is held', [('info', 'at the end of this node: the arm is held')]),
        (False, f'hold: {not_active()}', []),
        (False, 'a fault', [('warning', f'{NOT_HELD}: a fault')]),
    ],
)
def test_only_a_running_bridge_that_does_not_hold_causes_a_warning(
    held: bool,
    text: str,
    logged: list[tuple[str, str]],
    ros_node: Node,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found: list[tuple[str, str]] = []
    log = ros_node.get_logger()
    monkeypatch.setattr(log, 'info', lambda text: found.append(('info', text)))
    monkeypatch.setattr(log, 'warning', lambda text: found.append(('warning', text)))

    def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = held, text
        return response

    ros_node.create_service(Trigger, 'bridge/hold', answer)
    end = ArmAtEnd(ros_node, SimpleNamespace(at_end=HOLD, bridges=['bridge']))
    until_offered(ros_node, 'bridge/hold')
    assert end._hold is not None
    assert end._hold._clients['bridge'].wait_for_service(LIMIT)
    with BackgroundExecutor(ros_node):
        end.leave()
    assert found == logged
