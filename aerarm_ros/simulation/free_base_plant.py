"""The simulated arm on a body that is free to move."""

from dataclasses import dataclass, field
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.description.robot import Robot
from aerarm_ros.simulation.arm_plant import ArmPlant, Array
from aerarm_ros.simulation.base_profile import BaseState
from aerarm_ros.simulation.plant_parameters import PlantParameters

GRAVITY = np.array([0.0, 0.0, -9.81])
"""In the world [m/s^2]."""

_FREE = 6


@dataclass(frozen=True, eq=False)
class BaseBody:
    """What carries the arm.

    Attributes
    ----------
    mass : float
        [kg]
    inertia : (3, 3) ndarray
        About the centre of mass, in body axes [kg m^2].
    centre : (3,) ndarray
        Centre of mass in the body frame [m].
    mount, mount_rotation : (3,) and (3, 3) ndarray
        Pose of the arm's base frame in the body frame.
    imu, imu_rotation : (3,) and (3, 3) ndarray
        Pose of the IMU's frame in the body frame.
    """

    mass: float
    inertia: Array
    centre: Array = field(default_factory=lambda: np.zeros(3))
    mount: Array = field(default_factory=lambda: np.zeros(3))
    mount_rotation: Array = field(default_factory=lambda: np.eye(3))
    imu: Array = field(default_factory=lambda: np.zeros(3))
    imu_rotation: Array = field(default_factory=lambda: np.eye(3))


class FreeBasePlant(ArmPlant):
    """An `ArmPlant` under (or on) a free body; the engine simulates both in the world.

    What the arm feels of the body's motion, and the body of the arm's, is the engine's own
    work. The parameters are those of the arm on a fixed base; the robot's own gravity is not
    used.

    Parameters
    ----------
    robot, parameters, position
        As for `ArmPlant`.
    body
        What carries the arm.
    """

    def __init__(
        self, robot: Robot, parameters: PlantParameters, position: ArrayLike, body: BaseBody
    ) -> None:
        self._body = body
        super().__init__(robot, parameters, position)

    @property
    def base(self) -> BaseState:
        """State of the body."""
        data = self._data
        return BaseState(
            np.array(data.qpos[:3]),
            np.array(data.qpos[3:7]),
            np.array(data.qvel[:3]),
            np.array(data.qvel[3:6]),
            np.array(data.qacc[:3]),
            np.array(data.qacc[3:6]),
        )

    @property
    def imu(self) -> tuple[Array, Array, Array]:
        """What an ideal IMU at its place reads.

        Attitude (x, y, z, w), IMU to world; angular velocity [rad/s]; specific force
        [m/s^2], both (3,) in the IMU's axes.
        """
        base, body = self.base, self._body
        to_world = rotation_of(base.quaternion)
        spin, rate = base.angular_acceleration, base.angular_velocity
        lever = np.cross(spin, body.imu) + np.cross(rate, np.cross(rate, body.imu))
        force = to_world.T @ (base.acceleration - GRAVITY) + lever
        attitude = np.empty(4)
        mujoco.mju_mat2Quat(attitude, (to_world @ body.imu_rotation).ravel())
        to_imu = body.imu_rotation.T
        return np.roll(attitude, -1), to_imu @ rate, to_imu @ force

    def _engine_model(self, robot: Robot) -> Any:
        return _with_free_base(robot, super()._engine_model(robot), self._body)

    def _set_gravity(self) -> None:
        # Whoever carries the arm's weight carries it in the world.
        self._model.opt.gravity = (1.0 - self._support) * GRAVITY


def rotation_of(quaternion: Array) -> Array:
    """Return the (3, 3) matrix of a quaternion (w, x, y, z)."""
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, quaternion)
    return rotation.reshape(3, 3)


def _with_free_base(robot: Robot, fixed: Any, base: BaseBody) -> Any:
    """Return the engine's model of the arm under a free body, all else as in `fixed`."""
    spec = mujoco.MjSpec()
    tensor = base.inertia
    body = spec.worldbody.add_body(
        name='base',
        mass=base.mass,
        ipos=base.centre,
        fullinertia=[*np.diag(tensor), tensor[0, 1], tensor[0, 2], tensor[1, 2]],
        explicitinertial=True,
    )
    body.add_freejoint()
    arm = mujoco.MjSpec.from_string(_without_shapes(robot.urdf_text))
    turn = np.empty(4)
    mujoco.mju_mat2Quat(turn, np.ascontiguousarray(base.mount_rotation).ravel())
    frame = body.add_frame(pos=base.mount, quat=turn)
    frame.attach_body(arm.worldbody.first_body(), 'arm_', '')
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
    return model


def _without_shapes(urdf: str) -> str:
    root = ElementTree.fromstring(urdf)
    for link in root.findall('link'):
        for shape in [*link.findall('visual'), *link.findall('collision')]:
            link.remove(shape)
    return ElementTree.tostring(root, encoding='unicode')
