"""What the tests of control laws share: the arm, and engines to try them on."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
import numpy.typing as npt
import pytest

from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.checks.joint_limits import JointLimits
from aerarm_ros.description.arm_config import ArmConfig, load_arm_config
from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.motion.arm_state import ArmState
from aerarm_ros.motion.joint_command import JointCommand
from aerarm_ros.simulation.arm_plant import ArmPlant
from aerarm_ros.simulation.plant_parameters import PlantParameters

Array = npt.NDArray[np.float64]
Controller = Callable[[ArmState, float], JointCommand]

CYCLE = 1e-3


@dataclass
class Run:
    """What a simulated run left behind, one row a cycle."""

    time: Array
    q: Array
    dq: Array
    effort: Array


class Bench:
    """The arm on the physics engine, with torque commands at 1 kHz and perfect sensors."""

    def __init__(self, robot: Robot, parameters: PlantParameters, q: npt.ArrayLike) -> None:
        self.plant = ArmPlant(robot, parameters, q)
        self.tau = np.zeros(robot.n)

    def state(self) -> ArmState:
        return ArmState(self.plant.position, self.plant.velocity, self.tau)

    def run(self, controller: Controller, seconds: float, disturbance: Any = 0.0) -> Run:
        """Control the arm; `disturbance` (n,) [Nm] acts on the joints, unseen by sensors."""
        rows = []
        for cycle in range(round(seconds / CYCLE)):
            state = self.state()
            effort = controller(state, cycle * CYCLE).tau
            assert effort is not None
            rows.append(np.concatenate([[cycle * CYCLE], state.q, state.dq, effort]))
            self.plant.apply_effort(effort + disturbance)
            self.plant.advance(CYCLE)
            self.tau = np.array(effort)
        table = np.array(rows)
        return Run(table[:, 0], *np.split(table[:, 1:], 3, axis=1))


@pytest.fixture(scope='session')
def config() -> ArmConfig:
    return load_arm_config()


@pytest.fixture(scope='session')
def robot() -> Robot:
    return load_robot()


@pytest.fixture(scope='session')
def limits(config: ArmConfig) -> JointLimits:
    return JointLimits.from_config(config)


@pytest.fixture
def dynamics(robot: Robot, config: ArmConfig) -> MovingBaseDynamics:
    return MovingBaseDynamics(robot, config.column('reflected_inertia'))


@pytest.fixture
def parameters(config: ArmConfig, robot: Robot) -> PlantParameters:
    """Return the plant's parameters: the model's own."""
    return PlantParameters.nominal(config, robot)


@pytest.fixture
def frictionless_bench(robot: Robot, parameters: PlantParameters) -> Callable[..., Bench]:
    return lambda q: Bench(robot, parameters.without_friction(), q)


@pytest.fixture
def bench(robot: Robot, parameters: PlantParameters) -> Callable[..., Bench]:
    return lambda q: Bench(robot, parameters, q)


@pytest.fixture
def postures(limits: JointLimits) -> Array:
    """Return postures (10, n) spread over the limits [rad]."""
    random = np.random.default_rng(3)
    return random.uniform(limits.position_min, limits.position_max, (10, limits.n))


class FlyingArm:
    """The arm under a free-flying body in the physics engine, for inverse dynamics.

    The arm's base is mounted on the body off its origin and turned; the wrench in the mount
    is the engine's own constraint force.
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
        """Wrench between arm and body at the mount (6,), as the engine's sensors read it."""
        return np.array(self.data.sensordata)


def _without_shapes(urdf: str) -> str:
    """Return the URDF without shapes, to which the engine would give mass."""
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
