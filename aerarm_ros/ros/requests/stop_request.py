"""A stop that goes to every bridge."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence

from rclpy.client import Client
from rclpy.node import Node

from aerarm_ros.hardware.gate.command_intake import Answer
from aerarm_ros.ros.executors import this_domain
from aerarm_ros.ros.requests.bridge_service import BridgeFinder, ServiceCall, same_name_problem

# Services that come and go all the time must not keep what is known from being told.
_LOOKING_MAX = 8.0  # [s]


class StopRequest:
    """Asks each bridge as soon as it is found, so that none waits for another's answer.

    Its owner polls while the node is spun, here or in another thread.

    Parameters
    ----------
    node
        Owner of the clients.
    finder
        Finds the bridges.
    timeout
        Longest time to find bridges, and again for each one's answer [s].

    Attributes
    ----------
    answers
        What is known so far, by the full names of the bridges. When it is over, one whose name
        several bridges have is not said to be stopped: only one of them is heard.
    is_over
        Whether every bridge that is there has answered, or will not.
    """

    def __init__(self, node: Node, finder: BridgeFinder, timeout: float) -> None:
        self.answers: dict[str, Answer] = {}
        self.is_over = False
        self._node = node
        self._finder = finder
        self._timeout = timeout
        self._end = time.monotonic() + timeout
        self._looks_until = time.monotonic() + max(timeout, _LOOKING_MAX)
        self._calls: dict[str, ServiceCall] = {}
        self._asked: dict[str, int] = {}
        self._asked_last: set[str] = set()

    @property
    def has_found(self) -> bool:
        """Whether a bridge has been asked."""
        return bool(self._calls)

    def poll(self) -> bool:
        """Ask those found by now, and listen; return `is_over`."""
        found = self._finder.find()
        for name, client in found.items():
            if client is not None and client.service_is_ready():
                self._ask(name, client)
        for name, call in self._calls.items():
            answer = None if name in self.answers else call.poll()
            if answer is not None:
                self.answers[name] = answer
        now = time.monotonic()
        is_late = now > self._end
        if is_late:
            for name in found.keys() - self._calls.keys():
                self.answers[name] = Answer(False, 'it is seen, but cannot be asked')
        is_answered = not (found.keys() | self._calls.keys()) - self.answers.keys()
        # Who has found one bridge looks on for others, however soon it would give up.
        has_looked = self._finder.is_settled() or now > self._looks_until
        is_complete = has_looked if self.answers else is_late
        self.is_over = is_answered and is_complete and not self._ask_those_of_one_name(found)
        return self.is_over

    def _ask(self, name: str, client: Client) -> None:
        """Ask a bridge, and again once another one with its name is there."""
        count = max(self._node.count_services(client.srv_name), 1)  # it is ready
        if count > self._asked.get(name, 0):
            self._asked[name] = count
            self._calls[name] = ServiceCall(client, self._timeout, repeats=True)

    def _ask_those_of_one_name(self, found: Mapping[str, Client | None]) -> bool:
        """Tell that they are several; return whether they were asked a last time.

        What was sent when one of them was only just seen may not have reached it.
        """
        asked = False
        for name, client in found.items():
            problem = same_name_problem(self._node, client)
            if problem and client is not None and name not in self._asked_last:
                self._asked_last.add(name)
                self._calls[name] = ServiceCall(client, self._timeout, repeats=True)
                del self.answers[name]
                asked = True
            elif problem:
                self.answers[name] = Answer(False, problem)
        return asked


_POLL = 0.02  # [s]


class StopService:
    """Stops the arm of every bridge, known beforehand or not.

    Parameters
    ----------
    node
        Owner of the clients; an executor must spin it in another thread.
    action
        A key of `bridge_services.STOPS`.
    bridges
        Node names of bridges that are expected, relative or absolute.
    timeout
        Longest time to find bridges, and again for the answer of each [s].
    """

    def __init__(
        self, node: Node, action: str, bridges: Sequence[str], timeout: float = 1.0
    ) -> None:
        self._node = node
        self._action = action
        self._finder = BridgeFinder(node, action, bridges)
        self._timeout = timeout

    def look(self) -> None:
        """Make clients of the bridges that are there by now, so that a call need not."""
        self._finder.find()

    def call(self) -> tuple[bool, str]:
        """Ask; blocks until every bridge that is asked has answered.

        Returns
        -------
        done
            Whether every bridge there is has confirmed, and there was one.
        text
            What the bridges said, in the order of their names, or that there is none.
        """
        request = StopRequest(self._node, self._finder, self._timeout)
        while not request.poll():
            time.sleep(_POLL)
        if not request.answers:
            return False, f'no bridge offers {self._action}: is one running in {this_domain()}?'
        text = '; '.join(f'{name}: {reply}' for name, (_, reply) in sorted(request.answers.items()))
        return all(done for done, _ in request.answers.values()), text
