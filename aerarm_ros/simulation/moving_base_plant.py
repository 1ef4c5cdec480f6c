"""The simulated arm on a base that moves as told."""

import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.description.robot import Robot
from aerarm_ros.simulation.arm_plant import SUBSTEP
from aerarm_ros.simulation.base_profile import BaseProfile, BaseState
from aerarm_ros.simulation.free_base_plant import GRAVITY, BaseBody, FreeBasePlant
from aerarm_ros.simulation.plant_parameters import PlantParameters

# The base is so heavy [kg], [kg m^2] that the arm's reaction bends its motion by 1e-5 m/s^2 at
# most; position and velocity are set anew in each sub-step.
_INERTIA = 1e6


class MovingBasePlant(FreeBasePlant):
    """An `ArmPlant` under a body that follows a `BaseProfile` exactly.

    Parameters
    ----------
    robot, parameters, position
        As for `FreeBasePlant`.
    profile
        Motion of the base. It begins when `start` is called.
    """

    def __init__(
        self,
        robot: Robot,
        parameters: PlantParameters,
        position: ArrayLike,
        profile: BaseProfile,
    ) -> None:
        self._profile = profile
        self._start_count: int | None = None
        super().__init__(robot, parameters, position, BaseBody(_INERTIA, _INERTIA * np.eye(3)))

    @property
    def base(self) -> BaseState:
        """State of the base."""
        begun = self._start_count
        return self._profile.evaluate(-1.0 if begun is None else (self._count - begun) * SUBSTEP)

    def start(self) -> None:
        """Let the base's motion begin."""
        self._start_count = self._count

    def step(self) -> None:
        """Advance by one sub-step."""
        self._place_base()
        super().step()

    def _place_base(self) -> None:
        base, data = self.base, self._data
        data.qpos[:3], data.qpos[3:7] = base.position, base.quaternion
        data.qvel[:3], data.qvel[3:6] = base.velocity, base.angular_velocity
        gravity = (1.0 - self._support) * GRAVITY
        data.qfrc_applied[:3] = _INERTIA * (base.acceleration - gravity)
        data.qfrc_applied[3:6] = _INERTIA * base.angular_acceleration
