"""A flying arm in the physics engine."""

from collections.abc import Callable, Sequence
from xml.etree import ElementTree

import mujoco
import numpy as np
import numpy.typing as npt
import pytest

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot

Array = npt.NDArray[np.float64]


class FlyingArm:
    """The arm under a free-flying body in the physics engine, for inverse dynamics.

    The arm's base is mounted on the body with an offset and a rotation. The wrench in the mount is
    the engine's own constraint force.
    """

    def __init__(self, urdf: str, armature: Sequence[float], position: Array, turn: Array) -> None:
        arm = mujoco.MjSpec.from_string(_without_shapes(urdf))
        arm.compiler.fusestatic = False
        arm.body('base_link').add_site(name='mount')
        self.spec = mujoco.MjSpec()
        self.spec.option.gravity = [0.0, 0.0, -9.81]
        body = self.spec.worldbody.add_body(name='body', mass=2.0, inertia=[0.02, 0.02, 0.03])
        body.add_freejoint()
        body.add_frame(pos=position, quat=turn).attach_body(arm.body('base_link'), 'arm_', '')
        for kind in (mujoco.mjtSensor.mjSENS_FORCE, mujoco.mjtSensor.mjSENS_TORQUE):
            self.spec.add_sensor(
                type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname='arm_mount', name=kind.name
            )
        self.model = self.spec.compile()
        self.model.dof_armature[6:] = armature
        self.model.dof_damping[:] = 0.0
        self.model.dof_frictionloss[:] = 0.0
        self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
        self.data = mujoco.MjData(self.model)

    def inverse(self, attitude: Array, twist: Array, acceleration: Array, joints: Array) -> Array:
        """Return the engine's joint torques (n,) [Nm].

        `attitude` is (w, x, y, z), body to world; `twist` and `acceleration` (6,) are linear
        along the world's axes, angular along the body's; `joints` is (3, n): q, dq, ddq.
        """
        data = self.data
        data.qpos[:] = np.concatenate([[0.3, -0.2, 1.0], attitude, joints[0]])
        data.qvel[:] = np.concatenate([twist, joints[1]])
        data.qacc[:] = np.concatenate([acceleration, joints[2]])
        mujoco.mj_inverse(self.model, data)
        return np.array(data.qfrc_inverse[6:])

    @property
    def wrench_in_mount(self) -> Array:
        """Wrench between arm and body at the mount (6,), from the engine's sensors."""
        return np.array(self.data.sensordata)


def _without_shapes(urdf: str) -> str:
    """Return the URDF without shapes, which the engine would give mass."""
    root = ElementTree.fromstring(urdf)
    for link in root.findall('link'):
        for shape in [*link.findall('visual'), *link.findall('collision')]:
            link.remove(shape)
    return ElementTree.tostring(root, encoding='unicode')


@pytest.fixture
def make_flying_arm(robot: Robot, config: ArmConfig) -> Callable[..., FlyingArm]:
    def make(position: Sequence[float] = (0.0, 0.0, 0.0), turn: Sequence[float] = (1, 0, 0, 0)):
        armature = config.column('reflected_inertia')
        return FlyingArm(robot.urdf_text, armature, np.array(position), np.array(turn))

    return make
