"""Services of the bridge that enable, home, hold and stop the arm."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from typing import TYPE_CHECKING

from rclpy.node import Node
from std_srvs.srv import Trigger

from aerarm_ros.hardware.bridge_modes import NOT_ACTIVE, STOPS, Action, Answer

if TYPE_CHECKING:  # Clients of the services load no bridge.
    from aerarm_ros.hardware.bridge_cycle import BridgeCycle

_ANSWER_TIMEOUT = 1.0  # [s]


class NotActiveError(RuntimeError):
    """The bridge's cycle is not running, because the bridge is not active yet or is ending."""


class CycleRequests:
    """Queue of requested actions that run between two cycles of the bridge.

    The cycle's thread runs them, so they need no lock.
    """

    def __init__(self) -> None:
        self._waiting: deque[tuple[Action, Future[Answer]]] = deque()
        self._closed = threading.Event()
        self._closed.set()

    def ask(self, action: Action, insist: bool = False) -> Answer:
        """Let the cycle's thread run an action, and return the answer of the action.

        After a time-out the action does not run, because its client has already received an error.
        With `insist` the action runs late, which is safer for a stop of the arm.

        Raises
        ------
        NotActiveError
            If the bridge's cycle is not running.
        TimeoutError
            If the action does not run within one second.
        """
        if self._closed.is_set():
            raise NotActiveError(NOT_ACTIVE)
        answer = self._put(action)
        try:
            return answer.result(_ANSWER_TIMEOUT)
        except TimeoutError:
            if not insist:
                answer.cancel()
            raise

    def post(self, action: Action) -> None:
        """Queue an action for the cycle's thread without waiting, if the cycle is running."""
        if self.is_open:
            self._put(action)

    def serve(self, cycle: BridgeCycle) -> None:
        """Run the queued actions; called from the cycle's thread."""
        while self._waiting:
            action, answer = self._waiting.popleft()
            if not answer.set_running_or_notify_cancel():
                continue
            try:
                answer.set_result(action(cycle))
            except ValueError as error:
                answer.set_exception(error)

    def open(self) -> None:
        """Accept requests from now on, because the cycle is running."""
        self._waiting.clear()
        self._closed.clear()

    def close(self) -> None:
        """Reject requests from now on, because the cycle has ended."""
        self._closed.set()

    def wait_closed(self, timeout: float) -> bool:
        """Wait up to `timeout` [s] for the end of the cycle; return whether it has ended."""
        return self._closed.wait(timeout)

    @property
    def is_open(self) -> bool:
        """Whether the bridge's cycle is running."""
        return not self._closed.is_set()

    @property
    def are_waiting(self) -> bool:
        """Whether actions are queued for the cycle's thread."""
        return bool(self._waiting)

    def _put(self, action: Action) -> Future[Answer]:
        answer: Future[Answer] = Future()
        self._waiting.append((action, answer))
        return answer


class BridgeServices:
    """Offer one `std_srvs/Trigger` service per action of the bridge, such as `~/enable`.

    Parameters
    ----------
    node
        Owner of the services.
    ask
        Runs an action in the cycle's thread, as `CycleRequests.ask` does.
    actions
        Actions by name of the service.
    """

    def __init__(
        self, node: Node, ask: Callable[[Action, bool], Answer], actions: Mapping[str, Action]
    ) -> None:
        self._node = node
        self._ask = ask
        for name, action in actions.items():
            node.create_service(Trigger, f'~/{name}', self._handler(name, action))

    def _same_name_problem(self) -> str:
        """Return a message if another node has the name of this bridge, else an empty string.

        A service request would reach both nodes, and the client would receive only one answer.
        """
        name, namespace = self._node.get_name(), self._node.get_namespace()
        if self._node.get_node_names_and_namespaces().count((name, namespace)) < 2:
            return ''
        return (
            f'two nodes have the name {self._node.get_fully_qualified_name()}: end one of '
            'them, or restart it with another name (-r __node:=NAME). If you have just killed one '
            'of them, wait some seconds'
        )

    def _handler(
        self, name: str, action: Action
    ) -> Callable[[Trigger.Request, Trigger.Response], Trigger.Response]:
        def handle(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            log, is_active = self._node.get_logger(), True
            try:
                if name not in STOPS and (problem := self._same_name_problem()):
                    raise ValueError(problem)
                answer = self._ask(action, name in STOPS)
            except (RuntimeError, ValueError) as error:
                answer, is_active = Answer(False, str(error)), not isinstance(error, NotActiveError)
            except TimeoutError:
                answer = Answer(
                    False,
                    f"the bridge's cycle did not respond within {_ANSWER_TIMEOUT:g} s: check the "
                    'log of the bridge',
                )
            response.success, response.message = answer.accepted, answer.message
            # rclpy fixes the severity of each line of code that logs. A controller that ends
            # together with the bridge also calls this service, so do not warn.
            if answer.accepted or not is_active:
                log.info(f'{name}: {answer.message}')
            else:
                log.warning(f'{name}: {answer.message}')
            return response

        return handle
