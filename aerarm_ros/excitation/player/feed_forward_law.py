"""Excitation by the boards' full law, with feed-forward."""

from __future__ import annotations

import numpy as np

from aerarm_ros.excitation.feasibility.effort_model import EffortModel
from aerarm_ros.motion.float_array import FloatArray
from aerarm_ros.motion.joint_command import JointCommand
from aerarm_ros.motion.joint_reference import JointReference


class FeedForwardLaw:
    """Position and velocity reference with the torque the prior model expects, thesis (4.4).

    Parameters
    ----------
    effort_model : prior inverse dynamics.
    """

    def __init__(self, effort_model: EffortModel) -> None:
        self._effort_model = effort_model

    def command(self, reference: JointReference, position: FloatArray) -> JointCommand:
        """Return reference and feed-forward torque; the boards close the loop themselves."""
        effort = self._effort_model.effort(*(np.atleast_2d(part) for part in reference))[0]
        return JointCommand(reference.q, reference.dq, effort)
