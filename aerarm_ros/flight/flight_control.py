"""Position and attitude of a drone held by a plain PID."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.drone_config import GRAVITY, DroneConfig
from aerarm_ros.flight.allocation import Allocation
from aerarm_ros.flight.flight_gains import FlightGains
from aerarm_ros.flight.flight_state import FlightState
from aerarm_ros.flight.flight_target import FlightTarget, yaw_of
from aerarm_ros.flight.mass_properties import MassProperties

Array = npt.NDArray[np.float64]

_UP = np.array([0.0, 0.0, 1.0])
# Most that the integrals may add: an acceleration [m/s^2], and a moment over the weight [m], which
# is how far the arm may move the centre of mass aside.
_INTEGRAL_ACCELERATION = 4.0
_INTEGRAL_LEVER = 0.2
_LIFT_MIN = 0.2  # share of the weight
_SINK = 0.97  # share of the weight that is lifted where the height is not known


class FlightControl:
    """A drone with its arm, held at a place by PID with gravity feed-forward.

    The centre of mass in the posture of `body` is held; the arm's motion is a disturbance. A force
    `m (g + Kp e + Kd de + Ki int e)` is asked for, and a moment
    `J (Kp e_R + Kd e_w + Ki int e_R)` about that centre, `e_R` being the attitude's error on
    SO(3) (Lee, Leok and McClamroch, CDC 2010). A drone with rotors in one plane turns its z axis
    along the force; a fully actuated one stays level.

    Parameters
    ----------
    drone : DroneConfig
    body : MassProperties
        Of drone and arm.
    gains : FlightGains, optional
    """

    def __init__(
        self, drone: DroneConfig, body: MassProperties, gains: FlightGains | None = None
    ) -> None:
        self._body = body
        self._gains = gains = FlightGains() if gains is None else gains
        self._allocation = Allocation(drone)
        self._is_full = drone.is_fully_actuated
        self._position_gains = _pid(
            gains.position_frequency, gains.position_damping, gains.position_integral
        )
        self._attitude_gains = _pid(
            gains.attitude_frequency, gains.attitude_damping, gains.attitude_integral
        )
        self._moment_max = _INTEGRAL_LEVER * body.mass * GRAVITY
        self.reset()

    def reset(self) -> None:
        """Forget the integrals."""
        self._push = np.zeros(3)
        self._moment = np.zeros(3)

    def update(self, state: FlightState, target: FlightTarget, dt: float) -> Array:
        """Return the thrusts (n,) [N] that hold the target, after a step of `dt` [s]."""
        acceleration = self._wanted_acceleration(state, target, dt)
        force = self._body.mass * (acceleration + GRAVITY * _UP)
        wanted = _attitude(_UP if self._is_full else force, target.yaw)
        return self._allocation.thrusts(self._wrench(state, force, wanted, dt))

    def level(self, state: FlightState, dt: float) -> Array:
        """Return the thrusts (n,) [N] of a drone that knows its attitude only: level, sinking."""
        force = _SINK * self._body.mass * GRAVITY * _UP
        wanted = _attitude(_UP, yaw_of(state.rotation))
        return self._allocation.thrusts(self._wrench(state, force, wanted, dt))

    def _wanted_acceleration(self, state: FlightState, target: FlightTarget, dt: float) -> Array:
        kp, kd, ki = self._position_gains
        lever = state.rotation @ self._body.centre
        velocity = state.velocity + state.rotation @ np.cross(state.rate, self._body.centre)
        level = _attitude(_UP, target.yaw) @ self._body.centre
        error = target.position + level - (state.position + lever)
        error = _limited(error, self._gains.speed_max * kd / kp)
        self._push = _limited(self._push + ki * dt * error, _INTEGRAL_ACCELERATION)
        wanted = kp * error - kd * velocity + self._push
        sideways = _limited(wanted * (1.0, 1.0, 0.0), GRAVITY * np.tan(self._gains.tilt_max))
        rise = max(wanted[2], (_LIFT_MIN - 1.0) * GRAVITY)
        return np.array([sideways[0], sideways[1], rise])

    def _wrench(self, state: FlightState, force: Array, wanted: Array, dt: float) -> Array:
        """Return the wrench on the body at its origin, in its axes."""
        kp, kd, ki = self._attitude_gains
        rotation, inertia = state.rotation, self._body.inertia
        turn = rotation.T @ wanted - wanted.T @ rotation
        error = 0.5 * np.array([turn[2, 1], turn[0, 2], turn[1, 0]])
        self._moment = _limited(self._moment + ki * dt * (inertia @ error), self._moment_max)
        moment = inertia @ (kp * error - kd * state.rate) + self._moment
        in_body = rotation.T @ force
        if not self._is_full:
            in_body = in_body * _UP
        return np.concatenate([in_body, moment + np.cross(self._body.centre, in_body)])


def _pid(frequency: float, damping: float, integral: float) -> tuple[float, float, float]:
    """Return gains per mass or inertia: [1/s^2], [1/s], [1/s^3]."""
    kp = frequency**2
    return kp, 2.0 * damping * frequency, integral * frequency * kp


def _attitude(up: Array, yaw: float) -> Array:
    """Return the rotation whose z axis is along `up` and whose heading is `yaw` [rad]."""
    z = up / np.linalg.norm(up)
    y = np.cross(z, [np.cos(yaw), np.sin(yaw), 0.0])
    y /= np.linalg.norm(y)
    return np.column_stack([np.cross(y, z), y, z])


def _limited(vector: Array, length: float) -> Array:
    """Return a vector that is no longer than that."""
    norm = float(np.linalg.norm(vector))
    return vector if norm <= length else vector * (length / norm)
