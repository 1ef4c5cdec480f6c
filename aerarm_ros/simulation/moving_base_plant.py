"""The simulated arm on a base that moves as told."""

from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.description.robot import Robot
from aerarm_ros.simulation.arm_plant import SUBSTEP, ArmPlant, Array
from aerarm_ros.simulation.base_profile import BaseProfile, BaseState
from aerarm_ros.simulation.plant_parameters import PlantParameters

_GRAVITY = np.array([0.0, 0.0, -9.81])
# The base is so heavy [kg], [kg m^2] that the arm's reaction bends its motion by 1e-5 m/s^2 at
# most; position and velocity are set anew in each sub-step.
_BASE_INERTIA = 1e6
_FREE = 6


class MovingBasePlant(ArmPlant):
    """An `ArmPlant` under a body that follows a `BaseProfile` exactly.

    The engine simulates both bodies in the world: what the arm feels of the motion is its
    own work. The parameters are those of the arm on a fixed base.

    Parameters
    ----------
    robot, parameters, position
        As for `ArmPlant`; the robot's own gravity is not used.
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
        self._is_moving = False
        super().__init__(robot, parameters, position)
        fixed, fixed_dof = self._model, robot.n
        self._model = _with_free_base(robot, fixed)
        self._data = mujoco.MjData(self._model)
        joints = slice(_FREE, _FREE + fixed_dof)
        self._applied = self._data.qfrc_applied[joints]
        self._velocity = self._data.qvel[joints]
        self._acceleration = self._data.qacc[joints]
        self._constraint = self._data.qfrc_constraint[joints]
        self._friction_limit = self._model.dof_frictionloss[joints]
        data, parts = self._data, (slice(0, 3), slice(3, 6))
        # What a base's state is written to, and the force on the base.
        self._pose = (data.qpos[:3], data.qpos[3:7])
        self._twist = tuple(data.qvel[part] for part in parts)
        self._push = tuple(data.qfrc_applied[part] for part in parts)
        self._engine_gravity = self._model.opt.gravity
        self._is_moving = True
        self.reset(position)

    @property
    def base(self) -> BaseState:
        """State of the base."""
        begun = self._start_count
        return self._profile.evaluate(-1.0 if begun is None else (self._count - begun) * SUBSTEP)

    @property
    def imu(self) -> tuple[Array, Array, Array]:
        """What an ideal IMU at the base's origin reads.

        Attitude (x, y, z, w), base to world; angular velocity [rad/s]; specific force
        [m/s^2], both (3,) in base axes.
        """
        base = self.base
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, base.quaternion)
        force = rotation.reshape(3, 3).T @ (base.acceleration - _GRAVITY)
        return np.roll(base.quaternion, -1), base.angular_velocity, force

    @property
    def position(self) -> Array:
        """Joint angles (n,) [rad], a copy."""
        return np.array(self._data.qpos[-self.n :])

    @property
    def velocity(self) -> Array:
        """Joint velocities (n,) [rad/s], a copy."""
        return np.array(self._data.qvel[-self.n :])

    def start(self) -> None:
        """Let the base's motion begin."""
        self._start_count = self._count

    def reset(self, position: ArrayLike, velocity: ArrayLike | None = None) -> None:
        """Put the arm somewhere, at rest unless a velocity (n,) [rad/s] is given."""
        if not self._is_moving:
            super().reset(position, velocity)
            return
        mujoco.mj_resetData(self._model, self._data)
        self._data.qpos[-self.n :] = position
        self._data.qvel[-self.n :] = 0.0 if velocity is None else velocity
        self._effort[:] = 0.0
        self._drive_base()
        mujoco.mj_forward(self._model, self._data)
        self._set_friction()

    def step(self) -> None:
        """Advance by one sub-step."""
        self._drive_base()
        super().step()

    def _drive_base(self) -> None:
        base = self.base
        # Whoever carries the arm's weight carries it in the world.
        gravity = (1.0 - self._support) * _GRAVITY
        self._engine_gravity[:] = gravity
        self._pose[0][:], self._pose[1][:] = base.position, base.quaternion
        self._twist[0][:], self._twist[1][:] = base.velocity, base.angular_velocity
        self._push[0][:] = _BASE_INERTIA * (base.acceleration - gravity)
        self._push[1][:] = _BASE_INERTIA * base.angular_acceleration


def _with_free_base(robot: Robot, fixed: Any) -> Any:
    """Return the engine's model of the arm under a free body, all else as in `fixed`."""
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body(
        name='base', mass=_BASE_INERTIA, inertia=[_BASE_INERTIA] * 3, ipos=[0, 0, 0]
    )
    body.add_freejoint()
    arm = mujoco.MjSpec.from_string(_without_shapes(robot.urdf_text))
    body.add_frame().attach_body(arm.worldbody.first_body(), 'arm_', '')
    model = spec.compile()
    for option in ('timestep', 'integrator', 'solver', 'disableflags'):
        setattr(model.opt, option, getattr(fixed.opt, option))
    for body_index in range(1, fixed.nbody):
        old = fixed.body(body_index)
        new = model.body(f'arm_{old.name}')
        for what in ('mass', 'ipos', 'iquat', 'inertia'):
            getattr(new, what)[:] = getattr(old, what)
    for array in ('armature', 'damping', 'solref', 'solimp'):
        getattr(model, f'dof_{array}')[_FREE:] = getattr(fixed, f'dof_{array}')
    for array in ('solref', 'range'):
        getattr(model, f'jnt_{array}')[1:] = getattr(fixed, f'jnt_{array}')
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def _without_shapes(urdf: str) -> str:
    root = ElementTree.fromstring(urdf)
    for link in root.findall('link'):
        for shape in [*link.findall('visual'), *link.findall('collision')]:
            link.remove(shape)
    return ElementTree.tostring(root, encoding='unicode')
