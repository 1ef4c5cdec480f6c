"""A scripted PX4 that replays recorded data and checks the data it receives."""

import socket
from collections.abc import Callable

import numpy as np
import pytest
from px4_recording import BODY, DRONE, FLOWN, STILL, ScriptedPx4, flight, fly, load

from aerarm_ros.autopilot import px4_flight
from aerarm_ros.autopilot.firmware_flight import FirmwareFlight
from aerarm_ros.autopilot.px4_link import CompanionLink, SimulatorLink
from aerarm_ros.description.drone_config import GRAVITY
from aerarm_ros.flight.flight_state import FlightTarget

STEPS = load()
AIR = len(STEPS) - FLOWN  # the first step in the air
TARGET = FlightTarget.here(STILL)

Stage = Callable[..., tuple[FirmwareFlight, ScriptedPx4, SimulatorLink]]


def free_port(kind: socket.SocketKind) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(('127.0.0.1', 0))
        return int(probe.getsockname()[1])


@pytest.fixture
def staged() -> Stage:
    """Return a function that starts a scripted PX4 and its connections."""
    links = []

    def start(**faults: int) -> tuple[FirmwareFlight, ScriptedPx4, SimulatorLink]:
        tcp = free_port(socket.SOCK_STREAM)
        udp, own = free_port(socket.SOCK_DGRAM), free_port(socket.SOCK_DGRAM)
        simulator, companion = SimulatorLink(tcp), CompanionLink(own, udp)
        links.extend((simulator, companion))
        px4 = ScriptedPx4(STEPS, tcp, udp, own, **faults)
        px4.start()
        return flight(simulator, companion), px4, simulator

    yield start
    for link in links:
        link.close()


def test_the_firmware_is_led_into_the_air_as_it_was_when_recorded(staged: Stage) -> None:
    control, px4, simulator = staged()
    assert 'no answer from PX4 yet' in control.problem
    seen = fly(control)
    px4.join(5.0)
    assert px4.differing == []  # byte by byte, in both directions
    assert px4.done == len(STEPS)
    assert control.problem == ''
    stages = 'estimator is settling', 'PX4 is arming', 'rotors are spooling up'
    assert [stage for text in seen for stage in stages if text.endswith(stage)] == list(stages)
    thrust = control.update(STILL, TARGET, 0.0)
    assert thrust.shape == (DRONE.n,)
    assert 0.5 < thrust.sum() / (BODY.mass * GRAVITY) < 2.0
    # The recording ends in flight, and so does this PX4.
    control.update(STILL, TARGET, 0.004)
    assert simulator.is_lost
    assert 'PX4 has ended' in control.problem


def test_a_firmware_that_ends_on_the_ground_is_noticed(staged: Stage, monkeypatch) -> None:
    monkeypatch.setattr(px4_flight, '_ANSWER', 0.2)
    control, px4, simulator = staged(ends_at=300)
    fly(control)
    assert simulator.is_lost
    assert 'PX4 has ended' in control.problem
    px4.join(5.0)
    assert px4.done == 300


def test_a_simulator_that_ends_ends_the_line(staged: Stage) -> None:
    control, px4, simulator = staged()
    control.update(STILL, TARGET, 0.004)
    simulator.close()
    px4.join(5.0)
    assert not px4.is_alive()


def test_a_damaged_answer_is_counted_and_the_thrust_before_it_holds(
    staged: Stage, monkeypatch
) -> None:
    control, px4, simulator = staged(damaged=AIR + 20)
    fly(control, flown=20)
    before = control.update(STILL, TARGET, 0.0)
    monkeypatch.setattr(px4_flight, '_ANSWER', 0.2)
    after = control.update(STILL, TARGET, 0.004)
    np.testing.assert_array_equal(after, before)
    assert simulator.damaged == 1
    assert px4.done == AIR + 21
    assert control.problem == ''


def test_a_port_that_is_taken_is_named() -> None:
    port = free_port(socket.SOCK_STREAM)
    first = SimulatorLink(port)
    with pytest.raises(ValueError, match=f'TCP port {port}.*autopilot_instance'):
        SimulatorLink(port)
    first.close()
    port = free_port(socket.SOCK_DGRAM)
    other = CompanionLink(port, 9)
    with pytest.raises(ValueError, match=f'UDP port {port}'):
        CompanionLink(port, 9)
    other.close()


def test_without_a_firmware_it_waits_and_says_so() -> None:
    simulator = SimulatorLink(free_port(socket.SOCK_STREAM))
    companion = CompanionLink(free_port(socket.SOCK_DGRAM), free_port(socket.SOCK_DGRAM))
    control = flight(simulator, companion)
    control.update(STILL, TARGET, 0.004)
    control.settle()
    assert control.is_settling
    assert 'before this node' in control.problem
    simulator.close()
    companion.close()
