"""Position control of a drone through Betaflight's sticks, including arming."""

from dataclasses import replace

import numpy as np
import pytest
from flown_arm import Flight, body
from scripted_firmware import BOOT, ScriptedFirmware

from aerarm_ros.autopilot.betaflight_flight import BetaflightFlight, BetaflightSetup, mixer_of
from aerarm_ros.description.drone_config import load_drone_config
from aerarm_ros.description.resources import resource
from aerarm_ros.flight.arm_load import FeedForward
from aerarm_ros.flight.flight_state import FlightTarget

DRONE = load_drone_config()
STEP = 0.004


class StickFlight(Flight):
    """A drone whose rotors a firmware commands."""

    def __init__(self, is_armed: bool = False) -> None:
        super().__init__(DRONE)
        self.firmware = ScriptedFirmware()
        if is_armed:
            self.firmware.states = BOOT
        self.law = BetaflightFlight(DRONE, self.body, self.firmware)
        while is_armed and self.law.problem:
            self.law.update(self.state, self.target, STEP)

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
    assert np.arctan2(flight.state.rotation[1, 0], flight.state.rotation[0, 0]) == pytest.approx(
        0.3, abs=0.05
    )
    # It falls silent: after half a second nothing is commanded.
    flight.firmware.is_deaf = True
    flight.go(0.4)
    assert flight.law.problem == ''
    flight.go(0.2)
    assert 'no data from Betaflight' in flight.law.problem


def test_sticks_lean_against_the_arms_motion() -> None:
    flight = StickFlight(is_armed=True)
    firmware, still = flight.firmware, np.zeros(6)

    def sticks(wrench: np.ndarray, rotation: np.ndarray | None = None) -> np.ndarray:
        """Return roll, pitch, throttle and yaw against a motion's wrench, in hover."""
        law = BetaflightFlight(DRONE, flight.body, firmware)
        state = flight.state if rotation is None else flight.state._replace(rotation=rotation)
        fed = FeedForward.at_rest(flight.body)._replace(wrench=wrench, wrench_now=wrench)
        firmware.is_armed = False
        while law.problem:
            law.update(state, FlightTarget.here(state), STEP)
        for _ in range(2):
            law.update(state, FlightTarget.here(state), STEP, fed)
        return np.array(firmware.sticks[:4])

    throttle = sticks(still)[2]
    np.testing.assert_array_equal(sticks(still)[[0, 1, 3]], 1500)
    # Pulled forward it leans backward, nose up; pulled left it leans right; pulled down it lifts.
    assert sticks(np.array([3.0, 0, 0, 0, 0, 0]))[1] < 1480
    assert sticks(np.array([0, 3.0, 0, 0, 0, 0]))[0] > 1520
    lift = DRONE.column('thrust_max').sum() * 0.945 / 990.0  # [N] a step of the stick
    assert sticks(np.array([0, 0, -5.0, 0, 0, 0]))[2] - throttle == pytest.approx(5 / lift, abs=1)
    # Which way it looks is no matter.
    turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert sticks(np.array([3.0, 0, 0, 0, 0, 0]), turned)[1] < 1480
    # Without a place it sinks slowly.
    flight.law.level(flight.state, STEP)
    weight = flight.body.mass * 9.81 / DRONE.column('thrust_max').sum()
    assert firmware.sticks[2] == BetaflightSetup().throttle(0.97 * weight)


def test_the_setup_knows_its_drones_and_gains() -> None:
    setup = BetaflightSetup()
    assert setup.motors_of(DRONE) == [3, 5, 2, 0, 4, 1]
    # Half of what the command line is told has its effect in the gains.
    assert setup.rate_gain(DRONE) == pytest.approx(2.0 * replace(setup, p=100).rate_gain(DRONE))
    assert setup.throttle(setup.idle) == 1010
    assert setup.throttle(1.0) == 2000
    assert setup.throttle(2.0) == 2000
    assert [mixer_of(drone)[0] for drone in (DRONE, quadrotor())] == ['HEX6X', 'QUADX']


def quadrotor():
    return load_drone_config(resource('config', 'drones', 'quadrotor.yaml'))


def test_a_drone_without_a_mixer_is_refused() -> None:
    tilted = load_drone_config(resource('config', 'drones', 'tilted_hexarotor.yaml'))
    reversed_turns = tuple(
        replace(rotor, moment_per_thrust=-rotor.moment_per_thrust) for rotor in DRONE.rotors
    )
    for drone, reason in (
        (tilted, 'in one plane'),
        (replace(DRONE, rotors=reversed_turns), 'turns the other way'),
    ):
        with pytest.raises(ValueError, match=reason):
            BetaflightFlight(drone, body(DRONE), ScriptedFirmware())
