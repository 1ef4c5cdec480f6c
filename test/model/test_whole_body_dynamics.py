"""Arm and carrier as one body: against the physics engine, finite differences and identities."""

import mujoco
import numpy as np
import pytest
from flying_arm import FlyingArm
from scipy.spatial.transform import Rotation

from aerarm_ros.description.robot import Robot
from aerarm_ros.model.inertia import from_pseudo_inertia
from aerarm_ros.model.whole_body_dynamics import WholeBodyDynamics

GRAVITY = np.array([0.0, 0.0, -9.81])
MASS, CENTRE, TENSOR = 1.3, np.array([0.02, -0.03, 0.07]), np.diag([0.012, 0.02, 0.015])
ROTORS = np.array([0.024, 0.0095, 0.0096, 0.0095])
POINT = np.append(CENTRE, 1.0)
SPREAD = np.diag([*(0.5 * np.trace(TENSOR) - np.diag(TENSOR)), 0.0])
CARRIER = from_pseudo_inertia(MASS * np.outer(POINT, POINT) + SPREAD)


def in_body_axes(attitude: Rotation) -> np.ndarray:
    """Return what turns the engine's coordinates, linear ones along the world, to ours."""
    turn = np.eye(10)
    turn[:3, :3] = attitude.as_matrix().T
    return turn


@pytest.fixture(scope='module')
def engine(arm: Robot) -> FlyingArm:
    return FlyingArm(arm, ROTORS, mass=MASS, centre=CENTRE, inertia=np.diag(TENSOR))


@pytest.fixture
def whole(arm: Robot) -> WholeBodyDynamics:
    return WholeBodyDynamics(arm, ROTORS, CARRIER)


@pytest.fixture
def samples(rng: np.random.Generator) -> list[tuple[Rotation, np.ndarray]]:
    """Return attitudes, and twist, base acceleration, q, dq, ddq in one row of 24."""
    return [(Rotation.random(random_state=rng), rng.uniform(-1.5, 1.5, 24)) for _ in range(10)]


def test_the_inertia_matrix_is_the_engines(whole, engine, samples) -> None:
    for attitude, x in samples:
        engine.place(attitude, x[12:16], x[:6], x[16:20])
        theirs = np.zeros((10, 10))
        mujoco.mj_fullM(engine.model, engine.data, theirs)
        turn = in_body_axes(attitude)
        np.testing.assert_allclose(
            whole.inertia_matrix(x[12:16]), turn @ theirs @ turn.T, atol=1e-10
        )


def test_forces_are_the_engines_inverse_dynamics(whole, engine, samples) -> None:
    for attitude, x in samples:
        twist, acceleration, (q, dq, ddq) = x[:6], x[6:12], x[12:].reshape(3, 4)
        engine.place(attitude, q, twist, dq)
        linear = attitude.apply(acceleration[:3])
        engine.data.qacc[:] = np.concatenate([linear, acceleration[3:], ddq])
        mujoco.mj_inverse(engine.model, engine.data)
        theirs = in_body_axes(attitude) @ engine.data.qfrc_inverse
        felt = np.append(attitude.inv().apply(linear - GRAVITY), acceleration[3:])
        ours = whole.forces(q, dq, ddq, twist[3:], felt)
        np.testing.assert_allclose(ours, theirs, atol=1e-9)
        rows = whole.inertia_matrix(q) @ np.concatenate([felt, ddq])
        rows += whole.forces(q, dq, np.zeros(4), twist[3:])
        np.testing.assert_allclose(rows, ours, atol=1e-10)


