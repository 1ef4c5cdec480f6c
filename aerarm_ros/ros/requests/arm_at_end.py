"""What becomes of the arm when a node that moves it ends."""

from __future__ import annotations

from types import SimpleNamespace

from rclpy.node import Node

from aerarm_ros.ros.bridge.cycle_requests import says_not_active
from aerarm_ros.ros.parameters.parameter import Parameter, grouped
from aerarm_ros.ros.requests.arm_client import BRIDGES
from aerarm_ros.ros.requests.bridge_service import BridgeService

HOLD, RELEASE = 'hold', 'release'

BRIDGES_PARAMETER = Parameter('bridges', list(BRIDGES), 'node names of the bridges to ask')

AT_END_PARAMETERS = grouped(
    'At the end',
    Parameter(
        'at_end',
        HOLD,
        "what becomes of the arm when this node ends: 'hold', the bridge holds it where it is, or "
        "'release', it is damped and sinks until it is enabled",
        choices=(HOLD, RELEASE),
    ),
    BRIDGES_PARAMETER,
)


class ArmAtEnd:
    """Asks the bridge to hold the arm, if that is wanted.

    A node that dies asks for nothing, so that its arm is damped.

    Parameters
    ----------
    node
        An executor must spin it in another thread.
    values
        Of `AT_END_PARAMETERS`.
    """

    def __init__(self, node: Node, values: SimpleNamespace) -> None:
        self._node = node
        # Made early: the answer to a client that the bridge has not discovered yet is lost.
        self._hold = BridgeService(node, 'hold', values.bridges) if values.at_end == HOLD else None

    def leave(self) -> None:
        """Leave an arm that is commanded no more; blocks until the bridge has answered."""
        if self._hold is None or not self._hold.found:
            return
        done, text = self._hold.call()
        log = self._node.get_logger()
        # rclpy ties a severity to the line that logs.
        if done:
            log.info(f'at the end {text}')
        # A bridge that ends as well holds nothing any more.
        elif self._hold.found and not says_not_active(text):
            log.warning(f'the arm is not held at the end: {text}')
