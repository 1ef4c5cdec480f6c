"""Services that ground_link relays."""

from __future__ import annotations

import json
import struct
from collections import Counter
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import pytest
from rclpy.client import Client
from rclpy.serialization import serialize_message
from rclpy.service import Service
from rclpy.task import Future
from std_srvs.srv import SetBool, Trigger

from aerarm_ros.link.connection import Connection
from aerarm_ros.ros.link.link_ends import _MALFORMED
from aerarm_ros.ros.link.relayed_services import DroneServices, GroundServices
from aerarm_ros.ros.link.relayed_topics import CALLS, OFFERED, STOPS

if TYPE_CHECKING:
    from conftest import Pair

ANSWER_TIMEOUT = 30.0  # [s]


class Relay:
    """Both relays of a pair, a bridge on the drone, and a client of it on the ground."""

    def __init__(self, pair: Pair) -> None:
        self.pair = pair
        self.log: list[str] = []
        self.drone = DroneServices(pair.drone.relay, pair.drone.connection)
        self.ground = GroundServices(
            pair.ground.relay, pair.ground.connection, lambda _, text: self.log.append(text)
        )
        self.stops = 0
        self._peers = pair.ground.connection.peers

    def restart_drone(self) -> None:
        side = self.pair.drone
        side.connection = Connection(bytes(range(32)), 'drone', 'ground', 1e6)
        for client in list(side.relay.clients):
            side.relay.destroy_client(client)
        self.drone = DroneServices(side.relay, side.connection)

    def step(self) -> bool:
        self.drone.update(self.pair.now)
        self.ground.update(self.pair.now)
        drone, ground = self.pair.step()
        if self.pair.ground.connection.peers != self._peers:
            self._peers = self.pair.ground.connection.peers
            self.ground.greet()
        for received in drone:
            assert received.channel in (CALLS, STOPS)
            self.drone.call(received.payload, self.pair.now, received.channel == STOPS)
        for received in ground:
            if received.channel == OFFERED:
                self.ground.take_offered(received.payload)
            else:
                self.ground.take_result(received.payload, self.pair.now)
        return True

    def steps(self, count: int) -> None:
        for _ in range(count):
            self.step()

    def until(self, condition: Callable[[], object]) -> None:
        self.pair.until(lambda: self.step() and condition())

    def bridge(self) -> Service:
        """Return the service of a bridge that stops at once."""

        def stop(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            self.stops += 1
            response.success = True
            return response

        return self.pair.drone.node.create_service(Trigger, '/bridge/e_stop', stop)

    def client(self, name: str = '/bridge/e_stop', kind: type = Trigger) -> Client:
        """Return a client on the ground that has found the service."""
        client = self.pair.ground.node.create_client(kind, name)
        self.until(client.service_is_ready)
        return client

    def call(self, client: Client, request: object = None) -> Future:
        return client.call_async(request or client.srv_type.Request())

    def answer(self, call: Future) -> Any:
        """Return the answer to a call."""
        self.until(call.done)
        return call.result()

    def client_without_bridge(self) -> Client:
        """Return a client of a bridge that has ended."""
        bridge = self.bridge()
        stop = self.client()
        self.pair.drone.node.destroy_service(bridge)
        self.until(lambda: not self.pair.drone.relay.count_services('/bridge/e_stop'))
        return stop

    def clients(self) -> Counter[str]:
        """Return the names of the clients on the drone."""
        return Counter(client.srv_name for client in self.pair.drone.relay.clients)


@pytest.fixture
def relay(pair: Pair) -> Relay:
    return Relay(pair)


def test_clients_of_services_that_ended_are_destroyed(relay: Relay) -> None:
    relay.bridge()
    node = relay.pair.drone.node
    for number in range(3):
        name = f'/arm_{number}/go'
        service = node.create_service(Trigger, name, lambda _, response: response)
        client = relay.client(name)
        relay.answer(relay.call(client))
        node.destroy_service(service)
        relay.pair.ground.node.destroy_client(client)
        relay.until(lambda name=name: name not in relay.clients())
    assert relay.clients() == {'/bridge/e_stop': 1}
    offered = relay.pair.ground.relay.services
    relay.until(lambda: not any('/arm_' in service.srv_name for service in offered))


def test_an_e_stop_passes_a_call_that_is_never_answered(relay: Relay) -> None:
    relay.bridge()
    silent = relay.pair.drone.relay.create_service(  # never answers: no executor runs its node
        SetBool, '/slow/set', lambda _, answer: answer
    )
    slow, stop = relay.client('/slow/set', SetBool), relay.client()
    waiting, begin = relay.call(slow), relay.pair.now
    relay.steps(5)
    assert relay.answer(relay.call(stop)).success
    assert relay.stops > 0
    assert relay.pair.now - begin < 1.0  # not the answer "not delivered yet"
    # The delivered call without an answer is reported.
    assert not waiting.done()
    relay.log.clear()
    relay.pair.now += ANSWER_TIMEOUT
    text = relay.answer(waiting).message
    assert not waiting.result().success
    assert 'has not answered within 30 s' in text
    assert relay.log == [f'/slow/set: {text}']
    relay.pair.drone.relay.destroy_service(silent)


def test_an_e_stop_that_was_reported_as_failed_stops_no_later_bridge(relay: Relay) -> None:
    stop = relay.client_without_bridge()
    relay.answer(relay.call(stop))
    relay.pair.now += ANSWER_TIMEOUT
    relay.until(lambda: any('no bridge answered' in text for text in relay.log))
    relay.steps(20)
    relay.bridge()
    relay.client()
    relay.steps(20)
    assert relay.stops == 0


def test_an_e_stop_during_a_long_cut_is_reported_as_delivered(relay: Relay) -> None:
    relay.bridge()
    stop = relay.client()
    relay.pair.loss = 1.0
    assert 'NOT DELIVERED YET' in relay.answer(relay.call(stop)).message
    relay.pair.now += 2.0 * ANSWER_TIMEOUT
    relay.step()
    assert relay.stops == 0
    relay.pair.loss = 0.0
    relay.log.clear()
    relay.until(lambda: relay.log)
    assert 'was delivered 6' in relay.log[0]
    assert relay.stops > 0
    assert relay.ground.kept_stops == []


def test_services_are_created_a_few_at_a_time_and_e_stops_first(relay: Relay) -> None:
    pair, made = relay.pair, []
    for number in range(20):
        pair.drone.node.create_service(Trigger, f'/arm_{number}/act', lambda _, response: response)
    relay.bridge()

    def step() -> bool:
        before = {service.srv_name for service in pair.ground.relay.services}
        clients = sum(relay.clients().values())
        relay.step()
        new = {service.srv_name for service in pair.ground.relay.services} - before
        assert len(new) <= 4
        assert sum(relay.clients().values()) - clients <= 4
        if new:
            made.append(new)
        return sum(map(len, made)) == 21

    pair.until(step)
    assert '/bridge/e_stop' in made[0]


def test_a_clear_fault_before_an_e_stop_does_not_undo_it(relay: Relay) -> None:
    came: list[str] = []
    for name in ('clear_fault', 'e_stop'):

        def act(
            _: Trigger.Request, response: Trigger.Response, name: str = name
        ) -> Trigger.Response:
            came.append(name)
            response.success = True
            return response

        relay.pair.drone.node.create_service(Trigger, f'/bridge/{name}', act)
    stop, clear = relay.client(), relay.client('/bridge/clear_fault')
    relay.pair.loss = 1.0
    calls = []
    for client in (stop, stop, clear, stop):
        calls.append(relay.call(client))
        relay.steps(8)
    assert relay.pair.ground.connection.waiting == 3  # one message for the first two e-stops
    relay.pair.loss = 0.0
    assert [relay.answer(call).success for call in calls] == [True, True, False, True]
    assert 'rejected, because an e-stop followed this request' in calls[2].result().message
    assert set(came) == {'e_stop'}
    assert relay.answer(relay.call(clear)).success  # at once, but after the e-stop


@pytest.mark.parametrize('is_restarted', [False, True])
def test_an_e_stop_is_repeated_until_a_bridge_answers(relay: Relay, is_restarted: bool) -> None:
    answer = relay.answer(relay.call(relay.client_without_bridge()))
    assert answer.message.startswith('NOT CONFIRMED: the drone received the e-stop, but no bridge')
    if is_restarted:
        relay.restart_drone()
    relay.bridge()
    relay.until(lambda: relay.stops > 0)
    relay.until(lambda: not relay.ground.kept_stops)


def test_a_truncated_e_stop_is_not_kept(relay: Relay) -> None:
    relay.bridge()
    relay.client()
    name = b'/bridge/e_stop'
    for body in (b'', b'\0\1'):
        with pytest.raises(_MALFORMED):
            relay.drone.call(struct.pack('<IH', 1, len(name)) + name + body, relay.pair.now, True)
        relay.pair.now += 0.3
        relay.step()
    assert relay.stops == 0


def test_offered_services_with_invalid_names_are_ignored(relay: Relay) -> None:
    names = ['/no name', '', 'a' * 300, '/\ud800', '/bridge/e_stop']
    offered = dict.fromkeys(names, 'std_srvs/srv/Trigger')
    relay.ground.take_offered(json.dumps(offered).encode())
    for _ in range(3):
        relay.ground.update(relay.pair.now)
    made = [service.srv_name for service in relay.pair.ground.relay.services]
    assert [name for name in made if 'get_type_description' not in name] == ['/bridge/e_stop']


def test_a_late_answer_to_a_former_ground_does_not_confirm_a_new_e_stop(relay: Relay) -> None:
    pair, stop = relay.pair, relay.client_without_bridge()
    relay.call(stop)
    relay.until(lambda: relay.ground.kept_stops)
    former = struct.pack('<IH', next(iter(relay.ground._calls)), 0)
    for service in list(pair.ground.relay.services):
        if service.srv_name == '/bridge/e_stop':
            pair.ground.relay.destroy_service(service)
    pair.until(lambda: pair.step() and not stop.service_is_ready())
    relay.ground = GroundServices(pair.ground.relay, pair.ground.connection, lambda *_: None)
    offered = json.dumps({'/bridge/e_stop': 'std_srvs/srv/Trigger'}).encode()
    relay.ground.take_offered(offered)
    relay.until(stop.service_is_ready)
    answer = relay.call(stop)
    relay.until(lambda: relay.ground.kept_stops)
    response = serialize_message(Trigger.Response(success=True))
    relay.ground.take_result(former + response, pair.now)
    assert relay.ground.kept_stops == ['/bridge/e_stop']
    assert not answer.done()


def test_a_service_named_e_stop_of_another_type_is_an_ordinary_call(relay: Relay) -> None:
    came: list[bool] = []

    def act(request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        came.append(request.data)
        response.success = True
        return response

    relay.pair.drone.node.create_service(SetBool, '/other/e_stop', act)
    client = relay.client('/other/e_stop', SetBool)
    assert relay.answer(relay.call(client, SetBool.Request(data=True))).success
    assert relay.drone._stops == {}
    relay.steps(30)
    assert came == [True]
