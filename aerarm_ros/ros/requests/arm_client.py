"""Client for the services of the running bridge, used by commands and nodes."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator, Sequence
from math import inf
from types import SimpleNamespace

from rclpy.node import Node
from std_msgs.msg import String

from aerarm_msgs_py import topics
from aerarm_ros.hardware.bridge_modes import ACTIONS, BRIDGES, NOT_ACTIVE, STOPS
from aerarm_ros.ros.executors import spin_until, this_domain
from aerarm_ros.ros.parameters.parameter import Parameter, grouped
from aerarm_ros.ros.requests.bridge_service import (
    BridgeFinder,
    BridgeService,
    StopRequest,
    bridges_among,
    no_bridge,
    offered_actions,
)

_DISCOVERY_TIME = 0.5  # [s]
# [s] for which discovery still lists a killed node, with the packaged profile
_LISTED_AFTER_DEATH = 6.0
_QUIET = 0.5  # [s] of waiting without a message to the user


class ArmClientError(RuntimeError):
    """Error for a request to a node that was not found, did not answer or rejected the request.

    The error's message names the node and states what to check.
    """


class ArmClient:
    """Call the services of the running bridge, and subscribe to the arm's mode.

    The methods spin the node, so no executor may contain it. The constructor creates the service
    clients, because an answer is lost if the bridge has not yet discovered the client.

    Parameters
    ----------
    node
        Owner of clients and subscription.
    bridges
        Possible node names of the bridge, by default `BRIDGES`. Without this argument a stop
        request also goes to bridges with other names.
    actions
        Names of the actions that will be called.
    on_wait
        Called with a description of the awaited node if the client has waited for half a second.
    everywhere
        Whether a stop request goes to the bridges of all namespaces.

    Attributes
    ----------
    mode
        Newest `arm_mode`, '' before the first message.
    """

    def __init__(
        self,
        node: Node,
        bridges: Sequence[str] = (),
        actions: Collection[str] = ACTIONS,
        on_wait: Callable[[str], None] = lambda _: None,
        everywhere: bool = False,
    ) -> None:
        self.mode = ''
        self._node = node
        self._on_wait = on_wait
        self._begin = time.monotonic()
        names = bridges or BRIDGES
        self._finders = {
            action: BridgeFinder(node, action, names, only=bool(bridges), everywhere=everywhere)
            for action in actions
            if action in STOPS
        }
        self._services = {
            action: BridgeService(node, action, names, spins=True)
            for action in actions
            if action not in STOPS
        }
        topic = topics.ARM_MODE
        # A bridge in another namespace publishes its mode there.
        namespace, slash, _ = names[0].rpartition('/') if len(names) == 1 else ('', '', '')
        name = f'{namespace}{slash}{topic.name}'
        node.create_subscription(topic.type, name, self._on_mode, topic.qos)

    def call(self, action: str, timeout: float = 10.0) -> str:
        """Call a service of the bridge and return the text of its answer.

        If several bridges run, a stop request goes to all of them; any other request raises an
        error.

        Parameters
        ----------
        action
            One of the actions given to the constructor.
        timeout
            Longest time to find the bridge, and again to wait for its answer [s].

        Raises
        ------
        ArmClientError
            If no bridge runs, or the bridge does not answer or rejects the request.
        """
        if action in STOPS:
            return '; '.join(self.stop(action, timeout))
        service = self._services[action]
        if self._find(lambda: service.found, timeout):
            # Discovery may still find another bridge.
            left = self._begin + _DISCOVERY_TIME - time.monotonic()
            spin_until(self._node, lambda: False, left)
        else:
            others = ' and '.join(bridges_among(offered_actions(self._node)))
            hint = f'. Found the bridges {others}: select one with --bridge NAME' if others else ''
            raise ArmClientError(f'{service.problem([])}{hint}')
        if service.problem(service.found):
            # Several bridges would all run the request, but a killed one stays listed for a while.
            if service.found:
                self._on_wait('all but one of the bridges to end')
            left = min(timeout, _LISTED_AFTER_DEATH)
            spin_until(self._node, lambda: not service.problem(service.found), left)
        answer = service.call(timeout)
        if not answer.accepted:
            raise ArmClientError(f'{action} failed: {answer.message}')
        return answer.message

    def stop(self, action: str, timeout: float = 10.0) -> Iterator[str]:
        """Send a stop request to every bridge, and yield each answer as soon as it arrives.

        Parameters
        ----------
        action
            One of `STOPS` that was given to the constructor.
        timeout
            Longest time to find bridges, and again for the answer of each bridge [s].

        Raises
        ------
        ArmClientError
            Raised after the last answer, if no bridge runs, or a bridge does not answer or
            rejects the request.
        """
        request = StopRequest(self._node, self._finders[action], timeout)
        self._find(lambda: request.poll() or request.has_found, timeout)
        reported: set[str] = set()
        while not request.is_over:
            spin_until(self._node, lambda: request.poll() or request.answers.keys() - reported, inf)
            for name in sorted(request.answers.keys() - reported):
                reported.add(name)
                if request.answers[name].accepted:
                    yield f'{name}: {request.answers[name].message}'
        if not request.answers:
            raise ArmClientError(no_bridge(action))
        failed = [f'{n}: {text}' for n, (done, text) in sorted(request.answers.items()) if not done]
        if failed:
            raise ArmClientError(f'the request {action} is NOT confirmed: {"; ".join(failed)}')

    def wait_for_mode(self, modes: Collection[str], timeout: float) -> None:
        """Wait until the newest message on the topic `arm_mode` is one of `modes`.

        Raises
        ------
        ArmClientError
            If the arm reaches none of these modes within `timeout` [s].
        """
        deadline = time.monotonic() + timeout
        self._find(lambda: self.mode, timeout)
        left = deadline - time.monotonic()
        if not spin_until(self._node, lambda: self.mode in modes, left):
            seen = f'no arm_mode received: check that a bridge runs in {this_domain()}'
            if self.mode:
                seen = f"arm_mode is '{self.mode}': check the log of the bridge"
            wanted = ' or '.join(modes)
            raise ArmClientError(f'waited {timeout:g} s for the arm_mode {wanted}, but {seen}')

    def _find(self, condition: Callable[[], object], timeout: float) -> bool:
        """Wait for a bridge until `condition` returns true; return False after `timeout` [s]."""
        if spin_until(self._node, condition, min(timeout, _QUIET)):
            return True
        if timeout <= _QUIET:
            return False
        self._on_wait(f'a bridge in {this_domain()}')
        return spin_until(self._node, condition, timeout - _QUIET)

    def _on_mode(self, message: String) -> None:
        self.mode = message.data


HOLD, RELEASE = 'hold', 'release'

BRIDGES_PARAMETER = Parameter(
    'bridges', list(BRIDGES), 'possible names of the bridge node to which this node sends requests'
)

AT_END_PARAMETERS = grouped(
    'At the end',
    Parameter(
        'at_end',
        HOLD,
        "action when this node ends: 'hold' (the bridge holds the arm in place) or 'release' "
        '(the bridge damps the arm, which sinks until it is enabled)',
        choices=(HOLD, RELEASE),
    ),
    BRIDGES_PARAMETER,
)


class ArmAtEnd:
    """Call the bridge's service `hold` when a node ends whose parameter `at_end` is 'hold'.

    A killed node sends no request, so the bridge damps the arm.

    Parameters
    ----------
    node
        Node that an executor spins in another thread.
    values
        Values of `AT_END_PARAMETERS`.
    """

    def __init__(self, node: Node, values: SimpleNamespace) -> None:
        self._node = node
        # Created early: an answer is lost if the bridge has not yet discovered the client.
        self._hold = BridgeService(node, 'hold', values.bridges) if values.at_end == HOLD else None

    def leave(self) -> None:
        """Call the bridge's service `hold`, and wait for the answer."""
        if self._hold is None or not self._hold.found:
            return
        done, text = self._hold.call()
        log = self._node.get_logger()
        # rclpy fixes the severity of each line of code that logs.
        if done:
            log.info(f'at the end of this node: {text}')
        # A bridge that ends at the same time cannot hold the arm.
        elif self._hold.found and not text.endswith(NOT_ACTIVE):
            log.warning(f'the bridge does not hold the arm at the end of this node: {text}')
