"""A node that moved the arm requests holding at its end, and logs the result."""

from types import SimpleNamespace

import pytest
from answering_bridges import LIMIT, until_offered
from rclpy.node import Node
from std_srvs.srv import Trigger

from aerarm_ros.ros.bridge.bridge_services import CycleRequests, NotActiveError
from aerarm_ros.ros.executors import BackgroundExecutor
from aerarm_ros.ros.requests.arm_client import HOLD, ArmAtEnd

NOT_HELD = 'the bridge does not hold the arm at the end of this node'


def not_active() -> str:
    """Return what a bridge answers while no cycle is running."""
    with pytest.raises(NotActiveError) as caught:
        CycleRequests().ask(lambda cycle: pytest.fail('no cycle is running'))
    return str(caught.value)


@pytest.mark.parametrize(
    ('held', 'text', 'logged'),
    [
        (True, 'the arm is held', [('info', 'at the end of this node: bridge: the arm is held')]),
        (False, f'hold: {not_active()}', []),
        (False, 'a fault', [('warning', f'{NOT_HELD}: bridge: a fault')]),
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
