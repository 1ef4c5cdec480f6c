"""Control of position and attitude of a drone with its arm, on SE(3)."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.checks import non_negative_number, positive
from aerarm_ros.description.drone_config import GRAVITY, DroneConfig
from aerarm_ros.flight.arm_load import FeedForward, MassProperties
from aerarm_ros.flight.flight_state import FlightState, FlightTarget, yaw_of
from aerarm_ros.model.inertia import cross
from aerarm_ros.motion.signals import Array, limited

# Components with priority: lift, and the moments that keep the drone upright.
_FIRST = np.array([False, False, True, True, True, False])
_HALVINGS = 10
_TURN = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1e3])  # [Nm], more than any rotors can give


class Allocation:
    """Distributes a wrench to the rotors, within their limits.

    If the rotors cannot give the whole wrench, the moments about the horizontal axes have
    priority, then lift. The moment about the vertical and horizontal forces follow, scaled down
    together.

    Parameters
    ----------
    drone : DroneConfig
        A drone with rotors in one plane gets no horizontal force.

    Attributes
    ----------
    matrix : (6, n) ndarray
        Wrench per thrust on the body at its frame's origin.
    """

    def __init__(self, drone: DroneConfig) -> None:
        self.matrix = matrix = drone.allocation
        rows = np.ones(6, dtype=bool)
        if not drone.is_fully_actuated:
            rows[:2] = False
        inverse = np.zeros((drone.n, 6))
        inverse[:, rows] = np.linalg.pinv(matrix[rows])
        self._lift = inverse[:, 2]
        self._tilt = inverse[:, 3:5]
        self._rest = inverse[:, ~_FIRST]
        self._min, self._max = drone.column('thrust_min'), drone.column('thrust_max')

    def thrusts(self, wrench: Array) -> Array:
        """Return the thrusts (n,) [N] that produce a wrench (6,) about the body frame's origin."""
        first = self._first(wrench[2] * self._lift, self._tilt @ wrench[3:5])
        rest = self._rest @ wrench[~_FIRST]
        low, high = self._min - first, self._max - first
        with np.errstate(divide='ignore', invalid='ignore'):
            shares = np.where(rest > 0.0, high / rest, np.where(rest < 0.0, low / rest, 1.0))
        share = min(1.0, max(0.0, float(shares.min())))
        thrusts: Array = np.clip(first + share * rest, self._min, self._max)
        return thrusts

    def turning_moment(self, body: MassProperties) -> float:
        """Return the largest vertical moment [Nm] that the rotors can add to a hover."""
        weight = body.mass * GRAVITY
        force = np.array([0.0, 0.0, weight])
        hover = np.concatenate([force, cross(body.centre, force)])
        most = [abs(self.matrix[5] @ self.thrusts(hover + turn)) for turn in (-_TURN, _TURN)]
        return float(min(most))

    def _first(self, lift: Array, tilt: Array) -> Array:
        """Return thrusts for lift and tilting moment within limits; the moment has priority."""
        if (scale := self._scale(lift, tilt)) is not None:
            return scale * lift + tilt
        thrusts: Array = np.clip(lift, self._min, self._max)
        share, step = 0.0, 0.5
        for _ in range(_HALVINGS):
            if (scale := self._scale(lift, (share + step) * tilt)) is not None:
                share += step
                thrusts = scale * lift + share * tilt
            step *= 0.5
        return thrusts

    def _scale(self, lift: Array, tilt: Array) -> float | None:
        """Return the factor on the lift, as close to 1 as possible, that permits the moment."""
        used = np.abs(lift) > 1e-9
        if np.any(tilt[~used] > self._max[~used]) or np.any(tilt[~used] < self._min[~used]):
            return None
        ends = np.array([self._min - tilt, self._max - tilt])[:, used] / lift[used]
        low, high = float(ends.min(axis=0).max()), float(ends.max(axis=0).min())
        return None if low > high else min(max(1.0, low), high)


