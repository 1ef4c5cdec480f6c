import numpy as np
import pinocchio as pin
import pytest

from aerarm_ros.description.robot import Robot
from aerarm_ros.model.inertia import parameters_of_body
from aerarm_ros.model.regressor import MomentumRegressor
from aerarm_ros.model.whole_body_dynamics import WholeBodyDynamics

STEP = 1e-6
PAYLOAD = parameters_of_body(0.3, [0.1, 0.02, -0.03], np.diag([1e-3, 2e-3, 2.5e-3]))


@pytest.fixture(scope='module')
def random() -> np.random.Generator:
    return np.random.default_rng(3)


def test_the_cross_product_is_that_of_twists(robot: Robot, random: np.random.Generator) -> None:
    first, second = random.normal(size=(2, 6))
    matrix = np.tensordot(first, MomentumRegressor(robot)._cross.reshape(6, 6, 6), 1)
    crossed = pin.Motion(first).cross(pin.Motion(second)).vector
    np.testing.assert_allclose(matrix @ second, crossed, atol=1e-14)


@pytest.mark.parametrize('is_still', [True, False])
def test_rate_of_momentum_and_force_make_the_torque(
    robot: Robot, random: np.random.Generator, is_still: bool
) -> None:
    regressor = MomentumRegressor(robot)
    bare, loaded = WholeBodyDynamics(robot), WholeBodyDynamics(robot)
    loaded.carry(PAYLOAD)
    for _ in range(5):
        q, dq, ddq = random.normal(size=(3, robot.n))
        force, rate, spin = random.normal(size=(3, 3))
        if is_still:
            force, rate, spin = -robot.gravity_in_base, np.zeros(3), np.zeros(3)
        acceleration = np.concatenate([force, spin])

        def momentum(time: float, q=q, dq=dq, ddq=ddq, force=force, rate=rate, spin=spin):  # noqa: ANN001, ANN202
            turned = q + time * dq + 0.5 * time**2 * ddq
            return regressor.evaluate(turned, dq + time * ddq, force, rate + time * spin)[0]

        change = (momentum(STEP) - momentum(-STEP)) / (2.0 * STEP)
        tau = (change + regressor.evaluate(q, dq, force, rate)[1]) @ PAYLOAD
        whole = loaded.forces(q, dq, ddq, rate, acceleration)
        torque = (whole - bare.forces(q, dq, ddq, rate, acceleration))[6:]
        np.testing.assert_allclose(tau, torque, atol=1e-7)
