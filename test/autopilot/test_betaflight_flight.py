"""Betaflight's packets compared with bytes, and flights by its sticks, including arming."""

import socket
import struct
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from flown_arm import Flight, body
from scripted_firmware import BOOT, ScriptedFirmware

from aerarm_ros.autopilot.betaflight_flight import (
    BetaflightFlight,
    BetaflightLink,
    BetaflightSetup,
    mixer_of,
    motor_outputs,
    rc_packet,
    state_packet,
)
from aerarm_ros.description.drone_config import load_drone_config
from aerarm_ros.description.resources import resource
from aerarm_ros.flight.arm_load import FeedForward
from aerarm_ros.flight.flight_state import FlightTarget, yaw_of

DRONE = load_drone_config()
QUADROTOR, TILTED = (
    load_drone_config(resource('config', 'drones', f'{name}.yaml'))
    for name in ('quadrotor', 'tilted_hexarotor')
)
STEP = 0.004
LEVEL, UPRIGHT = np.array([0.0, 0.0, 9.81]), np.array([1.0, 0.0, 0.0, 0.0])


def test_packets_are_those_of_the_firmware_byte_by_byte() -> None:
    state = state_packet(np.array([1.0, 2.0, 3.0]), np.array([0.1, 0.2, 9.8]), np.full(4, 0.5))
    expected = [0.0, 1.0, -2.0, -3.0, -0.1, -0.2, -9.8, 0.5, 0.5, -0.5, -0.5, *[0.0] * 6, 101325.0]
    assert state == struct.pack('<18d', *expected)
    sticks = rc_packet([1500, 1501, 1000])
    assert sticks == bytes(8) + bytes.fromhex('dc05dd05e803') + 13 * bytes.fromhex('e803')
    packet = bytes.fromhex('06000000') + struct.pack('<16f', *range(1000, 1016))
    np.testing.assert_array_equal(motor_outputs(packet), np.arange(1000, 1006))
    too_many, nan = (
        struct.pack('<H2x16f', 17, *[1.0] * 16),
        struct.pack('<H2x16f', 6, *[np.nan] * 16),
    )
    for other in (b'', bytes(67), bytes(68), too_many, nan):
        assert motor_outputs(other) is None


def test_a_firmware_beside_us_is_armed_and_answers() -> None:
    probes = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(3)]
    for probe in probes:
        probe.bind(('127.0.0.1', 0))
    ports = [probe.getsockname()[1] for probe in probes]
    with pytest.raises(ValueError, match=f'UDP port {ports[0]} .*stop the other'):
        BetaflightLink(*ports)
    for probe in probes:
        probe.close()
    script = Path(__file__).with_name('scripted_firmware.py')
    command = [sys.executable, script, *map(str, ports)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == 'ready\n'
        link, heard = BetaflightLink(*ports), []
        while len(heard) < BOOT + 100:
            throttle = 1000 if len(heard) < BOOT + 20 else 1400
            sticks = [1500, 1500, throttle, 1500, 2000, 2000]
            pulses = link.exchange(sticks, np.zeros(3), LEVEL, UPRIGHT)
            heard += [] if pulses is None else [pulses]
        link.close()
        process.kill()
    assert np.all(heard[0] == 1000.0)
    np.testing.assert_allclose(heard[-1], 1055.0 + 945.0 * 390.0 / 990.0, rtol=1e-6)


class StickFlight(Flight):
    """A drone whose rotors a firmware commands."""

    def __init__(self) -> None:
        super().__init__(DRONE)
        self.firmware = ScriptedFirmware()
        self.law = BetaflightFlight(DRONE, self.body, self.firmware)

    def go(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP)):
            state = self.state._replace(specific_force=self.plant.imu[2])
            thrust = self.law.update(state, self.target, STEP)
            if not self.law.problem:
                self.plant.rotors.command(thrust)
            self.hold_arm()


