"""What a person asks of the bridge, from another process."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator, Sequence
from math import inf
from types import SimpleNamespace

from rclpy.client import Client
from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import Trigger

from aerarm_msgs_py import topics
from aerarm_ros.ros.bridge.bridge_services import ACTIONS, STOPS, says_not_active
from aerarm_ros.ros.executors import spin_until, this_domain
from aerarm_ros.ros.parameters.parameter_table import Parameter, grouped
from aerarm_ros.ros.requests.bridge_service import (
    BridgeFinder,
    BridgeService,
    ServiceCall,
    StopRequest,
    bridges_among,
    offered_actions,
    same_name_problem,
)

BRIDGES = ('hardware_bridge', 'fake_hardware')
_DISCOVERY_TIME = 0.5  # [s]
_SEEN_AFTER_DEATH = 6.0  # [s] for which others see a killed node, with the packaged profile
_QUIET = 1.0  # [s] in which who waits need not be told what for


class ArmClientError(RuntimeError):
    """A node is absent, silent or refuses; the message says which and what to check."""


class ArmClient:
    """Calls the services of the bridge that is there and follows the arm's mode.

    Its methods spin the node themselves: no executor may hold it. The service clients are made
    at once: an answer to a client that the bridge has not discovered yet is lost.

    Parameters
    ----------
    node
        Owner of clients and subscription.
    bridges
        Node names the bridge may have, by default those of `BRIDGES`. What stops an arm finds all
        other bridges too, unless names are given.
    actions
        Those that will be called.
    on_wait
        Told what is waited for, if there is no bridge for a second.
    everywhere
        Whether what stops an arm goes to the bridges of all namespaces.

    Attributes
    ----------
    mode
        Last `arm_mode`, '' before the first.
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
        self._clients = {
            action: [node.create_client(Trigger, f'{bridge}/{action}') for bridge in names]
            for action in actions
            if action not in STOPS
        }
        topic = topics.ARM_MODE
        # A bridge of another namespace tells its mode there.
        namespace, slash, _ = names[0].rpartition('/') if len(names) == 1 else ('', '', '')
        self._subscription = node.create_subscription(
            topic.type, f'{namespace}{slash}{topic.name}', self._on_mode, topic.qos
        )

    def call(self, action: str, timeout: float = 10.0) -> str:
        """Call a service of the bridge and return what it says.

        With several bridges, what stops an arm goes to all of them, and nothing else to any.

        Parameters
        ----------
        action
            One of those given at the start.
        timeout
            Longest time to find the bridge, and again for its answer [s].

        Raises
        ------
        ArmClientError
            If there is no bridge, or it does not answer, or refuses.
        """
        if action in STOPS:
            return '; '.join(self.stop(action, timeout))
        client = self._one_client(self._clients[action], timeout)
        call = ServiceCall(client, timeout)
        spin_until(self._node, call.poll, inf)
        answer = call.poll()
        assert answer is not None
        if not answer.accepted:
            who = f'{action} rejected' if call.is_answered else client.srv_name
            raise ArmClientError(f'{who}: {answer.message}')
        return answer.message

    def stop(self, action: str, timeout: float = 10.0) -> Iterator[str]:
        """Stop the arm of every bridge; yield what each says as soon as it does.

        Parameters
        ----------
        action
            One of `STOPS` that was given at the start.
        timeout
            Longest time to find bridges, and again for the answer of each [s].

        Raises
        ------
        ArmClientError
            In the end, if there is no bridge, or one does not answer, or refuses.
        """
        request = StopRequest(self._node, self._finders[action], timeout)
        self._find(lambda: request.poll() or request.has_found, timeout)
        told: set[str] = set()
        while not request.is_over:
            spin_until(self._node, lambda: request.poll() or request.answers.keys() - told, inf)
            for name in sorted(request.answers.keys() - told):
                told.add(name)
                if request.answers[name].accepted:
                    yield f'{name}: {request.answers[name].message}'
        if not request.answers:
            raise ArmClientError(
                f'no bridge offers {action}: check that one runs in {this_domain()}'
            )
        failed = [f'{n}: {text}' for n, (done, text) in sorted(request.answers.items()) if not done]
        if failed:
            raise ArmClientError(f'{action} is NOT confirmed: {"; ".join(failed)}')

    def wait_for_mode(self, modes: Collection[str], timeout: float) -> None:
        """Wait until the arm is in one of `modes`.

        Raises
        ------
        ArmClientError
            If it is not within `timeout` [s].
        """
        deadline = time.monotonic() + timeout
        self._find(lambda: self.mode, timeout)
        left = deadline - time.monotonic()
        if not spin_until(self._node, lambda: self.mode in modes, left):
            seen = f'no arm_mode received: check that a bridge runs in {this_domain()}'
            if self.mode:
                seen = f"arm_mode is '{self.mode}': check the log of the bridge"
            raise ArmClientError(f'waited {timeout:g} s for {" or ".join(modes)}, but {seen}')

    def _find(self, condition: Callable[[], object], timeout: float) -> bool:
        """Wait for what shows that a bridge is there, and say so after a second."""
        if spin_until(self._node, condition, min(timeout, _QUIET)):
            return True
        if timeout <= _QUIET:
            return False
        self._on_wait(f'a bridge in {this_domain()}')
        return spin_until(self._node, condition, timeout - _QUIET)

    def _one_client(self, clients: Sequence[Client], timeout: float) -> Client:
        """Return the client of the only bridge there is; raises ArmClientError."""

        def ready() -> list[Client]:
            return [client for client in clients if client.service_is_ready()]

        if not self._find(ready, timeout):
            names = ' or '.join(client.srv_name for client in clients)
            others = ' and '.join(bridges_among(offered_actions(self._node)))
            hint = f' Found: {others}; --bridge NAME selects one' if others else ''
            raise ArmClientError(
                f'no service {names}: check that a bridge runs in {this_domain()}{hint}'
            )
        # Another bridge may only just be discovered.
        first, left = ready(), self._begin + _DISCOVERY_TIME - time.monotonic()
        spin_until(self._node, lambda: False, left)
        found = ready() or first
        if len(found) > 1:
            names = ' and '.join(client.srv_name for client in found)
            raise ArmClientError(f'found {names}: stop one bridge, or name the intended one')
        self._expect_one_of_its_name(found[0], timeout)
        return found[0]

    def _expect_one_of_its_name(self, client: Client, timeout: float) -> None:
        """Raise ArmClientError if several bridges have one name: all of them would do it."""
        if same_name_problem(self._node, client):
            self._on_wait('one of the bridges of this name to end, if it was killed')
            timeout = min(timeout, _SEEN_AFTER_DEATH)
            spin_until(self._node, lambda: not same_name_problem(self._node, client), timeout)
        problem = same_name_problem(self._node, client)
        if problem:
            raise ArmClientError(problem)

    def _on_mode(self, message: String) -> None:
        self.mode = message.data


HOLD, RELEASE = 'hold', 'release'

BRIDGES_PARAMETER = Parameter(
    'bridges', list(BRIDGES), 'node names of the bridges to send requests to'
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
