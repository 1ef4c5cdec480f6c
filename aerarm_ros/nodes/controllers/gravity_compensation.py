"""Follow set points and trajectories with gravity compensation, or let a person move the arm.

The control law is equation (2.14) of the thesis. Set points arrive on the topic set_point. While
the parameter hand_guiding is true, the gains are zero, so that a person can move the arm by hand.
"""

from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.control.compensation import FrictionCompensation
from aerarm_ros.control.laws.gravity_compensation import GravityCompensation
from aerarm_ros.motion.signals import ArmState, Array, JointReference
from aerarm_ros.ros.controllers.controller_node import controller_parameters
from aerarm_ros.ros.controllers.controller_parameters import scalar_or_array
from aerarm_ros.ros.controllers.trajectory_input import TRAJECTORY_PARAMETERS, TrajectoryController
from aerarm_ros.ros.parameters.parameter import Parameter

KP, KD = [60.0, 60.0, 40.0, 40.0], [5.0, 5.0, 1.0, 1.0]

PARAMETERS = controller_parameters(
    *TRAJECTORY_PARAMETERS,
    Parameter('kp', KP,
        'proportional gains, one value or one per joint', 'Nm/rad', 0.0, 1e4, live=True),
    Parameter('kd', KD,
        'derivative gains, one value or one per joint', 'Nms/rad', 0.0, 1e3, live=True),
    Parameter('hand_guiding', False,
        'whether the gains fade to zero, so that a person can move the arm by hand', live=True),
    Parameter('hand_friction', 0.7,
        'fraction of the modelled joint friction that the controller compensates during hand '
        'guiding',
        '', 0.0, 0.95),
)  # fmt: skip


class GravityCompensationNode(TrajectoryController):
    """Trajectory controller with the control law `GravityCompensation`."""

    parameters = PARAMETERS

    def make_law(
        self, dynamics: MovingBaseDynamics, friction: FrictionCompensation
    ) -> GravityCompensation:
        """Return the control law."""
        values, robot = self.values, self.arm.robot
        # During hand guiding the friction compensation uses the measured velocity. A larger width
        # reduces the effect of its noise.
        hand = FrictionCompensation(robot.viscous, robot.coulomb, 0.1, values.hand_friction)
        kp, kd = scalar_or_array(values.kp), scalar_or_array(values.kd)
        law = GravityCompensation(dynamics, kp, kd, friction, hand)
        law.hand_guiding = self._was_guided = values.hand_guiding
        return law

    def require_commandable(self, what: str) -> None:
        """Raise RejectedInputError if the topic `what` must not move the arm at present."""
        super().require_commandable(what)
        if self.law.hand_guiding:
            raise RejectedInputError(
                f'{what} rejected, because hand_guiding is true: set hand_guiding to false first'
            )

    def ahead(self, times: Array) -> JointReference | None:
        """Return the planned joint motion at `times` (M,) [s], None during hand guiding."""
        return None if self._was_guided else super().ahead(times)

    def before_update(self, state: ArmState, now: float) -> None:
        """Make the reference posture follow the arm while a person moves the arm."""
        guided = self.law.hand_guiding
        self.loop.compensating = not guided
        if guided and self.law.stiffness > 0.0:
            # The torque due to the remaining position error fades with the gains.
            if self.follower.status != 'holding':
                self.follower.stop(now, 'stopped: hand guiding')
        elif guided or self._was_guided:
            self.follower.take_over(state.q)
        self._was_guided = guided

    def describe(self) -> dict[str, object]:
        """Return the state of the motion, for /diagnostics."""
        values = super().describe()
        return {**values, 'motion': 'hand guiding'} if self.law.hand_guiding else values


main = GravityCompensationNode.main
