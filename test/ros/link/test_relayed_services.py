"""Services that ground_link relays."""

from __future__ import annotations

import json
import struct
from collections import Counter
from typing import TYPE_CHECKING

import pytest
from rclpy.client import Client
from rclpy.serialization import serialize_message
from rclpy.service import Service
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
        self.pair.until(lambda: self.step() and client.service_is_ready())
        return client

    def clients(self) -> Counter[str]:
        """Return the names of the clients on the drone."""
        return Counter(client.srv_name for client in self.pair.drone.relay.clients)


def test_clients_of_services_that_ended_are_destroyed(pair: Pair) -> None:
    relay = Relay(pair)
    relay.bridge()
    node = pair.drone.node
    for number in range(5):
        name = f'/arm_{number}/go'
        service = node.create_service(Trigger, name, lambda _, response: response)
        client = relay.client(name)
        answer = client.call_async(Trigger.Request())
        pair.until(lambda answer=answer: relay.step() and answer.done())
        node.destroy_service(service)
        pair.ground.node.destroy_client(client)
        pair.until(lambda name=name: relay.step() and name not in relay.clients())
    assert relay.clients() == {'/bridge/e_stop': 1}
    offered = pair.ground.relay.services
    pair.until(lambda: relay.step() and not any('/arm_' in s.srv_name for s in offered))


def test_an_e_stop_passes_a_call_that_is_never_answered(pair: Pair) -> None:
    relay = Relay(pair)
    relay.bridge()
    silent = pair.drone.relay.create_service(  # no executor runs this node
        SetBool, '/slow/set', lambda _, response: response
    )
    slow, stop = relay.client('/slow/set', SetBool), relay.client()
    slow.call_async(SetBool.Request())
    for _ in range(5):
        relay.step()
    begin = pair.now
    answer = stop.call_async(Trigger.Request())
    pair.until(lambda: relay.step() and answer.done())
    assert answer.result().success
    assert relay.stops > 0
    assert pair.now - begin < 1.0  # not the answer "not delivered yet"
    pair.drone.relay.destroy_service(silent)


def test_an_e_stop_that_was_reported_as_failed_stops_no_later_bridge(pair: Pair) -> None:
    relay = Relay(pair)
    bridge = relay.bridge()
    stop = relay.client()
    pair.drone.node.destroy_service(bridge)
    pair.until(lambda: relay.step() and not pair.drone.relay.count_services('/bridge/e_stop'))
    answer = stop.call_async(Trigger.Request())
    pair.until(lambda: relay.step() and answer.done())
    assert 'NOT CONFIRMED' in answer.result().message
    pair.now += ANSWER_TIMEOUT
    pair.until(lambda: relay.step() and any('no bridge answered' in text for text in relay.log))
    for _ in range(20):
        relay.step()
    relay.bridge()
    relay.client()
    for _ in range(20):
        relay.step()
    assert relay.stops == 0


def test_an_e_stop_during_a_long_cut_is_reported_as_delivered(pair: Pair) -> None:
    relay = Relay(pair)
    relay.bridge()
    stop = relay.client()
    pair.loss = 1.0
    answer = stop.call_async(Trigger.Request())
    pair.until(lambda: relay.step() and answer.done())
    assert 'NOT DELIVERED YET' in answer.result().message
    pair.now += 2.0 * ANSWER_TIMEOUT
    relay.step()
    assert relay.stops == 0
    pair.loss = 0.0
    relay.log.clear()
    pair.until(lambda: relay.step() and relay.log)
    assert 'was delivered 6' in relay.log[0]
    assert relay.stops > 0
    assert relay.ground.kept_stops == []


def test_an_e_stop_waits_for_a_bridge_that_starts_in_time(pair: Pair) -> None:
    relay = Relay(pair)
    bridge = relay.bridge()
    stop = relay.client()
    pair.drone.node.destroy_service(bridge)
    pair.until(lambda: relay.step() and not pair.drone.relay.count_services('/bridge/e_stop'))
    stop.call_async(Trigger.Request())
    for _ in range(5):
        relay.step()
    relay.bridge()
    pair.until(lambda: relay.step() and relay.stops > 0)


