"""Services of the bridge with which a person or a node enables and stops the arm."""

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
    """No cycle is running: the bridge has not been activated, or it is ending."""


class CycleRequests:
    """Queue of actions that run between two cycles, so that they need no lock."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[Action, Future[Answer]]] = deque()
        self._closed = threading.Event()
        self._closed.set()

    def ask(self, action: Action, insist: bool = False) -> Answer:
        """Run an action in the cycle's thread and return its answer.

        After a time-out the action does not run, because its client has already received an error.
        With `insist` the action runs late, which is safer for a stop of the arm.

        Raises
        ------
        NotActiveError
            If no cycle is running.
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
        """Queue an action for the cycle's thread, if a cycle is running."""
        if self.is_open:
            self._put(action)

    def serve(self, cycle: BridgeCycle) -> None:
        """Run the queued actions and pass their exceptions to the callers."""
        while self._waiting:
            action, answer = self._waiting.popleft()
            if not answer.set_running_or_notify_cancel():
                continue
            try:
                answer.set_result(action(cycle))
            except ValueError as error:
                answer.set_exception(error)

    def open(self) -> None:
        """Accept requests from now on, because a cycle runs."""
        self._waiting.clear()
        self._closed.clear()

    def close(self) -> None:
        """Reject requests from now on, because the last cycle has run."""
        self._closed.set()

    def wait_closed(self, timeout: float) -> bool:
        """Wait up to `timeout` [s]; return whether the last cycle has ended."""
        return self._closed.wait(timeout)

    @property
    def is_open(self) -> bool:
        """Whether a cycle is running."""
        return not self._closed.is_set()

    @property
    def are_waiting(self) -> bool:
        """Whether actions wait for the cycle's thread."""
        return bool(self._waiting)

    def _put(self, action: Action) -> Future[Answer]:
        answer: Future[Answer] = Future()
        self._waiting.append((action, answer))
        return answer


class BridgeServices:
    """One `std_srvs/Trigger` service per action: `~/enable`, `~/disable` and so on.

    Parameters
    ----------
    node
        Owner of the services.
    ask
        Runs an action in the cycle's thread, like `CycleRequests.ask`.
    actions
        The actions, by name.
    """

    def __init__(
        self, node: Node, ask: Callable[[Action, bool], Answer], actions: Mapping[str, Action]
    ) -> None:
        self._node = node
        self._ask = ask
        for name, action in actions.items():
            node.create_service(Trigger, f'~/{name}', self._handler(name, action))

    def _twin(self) -> str:
        """Return a recovery hint if another node has the bridge's name, else an empty text.

        If two nodes share the name, a request reaches both, and the client accepts the first
        answer.
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
                # A controller that ends together with the bridge also calls this service, so do
                # not warn.
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
            # rclpy fixes the severity of each line of code that logs.
            if answer.accepted:
                log.info(f'{name}: {answer.message}')
            else:
                log.warning(f'{name}: {answer.message}')
            return response

        return handle
