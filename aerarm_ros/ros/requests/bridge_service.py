"""Service calls to the bridge: to the only bridge, or to all bridges for a stop.

The node is spun by an executor in another thread, or by the waiting call itself (`spins`).
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable, Mapping, Sequence
from math import inf

from rclpy._rclpy_pybind11 import RCLError
from rclpy.client import Client
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Trigger

from aerarm_ros.hardware.bridge_modes import ACTIONS, REACHES_ALL, Answer
from aerarm_ros.ros.executors import spin_until, this_domain
from aerarm_ros.ros.process.node_process import has_packaged_profile

ASK_AGAIN = 0.5  # [s]


def no_bridge(services: str) -> str:
    """Return the error message that no bridge offers the named services."""
    return f'no bridge offers the service {services}: check that a bridge runs in {this_domain()}'


class ServiceCall:
    """Call of one service: the constructor sends the request, and `poll` returns the answer.

    The caller of `poll` must spin the node, in the same or another thread.

    Parameters
    ----------
    client
        Client of a ready `std_srvs/Trigger` service.
    timeout
        Longest time to wait for the answer [s].
    repeats
        Whether to repeat the request until an answer arrives. An answer is lost if the bridge has
        not yet discovered the client. Set this only for requests that may be executed twice.
    """

    def __init__(self, client: Client, timeout: float, repeats: bool = False) -> None:
        self._answer: Answer | None = None
        self._client = client
        self._timeout = timeout
        self._interval = ASK_AGAIN if repeats else inf
        self._begin = self._asked = time.monotonic()
        self._futures: list[Future] = []
        self._problem = ''
        self._send()

    def poll(self) -> Answer | None:
        """Return the bridge's answer or a failure message, or None while waiting."""
        if self._answer is not None:
            return self._answer
        now = time.monotonic()
        answer = next((future.result() for future in self._futures if future.done()), None)
        is_late = now - self._begin > self._timeout
        if answer is not None:
            self._end(bool(answer.success), answer.message)
        elif not self._futures and (is_late or self._interval == inf):
            self._end(False, self._problem)
        elif is_late:
            text = f'the bridge did not respond within {self._timeout:g} s: check arm_mode'
            self._end(False, text)
        elif now - self._asked > self._interval:
            self._asked = now
            self._send()
        return self._answer

    def _send(self) -> None:
        try:
            self._futures.append(self._client.call_async(Trigger.Request()))
        except (RCLError, InvalidHandle) as error:
            # Clients of several bridges continue with the next bridge.
            self._problem = f'the request to the bridge could not be sent: {error}'

    def _end(self, accepted: bool, message: str) -> None:
        self._answer = Answer(accepted, message)
        for future in self._futures:
            if not future.done():
                self._client.remove_pending_request(future)


_PAUSE = 1.0  # [s] without change of the graph, after which discovery counts as complete
# [s] after which an emergency stop no longer waits for a busy host before it leaves its namespace
_WAIT_MAX = 4.0
_STEP_MAX = 0.1  # [s] of a step that counts as time of discovery
_TRIGGER = 'std_srvs/srv/Trigger'


def discovery_time() -> float:
    """Return the time [s] in which a new node discovers all nodes of the ROS graph.

    With the packaged profile of Fast DDS, a new node announces itself every 0.25 s or more often,
    and all nodes answer its announcements: three bridges were found within 0.8 s. With another
    profile, discovery can take 3 s.
    """
    return 2.0 if has_packaged_profile() else 4.0


def offered_actions(node: Node) -> dict[str, int]:
    """Return the number of servers of each bridge service in the ROS graph, by full name.

    The ROS graph also lists services without a server if they have clients, such as the page of
    `view`.
    """
    counts = {
        name: node.count_services(name)
        for name, types in node.get_service_names_and_types()
        if _TRIGGER in types and name.rpartition('/')[2] in ACTIONS
    }
    return {name: count for name, count in counts.items() if count}


def bridges_among(services: Iterable[str]) -> list[str]:
    """Return the full names of the nodes that offer all services of a bridge.

    Parameters
    ----------
    services
        Full service names, as `offered_actions` returns them.
    """
    offered: dict[str, set[str]] = {}
    for service in services:
        node, _, action = service.rpartition('/')
        if action in ACTIONS:
            offered.setdefault(node, set()).add(action)
    return sorted(node for node, actions in offered.items() if len(actions) == len(ACTIONS))


def same_name_problem(node: Node, client: Client) -> str:
    """Return an error message if several bridges have the name that a client calls, else ''.

    All of these bridges execute the request, but the client receives only one answer.
    """
    count = node.count_services(client.srv_name)
    if count < 2:
        return ''
    name = node.resolve_service_name(client.srv_name).rpartition('/')[0]
    return (
        f'found {count} nodes named {name}: stop all but one, or start each with a different '
        'name (-r __node:=NAME), namespace or ROS_DOMAIN_ID'
    )


