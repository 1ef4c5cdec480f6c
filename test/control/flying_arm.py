"""The arm under a free-flying body in the physics engine, for inverse and direct dynamics."""

from collections.abc import Sequence
from xml.etree import ElementTree

import mujoco
import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from aerarm_ros.description.robot import Robot

Array = npt.NDArray[np.float64]


class FlyingArm:
    """The arm's base is mounted on the body with an offset and a rotation (w, x, y, z).

    The wrench in the mount is the engine's own constraint force.
    """

    def __init__(
        self,
        robot: Robot,
        armature: Sequence[float],
        position: Sequence[float] = (0.0, 0.0, 0.0),
        turn: Sequence[float] = (1.0, 0.0, 0.0, 0.0),
        mass: float = 2.0,
        centre: Sequence[float] = (0.0, 0.0, 0.0),
        inertia: Sequence[float] = (0.02, 0.02, 0.03),
    ) -> None:
        arm = mujoco.MjSpec.from_string(without_shapes(robot.urdf_text))
        arm.compiler.fusestatic = False
        arm.body('base_link').add_site(name='mount')
        spec = mujoco.MjSpec()
        spec.option.gravity = [0.0, 0.0, -9.81]
        body = spec.worldbody.add_body(name='body', mass=mass, ipos=centre, inertia=inertia)
        body.add_freejoint()
        body.add_frame(pos=position, quat=turn).attach_body(arm.body('base_link'), 'arm_', '')
        for kind in (mujoco.mjtSensor.mjSENS_FORCE, mujoco.mjtSensor.mjSENS_TORQUE):
            spec.add_sensor(
                type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname='arm_mount', name=kind.name
            )
        self.model = spec.compile()
        self.model.dof_armature[6:] = armature
        self.model.dof_damping[:] = 0.0
        self.model.dof_frictionloss[:] = 0.0
        disabled = mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
        self.model.opt.disableflags |= int(disabled)
        self.data = mujoco.MjData(self.model)

    def place(self, attitude: Rotation, q: Array, twist: Array, dq: Array) -> None:
        """Set pose and velocities; the twist is along the body's axes."""
        data = self.data
        data.qpos[:] = np.concatenate([[0.4, -0.2, 1.0], attitude.as_quat()[[3, 0, 1, 2]], q])
        data.qvel[:] = np.concatenate([attitude.apply(twist[:3]), twist[3:], dq])
        mujoco.mj_forward(self.model, data)

    def inverse(
        self, attitude: Rotation, twist: Array, acceleration: Array, joints: Array
    ) -> Array:
        """Return the engine's joint torques (n,) [Nm].

        `twist` and `acceleration` (6,) are linear along the world's axes, angular along the
        body's; `joints` is (3, n): q, dq, ddq.
        """
        own = np.concatenate([attitude.inv().apply(twist[:3]), twist[3:]])
        self.place(attitude, joints[0], own, joints[1])
        self.data.qacc[:] = np.concatenate([acceleration, joints[2]])
        mujoco.mj_inverse(self.model, self.data)
        return np.array(self.data.qfrc_inverse[6:])

    @property
    def wrench_in_mount(self) -> Array:
        """Wrench between arm and body at the mount (6,), from the engine's sensors."""
        return np.array(self.data.sensordata)


def without_shapes(urdf: str) -> str:
    """Return the URDF without shapes, which the engine would give mass."""
    root = ElementTree.fromstring(urdf)
    for link in root.findall('link'):
        for shape in [*link.findall('visual'), *link.findall('collision')]:
            link.remove(shape)
    return ElementTree.tostring(root, encoding='unicode')
