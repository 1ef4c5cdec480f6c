"""Check of a motion's limits and clearances, independent of the planner's own check."""

from dataclasses import dataclass

import numpy as np
from mujoco_arm import MujocoArm
from numpy.typing import ArrayLike

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.excitation.settings import ExcitationConfig
from aerarm_ros.motion.signals import JointMotion

STEP = 0.37e-3  # [s] step, more than twice as dense as the planner's checks
LOOK = 5e-3  # [s] between two checks of distances


@dataclass(frozen=True)
class DenseResult:
    """Largest used fraction of a limit, and least distance beyond the required ones [m]."""

    use: float
    clearance: float

    @property
    def is_kept(self) -> bool:
        """Return whether every limit and clearance is kept."""
        return self.use <= 1.0 and self.clearance >= -1e-5


class DenseCheck:
    """Position, velocity, acceleration, torque and current by MuJoCo; distances by MuJoCo.

    Parameters
    ----------
    robot, config, surroundings
        The arm in its planner's model, and its surroundings.
    rotor_inertia : (n,) ndarray
        [kg m^2]
    load_friction : (n,) array_like
        Dry friction per transmitted torque [-].
    velocity_share, effort_share : float
        Usable fraction of velocity and acceleration limits, and of torque and current limits.
    """

    def __init__(
        self,
        robot: Robot,
        config: ArmConfig,
        surroundings: ExcitationConfig,
        rotor_inertia: np.ndarray,
        load_friction: ArrayLike,
        velocity_share: float = 0.9,
        effort_share: float = 0.8,
    ) -> None:
        assert surroundings.ground_height is not None
        self._arm = MujocoArm(robot, rotor_inertia, surroundings.ground_height)
        self._friction = robot.viscous, robot.coulomb, np.asarray(load_friction)
        self._rotors = rotor_inertia
        self._required = surroundings.self_clearance, surroundings.ground_clearance
        low, high = config.column('position_min'), config.column('position_max')
        self._middle, self._half = (low + high) / 2, (high - low) / 2
        self._velocity = velocity_share * config.column('velocity_max')
        self._acceleration = velocity_share * config.column('acceleration_max')
        current = config.column('motor.current_max') * config.column('torque_per_ampere')
        self._effort = effort_share * np.minimum(config.column('effort_max'), current)

    def __call__(self, motion: JointMotion) -> DenseResult:
        """Return the used fraction of the limits, and the distances, of a motion."""
        q, dq, ddq = motion.evaluate(np.append(np.arange(0, motion.duration, STEP), 0.0))
        shares = (
            np.abs(q - self._middle) / self._half,
            np.abs(dq) / self._velocity,
            np.abs(ddq) / self._acceleration,
            np.abs(self._torque(q, dq, ddq)) / self._effort,
        )
        looks = motion.evaluate(np.append(np.arange(0, motion.duration, LOOK), motion.duration)).q
        nearest = np.min([self._arm.distances(row) for row in looks], axis=0)
        return DenseResult(float(np.max(shares)), float(np.min(nearest - self._required)))

    def _torque(self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        viscous, coulomb, load = self._friction
        torque = np.array([self._arm.effort(*row) for row in zip(q, dq, ddq, strict=True)])
        links = torque - viscous * dq - coulomb * np.sign(dq) - self._rotors * ddq
        return torque + load * np.abs(links) * np.sign(dq)
