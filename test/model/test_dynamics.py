"""Dynamics: identities of mechanics, and a second engine that shares no code."""

import mujoco
import numpy as np
import pytest

from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.model.dynamics import GRAVITY, Dynamics, largest_gravity_load
from aerarm_ros.model.inertia import from_pseudo_inertia


@pytest.fixture
def dynamics(robot: Robot) -> Dynamics:
    return Dynamics(robot, np.linspace(0.01, 0.03, robot.n))


@pytest.fixture
def samples(robot: Robot, rng: np.random.Generator) -> np.ndarray:
    """Ten samples of position, velocity and acceleration."""
    return rng.uniform(-1.5, 1.5, (10, 3, robot.n))


def test_inverse_dynamics_are_the_sum_of_their_terms(
    dynamics: Dynamics, samples: np.ndarray
) -> None:
    for q, dq, ddq in samples:
        matrix, torque = dynamics.inertia_matrix(q), dynamics.inverse(q, dq, ddq)
        assert np.allclose(matrix, matrix.T)
        assert np.linalg.eigvalsh(matrix)[0] > 0.0
        bias = dynamics.coriolis_matrix(q, dq) @ dq + dynamics.gravity(q)
        assert np.allclose(dynamics.bias(q, dq), bias)
        assert np.allclose(torque, matrix @ ddq + bias)
        assert np.allclose(dynamics.forward(q, dq, torque), ddq)


def test_rotors_add_their_inertia_to_the_diagonal(robot: Robot, samples: np.ndarray) -> None:
    rotor = np.linspace(0.01, 0.03, robot.n)
    with_rotors, without = Dynamics(robot, rotor), Dynamics(robot)
    assert np.array_equal(with_rotors.rotor_inertia, rotor)
    assert np.all(robot.model.armature == 0.0), 'the robot is shared, so it must not change'
    for q, dq, ddq in samples:
        added = with_rotors.inertia_matrix(q) - without.inertia_matrix(q)
        assert np.allclose(added, np.diag(rotor))
        torque = with_rotors.inverse(q, dq, ddq) - without.inverse(q, dq, ddq)
        assert np.allclose(torque, rotor * ddq)
        energies = (each.kinetic_energy(q, dq) for each in (with_rotors, without))
        assert np.subtract(*energies) == pytest.approx(0.5 * np.sum(rotor * dq**2))
        mobility = with_rotors.mobility_matrix(q)
        assert np.allclose(mobility @ with_rotors.inertia_matrix(q), np.eye(robot.n))
        assert np.array_equal(mobility, mobility.T)


def test_the_rate_of_the_inertia_matrix_minus_twice_c_is_skew(
    dynamics: Dynamics, samples: np.ndarray
) -> None:
    """Thesis (2.13), for every velocity and not only the one of the motion."""
    step = 1e-6
    for q, dq, _ in samples:
        ahead, behind = (dynamics.inertia_matrix(q + s * step * dq) for s in (1, -1))
        skew = (ahead - behind) / (2 * step) - 2 * dynamics.coriolis_matrix(q, dq)
        assert np.allclose(skew + skew.T, 0.0, atol=1e-7)


def test_gravity_is_the_slope_of_the_potential_energy(
    dynamics: Dynamics, samples: np.ndarray
) -> None:
    step = 1e-6
    for q, _, _ in samples:
        slope = [
            dynamics.potential_energy(q + step * u) - dynamics.potential_energy(q - step * u)
            for u in np.eye(len(q))
        ]
        assert np.allclose(dynamics.gravity(q), np.array(slope) / (2 * step), atol=1e-6)