def test_services_are_created_a_few_at_a_time_and_e_stops_first(pair: Pair) -> None:
    relay = Relay(pair)
    for number in range(20):
        pair.drone.node.create_service(Trigger, f'/arm_{number}/act', lambda _, response: response)
    relay.bridge()
    relay_node, made = pair.ground.relay, []

    def step() -> bool:
        before = {service.srv_name for service in relay_node.services}
        clients = sum(relay.clients().values())
        relay.step()
        new = {service.srv_name for service in relay_node.services} - before
        assert len(new) <= 4
        assert sum(relay.clients().values()) - clients <= 4
        if new:
            made.append(new)
        return sum(map(len, made)) == 21

    pair.until(step)
    assert '/bridge/e_stop' in made[0]


def log_of_bridge(pair: Pair) -> list[str]:
    """Return the calls that a bridge with `clear_fault` and `e_stop` receives, in order."""
    came: list[str] = []
    for name in ('clear_fault', 'e_stop'):

        def act(
            _: Trigger.Request, response: Trigger.Response, name: str = name
        ) -> Trigger.Response:
            came.append(name)
            response.success = True
            return response

        pair.drone.node.create_service(Trigger, f'/bridge/{name}', act)
    return came


def test_an_earlier_clear_fault_does_not_undo_an_e_stop(pair: Pair) -> None:
    relay = Relay(pair)
    came = log_of_bridge(pair)
    stop, clear = relay.client(), relay.client('/bridge/clear_fault')
    pair.loss = 1.0
    cleared = clear.call_async(Trigger.Request())
    for _ in range(15):
        relay.step()
    stopped = stop.call_async(Trigger.Request())
    for _ in range(15):
        relay.step()
    pair.loss = 0.0
    pair.until(lambda: relay.step() and cleared.done() and stopped.done())
    assert set(came) == {'e_stop'}
    assert 'rejected, because an e-stop followed this request' in cleared.result().message
    assert stopped.result().success
    cleared = clear.call_async(Trigger.Request())  # at once, but after the e-stop
    pair.until(lambda: relay.step() and cleared.done())
    assert cleared.result().success


def test_an_e_stop_after_a_clear_fault_does_not_share_the_message_of_an_earlier_one(
    pair: Pair,
) -> None:
    relay = Relay(pair)
    came = log_of_bridge(pair)
    stop, clear = relay.client(), relay.client('/bridge/clear_fault')
    pair.loss = 1.0
    calls = []
    for client in (stop, stop, clear, stop):
        calls.append(client.call_async(Trigger.Request()))
        for _ in range(5):
            relay.step()
    assert pair.ground.connection.waiting == 3  # one message for the first two e-stops
    pair.loss = 0.0
    pair.until(lambda: relay.step() and all(call.done() for call in calls))
    assert 'clear_fault' not in came
    assert [call.result().success for call in calls] == [True, True, False, True]


def test_a_restarted_drone_receives_an_e_stop_that_no_bridge_has_answered(pair: Pair) -> None:
    relay = Relay(pair)
    bridge = relay.bridge()
    stop = relay.client()
    pair.drone.node.destroy_service(bridge)
    pair.until(lambda: relay.step() and not pair.drone.relay.count_services('/bridge/e_stop'))
    answer = stop.call_async(Trigger.Request())
    pair.until(lambda: relay.step() and answer.done())
    text = answer.result().message
    assert text.startswith('NOT CONFIRMED: the drone received the e-stop, but no bridge')
    relay.restart_drone()
    relay.bridge()
    pair.until(lambda: relay.step() and relay.stops > 0)
    pair.until(lambda: relay.step() and not relay.ground.kept_stops)


