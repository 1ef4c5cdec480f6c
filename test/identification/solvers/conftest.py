"""Problems for the solvers: the thesis's, and systems with a known solution."""

from collections.abc import Callable

import numpy as np
import pytest

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.joint_model import ArmParameters
from aerarm_ros.identification.model_fit import Prior
from aerarm_ros.identification.regression import TriangularSystem
from aerarm_ros.identification.solvers.estimate import PhysicalLimits
from aerarm_ros.identification.solvers.solvers import physical_limits
from aerarm_ros.identification.solvers.thesis_solver import ThesisProblem, solve_slsqp
from aerarm_ros.model.inertia import from_pseudo_inertia
from aerarm_ros.model.regressor import Regressor


@pytest.fixture(scope='session')
def problem(result: IdentificationResult) -> ThesisProblem:
    return ThesisProblem.of(result.fit, physical_limits(result.fit, result.cad))


@pytest.fixture(scope='session')
def slsqp(problem: ThesisProblem) -> np.ndarray:
    return solve_slsqp(problem)


@pytest.fixture(scope='session')
def limits(cad: ArmParameters) -> PhysicalLimits:
    """Limits of links and of three coefficients per joint, none of which may be negative."""
    size = cad.inertial_scale()[:, 1] / cad.inertial[:, 0]
    return PhysicalLimits(cad.inertial[:, 0], size, np.ones(12, dtype=bool))


@pytest.fixture(scope='session')
def prior(cad: ArmParameters) -> Prior:
    mean = np.concatenate([cad.inertial.ravel(), np.full(12, 0.1)])
    return Prior(mean, np.concatenate([0.3 * cad.inertial_scale().ravel(), np.ones(12)]))


@pytest.fixture(scope='session')
def factor(robot: Robot) -> np.ndarray:
    random = np.random.default_rng(0)
    stacked = Regressor(robot, rotor_inertia=True).stack(*random.uniform(-2, 2, (3, 100, robot.n)))
    return np.linalg.qr(stacked, mode='r')


@pytest.fixture(scope='session')
def true(make_arm: Callable) -> np.ndarray:
    """Parameters of a physical arm."""
    arm = make_arm()
    return np.concatenate([arm.inertial.ravel(), arm.viscous, arm.coulomb, arm.rotor])


@pytest.fixture(scope='session')
def system_of(factor: np.ndarray) -> Callable[..., TriangularSystem]:
    """Return a function that creates weighted systems without noise from given parameters."""

    def make(theta: np.ndarray, weight: float = 1.0) -> TriangularSystem:
        return TriangularSystem(weight * factor, weight * factor @ theta)

    return make


@pytest.fixture(scope='session')
def impossible(prior: Prior) -> Callable[[np.random.Generator], np.ndarray]:
    """Return a function that draws non-physical parameters, far from the prior."""
    return lambda random: prior.mean + 3.0 * prior.std * random.standard_normal(len(prior.mean))


@pytest.fixture(scope='session')
def possible(limits: PhysicalLimits) -> Callable[[np.random.Generator], np.ndarray]:
    """Return a function that draws physical parameters within the limits."""

    def draw(random: np.random.Generator) -> np.ndarray:
        roots = random.standard_normal((4, 4, 4))
        matter = roots @ roots.transpose(0, 2, 1)
        matter *= (limits.mass * random.uniform(0.6, 1.9, 4) / matter[:, 3, 3])[:, None, None]
        return np.concatenate([from_pseudo_inertia(matter).ravel(), random.uniform(0, 1, 12)])

    return draw
