"""The regressor reproduces the dynamics, and has the ranks mechanics says."""

import numpy as np
import pytest

from aerarm_ros.description.robot import Robot
from aerarm_ros.model.dynamics import Dynamics
from aerarm_ros.model.inertia import parameters_of_body
from aerarm_ros.model.regressor import MomentumRegressor, Regressor, viscous_coulomb
from aerarm_ros.model.whole_body_dynamics import WholeBodyDynamics


def motion(robot: Robot, rng: np.random.Generator, samples: int = 60) -> np.ndarray:
    """Positions, velocities and accelerations of `samples` instants."""
    return rng.uniform(-2.0, 2.0, (3, samples, robot.n))


@pytest.mark.parametrize('rotor_inertia', [False, True])
def test_regressor_times_parameters_is_the_torque(
    robot: Robot, rng: np.random.Generator, rotor_inertia: bool
) -> None:
    """Thesis (2.7), (3.1): links, friction and rotors."""
    q, dq, ddq = motion(robot, rng)
    fv, fs, rotor = rng.uniform(0.01, 1.0, (3, robot.n))
    regressor = Regressor(robot, rotor_inertia)
    theta = regressor.parameters(
        robot.inertial_parameters, fv, fs, rotor if rotor_inertia else None
    )
    dynamics = Dynamics(robot, rotor if rotor_inertia else 0.0)
    rigid = [dynamics.inverse(*sample) for sample in zip(q, dq, ddq, strict=True)]
    tau = np.array(rigid) + viscous_coulomb(dq, fv, fs)
    assert np.allclose(regressor.stack(q, dq, ddq) @ theta, tau.reshape(-1), atol=1e-9)


def test_wrong_shapes_are_refused(arm: Robot) -> None:
    regressor = Regressor(arm)
    with pytest.raises(ValueError, match=r'\(samples, 4\)'):
        regressor.stack(np.zeros((5, 3)), np.zeros((5, 3)), np.zeros((5, 3)))
    with pytest.raises(ValueError, match=r'shapes'):
        regressor.stack_rigid(np.zeros((5, 4)), np.zeros((5, 4)), np.zeros((6, 4)))
    with pytest.raises(ValueError, match='has no columns for rotor inertia'):
        regressor.parameters(arm.inertial_parameters, arm.viscous, arm.coulomb, np.zeros(4))
    with pytest.raises(ValueError, match='4 joints'):
        regressor.parameters(np.zeros((3, 10)), arm.viscous, arm.coulomb)


STEP = 1e-6
PAYLOAD = parameters_of_body(0.3, [0.1, 0.02, -0.03], np.diag([1e-3, 2e-3, 2.5e-3]))


@pytest.fixture(scope='module')
def random() -> np.random.Generator:
    return np.random.default_rng(3)


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