class BridgeFinder:
    """Find all running bridges, and create a client for one service of each.

    The methods may be called from any thread.

    Parameters
    ----------
    node
        Owner of the clients; the finder searches the ROS graph of this node.
    action
        Name of the service, one of `ACTIONS`. The finder searches the node's namespace. If that
        namespace has no bridge and `action` is in `REACHES_ALL`, the finder searches all
        namespaces.
    bridges
        Node names of expected bridges. Their clients are created at once, because the first
        answer is lost if the bridge has not yet discovered the client.
    only
        Whether to ignore bridges that `bridges` does not name.
    everywhere
        Whether to search all namespaces in any case.
    """

    def __init__(
        self,
        node: Node,
        action: str,
        bridges: Sequence[str],
        only: bool = False,
        everywhere: bool = False,
    ) -> None:
        self._node = node
        self._action = action
        self._only = only
        self._everywhere = everywhere
        self._lock = threading.Lock()
        self._seen: dict[str, int] | None = None
        self._looked = self._began = time.monotonic()
        # [s] of search, and of search since the graph last changed. While a busy host delays this
        # process, it delays discovery as well, so such pauses do not count.
        self._searched = self._unchanged = 0.0
        self._clients: dict[str, Client | None] = {}
        for name in bridges:
            service = node.resolve_service_name(f'{name}/{action}')
            self._clients[service.rpartition('/')[0]] = self._client(service)

    def find(self, in_vain: bool = False) -> dict[str, Client | None]:
        """Return the client of each running bridge, with the bridge's full name as the key.

        `in_vain` means that the node's own namespace was already searched without success. An
        emergency stop then searches all namespaces at once. A returned client may not be ready yet.
        The client is None if a security policy does not allow this node to call the bridge.
        """
        with self._lock:
            names = self._look(in_vain)
            for name in names:
                if name not in self._clients:
                    self._clients[name] = self._client(f'{name}/{self._action}')
            return {
                name: client
                for name, client in self._clients.items()
                if name in names or (client is not None and client.service_is_ready())
            }

    def is_settled(self) -> bool:
        """Return whether discovery is probably complete, so that no further bridge will appear."""
        return self._searched > discovery_time() and self._unchanged > _PAUSE

    def _look(self, in_vain: bool) -> list[str]:
        seen = offered_actions(self._node)
        now = time.monotonic()
        step, self._looked = min(now - self._looked, _STEP_MAX), now
        self._searched += step
        # The services of the first search may have appeared at any time before.
        has_changed = self._seen is not None and seen != self._seen
        self._unchanged = 0.0 if has_changed else self._unchanged + step
        self._seen = seen
        if self._only:
            return []
        found = bridges_among(seen)
        own = self._node.get_namespace().rstrip('/')
        ours = [name for name in found if name.rpartition('/')[0] == own]
        may_reach_all = self._action in REACHES_ALL and not ours
        is_late = now - self._began > _WAIT_MAX  # an emergency stop does not wait for a busy host
        may_reach_all = may_reach_all and (in_vain or is_late or self.is_settled())
        return found if self._everywhere or may_reach_all else ours

    def _client(self, service: str) -> Client | None:
        try:
            return self._node.create_client(Trigger, service)
        except RCLError:  # A security policy forbids this client; still stop the others.
            return None


class BridgeService:
    """Call a service of the bridge, provided that exactly one bridge runs.

    If several bridges run, the request goes to none of them. Use `StopService` for stop requests.
    The constructor creates the clients, because an answer is lost if the bridge has not yet
    discovered the client.

    Parameters
    ----------
    node
        Owner of the clients.
    action
        Name of the service, one of `ACTIONS` or of the additional services of `fake_hardware`.
    bridges
        Node names of the bridges, relative or absolute.
    timeout
        Longest time to find a bridge, and again for its answer [s].
    spins
        Whether `call` spins the node; otherwise an executor must spin it in another thread.
    """

    def __init__(
        self,
        node: Node,
        action: str,
        bridges: Sequence[str],
        timeout: float = 1.0,
        spins: bool = False,
    ) -> None:
        self._node = node
        self._clients = {name: node.create_client(Trigger, f'{name}/{action}') for name in bridges}
        self._timeout = timeout
        self._spun = node if spins else None

    @property
    def found(self) -> list[str]:
        """Node names of the discovered bridges."""
        return [name for name, client in self._clients.items() if client.service_is_ready()]

    def problem(self, found: Sequence[str]) -> str:
        """Return why the request cannot be sent to one of the found bridges, or an empty string."""
        if not found:
            return no_bridge(' or '.join(client.srv_name for client in self._clients.values()))
        if len(found) > 1:
            return (
                f'found the bridges {" and ".join(found)}: stop all bridges but one, or name the '
                'intended bridge'
            )
        return same_name_problem(self._node, self._clients[found[0]])

    def call(self, timeout: float | None = None) -> Answer:
        """Send the request and wait for the bridge's answer.

        Returns
        -------
        accepted
            Whether the bridge has confirmed the request.
        message
            Answer of the bridge, or the reason why no bridge received the request.
        """
        timeout = self._timeout if timeout is None else timeout
        spin_until(self._spun, lambda: self.found, timeout)
        found = self.found
        problem = self.problem(found)
        if problem:
            return Answer(False, problem)
        call = ServiceCall(self._clients[found[0]], timeout)
        spin_until(self._spun, call.poll, inf)
        answer = call.poll()
        assert answer is not None
        return answer