@dataclass(frozen=True)
class FlightGains:
    """Desired closed-loop frequencies and damping of position and attitude.

    The attitude loop includes the rotors' lag of some 25 ms, so its frequency times that lag must
    be well below one. The position loop includes the attitude loop, so it is about four times
    slower. Lift needs no tilt, so the height loop can be stiffer.

    Attributes
    ----------
    position_frequency, height_frequency, attitude_frequency : float
        Undamped natural frequencies [rad/s] of horizontal position, height and attitude.
    position_damping, attitude_damping : float
        Damping ratio [-].
    position_integral, attitude_integral : float
        Rate of the loop's integral as a fraction of the loop's frequency [-].
    speed_max : float
        Largest speed toward a distant set point [m/s].
    tilt_max : float
        Largest commanded tilt [rad].

    Raises
    ------
    ValueError
        If an integral is negative, or another value is not positive.
    """

    position_frequency: float = 2.0
    height_frequency: float = 3.0
    attitude_frequency: float = 9.0
    position_damping: float = 0.9
    attitude_damping: float = 0.8
    position_integral: float = 0.3
    attitude_integral: float = 0.2
    speed_max: float = 1.0
    tilt_max: float = 0.5

    def __post_init__(self) -> None:
        """Check that every value is in its range."""
        for name, value in vars(self).items():
            if name.endswith('_integral'):
                non_negative_number(name, value)
            else:
                positive(name, value)

    @property
    def position_frequencies(self) -> npt.NDArray[np.float64]:
        """Frequencies of the position loop along the world's axes, (3,) [rad/s]."""
        return np.array([self.position_frequency, self.position_frequency, self.height_frequency])


_PUSH_MAX = 3.0  # [m/s^2] largest integral action of a `PositionLoop`


class PositionLoop:
    """PID control of the position in front of a firmware that controls the attitude.

    Parameters
    ----------
    gains : FlightGains
        Gains of the position loop, and the largest speed toward a set point.
    """

    def __init__(self, gains: FlightGains) -> None:
        self._speed_max = gains.speed_max
        frequency = gains.position_frequencies
        self._gains = _pid(frequency, gains.position_damping, gains.position_integral)
        self.reset()

    def reset(self) -> None:
        """Reset the integral."""
        self._push = np.zeros(3)

    def update(self, state: FlightState, target: FlightTarget, dt: float) -> Array:
        """Return the acceleration (3,) [m/s^2] toward a target; `dt` is a step [s]."""
        kp, kd, ki = self._gains
        error = target.position - state.position
        error = kd / kp * limited(kp / kd * error, self._speed_max)
        self._push = np.clip(self._push + ki * dt * error, -_PUSH_MAX, _PUSH_MAX)
        return np.asarray(kp * error + kd * (target.velocity - state.velocity) + self._push)


_UP = np.array([0.0, 0.0, 1.0])
_SIDEWAYS = np.array([1.0, 1.0, 0.0])
# Limits of integrals: an acceleration [m/s^2], and a moment over the weight [m],
# which is the largest sideways shift of the centre of mass by the arm.
_CORRECTION = 4.0
_CORRECTION_LEVER = 0.2
# Rotors turn a drone about the vertical by little more than their drag. A moment beyond that must
# neither tilt the drone [rad] nor add to the integral [m]. The feedback of the heading uses at most
# a fraction of that moment, because more would only switch between the limits.
_YAW_STEP, _YAW_LEVER = 0.2, 0.01
_YAW_SHARE = 0.25
_YAW_MISSED = 0.01  # [rad/s^2]
_LIFT_MIN = 0.2  # fraction of the weight
_SINK = 0.97  # lifted fraction of the weight without a known height