def test_free_motion_keeps_its_energy(dynamics: Dynamics, rng: np.random.Generator) -> None:
    """Along a motion by the classical Runge-Kutta method."""
    n, step = dynamics.robot.n, 1e-3

    def rate(x: np.ndarray) -> np.ndarray:
        return np.array([x[1], dynamics.forward(x[0], x[1], np.zeros(n))])

    def energy(x: np.ndarray) -> float:
        return dynamics.kinetic_energy(*x) + dynamics.potential_energy(x[0])

    x = start = rng.uniform(-1, 1, (2, n))
    for _ in range(500):
        k1 = rate(x)
        k2 = rate(x + step / 2 * k1)
        k3 = rate(x + step / 2 * k2)
        k4 = rate(x + step * k3)
        x = x + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    assert not np.allclose(x[0], start[0], atol=0.1)
    assert energy(x) == pytest.approx(energy(start), abs=1e-7)


@pytest.mark.parametrize('gravity', [(0.0, 0.0, -9.81), (3.0, -4.0, 8.0)])
def test_mujoco_computes_the_same_torques(
    arm: Robot, rng: np.random.Generator, gravity: tuple[float, float, float]
) -> None:
    rotor = np.array([0.024, 0.0095, 0.0096, 0.0095])
    model = mujoco.MjModel.from_xml_string(arm.urdf_text)
    model.opt.gravity[:] = gravity
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
    model.dof_armature[:] = rotor
    model.dof_damping[:] = 0.0
    model.dof_frictionloss[:] = 0.0
    data = mujoco.MjData(model)
    dynamics = Dynamics(arm.with_gravity(gravity), rotor)
    for q, dq, ddq in rng.uniform(-2.0, 2.0, (20, 3, 4)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q, dq, ddq
        mujoco.mj_inverse(model, data)
        assert np.allclose(dynamics.inverse(q, dq, ddq), data.qfrc_inverse, atol=1e-10)


def test_a_payload_is_a_part_of_the_last_link() -> None:
    robot = load_robot()
    point = np.array([0.1, 0.01, -0.02, 1.0])
    payload = from_pseudo_inertia(0.2 * (np.outer(point, point) + np.diag([1e-4] * 3 + [0.0])))
    inertial = np.array(robot.inertial_parameters)
    inertial[-1] += payload
    expected = Dynamics(robot.with_inertial_parameters(inertial), 0.01)
    carrying, alone = Dynamics(robot, 0.01), Dynamics(robot, 0.01)
    q, dq, ddq = np.random.default_rng(1).uniform(-1.0, 1.0, (3, 4))
    carrying.carry(0.5 * payload)
    carrying.carry(payload)  # in place of the first, not on top of it
    wanted = expected.inverse(q, dq, ddq)
    np.testing.assert_allclose(carrying.inverse(q, dq, ddq), wanted, atol=1e-12)
    assert np.abs(wanted - alone.inverse(q, dq, ddq)).max() > 0.1
    carrying.carry(np.zeros(10))
    np.testing.assert_allclose(carrying.inverse(q, dq, ddq), alone.inverse(q, dq, ddq), atol=1e-12)
    for impossible in (-payload, payload[:4], np.full(10, np.nan)):
        with pytest.raises(ValueError, match='no body has these'):
            carrying.carry(impossible)


def test_no_direction_of_gravity_causes_a_larger_torque() -> None:
    robot = load_robot()
    largest = largest_gravity_load(robot)
    random = np.random.default_rng(1)
    for direction in random.normal(size=(50, 3)):
        gravity = GRAVITY * direction / np.linalg.norm(direction)
        dynamics = Dynamics(load_robot(gravity_in_base=gravity))
        for q in random.uniform(robot.position_min, robot.position_max, (20, robot.n)):
            assert np.all(np.abs(dynamics.gravity(q)) < 1.02 * largest)


@pytest.mark.parametrize(
    ('rotor', 'message'),
    [([0.1, 0.1], '2 rotor inertias for 4 joints'), (-1.0, 'not negative'), (np.nan, 'finite')],
)
def test_a_wrong_rotor_inertia_is_refused(arm: Robot, rotor: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Dynamics(arm, rotor)  # type: ignore[arg-type]
