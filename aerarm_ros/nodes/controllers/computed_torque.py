"""Follow joint trajectories with computed-torque control, equation (2.21) of the thesis."""

from typing import Any

import numpy as np

from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.compensation import ErrorIntegral, FrictionCompensation
from aerarm_ros.control.laws.computed_torque import BoardComputedTorque, ComputedTorque
from aerarm_ros.motion.signals import Reaction
from aerarm_ros.ros.controllers.controller_node import controller_parameters
from aerarm_ros.ros.controllers.controller_parameters import REACTION, scalar_or_array
from aerarm_ros.ros.controllers.trajectory_input import TRAJECTORY_PARAMETERS, TrajectoryController
from aerarm_ros.ros.parameters.parameter import Parameter

HOST, BOARDS = 'host', 'boards'
INTEGRAL_MAX = 20.0  # [rad/s^2] largest acceleration that the integral action commands

PARAMETERS = controller_parameters(
    *TRAJECTORY_PARAMETERS,
    Parameter('feedback', HOST,
        "processor that computes the position feedback. 'host': this node, with kp and kd; "
        "'boards': the motor boards, with the gains board_kp and board_kd of the bridge",
        choices=(HOST, BOARDS)),
    Parameter('kp', [400.0],
        'proportional gains, one value or one per joint', '1/s^2', 0, 1e5, live=True),
    Parameter('kd', [40.0],
        'derivative gains, one value or one per joint', '1/s', 0, 1e4, live=True),
    Parameter('command_delay', 0.0,
        "delay that the controller compensates with feedback 'host': from a joint state to the "
        'middle of the cycle that applies its command (0.0015 s at 1 kHz)', 's', 0.0, 0.02),
    Parameter('velocity_lag', 0.0,
        "time constant of the boards' velocity low-pass, which the controller compensates with "
        "feedback 'host' (0.00159 s for 100 Hz)", 's', 0.0, 0.02),
    Parameter('ki', 0.0,
        'gain of the integral action; 0 for no integral action', '1/s^3', 0.0, 1e6),
)  # fmt: skip


class ComputedTorqueNode(TrajectoryController):
    """Trajectory controller with the control law `ComputedTorque` or `BoardComputedTorque`."""

    parameters = PARAMETERS

    def make_law(
        self, dynamics: MovingBaseDynamics, friction: FrictionCompensation
    ) -> ComputedTorque | BoardComputedTorque:
        """Return the control law that the parameter `feedback` selects."""
        values, n = self.values, self.arm.config.n
        integral = None
        if values.ki > 0.0:
            integral = ErrorIntegral(np.full(n, values.ki), np.full(n, INTEGRAL_MAX))
        if values.feedback == BOARDS:
            return BoardComputedTorque(dynamics, integral, friction)
        kp, kd = scalar_or_array(values.kp), scalar_or_array(values.kd)
        timing = values.command_delay, values.velocity_lag
        return ComputedTorque(dynamics, kp, kd, integral, friction, *timing)

    def subscribe(self) -> None:
        """Check that `feedback` permits `contact_reaction`; subscribe to reference topics."""
        self.check_parameter(REACTION, self.values.contact_reaction)
        super().subscribe()

    def check_parameter(self, name: str, value: Any) -> None:
        """Raise ValueError for an invalid gain, or a value that is invalid with `feedback`."""
        is_host = isinstance(self.law, ComputedTorque)
        if name == REACTION and value == Reaction.COMPLY.value and not is_host:
            raise ValueError(
                "with feedback 'boards' the arm cannot comply with contact forces: set "
                "contact_reaction to 'stop' or 'retreat', or set feedback to 'host'"
            )
        if name in ('kp', 'kd') and not is_host:
            raise ValueError(
                "kp and kd have no effect with feedback 'boards': set the gains of the bridge "
                "instead, or set feedback to 'host'"
            )
        super().check_parameter(name, value)


main = ComputedTorqueNode.main