class FlightControl:
    """Flight controller that holds a drone with its arm at a position, or moves it along a path.

    The controlled point is the common centre of mass. The target of the centre of mass is its
    position while the level body is at the body's target. A tilted body is therefore displaced
    from the body's target. The force f_a and the moment m_a are those of the joints' motion, e is
    the position error, and a_d the target's acceleration::

        F = m (g + a_d + Kp e + Kd de + Ki int e) - f_a
        M = J (a_R + Kp e_R + Kd e_w) + w x J w + Ki int e_R - m_a

    M, J and m_a are about the centre of mass.

    `e_R` is the attitude's error on SO(3) (Lee, Leok and McClamroch, CDC 2010). A drone with rotors
    in one plane turns its z axis along the force. `e_w` and `a_R` follow from the rate of the
    planned force and of the heading. A fully actuated drone stays level. If the rotors cannot give
    the moment about the vertical, only the heading error grows. The stiffness of the heading is
    limited by the rotors' moment.

    Parameters
    ----------
    body : MassProperties
        Default mass properties of drone and arm.

    Attributes
    ----------
    problem : str
        Reason why the rotors must not be commanded; always empty for this law.
    """

    problem = ''

    def __init__(
        self, drone: DroneConfig, body: MassProperties, gains: FlightGains | None = None
    ) -> None:
        self._at_rest = FeedForward.at_rest(body)
        self._gains = gains = FlightGains() if gains is None else gains
        self._allocation = Allocation(drone)
        self._is_full = drone.is_fully_actuated
        self._position_gains = _pid(
            gains.position_frequencies, gains.position_damping, gains.position_integral
        )
        stiffness = self._allocation.turning_moment(body) / (body.inertia[2, 2] * _YAW_STEP)
        heading = min(gains.attitude_frequency, float(np.sqrt(_YAW_SHARE * stiffness)))
        self._attitude_gains = _pid(
            np.array([*[gains.attitude_frequency] * 2, heading]),
            gains.attitude_damping,
            gains.attitude_integral,
        )
        self._moment_max = _CORRECTION_LEVER * body.mass * GRAVITY
        self._yaw_max = _YAW_LEVER * body.mass * GRAVITY
        self._push = np.zeros(3)
        self._moment = np.zeros(3)

    def update(
        self, state: FlightState, target: FlightTarget, dt: float, arm: FeedForward | None = None
    ) -> Array:
        """Return the rotors' thrusts (n,) [N] for flight to the target; `dt` [s] is one step."""
        arm = self._at_rest if arm is None else arm
        body, heading = arm.body, yaw_of(state.rotation)
        # The arm turns with the body, so use the measured heading.
        level = _attitude(_UP, heading)
        yaw = heading + min(max(_turned(target.yaw - heading), -_YAW_STEP), _YAW_STEP)
        feedback = self._wanted_acceleration(state, target, body, level, dt)
        now = self._bounded(body.mass * feedback - level @ arm.wrench_now[:3], body.mass)
        ahead = self._bounded(body.mass * feedback - level @ arm.wrench[:3], body.mass)
        if self._is_full:
            return self._thrusts(state, arm, ahead, _attitude(_UP, yaw), np.zeros((2, 3)), dt)
        # A plan in body axes rotates with the body's heading.
        turn = _heading_rate(state)
        rate = arm.force_rate + cross(turn, arm.wrench_now[:3])
        passing = cross(turn, 2.0 * arm.force_rate + cross(turn, arm.wrench[:3]))
        turning = _turning(now, -level @ rate, -level @ (arm.force_curvature + passing))
        return self._thrusts(state, arm, ahead, _attitude(now, yaw), turning, dt)

    def level(self, state: FlightState, dt: float) -> Array:
        """Return thrusts (n,) [N] for a level descent, used if the position is unknown."""
        force = _SINK * self._at_rest.body.mass * GRAVITY * _UP
        wanted = _attitude(_UP, yaw_of(state.rotation))
        return self._thrusts(state, self._at_rest, force, wanted, np.zeros((2, 3)), dt)

    def _wanted_acceleration(
        self,
        state: FlightState,
        target: FlightTarget,
        body: MassProperties,
        level: Array,
        dt: float,
    ) -> Array:
        kp, kd, ki = self._position_gains
        lever = state.rotation @ body.centre
        velocity = state.velocity + state.rotation @ cross(state.rate, body.centre)
        # The target of the centre rotates with the heading.
        turn = _heading_rate(state)
        moving = cross(turn, level @ body.centre)
        error = target.position + level @ body.centre - (state.position + lever)
        error = kd / kp * limited(kp / kd * error, self._gains.speed_max)
        self._push = limited(self._push + ki * dt * error, _CORRECTION)
        feedback = kp * error + kd * (target.velocity + moving - velocity) + self._push
        swung = cross(turn, moving)
        return target.acceleration + swung + feedback

    def _bounded(self, force: Array, mass: float) -> Array:
        """Return a force plus the weight [N], limited in its tilt and with a least lift."""
        sideways = limited(force * _SIDEWAYS, mass * GRAVITY * np.tan(self._gains.tilt_max))
        lift = max(force[2] + mass * GRAVITY, _LIFT_MIN * mass * GRAVITY)
        return np.array([sideways[0], sideways[1], lift])

    def _integrate(self, step: Array) -> None:
        moment, most = limited(self._moment + step, self._moment_max), self._yaw_max
        self._moment = np.append(moment[:2], min(max(moment[2], -most), most))

    def _thrusts(
        self,
        state: FlightState,
        arm: FeedForward,
        force: Array,
        wanted: Array,
        turning: Array,
        dt: float,
    ) -> Array:
        """Return the thrusts (n,) [N] for a force in world axes and a desired attitude."""
        kp, kd, ki = self._attitude_gains
        rotation, body = state.rotation, arm.body
        inertia = body.inertia
        turn = rotation.T @ wanted - wanted.T @ rotation
        error = 0.5 * np.array([turn[2, 1], turn[0, 2], turn[1, 0]])
        rate, spin = turning @ rotation  # in body axes
        # Per axis: products of inertia must not turn a heading error into a tilt.
        self._integrate(ki * dt * np.diag(inertia) * error)
        spin = spin - cross(state.rate, rate)
        moment = inertia @ (spin + kp * error + kd * (rate - state.rate))
        moment = moment + cross(state.rate, inertia @ state.rate)
        about_centre = arm.wrench[3:] - cross(body.centre, arm.wrench[:3])
        moment = moment + self._moment - about_centre
        in_body = rotation.T @ force
        if not self._is_full:
            in_body = in_body * _UP
        wrench = np.concatenate([in_body, moment + cross(body.centre, in_body)])
        thrusts = self._allocation.thrusts(wrench)
        missing = (self._allocation.matrix[5] @ thrusts - wrench[5]) / inertia[2, 2]
        if abs(missing) > _YAW_MISSED:
            # A missing yaw moment must not cause a tilt.
            wrench[3:5] += missing * inertia[:2, 2]
            thrusts = self._allocation.thrusts(wrench)
        return thrusts


