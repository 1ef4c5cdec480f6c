"""Control of the tool's force on a wall, in one direction, measured by the joint torques."""

from enum import Enum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.base.base_motion_estimator import BaseMotionEstimator
from aerarm_ros.control.base.free_base_estimator import FreeBaseEstimator
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.checks import RejectedInputError, non_negative, positive
from aerarm_ros.control.compensation import FrictionCompensation, MomentumObserver
from aerarm_ros.model.inertia import cross
from aerarm_ros.motion.signals import ArmState, Array, TaskReference
from aerarm_ros.world.base_pose import BasePose
from aerarm_ros.world.world_law import WorldLaw

_LEAST = 0.2  # [N], smallest set force
_FRICTION_MIN = 0.02  # [Nm]
_ACROSS, _ACROSS_SHARE = 0.5, 0.2  # expected force across: [N], and relative to the set force
_RECOIL = 0.03  # [s] for which the reversed force counters that of the rotors after a loss
_LINGER = 0.2  # [s] after a contact for which the observer still contains its force
_TINY = 1e-9
_REGULAR = 1e-2  # [1/N^2] prior of the force along, where it causes no torque
_LAG = 0.015  # [m] by which the reference may precede a tool that does not move
_BEGIN = 0.3  # [s] of the approach before a contact can be detected
_BIAS_TIME = 0.4  # [s] over which the approach averages the bias of the force
_BIAS_SHARE = 0.5  # of contact_force
_EXTRA = 1.0  # [s] beyond the duration of the approach at its speed
_SPEED_TIME = 0.1  # [s] in which the approach reaches its speed
_LOST_SHARE, _LOST_TIME = 0.4, 0.3  # of the set force, and for how long, until contact is lost
# Speed along the force from which the force decreases, and at which it is zero [m/s]; and time at
# the former speed after which the contact counts as lost [s].
_FAST, _FASTEST, _FAST_TIME = 0.04, 0.1, 0.003
_CORRECTION_SHARE, _CORRECTION = 0.5, 1.0  # largest correction: share of the set force, and [N]


