from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from carrying_run import COLD, CarryingRun

from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.model.inertia import minimum_eigenvalue
from aerarm_ros.motion.signals import ArmState
from aerarm_ros.online.information_filter import SPECK
from aerarm_ros.online.payload_estimator import EstimatorSettings, OnlineEstimate, PayloadEstimator
from aerarm_ros.online.replay import KnownArm
from aerarm_ros.simulation.arm_plant import PlantParameters, Spread


def feed(
    estimator: PayloadEstimator, states: list[tuple[float, ArmState]]
) -> Iterator[OnlineEstimate]:
    for now, state in states:
        estimate = estimator.update(state, now)
        if estimate is not None:
            yield estimate


@pytest.fixture(scope='module')
def estimates(run: CarryingRun) -> list[OnlineEstimate]:
    return list(feed(run.estimator(), run.states()))


def test_a_payload_is_found_weighed_and_put_down(
    run: CarryingRun, estimates: list[OnlineEstimate]
) -> None:
    carrying = np.array([estimate.carries for estimate in estimates])
    times = np.array([estimate.time for estimate in estimates])
    changes = times[1:][carrying[1:] != carrying[:-1]]
    assert len(changes) == 2
    assert 0.0 < changes[0] - run.pick_up < 0.5
    assert 0.0 < changes[1] - run.put_down < 0.5
    assert min(minimum_eigenvalue(estimate.payload.inertial) for estimate in estimates) > 0.0
    payload = estimates[int(np.argmax(times >= run.pick_up + 2.0))].payload
    true_centre = run.payload[1:4] / run.payload[0]
    assert payload.mass == pytest.approx(run.payload[0], rel=0.05)
    assert np.linalg.norm(payload.centre - true_centre) < 5e-3
    assert abs(payload.mass - run.payload[0]) < 2.0 * payload.std[0]
    assert (np.abs(payload.centre - true_centre) < 2.0 * payload.centre_std).all()
    last, true = estimates[-1], run.truth.coulomb
    assert last.payload.mass == SPECK
    # Friction that has changed is estimated as well.
    error = np.abs(last.friction[1] - true)
    assert (error < 0.7 * (COLD - 1.0) * true).all()
    assert (error < 3.0 * last.friction_std[1]).all()


def test_viscous_coulomb_and_load_dependent_friction_are_separated(robot: Robot) -> None:
    """Each coefficient is wrong in another joint."""
    plant = PlantParameters.nominal(load_arm_config(), robot)
    known = np.array([plant.viscous, plant.coulomb, plant.load_friction])
    worn = known * 1.0
    worn[0, 0] *= 3.0
    worn[1, 2] *= 1.3
    worn[2, 1] *= 2.0
    estimator = KnownArm(robot, plant.rotor_inertia, known).estimator()
    (*_, last) = feed(estimator, swinging(robot, plant.rotor_inertia, worn, 15.0))
    assert not last.carries
    changed = worn != known
    found = (last.friction - known)[changed] / (worn - known)[changed]
    assert found == pytest.approx(1.0, abs=0.25)
    assert (np.abs(last.friction - worn) < 3.0 * last.friction_std).all()
    assert (np.abs(worn - known) > 3.0 * last.friction_std)[changed].all()


def swinging(
    robot: Robot, rotor_inertia: np.ndarray, friction: np.ndarray, seconds: float
) -> list[tuple[float, ArmState]]:
    """Return a hundred states per second of a swinging arm without payload."""
    time = np.arange(0.0, seconds, 0.01)[:, np.newaxis, np.newaxis]
    rate = 2.0 * np.pi * np.array([[0.21, 0.63], [0.17, 0.47], [0.31, 0.83], [0.37, 0.97]])
    swing = np.array([[0.6, 0.25], [0.5, 0.25], [0.5, 0.3], [0.6, 0.3]])
    q = np.array([0.0, 1.2, 0.3, -0.4]) + (swing * np.sin(rate * time)).sum(axis=2)
    dq = (swing * rate * np.cos(rate * time)).sum(axis=2)
    ddq = -(swing * rate**2 * np.sin(rate * time)).sum(axis=2)
    return measured(robot, rotor_inertia, friction, (q, dq, ddq))


