"""Tracking accuracy of the controllers, on the whole stack without ROS."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.excitation.trajectory import FourierTrajectory, RampedExcitation
from aerarm_ros.experiment import experiment_bench
from aerarm_ros.experiment.experiment_bench import (
    BOARDS,
    CAD,
    HOST,
    TRUE,
    ExperimentBench,
    ExperimentCase,
    ExperimentRun,
)
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.nodes import experiment
from aerarm_ros.simulation.arm_plant import PlantParameters
from aerarm_ros.simulation.base_profile import MOVING

UPRIGHT = np.array([0.0, np.pi / 2, 0.0, 0.0])


@pytest.fixture(scope='module', autouse=True)
def short_rest() -> Iterator[None]:
    """Let the arm rest for 0.1 s before and after a motion."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(experiment_bench, 'SETTLE', 0.1)
        yield


@pytest.fixture(scope='module')
def nominal() -> PlantParameters:
    return PlantParameters.nominal(load_arm_config(), load_robot())


@pytest.fixture(scope='module')
def motion() -> RampedExcitation:
    """Return 3 s of a trajectory with harmonics up to 1 Hz."""
    alpha, beta = np.random.default_rng(2).uniform(-0.1, 0.1, (2, 4, 2))
    return RampedExcitation(FourierTrajectory(0.5, UPRIGHT, alpha, beta), 1, 0.5)


def make_bench(truth: PlantParameters, motion: RampedExcitation) -> ExperimentBench:
    return ExperimentBench(load_arm_config(), load_robot(), truth, motion)


def joint_rms(run: ExperimentRun) -> np.ndarray:
    return np.sqrt(((run.qd - run.q)[run.at_full_speed] ** 2).mean(axis=0))


def tool_rms(run: ExperimentRun) -> float:
    position = Kinematics(load_robot()).position
    moving = run.at_full_speed
    pairs = zip(run.q[moving], run.qd[moving], strict=True)
    errors = [position(q) - position(qd) for q, qd in pairs]
    return float(np.sqrt((np.array(errors) ** 2).sum(axis=1).mean()))


@pytest.fixture(scope='module')
def exact(nominal, motion) -> ExperimentBench:
    """Return the bench of an arm that differs from CAD; the case `TRUE` knows this arm."""
    return make_bench(nominal.perturbed(7), motion)


@pytest.fixture(scope='module')
def still(exact) -> ExperimentRun:
    return exact.run(ExperimentCase(HOST, TRUE))


def test_the_exact_model_tracks_below_a_milliradian(exact, still) -> None:
    assert np.all(joint_rms(still) < 1e-3)
    assert np.all(joint_rms(exact.run(ExperimentCase(BOARDS, TRUE))) < 1e-3)


def test_the_observer_makes_up_for_a_wrong_model(nominal, motion) -> None:
    """CAD links in the controller, 25 % too little friction."""
    wrong = replace(
        nominal.perturbed(7),
        rotor_inertia=nominal.rotor_inertia,
        viscous=nominal.viscous / 0.75,
        coulomb=nominal.coulomb / 0.75,
    )
    bench = make_bench(wrong, motion)
    plain, observed = (
        tool_rms(bench.run(ExperimentCase(HOST, CAD, observer=x))) for x in (False, True)
    )
    assert observed < plain / 3.0


def test_the_imu_makes_up_for_a_moving_base(exact, still) -> None:
    """Swings of 30 degrees at 0.5 Hz: errors as on a still base, unlike without the IMU."""
    aware = exact.run(replace(still.case, base=MOVING, aware=True))
    unaware = exact.run(replace(still.case, base=MOVING))
    for error in (lambda run: joint_rms(run).max(), tool_rms):
        assert error(aware) < 1.5 * error(still)
        assert error(unaware) > 3.0 * error(still)


def test_a_joint_held_on_a_moving_base_is_no_stuck_encoder(nominal) -> None:
    """The joint's torque follows the base while its angle stays within one count."""
    zero = np.zeros((4, 1))
    posture = FourierTrajectory(0.6, np.array([0.3, 0.4, 0.2, -0.5]), zero, zero)
    bench = make_bench(nominal.perturbed(7), RampedExcitation(posture, 1, 0.5))
    run = bench.run(ExperimentCase(HOST, TRUE, True, MOVING, True))
    held = run.time > 1.0
    assert np.ptp(run.q[held], axis=0).max() < 3e-3
    assert np.ptp(run.effort[held], axis=0).max() > 2.0


def test_writes_table_and_page(still, tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.setattr(ExperimentBench, 'run', lambda bench, case: still)
    only, file = still.case.name, tmp_path / 'controllers.html'
    arguments = ['--only', only, '--amplitude', '0.05', '--out', str(tmp_path)]
    assert experiment.main(arguments) == 0
    assert only in capsys.readouterr().out
    page = file.read_text()
    assert only in page

    file.unlink()
    file.mkdir()  # so that no page can be written
    assert experiment.main(arguments) == 1
    said = capsys.readouterr()
    assert only in said.out
    assert said.err.count('\n') == 1
    assert f'cannot write the page {file} (Is a directory)' in said.err


@pytest.mark.parametrize(
    ('arguments', 'text'),
    [
        (['--only', 'nothing'], "no case has a name that contains 'nothing' (--only): choose from"),
        (['--out', '/proc/experiment'], '/proc/experiment'),
    ],
)
def test_impossible_runs_and_outputs_are_reported_at_the_start(arguments, text, capsys) -> None:
    assert experiment.main(arguments) == 1
    assert text in capsys.readouterr().err
