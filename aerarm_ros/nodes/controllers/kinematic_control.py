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
    Parameter('singular_threshold', 0.03,
        'singular value of the Jacobian below which its inverse is damped', 'm/rad', 1e-4, 1.0),
    Parameter('singular_damping', 0.02,
        'damping of the inverse Jacobian at a singularity', 'm/rad', 1e-4, 1.0),
    Parameter('rest_gain', 0.5,
        'gain of the null-space motion towards the home configuration, which does not move the '
        'tool', '1/s', 0.0,
        20.0),
    Parameter('limit_gain', 5.0,
        'gain of the motion away from a position limit', '1/s', 0.1, 100.0),
    Parameter('limit_margin', 0.02,
        'distance from a position limit below which the joint moves away from the limit',
        'rad', 0.0,
        1.0),
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
            DampedInverse(values.singular_threshold, values.singular_damping),
            values.rest_gain,
            values.limit_gain,
            values.limit_margin,
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
