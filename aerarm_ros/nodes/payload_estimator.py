"""Estimate mass, centre of mass and inertia of the payload that the moving arm carries.

The node receives joint_states at 1 kHz. It publishes the estimated payload on `payload` and the
estimated friction on `joint_friction`, both at 50 Hz. The estimate does not include a payload of
`payload.inertial_parameters`. The arm must start without any other payload, and move for one
second before the first estimate.

With --bag DIR the program estimates the payload from recordings, without ROS (--bag DIR --help
lists the options).
"""

from __future__ import annotations

from collections.abc import Sequence

from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout, String

from aerarm_msgs_py import topics
from aerarm_ros.control.base.base_motion_estimator import NONE
from aerarm_ros.hardware.bridge_modes import HELD
from aerarm_ros.motion.signals import ArmState
from aerarm_ros.online.payload_estimator import FRICTION_NAMES, OnlineEstimate, PayloadEstimator
from aerarm_ros.ros.controllers.controller_parameters import MODEL_PARAMETERS, load_share
from aerarm_ros.ros.controllers.payload_parameters import ESTIMATOR_PARAMETERS, estimator_settings
from aerarm_ros.ros.controllers.state_node import StateNode, state_node_parameters
from aerarm_ros.ros.messages import inertia_message
from aerarm_ros.ros.process.node_main import run_node
from aerarm_ros.ros.states.state_stream import base_header

NAME = 'payload_estimator'

# [s] after the motors have started to hold the arm; a person who carried it may still touch it.
_RELEASE_TIME = 1.0

PARAMETERS = state_node_parameters(*ESTIMATOR_PARAMETERS, *MODEL_PARAMETERS)


class PayloadEstimatorNode(StateNode):
    """Node that estimates the payload from joint states, and publishes the estimate."""

    answers_every_state = False
    # No joint state may be left out; the queue holds the states of half a second.
    states_waiting = 500

    def __init__(self) -> None:
        super().__init__(NAME, PARAMETERS)

    def build(self) -> None:
        """Create the payload estimator."""
        values = self.values
        if self.arm.drone is not None and values.base_motion == NONE:
            raise ValueError(
                "drone_file is set, but base_motion is 'none': set base_motion to 'free', because "
                'the estimator needs the motion of the drone'
            )
        self.base = self.arm.measured_base(values)
        self._estimator = PayloadEstimator(
            self.arm.dynamics(values),
            self.arm.robot.viscous,
            self.arm.robot.coulomb,
            load_share(values, self.arm.robot),
            estimator_settings(values),
        )
        self._mode = ''
        self._held_since: float | None = None

    def connect(self) -> None:
        """Create the publishers of payload and friction, and subscribe to the arm's mode."""
        self._payload = self.advertise(topics.PAYLOAD)
        self._friction = self.advertise(topics.JOINT_FRICTION)
        n, names = self.arm.robot.n, self.arm.config.joint_names
        self._layout = MultiArrayLayout(
            dim=[
                MultiArrayDimension(label=', '.join(FRICTION_NAMES), size=3, stride=3 * n),
                MultiArrayDimension(label='joint: ' + ' '.join(names), size=n, stride=n),
            ]
        )
        self.listen(topics.ARM_MODE, self._on_mode)

    def answer(self, stamp_ns: int, state: ArmState) -> None:
        """Process a joint state, and publish a payload estimate if a new one exists."""
        now = stamp_ns * 1e-9
        if self._pause(now):
            self._estimator.pause()
            return
        estimate = self._estimator.update(state, now, self.base.motion(now))
        if estimate is not None:
            self._send(stamp_ns, estimate)
            self.count_answer()

    def warning(self) -> str:
        """Return why the payload cannot be estimated, or an empty string."""
        return super().warning() or self._estimator.problem

    def describe(self) -> dict[str, object]:
        """Return the last valid estimate of payload and friction, for /diagnostics."""
        report = {**super().describe(), 'detected changes': self._estimator.changes}
        estimate = self._estimator.estimate
        if estimate is None:
            return {**report, 'carries': 'not yet identified'}
        payload, friction = estimate.payload, zip(FRICTION_NAMES, estimate.friction, strict=True)
        report['carries'] = 'a payload' if estimate.carries else 'nothing'
        report['standard deviation of the mass [kg]'] = round(float(payload.std[0]), 5)
        if estimate.carries:
            report['mass [kg]'] = round(payload.mass, 4)
            report['centre [m]'] = payload.centre.round(4).tolist()
            report['standard deviations of the centre [m]'] = payload.centre_std.round(4).tolist()
            report['inertial parameters'] = payload.inertial.round(6).tolist()
            report['standard deviations of the inertial parameters'] = payload.std.round(6).tolist()
            report['not excited'] = ' '.join(estimate.unexcited) or 'none'
        report |= {f'friction: {name}': row.round(4).tolist() for name, row in friction}
        spread = zip(FRICTION_NAMES, estimate.friction_std, strict=True)
        report |= {f'standard deviations of {name}': row.round(4).tolist() for name, row in spread}
        return {**report, 'unexplained torque [Nm]': estimate.residual.round(4).tolist()}

    def _pause(self, now: float) -> bool:
        """Return whether unknown forces may act on the arm, so that the estimator must pause."""
        if self.base.problem(now):
            return True
        if self._mode and self._mode not in HELD:
            self._held_since = None
            return True
        if self._held_since is None or now < self._held_since:
            self._held_since = now
        return now - self._held_since < _RELEASE_TIME

    def _send(self, stamp_ns: int, estimate: OnlineEstimate) -> None:
        header = base_header(stamp_ns, estimate.payload.link)
        payload = estimate.payload
        inertia = (payload.mass, payload.centre, payload.barycentric_inertia)
        self._payload.publish(inertia_message(header, *inertia))
        self._friction.publish(
            Float64MultiArray(layout=self._layout, data=estimate.friction.ravel().tolist())
        )

    def _on_mode(self, message: String, _: float) -> None:
        self._mode = message.data


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node(NAME, PayloadEstimatorNode, args, PARAMETERS, __doc__)
