"""Move the tool to targets by joint velocities from inverse kinematics.

Sections 2.5.2 and 2.5.3 of the thesis describe the control laws.
"""

from typing import Any

from aerarm_ros.control.control_loop import ControlLoop
from aerarm_ros.control.laws.kinematic_control import (
    CartesianMotionControl,
    DampedInverse,
    JointMotionControl,
    VelocityResolution,
)
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.ros.controllers.controller_node import controller_parameters
from aerarm_ros.ros.controllers.tool_topics import TARGET_PARAMETERS, ToolController
from aerarm_ros.ros.parameters.parameter import Parameter

JOINT, CARTESIAN = 'joint', 'cartesian'

PARAMETERS = controller_parameters(
    *TARGET_PARAMETERS,
    Parameter('scheme', CARTESIAN,
        'space in which the controller feeds the position error back: joint or Cartesian',
        choices=(JOINT, CARTESIAN)),
    Parameter('gain', 8.0,
        'feedback gain K: position errors decay as exp(-K t)', '1/s', 0.0, 100.0),
)  # fmt: skip


class KinematicControlNode(ToolController):
    """Tool controller with the control law `CartesianMotionControl` or `JointMotionControl`."""

    parameters = PARAMETERS

    def make_loop(self) -> ControlLoop[Any]:
        """Return a control loop that commands velocities, without a model of torques."""
        values, arm = self.values, self.arm
        self.follower = self.make_follower()
        self.resolution = VelocityResolution(
            Kinematics(arm.robot, values.frame),
            arm.limits,
            arm.config.rest_position,
            DampedInverse(),
        )
        scheme = CartesianMotionControl if values.scheme == CARTESIAN else JointMotionControl
        self.law = scheme(self.resolution, values.gain)
        return ControlLoop(arm.limits, self.follower, self.law)

    def describe(self) -> dict[str, object]:
        """Return the Jacobian's smallest singular value and the slowdown, for /diagnostics."""
        return {
            **super().describe(),
            'smallest singular value [m/rad]': round(self.resolution.least_singular_value, 4),
            'slowdown': round(self.resolution.slowdown, 3),
        }


main = KinematicControlNode.main
