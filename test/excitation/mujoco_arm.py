"""The arm on another engine, for checks of feasibility that share only the URDF."""

import mujoco
import numpy as np

from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.excitation.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.trajectory import FourierTrajectory, RampedExcitation

GROUND = 'ground'


class MujocoArm:
    """Distances and torques of an arm by MuJoCo.

    Parameters
    ----------
    robot : Robot
        Arm whose collision shapes are primitives.
    rotor_inertia : (n,) ndarray
        Reflected [kg m^2].
    ground_height : float
        [m]
    reach : float
        Largest computed distance [m].
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
        self._pairs, self._low = self._checked_pairs(robot)
        self._friction = robot.viscous, robot.coulomb

    def _checked_pairs(self, robot: Robot) -> tuple[np.ndarray, np.ndarray]:
        """Return pairs of shapes (P, 2), and shapes that could touch the ground.

        Moving neighbours touch by design. A shape fixed to the base may be an obstacle to link 1,
        which turns in front of it. Only pairs whose distance is constant over a full turn of joint
        1 are left out.
        """
        # Bodies are numbered along the chain; 0 is the base with all fixed shapes.
        body = self.model.geom_bodyid
        shapes = [geom for geom in range(self.model.ngeom) if geom != self._plane]
        pairs = [(a, b) for a in shapes for b in shapes if body[b] - body[a] > 1]
        beside = [(a, b) for a in shapes for b in shapes if (body[a], body[b]) == (0, 1)]
        below = [(geom, self._plane) for geom in shapes if body[geom] == 1]
        varying = self._varying([*beside, *below], robot)
        pairs += [pair for pair in beside if pair in varying]
        low = [geom for geom in shapes if body[geom] > 1 or (geom, self._plane) in varying]
        return np.array(pairs), np.array(low)

    def _varying(self, pairs: list, robot: Robot) -> set:
        """Return the pairs whose distance changes while joint 1 turns."""
        found = []
        low, high = max(robot.position_min[0], -np.pi), min(robot.position_max[0], np.pi)
        for angle in np.linspace(low, high, 361):
            self.data.qpos[:] = 0.0
            self.data.qpos[0] = angle
            mujoco.mj_kinematics(self.model, self.data)
            found.append(
                [mujoco.mj_geomDistance(self.model, self.data, a, b, 1.0, None) for a, b in pairs]
            )
        changes = np.ptp(found, axis=0) > 1e-4
        return {pair for pair, change in zip(pairs, changes, strict=True) if change}

    def distances(self, q: np.ndarray) -> tuple[float, float]:
        """Return the smallest distance to itself and to the ground [m], infinite if far.

        Neighbouring bodies, and pairs of constant distance, are left out.
        """
        self.data.qpos[:] = q
        mujoco.mj_kinematics(self.model, self.data)
        centres, radii = self.data.geom_xpos, self.model.geom_rbound
        first, second = self._pairs.T
        gap = (
            np.linalg.norm(centres[first] - centres[second], axis=1) - radii[first] - radii[second]
        )
        itself = self._nearest(self._pairs[gap < self._reach])
        height = self.data.geom_xpos[self._plane, 2]
        low = self._low[centres[self._low, 2] - radii[self._low] - height < self._reach]
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


def with_landing_gear(robot: Robot) -> Robot:
    """Return the arm with four legs around it, fixed to its base."""
    legs = ''.join(
        f'<collision name="leg{i}"><origin xyz="{x} {y} 0.1"/>'
        '<geometry><box size="0.03 0.03 0.5"/></geometry></collision>'
        for i, (x, y) in enumerate([(0.3, 0.3), (0.3, -0.3), (-0.3, 0.3), (-0.3, -0.3)])
    )
    base = '<link name="base_link">'
    return load_robot(robot.urdf_text.replace(base, base + legs))


def is_safe(
    setup: ExcitationSetup, other: MujocoArm, trajectory: FourierTrajectory, step: float
) -> bool:
    """Return whether a played trajectory keeps all limits and clearances in the other engine."""
    config, limits = setup.config, setup.usable_limits
    motion = RampedExcitation(trajectory, 1, config.ramp_time)
    states = motion.evaluate(np.arange(0.0, motion.duration, step))
    strongest = np.minimum(limits.effort, limits.current * setup.torque_per_ampere)
    if (
        (states.q < limits.position_min).any()
        or (states.q > limits.position_max).any()
        or (np.abs(states.dq) > limits.velocity).any()
        or (np.abs(states.ddq) > limits.acceleration).any()
    ):
        return False
    for q, dq, ddq in zip(*states, strict=True):
        itself, ground = other.distances(q)
        if itself < config.self_clearance - 1e-5 or ground < config.ground_clearance - 1e-5:
            return False
        if (np.abs(other.effort(q, dq, ddq)) > strongest).any():
            return False
    return True
