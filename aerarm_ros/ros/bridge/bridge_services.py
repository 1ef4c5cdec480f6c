"""The bridge's services: a person's hand on the arm."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from typing import TYPE_CHECKING

from rclpy.node import Node
from std_srvs.srv import Trigger

from aerarm_ros.hardware.bridge_modes import Answer

if TYPE_CHECKING:  # who only asks loads no bridge
    from aerarm_ros.hardware.bridge_cycle import BridgeCycle

Action = Callable[['BridgeCycle'], Answer]

_ANSWER_TIMEOUT = 1.0  # [s]
_NOT_ACTIVE = 'the bridge is not active: activate it first (ros2 lifecycle set)'


class NotActiveError(RuntimeError):
    """No cycle is running: the bridge was not activated, or is ending."""


def says_not_active(text: str) -> bool:
    """Tell whether the answer of a bridge's service says that no cycle is running."""
    return text.endswith(_NOT_ACTIVE)


class CycleRequests:
    """Queue of actions that are run between two cycles, so that none needs a lock."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[Action, Future[Answer]]] = deque()
        self._closed = threading.Event()
        self._closed.set()

    def ask(self, action: Action, insist: bool = False) -> Answer:
        """Let the cycle's thread do something and return its answer.

        Who was told that nothing happened must not be surprised later: after the time-out the
        action is not run any more, unless to `insist` is safer, as to stop the arm.

        Raises
        ------
        NotActiveError
            If no cycle is running.
        TimeoutError
            If it does not come to it within a second.
        """
        if self._closed.is_set():
            raise NotActiveError(_NOT_ACTIVE)
        answer = self._put(action)
        try:
            return answer.result(_ANSWER_TIMEOUT)
        except TimeoutError:
            if not insist:
                answer.cancel()
            raise

    def post(self, action: Action) -> None:
        """Let the cycle's thread do something soon, if a cycle is running."""
        if self.is_open:
            self._put(action)

    def serve(self, cycle: BridgeCycle) -> None:
        """Do what is asked; what an action raises goes to who asked."""
        while self._waiting:
            action, answer = self._waiting.popleft()
            if not answer.set_running_or_notify_cancel():
                continue
            try:
                answer.set_result(action(cycle))
            except ValueError as error:
                answer.set_exception(error)

    def open(self) -> None:
        """Take requests: a cycle will run from now on."""
        self._waiting.clear()
        self._closed.clear()

    def close(self) -> None:
        """Take no more: the last cycle has run."""
        self._closed.set()

    def wait_closed(self, timeout: float) -> bool:
        """Wait up to `timeout` [s]; return whether no cycle runs any more."""
        return self._closed.wait(timeout)

    @property
    def is_open(self) -> bool:
        """Whether a cycle runs."""
        return not self._closed.is_set()

    @property
    def are_waiting(self) -> bool:
        """Whether there is something to serve."""
        return bool(self._waiting)

    def _put(self, action: Action) -> Future[Answer]:
        answer: Future[Answer] = Future()
        self._waiting.append((action, answer))
        return answer


ACTIONS: dict[str, Action] = {
    'enable': lambda cycle: cycle.enable(),
    'hold': lambda cycle: cycle.hold(),
    'disable': lambda cycle: cycle.disable(),
    'clear_fault': lambda cycle: cycle.clear_fault(),
    'home': lambda cycle: cycle.home(),
    'e_stop': lambda cycle: cycle.e_stop('service e_stop'),
}
# What is done even if it comes late.
STOPS = {'disable', 'e_stop'}
# Where no arm has the namespace of whoever asks, this goes to every arm: to damp one too many is
# safe, to miss one is not.
REACHES_ALL = {'e_stop'}


class BridgeServices:
    """One `std_srvs/Trigger` service an action, `~/enable`, `~/disable` and so on.

    Parameters
    ----------
    node
        Owner of the services.
    ask
        Runs an action in the cycle's thread, as `CycleRequests.ask` does.
    actions
        What there is, by name.
    """

    def __init__(
        self, node: Node, ask: Callable[[Action, bool], Answer], actions: Mapping[str, Action]
    ) -> None:
        self._node = node
        self._ask = ask
        for name, action in actions.items():
            node.create_service(Trigger, f'~/{name}', self._handler(name, action))

    def _twin(self) -> str:
        """Return what to do about another node of the bridge's name, or ''.

        A request goes to both, and the client takes the first answer.
        """
        name, namespace = self._node.get_name(), self._node.get_namespace()
        if self._node.get_node_names_and_namespaces().count((name, namespace)) < 2:
            return ''
        return (
            f'two nodes have the name {self._node.get_fully_qualified_name()}: end one of them, '
            'or start it with -r __node:=NAME. ROS lists a killed node for some more seconds'
        )

    def _handler(
        self, name: str, action: Action
    ) -> Callable[[Trigger.Request, Trigger.Response], Trigger.Response]:
        def handle(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            log = self._node.get_logger()
            try:
                if name not in STOPS and (twin := self._twin()):
                    raise ValueError(twin)
                answer = self._ask(action, name in STOPS)
            except NotActiveError as error:
                # So are all asked that a controller sends while both end: nothing to warn of.
                log.info(f'{name}: {error}')
                response.success, response.message = False, str(error)
                return response
            except (RuntimeError, ValueError) as error:
                answer = Answer(False, str(error))
            except TimeoutError:
                answer = Answer(
                    False,
                    'the control cycle did not respond: check the log of the bridge, or '
                    'the page of view',
                )
            response.success, response.message = answer.accepted, answer.message
            # rclpy ties a severity to the line that logs.
            if answer.accepted:
                log.info(f'{name}: {answer.message}')
            else:
                log.warning(f'{name}: {answer.message}')
            return response

        return handle