class ToolForceObserver(MomentumObserver):
    """Disturbance observer of the joints, which also estimates the force on the tool.

    While a contact is known, a second observer r_m uses the measured motion of the base. With the
    tool's Jacobian `J_q` of the joints, `r_m = J_q^T f` then holds for any motion of the drone.
    The force f follows by least squares, weighted with the dry friction of the joints. The part
    of f across the known direction is assumed small, because the torques of few joints hardly
    separate it from the part along.

    The measured motion only serves the estimate, because a control law that responded to it at
    the bandwidth of the arm would be unstable (`FreeBaseEstimator`). The law and the base's
    estimator receive the force of the plan instead. The residual contains neither the planned
    force nor the estimated part along it.

    Parameters
    ----------
    law : WorldLaw
    dynamics : MovingBaseDynamics
        Dynamics of the law.
    gain : float
        Gain of both observers [1/s].
    base : FreeBaseEstimator or BaseMotionEstimator
        Estimator of the law, which receives the known force.
    measured : BaseMotionEstimator
        Estimator of the base's measured motion.
    friction : FrictionCompensation, optional
        As for `MomentumObserver`.
    dry : (n,) array_like
        Expected error of the friction per joint [Nm].
    """

    def __init__(
        self,
        law: WorldLaw,
        dynamics: MovingBaseDynamics,
        gain: npt.ArrayLike,
        base: BaseMotionEstimator | FreeBaseEstimator | None,
        measured: BaseMotionEstimator,
        friction: FrictionCompensation | None = None,
        dry: npt.ArrayLike = 0.05,
    ) -> None:
        super().__init__(dynamics, gain, friction)
        self.measured = measured
        self._law, self._base = law, base
        self._touched = MomentumObserver(dynamics, gain, friction)
        self._weights = 1.0 / np.maximum(non_negative('dry', dry, dynamics.n), _FRICTION_MIN) ** 2
        self._mobility = np.eye(dynamics.n)
        self._along: Array | None = None
        self._normal = np.zeros(3)
        self._is_touched = False
        self._lingers = self._now = 0.0
        self.expect(1.0)

    def expect(self, across: float) -> None:
        """Set the expected size [N] of forces perpendicular to the known direction."""
        self._prior = 1.0 / across**2

    def look(self, along: Array | None, now: float) -> None:
        """Set the direction (3,) of the force estimate in base axes; None stops the estimate."""
        if along is None or self._along is None:
            self._touched.reset()
        self._along, self._now = along, now
        if along is not None:
            self._normal = along

    def press(self, on_tool: Array | None, place: Array) -> None:
        """Set the known force (3,) [N] on the tool at `place` (3,) [m], both in base axes."""
        self._is_touched = on_tool is not None
        if isinstance(self._base, FreeBaseEstimator):
            force = np.zeros(3) if on_tool is None else on_tool
            self._base.contact = np.concatenate([force, cross(place, force)])

    def update(self, state: ArmState, dt: float, base: BaseMotion | None = None) -> Array:
        """Process a state of the joints, as `MomentumObserver.update` does."""
        law, q = self._law, state.q
        known = state._replace(tau=state.tau + law.jacobian.T @ law.contact)
        super().update(known, dt, base)
        self._lingers = _LINGER if self._is_touched else max(0.0, self._lingers - dt)
        if self._lingers:
            self._mobility = self._dynamics.mobility_matrix(q, base)
        if self._along is not None:
            self._touched.update(state, dt, self.measured.motion(self._now, -0.5 * dt))
        return self.residual

    @property
    def residual(self) -> Array:
        """Joint torque (n,) [Nm] that drive, model and contact do not explain, along +q."""
        residual = self._residual
        if not self._lingers:
            return residual
        row = self._normal @ self._law.task
        yielding = self._mobility @ row
        return np.asarray(residual - (yielding @ residual) / (yielding @ row + _TINY) * row)

    @property
    def speed(self) -> float:
        """Speed of the tool in the world, along the known direction [m/s]."""
        return 0.0 if self._along is None else float(self._along @ self._law.velocity)

    def force(self) -> float:
        """Return the estimated force of the tool along the known direction [N]."""
        along = self._along
        if along is None:
            return 0.0
        jacobian, torque = self._law.jacobian, self._touched.residual
        weighted = jacobian * self._weights
        prior = self._prior * (np.eye(3) - np.outer(along, along)) + _REGULAR * np.eye(3)
        force = np.linalg.solve(weighted @ jacobian.T + prior, weighted @ torque)
        return -float(along @ force)


class ForceSettings(NamedTuple):
    """Settings of `ToolForce`.

    Attributes
    ----------
    force_max : float
        Largest accepted set force [N].
    approach_speed : float
        Speed at which the tool approaches the wall [m/s].
    approach_max : float
        Distance of the approach after which the tool stops without a wall [m].
    contact_force : float
        Force from which the approach counts as contact [N].
    force_ramp : float
        Rate at which the force changes [N/s].
    force_gain : float
        Gain of the force's integral feedback [1/s].
    travel_max : float
        Distance along the force by which the tool may move in contact before it stops [m].
    """

    force_max: float = 10.0
    approach_speed: float = 0.03
    approach_max: float = 0.2
    contact_force: float = 1.5
    force_ramp: float = 5.0
    force_gain: float = 4.0
    travel_max: float = 0.01


class Phase(Enum):
    """Phase of a `ToolForce`."""

    NONE = 'none'
    APPROACH = 'approach'
    CONTACT = 'contact'


