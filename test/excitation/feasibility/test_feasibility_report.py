"""The report of the binding limit."""

import pytest

from aerarm_ros.excitation.feasibility import FeasibilityReport, LimitMargin
from aerarm_ros.excitation.settings import InfeasibleError


def margin(limit: str, subject: str, reached: float, allowed: float) -> LimitMargin:
    slack = allowed - reached
    return LimitMargin(limit, subject, reached, allowed, slack, slack / allowed, 'unit', 1.5)


WIDE, NEAR = margin('velocity', 'a', 1.0, 5.0), margin('velocity', 'b', 4.9, 5.0)
BROKEN = margin('torque', 'a', 12.0, 10.0)


def test_the_relatively_closest_limit_binds() -> None:
    report = FeasibilityReport([WIDE, NEAR])
    assert report.feasible
    assert report.binding is NEAR
    report.require('anything')


def test_a_broken_limit_is_named_with_its_numbers() -> None:
    report = FeasibilityReport([WIDE, NEAR, BROKEN])
    with pytest.raises(
        InfeasibleError,
        match=r'the run is infeasible: torque of a: 12 unit at t = 1.50 s, limit 10 unit',
    ):
        report.require('the run')


def test_one_line_a_kind_of_limit() -> None:
    report = FeasibilityReport([WIDE, NEAR, BROKEN])
    assert report.worst_of_each() == [NEAR, BROKEN]
    assert len(report.as_table().splitlines()) == 2
