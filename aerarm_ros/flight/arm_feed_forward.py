"""What a drone is told of its arm, made ready for its flight controller."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.checks.rejected_input_error import RejectedInputError
from aerarm_ros.control.compensation.fade import Fade
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.flight.feed_forward import FeedForward
from aerarm_ros.flight.mass_properties import MassProperties
from aerarm_ros.flight.stamped_values import StampedValues
from aerarm_ros.model.cross_product import cross

Array = npt.NDArray[np.float64]

HOLD = 0.05  # [s] for which the last that was told stands for what comes after it
_FADE = 0.1  # [s]
_SPACING = 0.012  # [s] of the differences that are derivatives
_STEP_MAX = 0.05  # [s]
_MASS_MAX = 3.0  # of the drone's; of an arm that is heavier something is wrong
_ROUNDING = 1e-9  # [m^2]
_REACH = 3.0  # [m] its centre is nearer, or was told in another unit


class ArmFeedForward:
    """Takes stamped mass properties and wrenches of the arm, and tells those of a time.

    What is told of a posture is kept until it is told anew; a motion that is no longer told fades.

    Parameters
    ----------
    drone : DroneConfig
    body : MassProperties
        Of drone and arm, until the arm's are told, and where the posture is not used.
    use_posture, use_motion : bool
    lead : float

    Attributes
    ----------
    use_posture, use_motion : bool
        What is used; may be changed.
    lead : float
        From a command until it acts [s]; may be changed.
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
        self._fade = Fade(_FADE, share=0.0)
        self._last = FeedForward.at_rest(body)
        self._time = -np.inf

    def offer_inertia(self, stamp: float, mass: float, com: Array, inertia: Array) -> None:
        """Take mass properties of the arm about a time [s], in its base's frame.

        Raises
        ------
        RejectedInputError
            If no body has them.
        """
        numbers = np.concatenate([[mass], com, inertia.ravel()])
        if not np.isfinite(numbers.sum()) or not 0.0 < mass < _MASS_MAX * self._drone.mass:
            raise RejectedInputError(f'arm_inertia: {mass:.3g} kg under a drone, or NaN')
        if np.linalg.norm(com) > _REACH or np.linalg.eigvalsh(inertia)[0] < -_ROUNDING * mass:
            raise RejectedInputError(
                f'arm_inertia: its centre is more than {_REACH:g} m away, or it has less than no '
                'moment of inertia'
            )
        self._arm.add(stamp, numbers)

    def offer_motion(self, stamp: float, wrench: Array) -> None:
        """Take the wrench (6,) of the joints' motion about a time [s], in the arm's base frame.

        Raises
        ------
        RejectedInputError
            If it is not finite, or larger than any motion's.
        """
        if not np.isfinite(wrench.sum()) or np.abs(wrench).max() > 100.0 * self._drone.mass:
            raise RejectedInputError('base_wrench_motion: NaN, or no force or moment of this arm')
        force, moment = self._rotation @ wrench[:3], self._rotation @ wrench[3:]
        self._motion.add(stamp, np.concatenate([force, moment + cross(self._mount, force)]))

    @property
    def newest(self) -> float | None:
        """Time of the newest that was told of the arm [s], None before the first."""
        times = [told.newest for told in (self._arm, self._motion) if told.newest is not None]
        return max(times, default=None)

    def is_late(self, now: float) -> bool:
        """Return whether the arm is told, but not yet as far ahead as `now` [s] needs."""
        ahead = now + self.lead
        needs = (
            (self.use_posture, self._arm.newest, ahead),
            (self.use_motion, self._motion.newest, ahead + _SPACING),
        )
        return any(used and newest is not None and newest < need for used, newest, need in needs)

    def at(self, now: float) -> FeedForward:
        """Return what is to be fed forward at `now` [s]."""
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
        if share == 1.0:
            return self._last
        return FeedForward(body, share * wrench, *(share * force for force in forces))

    def _motion_at(self, now: float) -> tuple[Array, Array, Array, Array] | None:
        """Return the wrench then and now, its force's derivatives, None if they are not told."""
        ahead, motion = now + self.lead, self._motion
        wrench = motion.at(ahead)
        if wrench is None:
            return None
        h = _SPACING
        here = motion.at(now)
        parts = [motion.between(time) for time in (now - h, now + h, ahead - h, ahead + h)]
        if here is None or any(part is None for part in parts):
            # Not told far enough ahead: it leans for what is, and turns for nothing.
            return wrench, wrench, np.zeros(3), np.zeros(3)
        before, after, earlier, later = (part[:3] for part in parts if part is not None)
        rate = (after - before) / (2.0 * h)
        curvature = (earlier - 2.0 * wrench[:3] + later) / h**2
        return wrench, here, rate, curvature
