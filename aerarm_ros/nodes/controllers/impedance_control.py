"""Move the tool to targets by Cartesian impedance control, as if a spring pulled the tool."""

from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.compensation import FrictionCompensation
from aerarm_ros.control.laws.cartesian_impedance import CartesianImpedance
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.ros.controllers.controller_node import controller_parameters
from aerarm_ros.ros.controllers.controller_parameters import scalar_or_array, torque_parameters
from aerarm_ros.ros.controllers.tool_topics import TARGET_PARAMETERS, ToolController
from aerarm_ros.ros.parameters.parameter import Parameter

PARAMETERS = controller_parameters(
    *TARGET_PARAMETERS,
    # The observer must not compensate contact forces.
    *torque_parameters(friction_fraction=0.7, friction_max=0.95, compensation=0.0),
    Parameter('stiffness', [300.0],
        'translational stiffness of the tool, one value or one per axis x, y, z',
        'N/m', 0.0, 1e5, live=True),
    Parameter('damping', [40.0],
        'translational damping of the tool, one value or one per axis x, y, z',
        'Ns/m', 0.0, 1e4, live=True),
)  # fmt: skip


class ImpedanceControlNode(ToolController):
    """Controller for tool targets with the control law `CartesianImpedance`."""

    parameters = PARAMETERS

    def make_law(
        self, dynamics: MovingBaseDynamics, friction: FrictionCompensation
    ) -> CartesianImpedance:
        """Return the control law."""
        values, arm = self.values, self.arm
        return CartesianImpedance(
            dynamics,
            Kinematics(arm.robot, values.frame),
            scalar_or_array(values.stiffness),
            scalar_or_array(values.damping),
            arm.config.rest_position,
            friction=friction,
        )

    def subscribe(self) -> None:
        """Subscribe to tool targets and to the payload estimate."""
        super().subscribe()
        self.take_payload()


main = ImpedanceControlNode.main