# Services that repeatedly appear and disappear must not delay the answer beyond this time.
_LOOKING_MAX = 8.0  # [s]


class StopRequest:
    """Send a stop request to each bridge as soon as it is found, and collect the answers.

    The caller of `poll` must spin the node, in the same or another thread.

    Parameters
    ----------
    node
        Owner of the clients.
    finder
        Finder of the bridges.
    timeout
        Longest time to find bridges, and again for each answer [s].

    Attributes
    ----------
    answers
        Answers so far, by the bridges' full names. If several bridges share a name, they do not
        count as stopped at the end, because only one answer arrives.
    is_over
        Whether every running bridge has answered or timed out.
    """

    def __init__(self, node: Node, finder: BridgeFinder, timeout: float) -> None:
        self.answers: dict[str, Answer] = {}
        self.is_over = False
        self._node = node
        self._finder = finder
        self._timeout = timeout
        self._end = time.monotonic() + timeout
        self._is_in_vain = False
        self._looks_until = time.monotonic() + max(timeout, _LOOKING_MAX)
        self._calls: dict[str, ServiceCall] = {}
        self._asked: dict[str, int] = {}
        self._asked_last: set[str] = set()

    @property
    def has_found(self) -> bool:
        """Whether the request was sent to at least one bridge."""
        return bool(self._calls)

    def poll(self) -> bool:
        """Send the request to newly found bridges, collect answers, and return `is_over`."""
        found = self._finder.find(self._is_in_vain)
        ready = {n: client for n, client in found.items() if client and client.service_is_ready()}
        for name, client in ready.items():
            count = max(self._node.count_services(client.srv_name), 1)  # The service is ready.
            if count > self._asked.get(name, 0):  # another bridge with the same name has appeared
                self._asked[name] = count
                self._ask(name, client)
        for name, call in self._calls.items():
            answer = None if name in self.answers else call.poll()
            if answer is not None:
                self.answers[name] = answer
        now = time.monotonic()
        if now > self._end and not (found or self._calls or self._is_in_vain):
            self._is_in_vain, self._end = True, now + self._timeout
        is_late = now > self._end
        if is_late:
            for name in found.keys() - self._calls.keys():
                self.answers[name] = Answer(
                    False, 'the bridge was discovered, but cannot receive requests: check its log'
                )
        is_answered = not (found.keys() | self._calls.keys()) - self.answers.keys()
        # The search for further bridges continues after the first one, even beyond the timeout.
        has_looked = self._finder.is_settled() or now > self._looks_until
        is_complete = has_looked if self.answers else is_late
        self.is_over = is_answered and is_complete and not self._ask_those_of_one_name(found)
        return self.is_over

    def _ask(self, name: str, client: Client) -> None:
        self._calls[name] = ServiceCall(client, self._timeout, repeats=True)

    def _ask_those_of_one_name(self, found: Mapping[str, Client | None]) -> bool:
        """Send one more request to bridges that share a name; return whether a request was sent.

        A request that was sent during the discovery of these bridges may not have reached all of
        them. Afterwards the answer for their name becomes an error.
        """
        asked = False
        for name, client in found.items():
            problem = same_name_problem(self._node, client) if client else ''
            if problem and client and name not in self._asked_last:
                self._asked_last.add(name)
                self._ask(name, client)
                del self.answers[name]
                asked = True
            elif problem:
                self.answers[name] = Answer(False, problem)
        return asked


class StopService:
    """Send a stop request to every running bridge, and wait for all answers.

    Parameters
    ----------
    node
        Owner of the clients; an executor must spin it in another thread.
    action
        Name of the service, one of `STOPS`.
    bridges
        Node names of expected bridges, relative or absolute.
    timeout
        Longest time to find bridges, and again for the answer of each bridge [s].
    """

    def __init__(
        self, node: Node, action: str, bridges: Sequence[str], timeout: float = 1.0
    ) -> None:
        self._node = node
        self._action = action
        self._finder = BridgeFinder(node, action, bridges)
        self._timeout = timeout

    def look(self) -> None:
        """Find the running bridges and create their clients now, so that a later call is faster."""
        self._finder.find()

    def call(self) -> Answer:
        """Send the request and wait for the answers of all bridges.

        Returns
        -------
        accepted
            Whether at least one bridge runs and every bridge has confirmed.
        message
            Answers of the bridges, sorted by name, or a message that no bridge runs.
        """
        request = StopRequest(self._node, self._finder, self._timeout)
        spin_until(None, request.poll, inf)
        if not request.answers:
            return Answer(False, no_bridge(self._action))
        text = '; '.join(f'{name}: {reply}' for name, (_, reply) in sorted(request.answers.items()))
        return Answer(all(done for done, _ in request.answers.values()), text)
