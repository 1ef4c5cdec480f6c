"""Commands from a reference in the velocity mode."""

import numpy as np

from aerarm_ros.excitation.player import VelocityLaw
from aerarm_ros.motion.signals import JointReference

REFERENCE = JointReference(*np.random.default_rng(0).normal(size=(3, 4)))
MEASURED = REFERENCE.q + 0.01


def test_velocity_law_corrects_the_position_error() -> None:
    command = VelocityLaw(2.0).command(REFERENCE, MEASURED)
    np.testing.assert_allclose(command.dq, REFERENCE.dq - 0.02)
    assert command.q is None
    assert command.tau is None


def test_without_gain_it_is_the_thesis_pure_velocity_command() -> None:
    command = VelocityLaw(0.0).command(REFERENCE, MEASURED)
    np.testing.assert_array_equal(command.dq, REFERENCE.dq)


def test_the_corrected_velocity_never_exceeds_the_limit() -> None:
    limit = np.full(4, 2.5)
    far = REFERENCE.q - np.array([3.0, -3.0, 3.0, 0.0])
    command = VelocityLaw(20.0, limit).command(REFERENCE, far)
    np.testing.assert_array_equal(command.dq[:3], [2.5, -2.5, 2.5])
    assert command.dq[3] == REFERENCE.dq[3]
