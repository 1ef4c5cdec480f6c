"""The checks and the planner of one arm, from its description and configuration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.excitation.clearance.clearance_checker import ClearanceChecker
from aerarm_ros.excitation.feasibility.effort_model import EffortModel
from aerarm_ros.excitation.feasibility.feasibility_checker import FeasibilityChecker
from aerarm_ros.excitation.feasibility.stop_limits import StopLimits
from aerarm_ros.excitation.planning.excitation_planner import ExcitationPlanner
from aerarm_ros.excitation.planning.random_trajectory import RandomTrajectory
from aerarm_ros.excitation.settings.excitation_config import ExcitationConfig
from aerarm_ros.excitation.settings.excitation_error import ExcitationError
from aerarm_ros.excitation.settings.motion_limits import MotionLimits, one_a_joint
from aerarm_ros.excitation.trajectory.transfer import standstill
from aerarm_ros.motion.float_array import FloatArray


@dataclass(frozen=True, eq=False)
class ExcitationSetup:
    """What is needed to find, check and plan excitations of one arm.

    Can be sent to another process, which builds its own checks.

    Parameters
    ----------
    robot : the arm.
    config : usable shares of the limits, surroundings.
    limits : the arm's limits, whole.
    rotor_inertia : (n,) reflected to the joints [kg m^2].
    torque_per_ampere : (n,) joint torque per motor current [Nm/A], infinite if unknown.
    package_directories : where `package://` meshes are looked for.
    """

    robot: Robot
    config: ExcitationConfig
    limits: MotionLimits
    rotor_inertia: FloatArray
    torque_per_ampere: FloatArray
    package_directories: tuple[Path, ...] = ()

    @classmethod
    def of_arm(cls, robot: Robot, arm: ArmConfig, config: ExcitationConfig) -> ExcitationSetup:
        """Return the setup of an arm whose drive train is configured."""
        return cls(
            robot,
            config,
            MotionLimits.of_arm(arm),
            arm.column('reflected_inertia'),
            arm.column('torque_per_ampere'),
        )

    @classmethod
    def of_robot(
        cls,
        robot: Robot,
        config: ExcitationConfig,
        package_directories: Sequence[Path] = (),
        acceleration_limit: ArrayLike = np.inf,
        current_limit: ArrayLike = np.inf,
        torque_per_ampere: ArrayLike = np.inf,
    ) -> ExcitationSetup:
        """Return the setup of any arm from its URDF, without rotor inertia.

        Parameters
        ----------
        robot, config, package_directories : as in the class.
        acceleration_limit, current_limit : what a URDF does not know, see `MotionLimits`.
        torque_per_ampere : joint torque per motor current [Nm/A], one for all joints or (n,).

        Raises
        ------
        ExcitationError
            If a number of values fits neither one nor all joints, a value is not positive, or
            current is limited but cannot be told from the torque.
        """
        limits = MotionLimits.of_robot(robot, acceleration_limit, current_limit)
        per_ampere = one_a_joint('torque per ampere', torque_per_ampere, robot.n)
        if not (per_ampere > 0.0).all():
            raise ExcitationError(f'torque per ampere must be positive, got {per_ampere.min()}')
        if np.isfinite(limits.current).any() and not np.isfinite(per_ampere).all():
            raise ExcitationError('a current limit needs the torque per ampere of each joint')
        return cls(robot, config, limits, np.zeros(robot.n), per_ampere, tuple(package_directories))

    @cached_property
    def usable_limits(self) -> MotionLimits:
        """The share of the limits an excitation may use."""
        config = self.config
        return self.limits.scaled(config.position_share, config.velocity_share, config.effort_share)

    @cached_property
    def effort_model(self) -> EffortModel:
        """Prior model of torque and current."""
        return EffortModel(self.robot, self.rotor_inertia, self.torque_per_ampere)

    @cached_property
    def clearance(self) -> ClearanceChecker:
        """Distances to keep; building it raises ExcitationError without collision shapes."""
        return ClearanceChecker(
            self.robot,
            self.config.self_clearance,
            self.config.ground_clearance,
            self.config.ground_height,
            self.package_directories,
            self.config.unchecked_pairs,
        )

    @cached_property
    def stops(self) -> StopLimits:
        """What a stop anywhere on a motion may ask of the joints: the whole limits."""
        return StopLimits(self.limits, self.effort_model)

    @cached_property
    def checker(self) -> FeasibilityChecker:
        """Limits of the excitation."""
        return FeasibilityChecker(
            self.usable_limits,
            self.clearance,
            self.effort_model,
            self.config.highest_frequency,
            stops=self.stops,
        )

    @cached_property
    def planner(self) -> ExcitationPlanner:
        """From any posture through an excitation and back."""
        transfers = FeasibilityChecker(
            self.limits, self.clearance, self.effort_model, stops=self.stops
        )
        return ExcitationPlanner(
            self.checker, transfers, self.config.ramp_time, self.config.transfer_share
        )

    def random_trajectory(
        self, amplitude: float, fundamental: float, harmonics: int
    ) -> RandomTrajectory:
        """Return the distribution of random trajectories about the configured bias.

        Parameters
        ----------
        amplitude : largest coefficient [rad].
        fundamental : f0 [Hz].
        harmonics : N.
        """
        return RandomTrajectory(
            self.config.bias_of(self.robot),
            self.config.bias_spread_of(self.robot),
            amplitude,
            fundamental,
            harmonics,
        )

    def require_bias(self) -> None:
        """Check the centre of the motion if one is configured: limits, gravity, clearance.

        Without one, random trajectories are drawn about many postures.

        Raises
        ------
        ConfigError
            If it does not have one finite value a joint.
        InfeasibleError
            If the arm may not rest there; names the limit that binds.
        """
        centre = self.config.bias_of(self.robot)
        if self.config.bias is not None:
            report = self.checker.check(standstill(centre))
            report.require('the centre of the motion (bias)')

    def __getstate__(self) -> dict[str, Any]:
        # Collision geometry and solver data cannot be sent; they are built again when needed.
        return {field.name: getattr(self, field.name) for field in fields(self)}