def test_a_free_base_answers_as_in_the_engine(whole, engine, samples) -> None:
    """Direct dynamics of the engine, against the reduced inertia and the base's answer."""
    for attitude, x in samples:
        wrench, (q, dq, tau) = 10.0 * x[6:12], x[12:].reshape(3, 4)
        engine.place(attitude, q, x[:6], dq)
        engine.data.qfrc_applied[:] = np.concatenate([attitude.apply(wrench[:3]), wrench[3:], tau])
        mujoco.mj_forward(engine.model, engine.data)
        engine.data.qfrc_applied[:] = 0.0
        ddq = np.array(engine.data.qacc[6:])
        felt = np.append(
            attitude.inv().apply(engine.data.qacc[:3] - GRAVITY), engine.data.qacc[3:6]
        )
        inverse, coupling = whole.response(q)
        c = whole.forces(q, dq, np.zeros(4), x[3:6])
        np.testing.assert_allclose(
            inverse @ (wrench - c[:6] - coupling @ ddq), felt, atol=1e-8, rtol=1e-8
        )
        rest = coupling.T @ (inverse @ (wrench - c[:6]))
        np.testing.assert_allclose(
            whole.reduced_inertia(q) @ ddq, tau - c[6:] - rest, atol=1e-8, rtol=1e-8
        )


def test_the_feedback_gain_is_that_of_the_loop(whole, samples) -> None:
    for _, x in samples:
        matrix = whole.inertia_matrix(x[12:16])
        coupling = matrix[:6, 6:]
        answer = np.linalg.solve(matrix[:6, :6], coupling)
        loop = answer @ np.linalg.solve(whole.reduced_inertia(x[12:16]), coupling.T)
        gain = np.max(np.abs(np.linalg.eigvals(loop)))
        assert whole.feedback_gain(x[12:16]) == pytest.approx(gain)


def test_centre_of_mass_and_momentum_are_the_engines(whole, engine, samples) -> None:
    for attitude, x in samples:
        twist, q, dq = x[:6], x[12:16], x[16:20]
        engine.place(attitude, q, twist, dq)
        mujoco.mj_subtreeVel(engine.model, engine.data)
        mass, com, inertia = whole.composite_inertia(q)
        there = attitude.inv().apply(engine.data.subtree_com[1] - engine.data.qpos[:3])
        np.testing.assert_allclose(com, there, atol=1e-12)
        assert mass == pytest.approx(engine.model.body_subtreemass[1])
        assert np.linalg.eigvalsh(inertia)[0] > 0.0
        momentum = whole.centroidal_momentum(q, dq, twist)
        theirs = [mass * engine.data.subtree_linvel[1], engine.data.subtree_angmom[1]]
        for ours, world in zip(np.split(momentum, 2), theirs, strict=True):
            np.testing.assert_allclose(ours, attitude.inv().apply(world), atol=1e-10)


def test_the_rate_of_kinetic_energy_is_the_power(whole, samples) -> None:
    """Without gravity: `d/dt (v^T M v / 2) = v . (w, tau)` along any motion."""
    step = 1e-6
    for _, x in samples:
        twist, acceleration, (q, dq, ddq) = x[:6], x[6:12], x[12:].reshape(3, 4)
        velocity, rate = np.append(twist, dq), np.append(acceleration, ddq)

        energies = []
        for s in (1.0, -1.0):
            v = velocity + s * step * rate
            energies.append(0.5 * v @ whole.inertia_matrix(q + s * step * dq) @ v)
        slope = (energies[0] - energies[1]) / (2.0 * step)
        # The components of a velocity in turning axes also change by -w x v.
        felt = acceleration + np.append(np.cross(twist[3:], twist[:3]), np.zeros(3))
        power = velocity @ whole.forces(q, dq, ddq, twist[3:], felt)
        assert slope == pytest.approx(power, abs=1e-6)


@pytest.mark.parametrize('carrier', [-CARRIER, CARRIER[:4], np.full(10, np.nan)])
def test_an_impossible_vehicle_is_rejected(arm: Robot, carrier: np.ndarray) -> None:
    with pytest.raises(ValueError, match='no body has these'):
        WholeBodyDynamics(arm, ROTORS, carrier)
