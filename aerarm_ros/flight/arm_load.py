"""Weight, inertia and motion of the arm as a load on the drone, for feedforward."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.control.compensation import Fade
from aerarm_ros.description.drone_config import GRAVITY, DroneConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.flight.flight_state import StampedValues
from aerarm_ros.model.inertia import cross, joined
from aerarm_ros.model.whole_body_dynamics import WholeBodyDynamics
from aerarm_ros.motion.polynomial_path import PolynomialPath
from aerarm_ros.motion.signals import Array, JointReference


@dataclass(frozen=True, eq=False)
class MassProperties:
    """Mass, centre of mass and inertia of drone and arm in one posture.

    Attributes
    ----------
    mass : float
        Total mass [kg].
    centre : (3,) ndarray
        Centre of mass in the body frame [m].
    inertia : (3, 3) ndarray
        Inertia about the centre of mass in body axes [kg m^2].
    """

    mass: float
    centre: Array
    inertia: Array

    @classmethod
    def of(
        cls, drone: DroneConfig, arm_mass: float, arm_centre: Array, arm_inertia: Array
    ) -> 'MassProperties':
        """Return the combined mass properties of drone and arm.

        Parameters
        ----------
        arm_mass : float
            Mass of the arm [kg].
        arm_centre : (3,) ndarray
            Centre of mass in the arm's base frame [m].
        arm_inertia : (3, 3) ndarray
            Inertia of the arm about its centre of mass, in the base frame's axes [kg m^2].
        """
        rotation, mount = drone.mount.rotation, np.array(drone.mount.position)
        body = drone.mass, np.array(drone.centre_of_mass), drone.inertia_matrix
        arm = arm_mass, mount + rotation @ arm_centre, rotation @ arm_inertia @ rotation.T
        return cls(*joined(body, arm))


class FeedForward(NamedTuple):
    """Feedforward data: mass properties of drone and arm, and the wrench of the arm's motion.

    All quantities are in body axes, with moments about the body frame's origin.

    Attributes
    ----------
    body : MassProperties
        Mass properties at the time when a rotor command sent now acts.
    wrench, wrench_now : (6,) ndarray
        Force [N] and moment [Nm] of the joints' motion on the drone. `wrench` is that at the time
        when a rotor command sent now acts, `wrench_now` that at present.
    force_rate, force_curvature : (3,) ndarray
        `force_rate` is the derivative of the force at present [N/s]. `force_curvature` is the
        second derivative when a rotor command sent now acts [N/s^2]. These derivatives determine
        how fast the drone must tilt.
    """

    body: MassProperties
    wrench: Array
    wrench_now: Array
    force_rate: Array
    force_curvature: Array

    @classmethod
    def at_rest(cls, body: MassProperties) -> 'FeedForward':
        """Return the feedforward of an arm at rest, whose motion causes no wrench."""
        zero = np.zeros(3)
        return cls(body, np.zeros(6), np.zeros(6), zero, zero)


class ArmLoad(NamedTuple):
    """Mass properties of the arm at one instant, and its wrenches on the drone.

    The load depends only on posture and motion of the joints, not on the drone's IMU, so its
    feedforward closes no feedback loop. All quantities are in the base frame's axes, with moments
    about its origin and force before moment.

    Attributes
    ----------
    mass : float
        Total mass [kg].
    com : (3,) ndarray
        Centre of mass of the arm [m].
    inertia : (3, 3) ndarray
        Inertia of the arm about its centre of mass [kg m^2].
    weight : (6,) ndarray
        Wrench of the arm's weight on a hovering drone, along the thrust at any tilt. A drone with
        rotors in one plane accelerates along its thrust, so the arm's specific force has that
        direction.
    motion : (6,) ndarray
        Wrench of the joints' own motion, `-(M_bj ddq + c_b)` of `WholeBodyDynamics`.
    """

    mass: float
    com: Array
    inertia: Array
    weight: Array
    motion: Array

    def acceleration(self, drone: DroneConfig) -> Array:
        """Return the acceleration (6,) by the rotors that compensates the arm's motion.

        The result is the acceleration of the arm's base origin [m/s^2], then the angular
        acceleration [rad/s^2], in base axes. Its value is minus `motion`, divided by the inertia of
        drone and arm in this posture.
        """
        body = MassProperties.of(drone, self.mass, self.com, self.inertia)
        rotation, mount = drone.mount.rotation, np.array(drone.mount.position)
        lever = rotation.T @ (mount - body.centre)  # from the centre of mass to the base
        inertia = rotation.T @ body.inertia @ rotation
        force, moment = -self.motion[:3], -self.motion[3:]
        spin = np.linalg.solve(inertia, moment + cross(lever, force))
        return np.concatenate([force / body.mass + cross(spin, lever), spin])


def at_drone_centre(acceleration: Array, drone: DroneConfig) -> Array:
    """Convert an acceleration (6,) of the arm's base to one of the drone's centre of mass.

    The result is in the drone's body axes. Centrifugal terms are neglected, because the body
    rotates slowly.
    """
    rotation = drone.mount.rotation
    linear, spin = rotation @ acceleration[:3], rotation @ acceleration[3:]
    lever = np.array(drone.centre_of_mass) - drone.mount.position
    return np.concatenate([linear + cross(spin, lever), spin])


_STILL = np.zeros(3)


class ArmLoadModel:
    """Computes an `ArmLoad` from the motion of the joints.

    Parameters
    ----------
    robot : Robot
        Model of all bodies that the arm adds to the drone, with the gravity under a level drone.

    Attributes
    ----------
    dynamics : WholeBodyDynamics
        The model, whose payload the caller sets.
    """

    def __init__(self, robot: Robot) -> None:
        self.dynamics = WholeBodyDynamics(robot)
        self._gravity = np.array(robot.gravity_in_base, dtype=float)

    def evaluate(self, motion: JointReference) -> ArmLoad:
        """Return the arm's load for positions, velocities and accelerations of the joints."""
        mass, com, inertia = self.dynamics.composite_inertia(motion.q)
        force = mass * self._gravity
        weight = np.concatenate([force, cross(com, force)])
        return ArmLoad(mass, com, inertia, weight, -self.dynamics.forces(*motion, _STILL)[:6])


