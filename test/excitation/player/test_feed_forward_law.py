"""Commands from a reference in the mode with feedforward."""

import numpy as np

from aerarm_ros.excitation.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.player import FeedForwardLaw
from aerarm_ros.motion.signals import JointReference

REFERENCE = JointReference(*np.random.default_rng(0).normal(size=(3, 4)))
MEASURED = REFERENCE.q + 0.01


def test_feed_forward_is_the_torque_of_the_reference(setup: ExcitationSetup) -> None:
    command = FeedForwardLaw(setup.effort_model).command(REFERENCE, MEASURED)
    np.testing.assert_array_equal(command.q, REFERENCE.q)
    np.testing.assert_array_equal(command.dq, REFERENCE.dq)
    rows = (part[np.newaxis] for part in REFERENCE)
    np.testing.assert_allclose(command.tau, setup.effort_model.effort(*rows)[0])