def measured(
    robot: Robot,
    rotor_inertia: np.ndarray,
    friction: np.ndarray,
    motion: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> list[tuple[float, ArmState]]:
    """Return the states of a motion (q, dq, ddq) of a hundred rows a second."""
    q, dq, ddq = motion
    data = robot.model.createData()
    links = np.array([pin.rnea(robot.model, data, *x) for x in zip(q, dq, ddq, strict=True)])
    dry = (friction[1] + friction[2] * np.abs(links)) * np.tanh(dq / 0.01)
    tau = links + rotor_inertia * ddq + friction[0] * dq + dry
    tau += 0.02 * np.random.default_rng(0).normal(size=tau.shape)
    during = 0.5 * (tau[1:] + tau[:-1])
    return [(0.01 * k, ArmState(q[k + 1], dq[k + 1], row)) for k, row in enumerate(during)]


def test_a_knock_is_not_carried_for_long(robot: Robot) -> None:
    plant = PlantParameters.nominal(load_arm_config(), robot)
    friction = np.array([plant.viscous, plant.coulomb, plant.load_friction])
    states = swinging(robot, plant.rotor_inertia, friction, 7.0)
    knock = np.array([0.0, 2.0, 0.5, 0.0])  # [Nm], for a tenth of a second
    knocked = [
        (now, state._replace(tau=state.tau + (3.0 <= now < 3.1) * knock)) for now, state in states
    ]
    told = list(feed(KnownArm(robot, plant.rotor_inertia, friction).estimator(), knocked))
    carrying = [estimate.time for estimate in told if estimate.carries]
    assert 3.0 < carrying[0] < 3.2
    assert 1.9 < carrying[-1] - carrying[0] < 2.5
    assert told[-1].payload.mass == SPECK


def test_model_errors_of_one_percent_are_no_payload(example_urdf: Callable[[str], Path]) -> None:
    """Six joints that carry up to 10 Nm move between postures, some of which are new."""
    robot = load_robot(example_urdf('z1.urdf'), locked=('jointGripper',))
    n, random = robot.n, np.random.default_rng(4)
    low, high = robot.posture_range
    postures = 0.5 * (low + high) + 0.3 * (high - low) * random.uniform(-1.0, 1.0, (20, n))
    s = np.arange(0.0, 1.0, 0.01 / 1.5)[:, np.newaxis]
    share = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    pairs = zip(postures, postures[1:], strict=False)
    q = np.concatenate([start + share * (end - start) for start, end in pairs])
    dq = np.gradient(q, 0.01, axis=0)
    ddq = np.gradient(dq, 0.01, axis=0)
    friction = np.repeat([[0.3], [0.3], [0.03]], n, axis=1)
    truth = PlantParameters(
        robot.joint_names,
        robot.link_names,
        np.array(robot.inertial_parameters),
        np.full(n, 0.02),
        *friction,
        np.ones(n),
        np.ones(n),
    )
    states = measured(robot, truth.rotor_inertia, friction, (q, dq, ddq))
    known = truth.perturbed(4, Spread(0.01, 0.005, 0.0005, 0.15, 0.15, 0.02, 0.0))
    estimator = KnownArm(
        robot.with_inertial_parameters(known.inertial_parameters),
        known.rotor_inertia,
        np.array([known.viscous, known.coulomb, known.load_friction]),
    ).estimator(EstimatorSettings(tare_mass=0.03))
    assert not any(estimate.carries for estimate in feed(estimator, states))
    assert estimator.has_moved_empty
    assert estimator.changes == 0
    assert not estimator.problem


def test_a_payload_present_from_the_start_is_reported_and_not_estimated(run: CarryingRun) -> None:
    estimator = run.estimator()
    carrying = [
        (now, state) for now, state in run.states() if run.pick_up < now < run.pick_up + 2.0
    ]
    assert not any(estimate.carries for estimate in feed(estimator, carrying))
    assert 'at the start' in estimator.problem
    bare = [(now, state) for now, state in run.states() if now < run.pick_up]
    later = [(now + run.put_down, state) for now, state in bare]
    assert not any(estimate.carries for estimate in feed(estimator, later))
    assert not estimator.problem


def test_a_dead_effort_leaves_the_last_good_estimate(run: CarryingRun) -> None:
    estimator = run.estimator()
    states = [(now, state) for now, state in run.states() if now < run.pick_up + 1.5]
    good = list(feed(estimator, states))[-1]
    dead = [
        (now, state._replace(tau=np.zeros(4)))
        for now, state in run.states()
        if run.pick_up + 1.5 <= now < run.pick_up + 2.5
    ]
    list(feed(estimator, dead))
    assert 'effort of' in estimator.problem
    assert estimator.estimate is not None
    assert estimator.estimate.payload.mass == pytest.approx(good.payload.mass, rel=0.1)


@pytest.mark.parametrize('kind', ['wrong signs', 'saturation', 'noise', 'rest'])
def test_whatever_comes_in_it_stays_a_body(run: CarryingRun, robot: Robot, kind: str) -> None:
    random = np.random.default_rng(1)
    states = [state for now, state in run.states() if now < 2.0]
    if kind == 'wrong signs':
        states = [state._replace(tau=-state.tau) for state in states]
    elif kind == 'saturation':
        states = [state._replace(tau=np.clip(state.tau, -0.3, 0.3)) for state in states]
    elif kind == 'noise':
        noise = random.normal(size=(2000, 3, 4)) * 10.0 ** random.uniform(-3, 3, size=(2000, 1, 1))
        states = [ArmState(*rows) for rows in noise]
    else:
        rest = states[0]
        states = [rest._replace(tau=random.normal(size=4), dq=np.zeros(4)) for _ in range(2000)]
    estimator = PayloadEstimator(
        MovingBaseDynamics(robot, 0.01), 0.01, 0.1, 0.03, EstimatorSettings(tare_mass=10.0)
    )
    for number, state in enumerate(states):
        estimate = estimator.update(state, 1e-3 * number)
        if estimate is not None:
            assert minimum_eigenvalue(estimate.payload.inertial) > 0.0
            assert np.isfinite(estimate.payload.covariance).all()
            assert (np.linalg.eigvalsh(estimate.payload.covariance) > 0.0).all()
