"""Commands of the motor bench, and their measured parts."""

import numpy as np
import pytest

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.excitation.bench_motion import BenchMotion, BenchPlan, bench_checker, split
from aerarm_ros.excitation.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.feasibility import FeasibilityChecker
from aerarm_ros.excitation.settings import ExcitationError, MotionLimits

LIMITS = MotionLimits.of_arm(load_arm_config())
REST = np.array(load_arm_config().rest_position)


def motion(plan: BenchPlan | None = None, joints=range(4), posture=REST) -> BenchMotion:
    return BenchMotion(plan or BenchPlan(), LIMITS, REST, np.array(posture), joints)


def test_every_speed_is_measured_both_ways_at_constant_velocity() -> None:
    bench = motion()
    speeds = [m.speed for m in bench.measurements if m.joint == 2 and m.speed is not None]
    assert sorted(speeds) == sorted(s * v for v in BenchPlan().speeds for s in (1, -1))
    grid = np.arange(0.0, bench.sequence.duration, 1e-2)
    for measurement, rows in split(bench.measurements, grid):
        assert measurement.start <= grid[rows][0] and grid[rows][-1] < measurement.end
        count = 100 * (measurement.end - measurement.start)
        assert len(grid[rows]) == pytest.approx(count, abs=1)
        time = np.linspace(measurement.start, measurement.end, 50)
        states = bench.sequence.evaluate(time)
        still = np.delete(states.dq, measurement.joint, axis=1)
        np.testing.assert_allclose(still, 0.0, atol=1e-12)
        if measurement.speed is not None:
            moving = states.dq[:, measurement.joint]
            np.testing.assert_allclose(moving, measurement.speed, atol=1e-12)


def test_acceleration_runs_use_the_given_fraction_of_the_limits() -> None:
    bench = motion(joints=[3])
    (run,) = [m for m in bench.measurements if m.speed is None]
    states = bench.sequence.evaluate(np.arange(run.start, run.end, 1e-3))
    velocity = np.abs(states.dq[:, 3]).max() / LIMITS.velocity[3]
    acceleration = np.abs(states.ddq[:, 3]).max() / LIMITS.acceleration[3]
    assert velocity <= 0.6 + 1e-9
    assert acceleration <= 0.5 + 1e-9
    assert max(velocity / 0.6, acceleration / 0.5) == pytest.approx(1.0, rel=1e-3)


def test_swings_are_sine_waves_about_the_posture() -> None:
    plan = BenchPlan(swings=3)
    bench = motion(plan, [3])
    (swings,) = [m for m in bench.measurements if m.swings]
    states = bench.sequence.evaluate(np.arange(swings.start, swings.end, 1e-3))
    q, dq, ddq = (values[:, 3] for values in states)
    assert [q.max(), -q.min()] == pytest.approx([plan.amplitude] * 2, rel=1e-4)
    # A whole number of equal waves.
    q, ddq = q - q.mean(), ddq - ddq.mean()
    np.testing.assert_allclose(ddq, q * (ddq @ q) / (q @ q), atol=1e-2)
    assert np.sum((q[:-1] < 0.0) & (q[1:] >= 0.0)) in (2, 3)
    reached = np.abs(dq).max() / LIMITS.velocity[3], np.abs(ddq).max() / LIMITS.acceleration[3]
    assert max(reached[0] / 0.6, reached[1] / 0.5) == pytest.approx(1.0, rel=1e-2)
    bench.require_feasible(FeasibilityChecker(LIMITS))


@pytest.mark.parametrize(
    ('plan', 'message'),
    [
        ({'speeds': (0.5,)}, 'two or more different'),
        ({'speeds': (0.5, -1.0)}, 'positive'),
        ({'span': 0.0}, 'span'),
        ({'span': 6.0}, 'joint1 can move 5.93 rad about 0 rad'),
        ({'speeds': (0.5, 6.0)}, 'velocity limit of joint1 is 5 rad/s'),
        ({'speeds': (0.5, 4.0), 'span': 0.5}, 'choose a larger span'),
        ({'swings': 1, 'amplitude': 0.9}, 'at most half of the span'),
    ],
)
def test_plans_that_make_no_sense_are_refused(plan: dict, message: str) -> None:
    with pytest.raises(ExcitationError, match=message):
        motion(BenchPlan(**plan))


@pytest.mark.parametrize('mounted', [True, False])
def test_the_motion_respects_the_limits_of_the_arm(setup: ExcitationSetup, mounted: bool) -> None:
    bench = motion()
    bench.require_feasible(bench_checker(setup, mounted))
    end = bench.sequence.evaluate(bench.sequence.duration)
    np.testing.assert_allclose(end.q, REST, atol=1e-9)
    np.testing.assert_allclose(end.dq, 0.0, atol=1e-9)
    # the postures that show backlash
    for joint, posture in ((0, [0.0, 0.3, 0.0, 0.0]), (2, [0.0, 0.97, 0.7, -1.4])):
        plan = BenchPlan(speeds=(0.4, 0.8), span=0.8, swings=1)
        swinging = BenchMotion(plan, setup.limits, REST, np.array(posture), [joint])
        swinging.require_feasible(bench_checker(setup, mounted))
