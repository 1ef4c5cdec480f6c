"""A designed trajectory is feasible, better than its start, and repeatable."""

from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.description.resources import resource
from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.excitation.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.parallel_design import design_all
from aerarm_ros.excitation.settings import (
    DesignStoppedError,
    ExcitationConfig,
    ExcitationError,
    InfeasibleError,
)
from aerarm_ros.excitation.trajectory_designer import (
    DesignResult,
    DesignSpecification,
    Quality,
    TrajectoryDesigner,
)
from aerarm_ros.model.regressor import Regressor


def test_condition_number_by_the_thesis_definition(designed: DesignResult, robot: Robot) -> None:
    """Thesis (5.2) on the exact regressor along one period; it has 47."""
    time = np.arange(0.0, 10.0, 0.005)
    regressor = Regressor(robot)
    singular = np.linalg.svd(regressor.stack(*designed.trajectory.evaluate(time)), compute_uv=False)
    assert singular[30] < 1e-9 * singular[0]
    assert singular[0] / singular[29] < 25.0
    assert designed.quality.condition_number == pytest.approx(singular[0] / singular[29], rel=0.02)


def test_beats_its_start_and_keeps_every_limit(
    designer: TrajectoryDesigner, designed: DesignResult, setup: ExcitationSetup
) -> None:
    start = designer.initial(0)
    assert designed.report.feasible
    assert setup.checker.check_trajectory(designed.trajectory, setup.config.ramp_time).feasible
    # Deviations shrink by e^0.6 = 1.8 times against this start, in the geometric mean.
    assert designed.quality.log_deviation < start.quality.log_deviation - 0.5
    plan = setup.planner.plan(designed.trajectory, 2, setup.config.bias_of(setup.robot))
    assert plan.duration > 24.0


def test_a_stop_ends_the_search(designer: TrajectoryDesigner) -> None:
    assert list(design_all(designer.specification, 4, 1, stop=lambda: True)) == []
    with pytest.raises(DesignStoppedError, match='stopped before a feasible'):
        designer.design(0, lambda: True)


def test_a_stop_in_the_middle_of_a_start_keeps_its_best(
    designer: TrajectoryDesigner, setup: ExcitationSetup
) -> None:
    calls = 0

    def stop() -> bool:
        nonlocal calls
        calls += 1
        return calls > 70

    start, stopped = designer.initial(0), designer.design(0, stop)
    assert stopped.report.feasible
    assert setup.checker.check_trajectory(stopped.trajectory, setup.config.ramp_time).feasible
    assert stopped.quality.objective < start.quality.objective
    assert 'stopped' in stopped.remark


def test_designs_of_another_arm_do_not_depend_on_the_workers() -> None:
    robot = load_robot(resource('config', 'examples', 'three_joints.urdf'))
    specification = DesignSpecification(
        ExcitationSetup.of_robot(robot, ExcitationConfig()), harmonics=3
    )
    one, two = (
        {found.start: found for found in design_all(specification, 2, workers)}
        for workers in (1, 2)
    )
    start = TrajectoryDesigner(specification).initial(0).quality
    for number in (0, 1):
        assert one[number].report.feasible
        assert one[number].quality.objective == pytest.approx(
            two[number].quality.objective, rel=1e-9
        )
    assert one[0].quality.objective != one[1].quality.objective
    assert one[0].quality.log_deviation < start.log_deviation - 0.25


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        ({'condition_limit': 0.5}, 'condition limit must exceed 1'),
        ({'seed': -1}, 'must not be negative'),
        ({'fundamental': 0.5}, r'exceeds 2 Hz \(highest_frequency of the excitation configuration'),
        ({'harmonics': 6000}, r'exceeds 500 Hz \(half the control rate'),
    ],
)
def test_wrong_specifications_name_the_limit(
    setup: ExcitationSetup, change: dict, message: str
) -> None:
    with pytest.raises(ExcitationError, match=message):
        DesignSpecification(setup, **change)


def test_infeasible_limits_name_the_one_that_binds(setup: ExcitationSetup) -> None:
    crawling = replace(setup.limits, velocity=np.full(4, 1e-3))
    slow = ExcitationSetup(
        setup.robot, setup.config, crawling, setup.rotor_inertia, setup.torque_per_ampere
    )
    with pytest.raises(
        InfeasibleError, match=r'amplitude 0.35 rad is .* velocity of joint\d exceeds its limit'
    ):
        TrajectoryDesigner(DesignSpecification(slow)).initial(0)


def test_a_better_condition_number_must_not_increase_the_deviations(
    designer: TrajectoryDesigner, designed: DesignResult
) -> None:
    """The objective alone would trade a lower condition number for larger deviations."""
    specification, start = designer.specification, Quality(1.0, 50.0, 20.0, -1.0)
    assert specification.betters(Quality(0.5, 30.0, 10.0, -1.1), start)
    assert specification.betters(Quality(0.5, 30.0, 10.0, -1.0), start)
    assert not specification.betters(Quality(0.5, 30.0, 10.0, -0.9), start)
    assert not specification.betters(Quality(0.5, 51.0, 10.0, -1.6), start)
    assert not specification.betters(start, start)
    # Below its limit the condition number is free.
    limit = specification.condition_limit
    low = Quality(1.0, 0.8 * limit, 10.0, -1.0)
    assert specification.betters(Quality(0.9, 0.9 * limit, 10.0, -1.1), low)
    assert specification.betters(designed.quality, designer.initial(0).quality)


def test_an_optimum_that_no_amplitude_repairs_still_helps(
    designer: TrajectoryDesigner, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The optimum's bias is outside of the limits, so smaller amplitudes do not help."""
    start = designer.initial(0)
    begin = designer._basis.coefficients(start.trajectory)
    optimum = begin.copy()
    optimum[1:] *= 1.2
    optimum[0, 1] += 10.0
    monkeypatch.setattr(designer, '_optimise', lambda *_: optimum)
    tried = []
    check = designer._check
    monkeypatch.setattr(designer, '_check', lambda t: tried.append(t) or check(t))
    assert designer.design(0).report.feasible
    nearest = min(np.abs(designer._basis.coefficients(t) - begin).max() for t in tried)
    assert nearest == pytest.approx(4.0)
