"""The arm on another engine, to check feasibility with nothing in common but the URDF."""

import mujoco
import numpy as np

from aerarm_ros.description.robot import Robot

GROUND = 'ground'


class MujocoArm:
    """Distances and torques of an arm by MuJoCo.

    Parameters
    ----------
    robot : Robot
        With collision shapes that are primitives.
    rotor_inertia : (n,) ndarray
        Reflected [kg m^2].
    ground_height : float
        [m]
    reach : float
        Distances beyond are not looked at [m].
    """

    def __init__(
        self, robot: Robot, rotor_inertia: np.ndarray, ground_height: float, reach: float = 0.06
    ) -> None:
        spec = mujoco.MjSpec.from_string(robot.urdf_text)
        spec.worldbody.add_geom(
            name=GROUND,
            type=mujoco.mjtGeom.mjGEOM_PLANE,
            size=[5, 5, 0.1],
            pos=[0, 0, ground_height],
        )
        self.model = spec.compile()
        self.model.dof_armature[:] = rotor_inertia
        self.model.dof_damping[:] = 0.0
        self.model.dof_frictionloss[:] = 0.0
        self.model.opt.gravity[:] = robot.gravity_in_base
        self.data = mujoco.MjData(self.model)
        self._plane = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_GEOM, GROUND)
        self._reach = reach
        # Bodies are numbered along the chain, 0 is the base.
        body = self.model.geom_bodyid
        shapes = [geom for geom in range(self.model.ngeom) if geom != self._plane]
        self._pairs = np.array([(a, b) for a in shapes for b in shapes if body[b] - body[a] > 1])
        self._moving = np.array([geom for geom in shapes if body[geom] > 1])
        self._friction = robot.viscous, robot.coulomb

    def distances(self, q: np.ndarray) -> tuple[float, float]:
        """Return the smallest distance to itself and to the ground [m], infinite if far.

        Neighbouring bodies, and the column that turns on the base, are left out.
        """
        self.data.qpos[:] = q
        mujoco.mj_kinematics(self.model, self.data)
        centres, radii = self.data.geom_xpos, self.model.geom_rbound
        first, second = self._pairs.T
        gap = (
            np.linalg.norm(centres[first] - centres[second], axis=1) - radii[first] - radii[second]
        )
        itself = self._nearest(self._pairs[gap < self._reach])
        low = self._moving[centres[self._moving, 2] - radii[self._moving] < self._reach]
        return itself, self._nearest([(geom, self._plane) for geom in low])

    def _nearest(self, pairs) -> float:
        distance = (
            mujoco.mj_geomDistance(self.model, self.data, a, b, self._reach, None) for a, b in pairs
        )
        return min((d for d in distance if d < self._reach), default=np.inf)

    def effort(self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        """Return the joint torques of one state [Nm], friction included."""
        self.data.qpos[:], self.data.qvel[:], self.data.qacc[:] = q, dq, ddq
        flags = self.model.opt.disableflags
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        mujoco.mj_inverse(self.model, self.data)
        self.model.opt.disableflags = flags
        viscous, coulomb = self._friction
        return self.data.qfrc_inverse + viscous * dq + coulomb * np.sign(dq)
