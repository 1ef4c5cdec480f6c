"""Which bridges there are, whatever they are called."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable, Sequence

from rclpy._rclpy_pybind11 import RCLError
from rclpy.client import Client
from rclpy.node import Node
from std_srvs.srv import Trigger

from aerarm_ros.ros.bridge.bridge_services import ACTIONS, EVERYWHERE

# Most nodes are found in tenths of a second. With another profile of Fast DDS than the packaged one
# some need 3 s.
_DISCOVERY_TIME = 4.0  # [s]
_PAUSE = 0.5  # [s] between the services of one node
_TRIGGER = 'std_srvs/srv/Trigger'


def offered_actions(node: Node) -> dict[str, int]:
    """Return how many servers each service has that a bridge may offer, by full name.

    The graph names services that only have clients, such as those of a page, as well.
    """
    counts = {
        name: node.count_services(name)
        for name, types in node.get_service_names_and_types()
        if _TRIGGER in types and name.rpartition('/')[2] in ACTIONS
    }
    return {name: count for name, count in counts.items() if count}


def bridges_among(services: Iterable[str]) -> list[str]:
    """Return the full names of the nodes that offer every service of a bridge.

    Parameters
    ----------
    services
        Full names, as of `offered_actions`.
    """
    offered: dict[str, set[str]] = {}
    for service in services:
        node, _, action = service.rpartition('/')
        if action in ACTIONS:
            offered.setdefault(node, set()).add(action)
    return sorted(node for node, actions in offered.items() if len(actions) == len(ACTIONS))


def same_name_problem(node: Node, client: Client | None) -> str:
    """Return how many nodes share the name of a client's bridge and what to do, '' if one has it.

    They all do what is asked, and only one of them is heard.
    """
    count = node.count_services(client.srv_name) if client is not None else 0
    if client is None or count < 2:
        return ''
    name = node.resolve_service_name(client.srv_name).rpartition('/')[0]
    return (
        f'there are {count} nodes named {name}: stop all but one, or give each another name '
        '(-r __node:=NAME), namespace or ROS_DOMAIN_ID'
    )


class BridgeFinder:
    """Finds every bridge that offers an action, and holds a client of each.

    Its methods may be called in any thread.

    Parameters
    ----------
    node
        Looks from its place in the graph and owns the clients.
    action
        A key of `bridge_services.ACTIONS`.
        What is not of `EVERYWHERE` finds the bridges of the node's own namespace alone.
    bridges
        Node names of those that are known beforehand: what they answer first is not lost.
    only
        Whether no others are looked for.
    """

    def __init__(self, node: Node, action: str, bridges: Sequence[str], only: bool = False) -> None:
        self._node = node
        self._action = action
        self._only = only
        self._lock = threading.Lock()
        self._seen: dict[str, int] | None = None
        self._born = self._changed = time.monotonic()
        self._clients: dict[str, Client | None] = {}
        for name in bridges:
            service = node.resolve_service_name(f'{name}/{action}')
            self._clients[service.rpartition('/')[0]] = self._client(service)

    def find(self) -> dict[str, Client | None]:
        """Return a client of each bridge that is there, by the bridges' full names.

        One that has only just been found may not be ready yet. It is None if this node may not
        ask that bridge.
        """
        with self._lock:
            names = self._look()
            for name in names:
                if name not in self._clients:
                    self._clients[name] = self._client(f'{name}/{self._action}')
            return {
                name: client
                for name, client in self._clients.items()
                if name in names or (client is not None and client.service_is_ready())
            }

    def is_settled(self) -> bool:
        """Tell whether the node is there for long enough, and no service has just come or gone."""
        now = time.monotonic()
        return now - self._born > _DISCOVERY_TIME and now - self._changed > _PAUSE

    def _look(self) -> list[str]:
        seen = offered_actions(self._node)
        # What was there when it was first looked for came at any time before.
        if self._seen is not None and seen != self._seen:
            self._changed = time.monotonic()
        self._seen = seen
        if self._only:
            return []
        found = bridges_among(seen)
        own = self._node.get_namespace().rstrip('/')
        return [n for n in found if self._action in EVERYWHERE or n.rpartition('/')[0] == own]

    def _client(self, service: str) -> Client | None:
        try:
            return self._node.create_client(Trigger, service)
        except RCLError:  # by a security policy; it must not keep the others from being stopped
            return None