def test_a_truncated_e_stop_is_not_kept(pair: Pair) -> None:
    relay = Relay(pair)
    relay.bridge()
    relay.client()
    name = b'/bridge/e_stop'
    for body in (b'', b'\0\1'):
        with pytest.raises(_MALFORMED):
            relay.drone.call(struct.pack('<IH', 1, len(name)) + name + body, pair.now, True)
        pair.now += 0.3
        relay.step()
    assert relay.stops == 0


def own_names(pair: Pair) -> list[str]:
    names = [service.srv_name for service in pair.ground.relay.services]
    return [name for name in names if 'get_type_description' not in name]


@pytest.mark.parametrize('name', ['/no name', '', 'a' * 300, '/\ud800'])
def test_an_offered_service_with_an_invalid_name_is_ignored(pair: Pair, name: str) -> None:
    relay = Relay(pair)
    kind = 'std_srvs/srv/Trigger'
    relay.ground.take_offered(json.dumps({name: kind, '/bridge/e_stop': kind}).encode())
    for _ in range(3):
        relay.ground.update(pair.now)
    assert own_names(pair) == ['/bridge/e_stop']


def test_a_late_answer_to_a_former_ground_does_not_confirm_a_new_e_stop(pair: Pair) -> None:
    relay = Relay(pair)
    bridge = relay.bridge()
    stop = relay.client()
    pair.drone.node.destroy_service(bridge)
    pair.until(lambda: relay.step() and not pair.drone.relay.count_services('/bridge/e_stop'))
    stop.call_async(Trigger.Request())
    relay.step()
    pair.until(lambda: relay.step() and relay.ground.kept_stops)
    former = struct.pack('<IH', next(iter(relay.ground._calls)), 0)
    for service in list(pair.ground.relay.services):
        if service.srv_name == '/bridge/e_stop':
            pair.ground.relay.destroy_service(service)
    pair.until(lambda: pair.step() and not stop.service_is_ready())
    relay.ground = GroundServices(pair.ground.relay, pair.ground.connection, lambda *_: None)
    offered = json.dumps({'/bridge/e_stop': 'std_srvs/srv/Trigger'}).encode()
    relay.ground.take_offered(offered)
    pair.until(lambda: relay.step() and stop.service_is_ready())
    answer = stop.call_async(Trigger.Request())
    pair.until(lambda: relay.step() and relay.ground.kept_stops)
    response = serialize_message(Trigger.Response(success=True))
    relay.ground.take_result(former + response, pair.now)
    assert relay.ground.kept_stops == ['/bridge/e_stop']
    assert not answer.done()


def test_a_service_named_e_stop_of_another_type_is_an_ordinary_call(pair: Pair) -> None:
    relay = Relay(pair)
    came: list[bool] = []

    def act(request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        came.append(request.data)
        response.success = True
        return response

    pair.drone.node.create_service(SetBool, '/other/e_stop', act)
    client = relay.client('/other/e_stop', SetBool)
    answer = client.call_async(SetBool.Request(data=True))
    pair.until(lambda: relay.step() and answer.done())
    assert answer.result().success
    assert relay.drone._stops == {}
    for _ in range(30):
        relay.step()
    assert came == [True]


def test_a_delivered_call_without_an_answer_is_reported(pair: Pair) -> None:
    relay = Relay(pair)
    silent = pair.drone.relay.create_service(  # no executor runs this node
        SetBool, '/slow/set', lambda _, response: response
    )
    client = relay.client('/slow/set', SetBool)
    answer = client.call_async(SetBool.Request())
    for _ in range(10):
        relay.step()
    assert not answer.done()
    pair.now += ANSWER_TIMEOUT
    pair.until(lambda: relay.step() and answer.done())
    assert not answer.result().success
    assert 'has not answered within 30 s' in answer.result().message
    assert relay.log == [f'/slow/set: {answer.result().message}']
    pair.drone.relay.destroy_service(silent)
