"""Triangular factors and columns of samples, of which both sides pass the same filter."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.joint_model import (
    ROTOR,
    THESIS_TERMS,
    JointModel,
    JointTerm,
    TermKind,
)
from aerarm_ros.identification.regression import ReducedRegression, SampleColumns, triangular_factor
from aerarm_ros.model.regressor import Regressor

JOINTS, ROWS, COLUMNS = 3, 200, 7
NAMES = tuple('abcdefg')


@pytest.fixture(scope='module')
def data() -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(0)
    phi = random.standard_normal((JOINTS, ROWS, COLUMNS))
    phi[:, :, 6] = 2.0 * phi[:, :, 0]  # dependent
    return phi, random.standard_normal((JOINTS, ROWS))


@pytest.fixture(scope='module')
def regression(data) -> ReducedRegression:
    factors = [triangular_factor(np.column_stack(pair)) for pair in zip(*data, strict=True)]
    return ReducedRegression(NAMES, factors, [ROWS] * JOINTS)


@pytest.mark.parametrize('weights', [(1.0, 1.0, 1.0), (0.1, 2.0, 30.0)])
def test_the_reduced_problem_has_the_solution_of_the_full_one(data, regression, weights) -> None:
    phi, tau = data
    full = np.vstack([w * p for w, p in zip(weights, phi, strict=True)])
    right = np.concatenate([w * t for w, t in zip(weights, tau, strict=True)])
    expected = np.linalg.lstsq(full, right, rcond=1e-10)[0]
    system = regression.system(weights)
    assert np.allclose(np.linalg.lstsq(system.R, system.z, rcond=1e-10)[0], expected)


def test_norms_and_errors_are_those_of_all_rows(data, regression) -> None:
    phi, tau = data
    theta = np.linspace(-1.0, 1.0, COLUMNS)
    residual = tau - phi @ theta
    assert np.allclose(regression.residual_norms(theta), np.linalg.norm(residual, axis=1))
    assert np.allclose(regression.torque_norms, np.linalg.norm(tau, axis=1))
    assert np.allclose(regression.column_norms(), np.linalg.norm(phi, axis=1))
    expected = 100.0 * np.linalg.norm(residual) / np.linalg.norm(tau)
    assert regression.error(theta) == pytest.approx(expected)


LOAD = JointTerm(TermKind.LOAD)


def parameters(arm, model: JointModel) -> np.ndarray:
    values = {'fv': arm.viscous, 'fs': arm.coulomb, 'Ja': arm.rotor, 'fl': arm.load}
    joints = [values[term.symbol][joint] for joint, term in model.joint_columns]
    return np.concatenate([arm.inertial.ravel(), joints])


@pytest.mark.parametrize('load', [0.0, 0.04])
@pytest.mark.parametrize('cutoff', [2.0, 5.0])
def test_true_parameters_predict_the_filtered_torque(
    make_arm: Callable, columns_of: Callable, robot: Robot, load: float, cutoff: float
) -> None:
    """Even with a cut-off that takes much of the dry friction's steps away."""
    arm = make_arm(load=load)
    bag = columns_of(arm, cutoff=cutoff)
    model = JointModel.uniform(robot.joint_names, robot.link_names, (*THESIS_TERMS, ROTOR, LOAD))
    predicted = bag.predict(model, parameters(arm, model))
    error = np.linalg.norm(predicted.filtered - bag.samples.tau) / np.linalg.norm(bag.samples.tau)
    assert error < 5e-4
    assert np.median(np.abs(predicted.raw - bag.samples.tau_raw)) < 1e-3


@pytest.mark.parametrize('kind', [TermKind.COULOMB, TermKind.LOAD])
@pytest.mark.parametrize('distance', [0.0, 0.02])
def test_a_rate_is_the_derivative_of_the_column(
    make_arm: Callable, columns_of: Callable, robot: Robot, kind: TermKind, distance: float
) -> None:
    bag, inertial = columns_of(make_arm()), robot.inertial_parameters.ravel()
    term = JointTerm(kind, distance=distance)
    column = bag.term(term, inertial)
    slope = CubicSpline(bag.samples.time, column).derivative()(bag.samples.time)[5:-5]
    left = np.linalg.norm(bag.rate(term, inertial)[5:-5] - slope)
    assert left < 0.1 * np.linalg.norm(slope)


def test_noise_of_a_velocity_at_rest_does_not_change_friction(
    make_arm: Callable, columns_of: Callable, robot: Robot
) -> None:
    """Coulomb friction after 4 s at rest is that of the last motion."""
    bag = columns_of(make_arm())
    random = np.random.default_rng(0)
    dq = bag.samples.dq_fine.copy()
    rest = slice(len(dq) // 2, len(dq) // 2 + round(4.0 / bag.samples.fine_filter.dt))
    dq[rest.start - 500 : rest.start] = 0.5
    dq[rest] = 1e-3 * random.standard_normal((rest.stop - rest.start, robot.n))
    noisy = SampleColumns(replace(bag.samples, dq_fine=dq), Regressor(robot))
    column = noisy.term(JointTerm(TermKind.COULOMB, distance=0.003))
    times = noisy.samples.time - noisy.samples.time[0]
    begin = rest.start * bag.samples.fine_filter.dt
    inside = (times > begin + 1.0) & (times < begin + 3.0)
    assert np.allclose(column[inside], 1.0, atol=0.05)


@pytest.mark.parametrize(
    'term',
    [ROTOR, JointTerm(TermKind.COULOMB), JointTerm(TermKind.COULOMB, distance=0.03), LOAD],
    ids=['rotor', 'coulomb', 'gradual', 'load'],
)
def test_equal_periods_are_computed_once(
    make_arm: Callable, columns_of: Callable, robot: Robot, term: JointTerm
) -> None:
    """The columns of 11 periods are those of all samples, also at the ends of the motion."""
    bag = columns_of(make_arm(), periods=11)
    samples = bag.samples
    whole = SampleColumns(replace(samples, cycle=len(samples.q)), Regressor(robot))
    assert len(samples.q) == 11 * samples.cycle == len(whole.motion.q)
    assert len(bag.motion.q) == 5 * samples.cycle
    assert np.array_equal(bag.rigid_raw, whole.rigid_raw)
    assert np.allclose(bag.rigid, whole.rigid, rtol=0.0, atol=1e-12)
    inertial = robot.inertial_parameters.ravel()
    for quantity in ('term', 'rate'):
        found, expected = (getattr(each, quantity)(term, inertial) for each in (bag, whole))
        # The filter's sharp edge at the coarse rate reaches farther than its memory, but weakly.
        assert np.allclose(found, expected, rtol=0.0, atol=1e-6 * np.abs(expected).max())
    assert np.array_equal(bag.links_torque(inertial), whole.links_torque(inertial))
