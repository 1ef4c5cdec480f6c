"""Relay of service calls from the ground computer to nodes on the drone."""

from __future__ import annotations

import json
import secrets
import struct
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from math import inf
from types import MappingProxyType
from typing import Any

from rcl_interfaces import srv as parameters
from rclpy.client import Client
from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.service import Service
from std_srvs.srv import SetBool, Trigger

from aerarm_msgs_py.live_topics import HiddenFromExecutors
from aerarm_ros.link.connection import PROMPT, URGENT, Connection, SentMessage
from aerarm_ros.ros.link.relayed_topics import CALLS, OFFERED, RESULTS, STOP_RESULTS, STOPS

SERVICE_TYPES: Mapping[str, Any] = MappingProxyType(
    {
        **{f'std_srvs/srv/{kind.__name__}': kind for kind in (SetBool, Trigger)},
        **{
            f'rcl_interfaces/srv/{name}': getattr(parameters, name)
            for name in (
                *('DescribeParameters', 'GetParameters', 'GetParameterTypes'),
                *('ListParameters', 'SetParameters', 'SetParametersAtomically'),
            )
        },
    }
)
"""Types of the services that `ground_link` relays, by the ROS names of the types."""
E_STOP = 'e_stop'

_CALL = struct.Struct('<IH')  # number, length of the name
_NUMBER_MAX = 2**32 - 1
_LIFETIME = 1.0  # [s] in which a call must reach the drone
_ANSWER_TIMEOUT = 30.0  # [s]; as long as the longest wait of the command `arm`
_STOP_NOTICE = 1.0  # [s] after which the user is warned that the stop is not delivered yet
_UNCONFIRMED = (
    'NOT CONFIRMED: the drone received the e-stop, but no bridge has answered: check the bridge on '
    'the drone'
)
_LOOKS = 0.5  # [s] between two checks for services
_STOP_AGAIN = 0.2  # [s] between two requests of an e-stop that the bridge has not answered
_NEW_MAX = 4  # services or clients made in one update: each takes a millisecond or more


class DroneServices:
    """Announce the drone's services to the ground, and call them at the ground's request.

    Parameters
    ----------
    node
        Owner of the clients.
    connection
        Connection to the ground computer.
    """

    def __init__(self, node: Node, connection: Connection) -> None:
        self._node = node
        self._connection = connection
        self._group = HiddenFromExecutors()
        self._own = f'{node.get_fully_qualified_name()}/'
        self._looked = -inf
        self._clients: dict[str, Client] = {}
        self._found: dict[str, str] = {}
        self._offered: dict[str, str] = {}
        self._calls: dict[tuple[str, int], tuple[int, int, float]] = {}
        self._stops: dict[int, tuple[str, Trigger.Request, float]] = {}
        self._stopped = -inf
        self._newest_stop, self._newest_stop_at = 0, -inf

    def update(self, now: float) -> None:
        """Check for new services every 0.5 s, and send received answers to the ground."""
        if now - self._looked > _LOOKS:
            self._looked = now
            self._look()
        self._make_clients()
        # The bridge may not be discovered yet, or not receive a request to a new client.
        if self._stops and now - self._stopped > _STOP_AGAIN:
            self._stopped = now
            # The ground reports an e-stop as failed after this time.
            self._stops = {k: stop for k, stop in self._stops.items() if stop[2] > now}
            for number, (name, request, _) in self._stops.items():
                self._request(STOP_RESULTS, number, name, request, now)
        waiting = {name for name, _ in self._calls}
        for name in waiting:
            client = self._clients[name]
            while True:
                header, response = client.handle.take_response(client.srv_type.Response)
                if header is None:
                    break
                call = self._calls.pop((name, header.request_id.sequence_number), None)
                if call is not None:
                    channel, number, _ = call
                    if channel == STOP_RESULTS:
                        self._stops.pop(number, None)
                    self._answer(channel, number, response)
        self._calls = {key: call for key, call in self._calls.items() if call[2] > now}

    def call(self, content: bytes, now: float, is_stop: bool) -> None:
        """Call a service on the drone for a client on the ground.

        `is_stop` marks an e-stop. An e-stop may overtake an earlier call, such as `clear_fault`.
        The drone then rejects the earlier call, so that the call does not undo the e-stop.
        """
        number, length = _CALL.unpack_from(content)
        name = content[_CALL.size : _CALL.size + length].decode()
        content = content[_CALL.size + length :]
        if is_stop:
            stop = deserialize_message(content, Trigger.Request)
            self._stops[number] = name, stop, now + _ANSWER_TIMEOUT
            self._stopped = self._newest_stop_at = now
            self._newest_stop = number
            self._request(STOP_RESULTS, number, name, stop, now)
        elif name in self._clients:
            kind = self._clients[name].srv_type
            request = deserialize_message(content, kind.Request)
            if self._is_before_stop(number, now) and hasattr(kind.Response, 'success'):
                text = (
                    f'{name} rejected, because an e-stop followed this request: send the request '
                    'again'
                )
                self._answer(RESULTS, number, kind.Response(success=False, message=text))
            else:
                self._request(RESULTS, number, name, request, now)

    def _is_before_stop(self, number: int, now: float) -> bool:
        age = (self._newest_stop - number) & _NUMBER_MAX
        return now - self._newest_stop_at < 2.0 * _LIFETIME and age <= _NUMBER_MAX // 2

    def _answer(self, channel: int, number: int, response: Any) -> None:
        content = _CALL.pack(number, 0) + serialize_message(response)
        self._connection.send(channel, content, URGENT if channel == STOP_RESULTS else PROMPT)

    def _request(self, channel: int, number: int, name: str, request: Any, now: float) -> None:
        client = self._clients.get(name)
        # A service named e_stop may have another type.
        if client is not None and isinstance(request, client.srv_type.Request):
            sequence = client.handle.send_request(request)
            self._calls[name, sequence] = channel, number, now + _ANSWER_TIMEOUT

    def greet(self) -> None:
        """Send the list of the drone's services to the ground."""
        self._connection.send(OFFERED, json.dumps(self._offered).encode())

    def _look(self) -> None:
        """Find the services of the drone, and destroy clients of services that no longer exist."""
        self._found = {
            name: types[0]
            for name, types in self._node.get_service_names_and_types()
            if types[0] in SERVICE_TYPES
            and not name.startswith(self._own)
            and self._node.count_services(name)
        }
        used = {name for name, _ in self._calls} | {name for name, _, _ in self._stops.values()}
        for name in self._clients.keys() - self._found.keys() - used:
            self._node.destroy_client(self._clients.pop(name))

    def _make_clients(self) -> None:
        """Create clients in advance, because a service must first discover a new client."""
        for name in _e_stops_first(self._found.keys() - self._clients.keys())[:_NEW_MAX]:
            self._clients[name] = self._node.create_client(
                SERVICE_TYPES[self._found[name]], name, callback_group=self._group
            )
        offered = {name: kind for name, kind in self._found.items() if name in self._clients}
        if offered != self._offered and len(offered) == len(self._found):
            self._offered = offered
            self.greet()