class ToolForce:
    """Tool reference along one world direction: approach a wall, then hold a force on the wall.

    The approach moves the tool along the force at constant speed. Its mean force is the bias of
    the estimate. From the first contact on, the position feedback along the force ends, and the
    damping remains. The force is the set force plus the integral of its error::

        F = F_set + gain int(F_set - f) dt

    so that the static force does not depend on the wall's stiffness. Joint friction limits its
    accuracy. If the tool moves too fast or too far along the force, or if the force is missing, the
    control of the force ends. The rotors still give the moment of the lost force for the time of
    their lag. `planned_on_tool` therefore reverses the force for 30 ms.

    Attributes
    ----------
    phase : Phase
    direction : (3,) ndarray
        Direction of the set force on the wall, a unit vector in the world.
    set_force, force : float
        Set force and estimated force on the wall [N].
    planned : float
        Force of the plan at present, for the drone [N].
    reason : str
        Why the last contact ended; empty without a problem.
    """

    def __init__(self, observer: ToolForceObserver, settings: ForceSettings | None = None) -> None:
        self._observer = observer
        self.settings = settings = ForceSettings() if settings is None else settings
        for name, value in zip(settings._fields, settings, strict=True):
            positive(name, value)
        self.direction = np.array([1.0, 0.0, 0.0])
        self.reason = ''
        self._recoil = np.zeros(3)
        self.reset()

    def reset(self) -> None:
        """End the contact."""
        self.phase = Phase.NONE
        self.set_force = self.force = self.planned = 0.0
        self._commanded = self._correction = self._bias = 0.0
        self._along = self._anchor = 0.0
        self._recoils_until = -np.inf
        self._observer.look(None, 0.0)
        self._observer.press(None, np.zeros(3))

    @property
    def is_active(self) -> bool:
        """Whether the tool approaches a wall or is in contact."""
        return self.phase is not Phase.NONE

    @property
    def on_tool(self) -> Array:
        """Known force (3,) [N] on the tool, in world axes."""
        return np.asarray(-self._commanded * self.direction)

    def push(self, force: Array, place: Array, now: float) -> bool:
        """Set the desired force (3,) [N] on the wall, with the tool at `place` (3,) [m].

        Returns
        -------
        bool
            Whether the force is not zero. Call `reset` for a force of zero.

        Raises
        ------
        RejectedInputError
            If the force is too large or too small, or has another direction than that of the
            present contact.
        """
        size, most = float(np.linalg.norm(force)), self.settings.force_max
        if size > most:
            raise RejectedInputError(
                f'tool force of {size:.1f} N is larger than force_max ({most:g} N): reduce it, or '
                'increase force_max as far as drone and wall permit'
            )
        if size == 0.0:
            return False
        if size < _LEAST:
            raise RejectedInputError(
                f'tool force of {size:.2g} N is too small to be measured: send {_LEAST:g} N or '
                'more, or zero to end the contact'
            )
        direction = force / size
        if self.is_active and direction @ self.direction < 0.999:
            raise RejectedInputError(
                'tool force: the direction cannot change during approach and contact: send a '
                'force of zero first'
            )
        self.set_force = size
        self._observer.expect(max(_ACROSS, _ACROSS_SHARE * size))
        if not self.is_active:
            self.phase, self.direction, self.reason = Phase.APPROACH, direction, ''
            self._begun, self._along, self._speed = now, float(direction @ place), 0.0
            self._anchor = self._along
        return True

    def shift(self, moved: Array) -> None:
        """Move the reference by `moved` (3,) [m], as the odometry jumped by this distance."""
        along = float(self.direction @ moved)
        self._along, self._anchor = self._along + along, self._anchor + along

    def update(
        self, reference: TaskReference, pose: BasePose, place: Array, now: float, dt: float
    ) -> TaskReference | None:
        """Return the tool reference, with its motion along the force replaced.

        The result is None if the contact has ended; `reason` then states why.

        Parameters
        ----------
        reference : TaskReference
            Motion of the tool in the world, of which the part across the force remains.
        pose : BasePose
        place : (3,) ndarray
            Present position of the tool in the world [m].
        """
        at, along = float(self.direction @ place), pose.rotation.T @ self.direction
        measured = self._observer.force()
        self.force = measured - self._bias
        if self.phase is Phase.APPROACH:
            self._approach(measured, at, now, dt)
        if self.phase is Phase.CONTACT:
            self._press(at, now, dt)
        if not self.is_active:
            return None
        self._observer.look(along, now)
        if self.phase is Phase.CONTACT:
            self._observer.press(-self._commanded * along, pose.to_base(place))
        speed = self._speed if self.phase is Phase.APPROACH else 0.0
        p, dp, ddp = self.across(reference)
        n = self.direction
        return TaskReference(p + (self._along - n @ p) * n, dp + speed * n, ddp)

    def across(self, reference: TaskReference) -> TaskReference:
        """Return a reference without its velocity and acceleration along the force."""
        p, dp, ddp = reference
        n = self.direction
        return TaskReference(p, dp - (n @ dp) * n, ddp - (n @ ddp) * n)

    def _approach(self, measured: float, at: float, now: float, dt: float) -> None:
        settings = self.settings
        self._speed = min(
            settings.approach_speed, self._speed + dt / _SPEED_TIME * settings.approach_speed
        )
        self._along = min(self._along + dt * self._speed, at + _LAG)
        longest = settings.approach_max / settings.approach_speed + _EXTRA
        if at - self._anchor > settings.approach_max or now - self._begun > longest:
            self.stop(f'no wall within approach_max ({settings.approach_max:g} m)', now)
            return
        if self.force < settings.contact_force:
            if self.force < 0.5 * settings.contact_force:
                # A soft object must not become a bias.
                most = _BIAS_SHARE * settings.contact_force
                bias = self._bias + dt / _BIAS_TIME * (measured - self._bias)
                self._bias = min(max(bias, -most), most)
        elif now - self._begun > _BEGIN:
            self.phase, self._pressed_at = Phase.CONTACT, now
            self._anchor, self._fast_for = at, 0.0
            self.planned = self._commanded = min(self.force, self.set_force)

    def _press(self, at: float, now: float, dt: float) -> None:
        settings = self.settings
        self._along = at
        step = settings.force_ramp * dt
        self.planned += min(max(self.set_force - self.planned, -step), step)
        most = max(_CORRECTION, _CORRECTION_SHARE * self.set_force)
        self._correction += dt * settings.force_gain * (self.planned - self.force)
        self._correction = min(max(self._correction, -most), most)
        self._commanded = max(0.0, self.planned + self._correction)
        if self.force > _LOST_SHARE * self.planned:
            self._pressed_at = now
        speed = self._observer.speed
        self._fast_for = self._fast_for + dt if speed > _FAST else 0.0
        self._commanded *= min(max((_FASTEST - speed) / (_FASTEST - _FAST), 0.0), 1.0)
        if self._fast_for > _FAST_TIME:
            self.stop('the wall gave way, or the tool left the wall', now)
        elif at - self._anchor > settings.travel_max:
            self.stop(f'the wall gave way by more than travel_max ({settings.travel_max:g} m)', now)
        elif now - self._pressed_at > _LOST_TIME:
            self.stop('the tool lost the contact', now)

    def stop(self, reason: str, now: float) -> None:
        """End the contact at `now` [s] because of a problem, which `reason` describes."""
        lost = self.planned * self.direction
        self.reset()
        self._recoil, self._recoils_until = lost, now + _RECOIL
        self.reason = f'{reason}: check the wall, then send the force again'

    def planned_on_tool(self, now: float) -> Array:
        """Return the force (3,) [N] on the tool, in world axes, for the drone's feedforward."""
        if 0.0 <= self._recoils_until - now < _RECOIL:
            return self._recoil
        return np.asarray(-self.planned * self.direction)