def _turned(angle: float) -> float:
    """Return an equivalent angle between -pi and pi [rad]."""
    return float(np.arctan2(np.sin(angle), np.cos(angle)))


def _heading_rate(state: FlightState) -> Array:
    """Return the vertical part (3,) of the angular velocity [rad/s], in world axes."""
    return float(state.rotation[2] @ state.rate) * _UP


def _pid(frequency: Array, damping: float, integral: float) -> tuple[Array, Array, Array]:
    """Return the P, D and I gains per unit of mass or inertia: [1/s^2], [1/s], [1/s^3]."""
    kp = frequency**2
    return kp, 2.0 * damping * frequency, integral * frequency * kp


def _attitude(up: Array, yaw: float) -> Array:
    """Return the rotation whose z axis points along `up` and whose heading is `yaw` [rad]."""
    z = up / np.linalg.norm(up)
    y = cross(z, np.array([np.cos(yaw), np.sin(yaw), 0.0]))
    y /= np.linalg.norm(y)
    return np.column_stack([cross(y, z), y, z])


def _turning(force: Array, rate: Array, curvature: Array) -> Array:
    """Return angular velocity and acceleration (2, 3) of a force's direction, in world axes.

    The result is of first order in the force's rate and has no rotation about the force.
    """
    length = np.linalg.norm(force)
    along = force / length
    turning: Array = np.array([cross(along, rate), cross(along, curvature)]) / length
    return turning