# Largest difference [rad], [rad/s] between the arm and a plan that it follows.
_POSTURE, _SPEED = 0.3, 1.5
_FADE = 0.05  # [s] between plan and measurement
_LONGEST = 10.0  # [s] of a plan
_TOO_OLD = 0.5  # [s]; a plan that begins so long before the newest state is outdated


class ArmForecast:
    """Forecast of the joints' motion a preview time ahead, from a plan or from measurements.

    A controller publishes its planned motion, which is available earlier than any estimate. The
    forecast adds the plan's further motion to the arm's present posture. Without a plan, or if the
    arm does not follow it, the posture is extrapolated with its measured velocity. A change between
    plan and extrapolation fades smoothly. Times are stamps of joint states [s].

    Parameters
    ----------
    n : int
        Number of joints.
    lead : float
        Preview time [s].
    use_measured : bool
        Whether to extrapolate the measured motion without a plan. Set it to False for a control
        law that reacts to the drone, because feedforward of the reaction would close a loop.

    Attributes
    ----------
    is_held : bool
        Whether the motors hold the arm; may be changed. The measured motion of a damped arm is not
        used, because such an arm also moves with the drone, as under a law that reacts to it.
    """

    def __init__(self, n: int, lead: float = 0.0, use_measured: bool = True) -> None:
        self.lead = lead
        self.is_held = True
        self._use_measured = use_measured
        self._seen = Fade(_FADE, share=1.0)
        self._n = n
        self._path: PolynomialPath | None = None
        self._begin = -np.inf
        self._fade = Fade(_FADE, share=0.0)
        self._time = -np.inf
        self._trust_problem = 'no plan'

    @property
    def problem(self) -> str:
        """Reason why the forecast ignores the plan; empty while the forecast uses the plan."""
        return self._trust_problem

    def offer(self, begin: float, times: Array, q: Array, dq: Array, ddq: Array) -> None:
        """Set the joints' plan: points (M, n) at times (M,) [s] that increase from 0 at `begin`.

        Raises
        ------
        RejectedInputError
            If the plan has fewer than two points, a number is missing or not finite, or times do
            not rise from 0.
        """
        if q.ndim != 2 or len(times) < 2 or not q.shape == dq.shape == ddq.shape:
            raise RejectedInputError(
                'planned motion: two points or more are needed, each with positions, velocities '
                'and accelerations'
            )
        if q.shape != (len(times), self._n):
            raise RejectedInputError(f'planned motion: each point needs values of {self._n} joints')
        if not np.isfinite(times.sum() + q.sum() + dq.sum() + ddq.sum()):
            raise RejectedInputError('planned motion: all numbers must be finite')
        if times[0] != 0.0 or np.any(np.diff(times) <= 0.0) or times[-1] > _LONGEST:
            raise RejectedInputError(
                f'planned motion: times must increase from 0 to {_LONGEST:g} s at most'
            )
        self._path = PolynomialPath.quintic(times, q, dq, ddq)
        self._begin = begin

    def motion(self, now: float, measured: JointReference) -> JointReference:
        """Return the joints' motion, (n,) each, predicted for the time `now + lead` [s]."""
        step = now - self._time
        self._time = now
        uses = self._use_measured and self.is_held
        self._trust_problem = self._problem(now, measured)
        if not 0.0 <= step < _TOO_OLD:
            # At first, or after a gap, there is no earlier value to fade from.
            self._fade.share = 0.0 if self._trust_problem else 1.0
            self._seen.share = float(uses)
            step = 0.0
        part = self._seen.update(step, uses)
        speed = part * measured.dq
        seen = measured.q + self.lead * speed, speed, part * measured.ddq
        share = self._fade.update(step, not self._trust_problem)
        if share == 0.0 or self._path is None:
            return JointReference(*seen)
        end = (1.0 - 1e-9) * self._path.duration  # at this time the motion still continues
        here = self._path.evaluate(min(now - self._begin, end))
        ahead = self._path.evaluate(min(now + self.lead - self._begin, end))
        planned = measured.q + ahead.q - here.q, ahead.dq, ahead.ddq
        mixed = (share * p + (1.0 - share) * s for p, s in zip(planned, seen, strict=True))
        return JointReference(*mixed)

    def _problem(self, now: float, measured: JointReference) -> str:
        if self._path is None:
            return 'no plan'
        elapsed = now - self._begin
        if elapsed < 0.0 or elapsed + self.lead > self._path.duration:
            if elapsed < -_TOO_OLD or elapsed > self._path.duration + _TOO_OLD:
                self._path = None
            return 'the plan does not cover this time'
        here = self._path.evaluate(elapsed)
        if np.any(np.abs(here.q - measured.q) > _POSTURE):
            return 'the arm is not at its planned position'
        if self._use_measured and np.any(np.abs(here.dq - measured.dq) > _SPEED):
            return 'the arm does not move as planned'
        return ''


