"""A drone that Betaflight flies, led by its sticks."""

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from aerarm_ros.autopilot.betaflight_link import Firmware
from aerarm_ros.autopilot.betaflight_packets import HIGH, LOW, MIDDLE
from aerarm_ros.autopilot.betaflight_setup import BetaflightSetup
from aerarm_ros.autopilot.set_point_acceleration import SetPointAcceleration
from aerarm_ros.description.drone_config import GRAVITY, DroneConfig
from aerarm_ros.flight.feed_forward import FeedForward
from aerarm_ros.flight.flight_gains import FlightGains
from aerarm_ros.flight.flight_state import FlightState
from aerarm_ros.flight.flight_target import FlightTarget, yaw_of
from aerarm_ros.flight.mass_properties import MassProperties
from aerarm_ros.motion.limited import limited

Array = npt.NDArray[np.float64]

_UP = np.array([0.0, 0.0, 1.0])
_INTEGRAL = 3.0  # [m/s^2] at most
_HEADING = 1.5  # [1/s] angular velocity per error of the heading
_TRY, _PAUSE = 3.0, 0.5  # [s] the switch is on for arming, and off in between
_SILENCE = 0.5  # [s] without motors' outputs
_SINK = 0.97  # share of the weight that is lifted where the height is not known


class BetaflightFlight:
    """Position control through the sticks of a Betaflight in angle mode, as a `FlightControl`.

    Sticks are roll and pitch, the angular velocity about the vertical, and throttle. The position
    loop is that of this drone's body; of the arm the set point takes the acceleration of
    `SetPointAcceleration`, which leans ahead by the gains of the setup, and throttle its mass.
    Before anything is commanded the firmware is armed: it needs some seconds after its start.

    Parameters
    ----------
    drone : DroneConfig
    body : MassProperties
        Of drone and arm, where nothing else is told.
    firmware : Firmware
    gains : FlightGains, optional
        Those of the position, and the limits.
    setup : BetaflightSetup, optional
        As the firmware was set up.

    Attributes
    ----------
    problem : str
        Why the rotors are not commanded, '' if they are.

    Raises
    ------
    ValueError
        If Betaflight has no mixer for this drone.
    """

    def __init__(
        self,
        drone: DroneConfig,
        body: MassProperties,
        firmware: Firmware,
        gains: FlightGains | None = None,
        setup: BetaflightSetup | None = None,
    ) -> None:
        self._setup = setup = BetaflightSetup() if setup is None else setup
        self._gains = FlightGains() if gains is None else gains
        self._motors = setup.motors_of(drone)
        self._thrust_max = drone.column('thrust_max')
        self._firmware = firmware
        self._at_rest = FeedForward.at_rest(body)
        self._acceleration = SetPointAcceleration(
            setup.attitude_gain, setup.rate_gain(drone), setup.integral_rate
        )
        self.reset()

    def reset(self) -> None:
        """Forget the integral, and that it is armed."""
        self._push = np.zeros(3)
        self._switched = 0.0
        self._silence = np.inf
        self._thrust = np.zeros(len(self._thrust_max))
        self._is_armed = False
        self.problem = 'Betaflight is not heard: start it before this node'

    def update(
        self, state: FlightState, target: FlightTarget, dt: float, arm: FeedForward | None = None
    ) -> Array:
        """Return the thrusts (n,) [N] that lead to the target, after a step of `dt` [s]."""
        arm = self._at_rest if arm is None else arm
        gains = self._gains
        frequency = gains.position_frequencies
        kp, kd = frequency**2, 2.0 * gains.position_damping * frequency
        error = target.position - state.position
        error = kd / kp * limited(kp / kd * error, gains.speed_max)
        if self._is_armed:
            step = gains.position_integral * frequency * kp * dt * error
            self._push = np.clip(self._push + step, -_INTEGRAL, _INTEGRAL)
        feedback = kp * error + kd * (target.velocity - state.velocity) + self._push
        fed = self._acceleration.update(arm, state.rotation, dt)
        force = arm.body.mass * (target.acceleration + feedback + fed + GRAVITY * _UP)
        turn = target.yaw - yaw_of(state.rotation)
        return self._fly(state, force, float(np.arctan2(np.sin(turn), np.cos(turn))), dt)

    def level(self, state: FlightState, dt: float) -> Array:
        """Return the thrusts (n,) [N] of a drone that knows its attitude only: level, sinking."""
        return self._fly(state, _SINK * self._at_rest.body.mass * GRAVITY * _UP, 0.0, dt)

    def _fly(self, state: FlightState, force: Array, turn: float, dt: float) -> Array:
        channels = [MIDDLE, MIDDLE, LOW, MIDDLE]
        if self._is_armed:
            channels = self._sticks(state, force, turn)
        switch = HIGH if self._is_armed or self._switched > _PAUSE else LOW
        w_last = pin.Quaternion(state.rotation).coeffs()
        felt = state.specific_force
        felt = GRAVITY * state.rotation[2] if felt is None else felt
        sticks = [*channels, switch, HIGH]
        pulses = self._firmware.exchange(sticks, state.rate, felt, np.roll(w_last, 1))
        self._silence = self._silence + dt if pulses is None else 0.0
        if pulses is not None and len(pulses) == len(self._motors):
            shares = np.clip((pulses[self._motors] - LOW) / (HIGH - LOW), 0.0, 1.0)
            self._thrust = shares * self._thrust_max
            self._note_outputs(float(shares.min()), dt)
        if _SILENCE < self._silence < np.inf:
            self.reset()
        return self._thrust

    def _note_outputs(self, least: float, dt: float) -> None:
        """Follow whether it is armed: its motors idle then."""
        self._is_armed = least > 0.5 * self._setup.idle
        self._switched = (self._switched + dt) % (_TRY + _PAUSE)
        self.problem = '' if self._is_armed else 'Betaflight is being armed'

    def _sticks(self, state: FlightState, force: Array, turn: float) -> list[int]:
        """Return roll, pitch, throttle and yaw for a force in the world, and a turn [rad]."""
        setup, heading = self._setup, yaw_of(state.rotation)
        lift = max(force[2], 0.2 * self._at_rest.body.mass * GRAVITY)
        sideways = limited(force[:2], lift * float(np.tan(self._gains.tilt_max)))
        along = pin.exp3(-heading * _UP) @ np.append(sideways, lift)
        thrust = float(np.append(sideways, lift) @ state.rotation[:, 2])
        x, y, z = along / np.linalg.norm(along)
        roll, pitch = np.degrees([-np.arcsin(y), np.arctan2(x, z)]) / setup.angle_limit
        yaw = -np.degrees(_HEADING * turn) / setup.yaw_rate  # to the right is positive
        throttle = setup.throttle(thrust / float(self._thrust_max.sum()))
        return [_pulse(roll), _pulse(pitch), throttle, _pulse(yaw)]


def _pulse(share: float) -> int:
    """Return the pulse [us] of a stick, -1 to 1."""
    return round(MIDDLE + 500.0 * min(max(share, -1.0), 1.0))
