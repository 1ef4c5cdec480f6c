"""Thesis (2.21): the error obeys (2.22), in every joint, for any motion of the arm."""

import numpy as np
import pytest
from answering_base import answering_base, joint_acceleration

from aerarm_ros.control.compensation import ErrorIntegral, FrictionCompensation
from aerarm_ros.control.laws.computed_torque import BoardComputedTorque, ComputedTorque
from aerarm_ros.motion.signals import ArmState, JointCommand, JointReference

CYCLE = 1e-3
KP, KD = 100.0, 20.0
UPRIGHT = np.array([0.0, 1.5708, 0.0, 0.0])
AMPLITUDE = np.array([0.5, 0.4, 0.6, 0.7])
RATE = np.array([2.0, 3.0, 2.5, 3.5])


def sine_reference(now: float) -> JointReference:
    angle = RATE * now
    return JointReference(
        UPRIGHT + AMPLITUDE * np.sin(angle),
        AMPLITUDE * RATE * np.cos(angle),
        -AMPLITUDE * RATE**2 * np.sin(angle),
    )


def test_error_decays_as_the_error_dynamics_predict(dynamics, frictionless_bench) -> None:
    law = ComputedTorque(dynamics, KP, KD)
    offset = np.array([0.1, -0.05, 0.1, -0.1])
    arm = frictionless_bench(UPRIGHT - offset)
    arm.plant.reset(UPRIGHT - offset, AMPLITUDE * RATE)
    run = arm.run(lambda state, now: law.update(state, sine_reference(now), CYCLE), 1.0)
    error = np.array([sine_reference(t).q for t in run.time]) - run.q
    # Critically damped with w = 10 rad/s, from rest: e = e0 (1 + w t) exp(-w t).
    w = np.sqrt(KP)
    predicted = np.outer((1.0 + w * run.time) * np.exp(-w * run.time), offset)
    # The torque is held for 1 ms, so the loop is 0.5 ms late.
    np.testing.assert_allclose(error, predicted, atol=0.01 * np.abs(offset).max())


def test_tracks_below_a_milliradian_with_friction(dynamics, bench, config) -> None:
    friction = FrictionCompensation(config.column('viscous'), config.column('coulomb'))
    law = ComputedTorque(dynamics, 400.0, 40.0, friction=friction)
    arm = bench(UPRIGHT)
    arm.plant.reset(UPRIGHT, AMPLITUDE * RATE)
    run = arm.run(lambda state, now: law.update(state, sine_reference(now), CYCLE), 4.0)
    error = np.array([sine_reference(t).q for t in run.time]) - run.q
    assert np.all(np.sqrt((error[500:] ** 2).mean(axis=0)) < 1e-3)


def test_the_integral_removes_a_constant_error(dynamics, frictionless_bench) -> None:
    reference = JointReference.at_rest(UPRIGHT)
    final = []
    for integral in (None, ErrorIntegral(np.full(4, 400.0), np.full(4, 100.0))):
        law = ComputedTorque(dynamics, KP, KD, integral)
        law.take_over(UPRIGHT)
        run = frictionless_bench(UPRIGHT).run(
            lambda state, now: law.update(state, reference, CYCLE),  # noqa: B023
            3.0,
            disturbance=np.array([0.3, 0.5, 0.1, 0.1]),
        )
        final.append(np.abs(run.q[-1] - UPRIGHT))
    assert np.all(final[0] > 1e-2)
    assert np.all(final[1] < 0.01 * final[0])


def test_known_delays_are_compensated(dynamics, frictionless_bench) -> None:
    """A torque acts one cycle later for one cycle; velocities pass a low-pass."""
    delay, lag = 1.5 * CYCLE, 1.59e-3
    errors = []
    for timing in ((0.0, 0.0), (delay, lag)):
        law = ComputedTorque(dynamics, 400.0, 40.0, None, None, *timing)
        arm = frictionless_bench(UPRIGHT)
        arm.plant.reset(UPRIGHT, AMPLITUDE * RATE)
        run = arm.run(Late(law, lag), 1.5)
        error = np.array([sine_reference(t).q for t in run.time]) - run.q
        errors.append(np.sqrt((error[500:] ** 2).mean(axis=0)))
    assert np.all(errors[1] < 0.2 * errors[0])


class Late:
    """A law whose commands act one cycle later, with filtered velocities."""

    def __init__(self, law: ComputedTorque, lag: float) -> None:
        self._law = law
        self._share = CYCLE / (CYCLE + lag)  # a ramp is told so much later
        self._dq = AMPLITUDE * RATE
        self._next = None

    def __call__(self, state: ArmState, now: float) -> JointCommand:
        self._dq = self._dq + self._share * (state.dq - self._dq)
        command = self._law.update(state._replace(dq=self._dq), sine_reference(now), CYCLE)
        due, self._next = self._next or command, command
        return due


@pytest.mark.parametrize('is_free', [False, True])
def test_boards_get_the_reference_and_the_torque_that_makes_it(
    dynamics, carried, is_free: bool
) -> None:
    reference = JointReference(UPRIGHT + 0.1, np.full(4, 0.3), np.full(4, 2.0))
    state = ArmState(UPRIGHT, np.zeros(4), np.zeros(4))
    model, base = (carried, answering_base()) if is_free else (dynamics, None)
    q, dq, tau = BoardComputedTorque(model).update(state, reference, CYCLE, base)
    np.testing.assert_array_equal([q, dq], reference[:2])
    # Applied to the arm on the reference, it gives the wanted acceleration.
    at = (q, dq, tau)
    ddq = joint_acceleration(carried, *at) if is_free else dynamics.fixed.forward(*at)
    np.testing.assert_allclose(ddq, reference.ddq, atol=1e-9)
    law = BoardComputedTorque(model, ErrorIntegral(np.full(4, 50.0), np.full(4, 10.0)))
    efforts = [law.update(state, reference, CYCLE, base).tau[0] for _ in range(100)]
    assert efforts[-1] > efforts[0], 'the integral pushes toward the reference'