@dataclass
class _Call:
    service: Any
    header: Any
    begin: float
    message: SentMessage
    is_answered: bool = False
    confirmed: float = inf  # [s]


class GroundServices:
    """Offer the drone's services on the ground computer, and forward calls to the drone.

    An e-stop is re-sent until the drone acknowledges it, even after a long loss of connection. Any
    other request that does not reach the drone within a second is dropped and answered with a
    failure.

    Parameters
    ----------
    node
        Owner of the services.
    connection
        Connection to the drone.
    log
        Logs a text, the second argument; the first argument is True for a warning.
    """

    def __init__(
        self, node: Node, connection: Connection, log: Callable[[bool, str], None]
    ) -> None:
        self._node = node
        self._connection = connection
        self._log = log
        self._group = HiddenFromExecutors()
        self._services: dict[str, Service] = {}
        self._offered: dict[str, str] = {}
        self._calls: dict[int, _Call] = {}
        self._shared_stops: dict[str, SentMessage] = {}  # since the newest other call
        # A late answer to a former process of this host must not answer a call of this one.
        self._number = secrets.randbits(32)

    @property
    def kept_stops(self) -> list[str]:
        """Names of e-stop services that were called, but not answered by a bridge yet."""
        return sorted({call.service.srv_name for call in self._calls.values() if _is_stop(call)})

    def take_offered(self, content: bytes) -> None:
        """Store the list of services that the drone announces; `update` creates them."""
        offered = json.loads(content)
        self._offered = {name: kind for name, kind in offered.items() if kind in SERVICE_TYPES}

    def greet(self) -> None:
        """Re-send e-stops that a former `ground_link` process of the drone has not answered."""
        for message in dict.fromkeys(c.message for c in self._calls.values() if _is_stop(c)):
            if message.is_confirmed:
                again = self._connection.send(STOPS, message.payload, URGENT)
                for call in self._calls.values():
                    if call.message is message:
                        call.message, call.confirmed = again, inf

    def update(self, now: float) -> bool:
        """Forward received service requests to the drone; return whether any was received."""
        has_sent = False
        for name, service in self._services.items():
            while True:
                request, header = service.handle.service_take_request(service.srv_type.Request)
                if header is None:
                    break
                self._forward(name, service, request, header, now)
                has_sent = True
        for number, call in list(self._calls.items()):
            self._look_after(number, call, now)
        self._offer_some()
        return has_sent

    def take_result(self, content: bytes, now: float) -> None:
        """Send a result from the drone to the client that called the service."""
        number, _ = _CALL.unpack_from(content)
        call = self._calls.get(number)
        if call is None:
            return
        response = deserialize_message(content[_CALL.size :], call.service.srv_type.Response)
        # Further stop requests during a stop are part of it.
        done = [n for n, other in self._calls.items() if other.message is call.message]
        for same in map(self._calls.pop, done):
            if not same.is_answered:
                self._answer(same, response)
        if call.is_answered:
            self._log(
                not response.success,
                f'{call.service.srv_name} was delivered {now - call.begin:.1f} s after the call: '
                f'{response.message}',
            )

    def _offer_some(self) -> None:
        """Remove and create at most four services, to return quickly to received e-stops."""
        own, offered = self._services.keys(), self._offered.keys()
        # A restarted drone offers nothing before it has discovered its bridge: stops wait for it.
        for name in [name for name in own - offered if E_STOP not in name][:_NEW_MAX]:
            self._node.destroy_service(self._services.pop(name))
        for name in _e_stops_first(offered - own)[:_NEW_MAX]:
            kind = SERVICE_TYPES[self._offered[name]]
            try:
                self._services[name] = self._node.create_service(
                    kind, name, _ignore, callback_group=self._group
                )
            except (NameValidationException, TypeError):  # TypeError: not UTF-8
                del self._offered[name]

    def _forward(self, name: str, service: Service, request: Any, header: Any, now: float) -> None:
        self._number = (self._number + 1) & _NUMBER_MAX
        encoded = name.encode()
        content = _CALL.pack(self._number, len(encoded)) + encoded + serialize_message(request)
        kept = self._shared_stops.get(name)
        if not _offers_stop(service):
            message = self._connection.send(CALLS, content, PROMPT, now + _LIFETIME)
            self._shared_stops.clear()  # a later e-stop must come after this call
        elif kept is not None and not kept.is_confirmed:
            message = kept  # one message is enough
        else:
            message = self._shared_stops[name] = self._connection.send(STOPS, content, URGENT)
        self._calls[self._number] = _Call(service, header, now, message)

    def _look_after(self, number: int, call: _Call, now: float) -> None:
        if _is_stop(call):
            if now - call.begin > _STOP_NOTICE and not call.is_answered:
                call.is_answered = True
                self._fail(call, _UNCONFIRMED if call.message.is_confirmed else (
                    f'NOT DELIVERED YET, because the drone has been silent {self._silence(now)}; '
                    'ground_link repeats the e-stop until the drone receives it'
                ))  # fmt: skip
            if call.message.is_confirmed:
                call.confirmed = min(call.confirmed, now)
            if now - call.confirmed > _ANSWER_TIMEOUT:
                del self._calls[number]
                self._log(True, f'{call.service.srv_name}: no bridge answered the e-stop within '
                          f'{_ANSWER_TIMEOUT:g} s: check the bridge on the drone')  # fmt: skip
        elif call.message.is_expired and not call.is_answered:
            del self._calls[number]
            self._fail(call, (
                f'not delivered within {_LIFETIME:g} s, because the drone has been silent '
                f'{self._silence(now)}: send the request again once the drone is connected'
            ))  # fmt: skip
        elif now - call.begin > _ANSWER_TIMEOUT:
            del self._calls[number]
            self._fail(call, (
                'the drone received the request, but the service has not answered within '
                f'{_ANSWER_TIMEOUT:g} s: check the node on the drone that offers this service'
            ))  # fmt: skip

    def _fail(self, call: _Call, text: str) -> None:
        """Log a warning, and answer with a failure if the service's type has a field `success`."""
        self._log(True, f'{call.service.srv_name}: {text}')
        kind = call.service.srv_type.Response
        if hasattr(kind, 'success'):
            self._answer(call, kind(success=False, message=text))

    def _silence(self, now: float) -> str:
        silent = now - self._connection.last_received
        return f'for {silent:.1f} s' if silent < inf else 'since the start of ground_link'

    def _answer(self, call: _Call, response: Any) -> None:
        service = self._services.get(call.service.srv_name)
        if service is not None and service is call.service:
            service.send_response(response, call.header)


def _e_stops_first(names: Iterable[str]) -> list[str]:
    return sorted(names, key=lambda name: (not name.endswith(f'/{E_STOP}'), name))


def _is_stop(call: _Call) -> bool:
    return _offers_stop(call.service)


def _offers_stop(service: Any) -> bool:
    # A node on another host may have a service of that name with another type.
    return service.srv_type is Trigger and bool(service.srv_name.endswith(f'/{E_STOP}'))


def _ignore(_: Any, response: Any) -> Any:
    """Return the response unchanged; rclpy requires this callback but never calls it."""
    return response
