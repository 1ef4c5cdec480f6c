"""Feedforward from the host, feedback on the boards."""

import numpy as np
from answering_base import answering_base, joint_acceleration

from aerarm_ros.control.compensation import ErrorIntegral
from aerarm_ros.control.laws.computed_torque import BoardComputedTorque
from aerarm_ros.motion.signals import ArmState, JointReference

CYCLE = 1e-3
UPRIGHT = np.array([0.0, 1.5708, 0.0, 0.0])


def test_commands_the_reference_and_the_torque_that_makes_it(dynamics) -> None:
    reference = JointReference(UPRIGHT + 0.1, np.full(4, 0.3), np.full(4, 2.0))
    state = ArmState(UPRIGHT, np.zeros(4), np.zeros(4))
    command = BoardComputedTorque(dynamics).update(state, reference, CYCLE)
    np.testing.assert_array_equal(command.q, reference.q)
    np.testing.assert_array_equal(command.dq, reference.dq)
    # Applied to the arm on the reference, it gives the wanted acceleration.
    ddq = dynamics.fixed.forward(reference.q, reference.dq, command.tau)
    np.testing.assert_allclose(ddq, reference.ddq, atol=1e-9)


def test_on_a_free_base_it_is_the_torque_that_makes_it_there(carried) -> None:
    reference = JointReference(UPRIGHT + 0.1, np.full(4, 0.3), np.full(4, 2.0))
    state = ArmState(UPRIGHT, np.zeros(4), np.zeros(4))
    command = BoardComputedTorque(carried).update(state, reference, CYCLE, answering_base())
    ddq = joint_acceleration(carried, reference.q, reference.dq, command.tau)
    np.testing.assert_allclose(ddq, reference.ddq, atol=1e-9)


def test_the_integral_pushes_toward_the_reference(dynamics) -> None:
    law = BoardComputedTorque(dynamics, ErrorIntegral(np.full(4, 50.0), np.full(4, 10.0)))
    reference = JointReference.at_rest(UPRIGHT + [0.1, 0.0, 0.0, 0.0])
    state = ArmState(UPRIGHT, np.zeros(4), np.zeros(4))
    first = law.update(state, reference, CYCLE).tau
    for _ in range(100):
        last = law.update(state, reference, CYCLE).tau
    assert last[0] > first[0]
