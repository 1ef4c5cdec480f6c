"""Fixtures of the tests of control laws: the arm, and simulated benches."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.checks import JointLimits
from aerarm_ros.description.arm_config import ArmConfig, load_arm_config
from aerarm_ros.description.robot import Robot
from aerarm_ros.motion.signals import ArmState, JointCommand
from aerarm_ros.simulation.arm_plant import ArmPlant, PlantParameters

Array = npt.NDArray[np.float64]
Controller = Callable[[ArmState, float], JointCommand]

CYCLE = 1e-3


@dataclass
class Run:
    """Results of a simulated run, one row per cycle."""

    time: Array
    q: Array
    dq: Array
    effort: Array


class LawBench:
    """The arm on the physics engine, with torque commands at 1 kHz and perfect sensors."""

    def __init__(self, robot: Robot, parameters: PlantParameters, q: npt.ArrayLike) -> None:
        self.plant = ArmPlant(robot, parameters, q)
        self.tau = np.zeros(robot.n)

    def state(self) -> ArmState:
        return ArmState(self.plant.position, self.plant.velocity, self.tau)

    def run(self, controller: Controller, seconds: float, disturbance: Any = 0.0) -> Run:
        """Control the arm; `disturbance` (n,) [Nm] acts on the joints, invisible to the sensors."""
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
def limits(config: ArmConfig) -> JointLimits:
    return JointLimits.from_config(config)


@pytest.fixture
def dynamics(robot: Robot, config: ArmConfig) -> MovingBaseDynamics:
    return MovingBaseDynamics(robot, config.column('reflected_inertia'))


@pytest.fixture
def carried(robot: Robot, config: ArmConfig) -> MovingBaseDynamics:
    """Return the arm under a body of 2 kg at the base's origin."""
    carrier = [2.0, 0.0, 0.0, 0.0, 0.02, 0.0, 0.02, 0.0, 0.0, 0.03]
    return MovingBaseDynamics(robot, config.column('reflected_inertia'), carrier)


@pytest.fixture
def parameters(config: ArmConfig, robot: Robot) -> PlantParameters:
    """Return the plant's parameters, which are the model's."""
    return PlantParameters.nominal(config, robot)


@pytest.fixture
def frictionless_bench(robot: Robot, parameters: PlantParameters) -> Callable[..., LawBench]:
    return lambda q: LawBench(robot, parameters.without_friction(), q)


@pytest.fixture
def bench(robot: Robot, parameters: PlantParameters) -> Callable[..., LawBench]:
    return lambda q: LawBench(robot, parameters, q)


@pytest.fixture
def postures(limits: JointLimits) -> Array:
    """Return postures (10, n) spread over the limits [rad]."""
    random = np.random.default_rng(3)
    return random.uniform(limits.position_min, limits.position_max, (10, limits.n))