def test_it_is_armed_then_hovers_and_goes_where_it_is_told() -> None:
    flight = StickFlight()
    assert 'no data from Betaflight' in flight.law.problem
    flight.go(0.3)
    assert flight.law.problem == 'Betaflight is arming'
    assert flight.firmware.sticks == [1500, 1500, 1000, 1500, 1000, 2000]
    np.testing.assert_allclose(flight.plant.base.position, 0.0, atol=1e-9)
    flight.go(0.7)
    assert flight.law.problem == ''
    flight.target = FlightTarget(np.array([0.2, -0.1, 0.1]), 0.3)
    flight.go(4.5)
    np.testing.assert_allclose(flight.plant.base.position, flight.target.position, atol=0.04)
    assert yaw_of(flight.state.rotation) == pytest.approx(0.3, abs=0.05)
    # It falls silent: after half a second nothing is commanded.
    flight.firmware.is_deaf = True
    flight.go(0.4)
    assert flight.law.problem == ''
    flight.go(0.2)
    assert 'no data from Betaflight' in flight.law.problem


def test_sticks_lean_against_the_arms_motion() -> None:
    flight = StickFlight()
    firmware = flight.firmware
    firmware.states = BOOT

    def sticks(*force: float, rotation: np.ndarray = flight.state.rotation) -> np.ndarray:
        """Return roll, pitch, throttle and yaw against a force of the motion, in hover."""
        law = BetaflightFlight(DRONE, flight.body, firmware)
        state, wrench = flight.state._replace(rotation=rotation), np.r_[force, 0.0, 0.0, 0.0]
        fed = FeedForward.at_rest(flight.body)._replace(wrench=wrench, wrench_now=wrench)
        firmware.is_armed = False
        while law.problem:
            law.update(state, FlightTarget.here(state), STEP)
        for _ in range(2):
            law.update(state, FlightTarget.here(state), STEP, fed)
        return np.array(firmware.sticks[:4])

    hover = sticks(0.0, 0.0, 0.0)
    np.testing.assert_array_equal(hover[[0, 1, 3]], 1500)
    # Pulled forward it leans backward, nose up; pulled left it leans right; pulled down it lifts.
    assert sticks(3.0, 0.0, 0.0)[1] < 1480
    assert sticks(0.0, 3.0, 0.0)[0] > 1520
    lift = DRONE.column('thrust_max').sum() * 0.945 / 990.0  # [N] a step of the stick
    assert sticks(0.0, 0.0, -5.0)[2] - hover[2] == pytest.approx(5 / lift, abs=1)
    # Which way it looks is no matter.
    turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert sticks(3.0, 0.0, 0.0, rotation=turned)[1] < 1480
    # Without a place it sinks slowly.
    while flight.law.problem:
        flight.law.update(flight.state, flight.target, STEP)
    flight.law.level(flight.state, STEP)
    weight = flight.body.mass * 9.81 / DRONE.column('thrust_max').sum()
    assert firmware.sticks[2] == BetaflightSetup().throttle(0.97 * weight)


def test_the_setup_knows_its_drones_and_gains() -> None:
    setup = BetaflightSetup()
    assert setup.motors_of(DRONE) == [3, 5, 2, 0, 4, 1]
    # Half of what the command line is told has its effect in the gains.
    assert setup.rate_gain(DRONE) == pytest.approx(2.0 * replace(setup, p=100).rate_gain(DRONE))
    assert [setup.throttle(x) for x in (setup.idle, 1.0, 2.0)] == [1010, 2000, 2000]
    assert [mixer_of(drone)[0] for drone in (DRONE, QUADROTOR)] == ['HEX6X', 'QUADX']
    turning = [replace(x, moment_per_thrust=-x.moment_per_thrust) for x in DRONE.rotors]
    reversed_turns = replace(DRONE, rotors=tuple(turning))
    for drone, reason in ((TILTED, 'in one plane'), (reversed_turns, 'turns the other way')):
        with pytest.raises(ValueError, match=reason):
            BetaflightFlight(drone, body(DRONE), ScriptedFirmware())
