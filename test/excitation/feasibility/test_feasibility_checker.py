"""Every limit is checked, reported with its margin, and named when it binds."""

from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.excitation.feasibility import FeasibilityChecker
from aerarm_ros.excitation.settings import InfeasibleError
from aerarm_ros.excitation.trajectory import FourierTrajectory, RampedExcitation

RAMP = 2.0


def test_reported_extremes_are_those_of_a_dense_grid(
    checker: FeasibilityChecker, trajectory: FourierTrajectory
) -> None:
    report = checker.check_trajectory(trajectory, RAMP)
    assert report.feasible
    motion = RampedExcitation(trajectory, 1, RAMP)
    reference = motion.evaluate(np.linspace(0.0, motion.duration, 50001))
    reached = {(m.limit, m.subject): m.reached for m in report.margins if m.limit != 'position'}
    for j, name in enumerate(checker.limits.joint_names):
        assert reached['velocity', name] == pytest.approx(
            np.abs(reference.dq[:, j]).max(), rel=1e-5
        )
        assert reached['acceleration', name] == pytest.approx(
            np.abs(reference.ddq[:, j]).max(), rel=1e-5
        )
        low, high = (
            m.reached for m in report.margins if (m.limit, m.subject) == ('position', name)
        )
        assert low == pytest.approx(reference.q[:, j].min(), abs=1e-6)
        assert high == pytest.approx(reference.q[:, j].max(), abs=1e-6)


def test_every_kind_of_limit_is_reported(
    checker: FeasibilityChecker, trajectory: FourierTrajectory
) -> None:
    report = checker.check_trajectory(trajectory, RAMP)
    assert [m.limit for m in report.worst_of_each()] == [
        'frequency', 'position', 'velocity', 'acceleration', 'torque', 'motor current',
        'self clearance', 'ground clearance', 'holding torque', 'holding current',
    ]  # fmt: skip
    assert all(m.limit in report.as_table() for m in report.margins)
    # The column stands nearer to the ground than asked for, and nothing can be done about it.
    assert (
        'note: link1 to ground: not checked, because the distance is 0.035 m in every posture'
        in report.as_table()
    )


@pytest.mark.parametrize(
    ('field', 'limit'),
    [
        ('position_max', 'position'),
        ('velocity', 'velocity'),
        ('acceleration', 'acceleration'),
        ('effort', 'torque'),
        ('current', 'motor current'),
    ],
)
def test_a_limit_just_below_the_reached_value_is_violated(
    checker: FeasibilityChecker, trajectory: FourierTrajectory, field: str, limit: str
) -> None:
    wide = checker.check_trajectory(trajectory, RAMP)
    extreme = max(
        (m for m in wide.margins if (m.limit, m.subject) == (limit, 'joint3')),
        key=lambda margin: margin.reached,
    )
    values = getattr(checker.limits, field).copy()
    values[2] = extreme.reached - 1e-3
    narrow = FeasibilityChecker(
        replace(checker.limits, **{field: values}), None, checker.effort_model
    )
    report = narrow.check_trajectory(trajectory, RAMP)
    assert not report.feasible
    with pytest.raises(InfeasibleError, match=f'the run is infeasible: {limit} of joint3'):
        report.require('the run')


def test_a_posture_too_close_to_the_ground_binds(checker: FeasibilityChecker) -> None:
    low = FourierTrajectory(0.1, np.array([0.0, 0.1, 0.0, 0.0]), *np.full((2, 4, 1), 0.2))
    report = checker.check_trajectory(low, RAMP, stop_early=True)
    assert (report.binding.limit, report.feasible) == ('ground clearance', False)
    assert 'ground' in report.binding.subject


def test_harmonics_are_limited(checker: FeasibilityChecker, trajectory: FourierTrajectory) -> None:
    slow = FeasibilityChecker(checker.limits, highest_frequency=0.4)
    report = slow.check_trajectory(trajectory, RAMP, stop_early=True)
    assert (report.binding.limit, report.feasible) == ('frequency', False)