HOLD = 0.05  # [s] for which the last received value remains valid
_FEED_FADE = 0.1  # [s]
_SPACING = 0.012  # [s] step of the numerical derivatives
_STEP_MAX = 0.05  # [s]
_MASS_MAX = 3.0  # of the drone's mass; a heavier arm indicates an error
_ROUNDING = 1e-9  # [m^2]
_REACH = 3.0  # [m] largest distance of the centre; a larger one is in another unit


class ArmFeedForward:
    """Stores stamped mass properties and wrenches of the arm, and returns them for a given time.

    The last mass properties apply until new ones arrive. Without new messages the wrench of the
    joints' motion fades to zero.

    Parameters
    ----------
    body : MassProperties
        Mass properties of drone and arm before the first message, and without `use_posture`.
    lead : float
        Time between a rotor command and its effect [s].

    Attributes
    ----------
    use_posture, use_motion : bool
        Whether the arm's mass properties, and the wrench of its motion, are used; may be changed.
    lead : float
        Time between a rotor command and its effect [s]; may be changed.
    """

    def __init__(
        self,
        drone: DroneConfig,
        body: MassProperties,
        use_posture: bool = True,
        use_motion: bool = True,
        lead: float = 0.0,
    ) -> None:
        self._drone = drone
        self.use_posture, self.use_motion = use_posture, use_motion
        self.lead = lead
        self._body = body
        self._rotation = drone.mount.rotation
        self._mount = np.array(drone.mount.position)
        self._arm = StampedValues(HOLD)
        self._motion = StampedValues(HOLD)
        self._contact = StampedValues(HOLD)
        self._pressed = np.zeros(6)
        self._contact_fade = Fade(_FEED_FADE, share=0.0)
        self._fade = Fade(_FEED_FADE, share=0.0)
        self._last = FeedForward.at_rest(body)
        self._time = -np.inf

    def offer_inertia(self, stamp: float, mass: float, com: Array, inertia: Array) -> None:
        """Add mass properties of the arm at a time [s], in the frame of its base.

        Raises
        ------
        RejectedInputError
            If no physical body has such properties.
        """
        numbers = np.concatenate([[mass], com, inertia.ravel()])
        if not np.isfinite(numbers.sum()) or not 0.0 < mass < _MASS_MAX * self._drone.mass:
            raise RejectedInputError(
                f'arm_inertia: mass of {mass:.3g} kg is too large for this drone, not '
                'positive, or NaN'
            )
        if np.linalg.norm(com) > _REACH or np.linalg.eigvalsh(inertia)[0] < -_ROUNDING * mass:
            raise RejectedInputError(
                f'arm_inertia: the centre of mass is more than {_REACH:g} m away, or a moment of '
                'inertia is negative'
            )
        self._arm.add(stamp, numbers)

    def offer_motion(self, stamp: float, wrench: Array) -> None:
        """Add the wrench (6,) of the joints' motion at a time [s], in the arm's base frame.

        Raises
        ------
        RejectedInputError
            If the wrench is not finite, or too large for any motion.
        """
        most = 100.0 * self._drone.mass
        self._motion.add(stamp, self._in_body('base_wrench_motion', wrench, most))

    def offer_contact(self, stamp: float, wrench: Array) -> None:
        """Add the wrench (6,) that a planned contact exerts, in the arm's base frame.

        The wrench acts from now on, without preview: the end of a contact is not known before.

        Raises
        ------
        RejectedInputError
            If the wrench is not finite, or a force or moment is larger than the drone's weight [N]
            or [Nm].
        """
        most = GRAVITY * self._drone.mass
        self._contact.add(stamp, self._in_body('planned_contact', wrench, most))

    def _in_body(self, what: str, wrench: Array, most: float) -> Array:
        """Check a wrench (6,), and convert it from the arm's base frame to the drone's body."""
        if not np.isfinite(wrench.sum()) or np.abs(wrench).max() > most:
            raise RejectedInputError(
                f'{what}: a force or moment is NaN, or too large for this drone and arm'
            )
        force, moment = self._rotation @ wrench[:3], self._rotation @ wrench[3:]
        return np.concatenate([force, moment + cross(self._mount, force)])

    @property
    def newest(self) -> float | None:
        """Time of the newest forecast of the arm [s], None before the first."""
        times = [stored.newest for stored in (self._arm, self._motion) if stored.newest is not None]
        return max(times, default=None)

    @property
    def preview(self) -> float:
        """Time [s] by which a forecast of the arm's motion must precede the motion."""
        return self.lead + _SPACING

    def is_late(self, now: float) -> bool:
        """Return whether the forecast ends before the time that a command at `now` [s] needs."""
        needs = (
            (self.use_posture, self._arm.newest, now + self.lead),
            (self.use_motion, self._motion.newest, now + self.preview),
        )
        return any(used and newest is not None and newest < need for used, newest, need in needs)

    def at(self, now: float) -> FeedForward:
        """Return the arm's feedforward for a rotor command that is sent at `now` [s]."""
        step = min(max(now - self._time, 0.0), _STEP_MAX)
        self._time = now
        last = self._last
        body = last.body if self.use_posture else self._body
        if self.use_posture and (numbers := self._arm.at(now + self.lead)) is not None:
            mass, com, inertia = numbers[0], numbers[1:4], numbers[4:].reshape(3, 3)
            body = MassProperties.of(self._drone, float(mass), com, inertia)
        known = self._motion_at(now) if self.use_motion else None
        share = self._fade.update(step, known is not None)
        wrench, *forces = last[1:] if known is None else known
        self._last = FeedForward(body, wrench, *forces)
        fed = self._last
        if share != 1.0:
            fed = FeedForward(body, share * wrench, *(share * force for force in forces))
        return self._with_contact(fed, now, step)

    def _with_contact(self, fed: FeedForward, now: float, step: float) -> FeedForward:
        """Add the wrench of the planned contact, which fades out without new messages."""
        pressed = self._contact.at(now) if self.use_motion else None
        share = self._contact_fade.update(step, pressed is not None)
        if pressed is not None:
            self._pressed = pressed
            share = self._contact_fade.share = 1.0
        if share == 0.0:
            return fed
        wrench = share * self._pressed
        return fed._replace(wrench=fed.wrench + wrench, wrench_now=fed.wrench_now + wrench)

    def _motion_at(self, now: float) -> tuple[Array, Array, Array, Array] | None:
        """Return the motion's wrenches at `now + lead` and `now`, and the force's derivatives."""
        ahead, motion = now + self.lead, self._motion
        wrench = motion.at(ahead)
        if wrench is None:
            return None
        h = _SPACING
        here = motion.at(now)
        parts = [motion.between(time) for time in (now - h, now + h, ahead - h, ahead + h)]
        if here is None or any(part is None for part in parts):
            # With too short a forecast, compensate the present force without its derivatives.
            return wrench, wrench, np.zeros(3), np.zeros(3)
        before, after, earlier, later = (part[:3] for part in parts if part is not None)
        rate = (after - before) / (2.0 * h)
        curvature = (earlier - 2.0 * wrench[:3] + later) / h**2
        return wrench, here, rate, curvature
