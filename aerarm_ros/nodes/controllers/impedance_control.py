"""Move the tool to targets by Cartesian impedance control, as if a spring pulled the tool."""

import sys
from collections.abc import Sequence
from typing import Any

from aerarm_ros.control.checks import non_negative
from aerarm_ros.control.control_loop import ControlLoop
from aerarm_ros.control.laws.cartesian_impedance import CartesianImpedance
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.ros.controllers.controller_node import ControllerNode, controller_parameters
from aerarm_ros.ros.controllers.controller_parameters import (
    FRICTION_PARAMETERS,
    observer_parameters,
    scalar_or_array,
)
from aerarm_ros.ros.controllers.payload_intake import PAYLOAD_COMPENSATION_PARAMETERS
from aerarm_ros.ros.controllers.tool_topics import (
    TARGET_PARAMETERS,
    ToolTopics,
    make_target_follower,
)
from aerarm_ros.ros.parameters.parameter import Parameter
from aerarm_ros.ros.process.node_main import run_node

NAME = 'impedance_control'

PARAMETERS = controller_parameters(
    *TARGET_PARAMETERS,
    *(p for p in FRICTION_PARAMETERS if p.name != 'friction_fraction'),
    # A fraction below one of friction compensation by measured velocity keeps the arm passive.
    Parameter('friction_fraction', 0.7,
        'fraction of the modelled joint friction that the controller compensates', '', 0.0, 0.95),
    # The observer must not compensate contact forces.
    *observer_parameters(compensation=0.0),
    *PAYLOAD_COMPENSATION_PARAMETERS,
    Parameter('stiffness', [300.0],
        'translational stiffness of the tool, one value or one per axis x, y, z',
        'N/m', 0.0, 1e5, live=True),
    Parameter('damping', [40.0],
        'translational damping of the tool, one value or one per axis x, y, z',
        'Ns/m', 0.0, 1e4, live=True),
    Parameter('rest_stiffness', 2.0,
        'joint stiffness towards the home configuration, in the null space of the tool',
        'Nm/rad', 0.0, 100.0),
    Parameter('rest_damping', 0.3,
        'joint damping in the null space of the tool', 'Nms/rad', 0.0, 100.0),
)  # fmt: skip


class ImpedanceControlNode(ControllerNode):
    """Controller for tool targets with the control law `CartesianImpedance`."""

    def __init__(self) -> None:
        super().__init__(NAME, PARAMETERS)

    def make_loop(self) -> ControlLoop[Any]:
        """Create the control law and the control loop."""
        values, arm = self.values, self.arm
        dynamics, friction = arm.dynamics(values), arm.friction(values)
        self.follower = make_target_follower(values, arm)
        self.law = CartesianImpedance(
            dynamics,
            Kinematics(arm.robot, values.frame),
            scalar_or_array(values.stiffness),
            scalar_or_array(values.damping),
            arm.config.rest_position,
            values.rest_stiffness,
            values.rest_damping,
            friction,
        )
        observer = arm.observer(values, dynamics, friction)
        limit = arm.compensation_max(values)
        return ControlLoop(arm.limits, self.follower, self.law, observer, self.base, limit)

    def subscribe(self) -> None:
        """Subscribe to tool targets and to the payload estimate."""
        self.tool = ToolTopics(self, self.follower, self.values.frame)
        self.take_payload()

    def on_parameter(self, name: str, value: Any) -> None:
        """Change the stiffness or the damping of the tool."""
        setattr(self.law, name, non_negative(name, scalar_or_array(value), 3))

    def check_parameter(self, name: str, value: Any) -> None:
        """Raise ValueError unless a new stiffness or damping has one value, or one per axis."""
        if name in ('stiffness', 'damping'):
            non_negative(name, scalar_or_array(value), 3)


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node(NAME, ImpedanceControlNode, args, PARAMETERS, __doc__)


if __name__ == '__main__':
    sys.exit(main())
