"""Publish the arm's effect on the drone: wrench, mass properties, feedforward and energy.

All vectors are in the axes of base_link, and moments are about the origin of base_link.
`base_wrench` is the wrench of the arm on the drone, and `base_wrench_static` the part due to
gravity. For feedforward the node publishes mass properties, `base_wrench_weight` and
`base_wrench_motion`. With a drone_file the node also publishes `feedforward_acceleration`. While
odometry and rotor_command arrive, `contact_wrench` is the estimated wrench of contacts on drone and
arm. `energy` is the energy that the arm draws from the battery, by cause.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from std_msgs.msg import String

from aerarm_msgs_py import topics
from aerarm_ros.control.base.base_motion_estimator import AccelerationEstimate
from aerarm_ros.control.base.free_base_estimator import FREE
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.control_loop import LONGEST_GAP
from aerarm_ros.hardware.bridge_modes import HELD
from aerarm_ros.motion.signals import ArmState, JointReference
from aerarm_ros.ros.controllers.controller_parameters import MODEL_PARAMETERS
from aerarm_ros.ros.controllers.reaction_topics import (
    BANDWIDTH,
    CONTACT_PARAMETERS,
    LOAD_PARAMETERS,
    ContactTopic,
    EnergyTopic,
    LoadTopics,
)
from aerarm_ros.ros.controllers.state_node import StateNode, state_node_parameters
from aerarm_ros.ros.graph import SilencePatience
from aerarm_ros.ros.messages import wrench_message
from aerarm_ros.ros.parameters.parameter import Parameter
from aerarm_ros.ros.process.node_main import run_node
from aerarm_ros.ros.states.state_stream import base_header

NAME = 'base_reaction'

PARAMETERS = state_node_parameters(
    Parameter('rate', 100.0,
        'publishing rate of base_wrench and base_wrench_static', 'Hz', 1.0, 1000.0),
    Parameter('cutoff', 20.0,
        'cutoff frequency of the low-pass filter of the measured joint acceleration',
        'Hz', 0.1, 500.0),
    *LOAD_PARAMETERS,
    *CONTACT_PARAMETERS,
    *MODEL_PARAMETERS,
)  # fmt: skip


class BaseReactionNode(StateNode):
    """Node that computes the arm's reaction on the drone from joint states, and publishes it."""

    answers_every_state = False

    def __init__(self) -> None:
        super().__init__(NAME, PARAMETERS)

    def build(self) -> None:
        """Create the model of the arm and the estimator of the joint accelerations."""
        if self.values.base_motion == FREE:
            # If the wrench contained the effect of the drone's acceleration, feed-forward to the
            # rotors would close a feedback loop.
            self.base = self.arm.hovering_base(self.values)
        self._dynamics = MovingBaseDynamics(self.arm.robot)
        self.arm.load(self._dynamics, self.values)
        self._acceleration = AccelerationEstimate(self.arm.config.n, self.values.cutoff)
        # A little less than a period, because joint states arrive with jitter.
        self._period = 1.0 / self.values.rate - 0.5e-3
        self._last = self._due = -np.inf
        self._is_located = True

    def connect(self) -> None:
        """Create the publishers and subscriptions."""
        self._wrench = self.advertise(topics.BASE_WRENCH)
        self._static = self.advertise(topics.STATIC_WRENCH)
        self._loads = LoadTopics(self)
        self.listen(topics.PLANNED_MOTION, self._loads.take_plan)
        self.listen(topics.ARM_MODE, self._on_mode)
        self._contact = ContactTopic(self)
        self._energy = EnergyTopic(self)
        states = self.node.resolve_topic_name(topics.JOINT_STATES.name)
        self._patience = SilencePatience(self.node, states)

    def answer(self, stamp_ns: int, state: ArmState) -> None:
        """Process a joint state; publish the reaction if its period has passed."""
        self._is_located = bool(np.isfinite(state.q).all())
        if not self._is_located:
            self._acceleration.reset()
            self._loads.fade()
            self._contact.fade()
            return
        now = stamp_ns * 1e-9
        dt, self._last = now - self._last, now
        if not 0.0 < dt < LONGEST_GAP:
            self._acceleration.reset()
            self._due = -np.inf  # the clock may have been set back
        ddq = self._acceleration.update(state.dq, dt)
        self._energy.add(now, state)
        self._loads.add(stamp_ns, JointReference(state.q, state.dq, ddq))
        self._contact.add(stamp_ns, state)
        if now < self._due:
            return
        self._due = now + self._period
        motion = self.base.motion(now)
        wrench, static = self._dynamics.reaction(state.q, state.dq, ddq, motion)
        header = base_header(stamp_ns, self.arm.robot.base_link)
        self.answers.publish(self._wrench, wrench_message(header, wrench))
        self.answers.publish(self._static, wrench_message(header, static))
        self.count_answer()

    def silence(self, silent_for: float) -> float:
        """Fade the published wrenches of motion and contact to zero while no joint states arrive.

        If the computer that emulates an arm pauses, the wrenches do not fade, because simulation
        time pauses too.
        """
        timeout = super().silence(silent_for)
        if silent_for <= self._patience.limit(timeout):
            return timeout
        pauses = self._loads.fade(), self._contact.fade()
        return min((pause for pause in pauses if pause), default=timeout)

    def on_parameter(self, name: str, value: Any) -> None:
        """Change the preview time `lead` or the cutoff frequency of `contact_wrench`."""
        if name == BANDWIDTH:
            self._contact.set_bandwidth(value)
        else:
            self._loads.forecast.lead = value

    def warning(self) -> str:
        """Return a warning if joint positions or inputs of an estimate are missing, else ''."""
        if not self._is_located:
            return 'joint positions are unknown, so base_reaction publishes nothing: home the arm'
        return super().warning() or self._contact.problem()

    def _on_mode(self, message: String, _: float) -> None:
        self._loads.forecast.is_held = message.data in HELD

    def describe(self) -> dict[str, object]:
        """Return the states of motion forecast, contact and energy estimate, for /diagnostics."""
        motion = self._loads.forecast.problem or 'planned'
        others = {**self._contact.describe(), **self._energy.describe()}
        return {**super().describe(), 'motion forecast': motion, **others}


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node(NAME, BaseReactionNode, args, PARAMETERS, __doc__)
