"""Base class of all controllers: a node that publishes one command per joint state."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from std_msgs.msg import Bool, String

from aerarm_msgs_py import topics
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_msgs_py.topics import Topic
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.checks import RejectedInputError, non_negative
from aerarm_ros.control.compensation import FrictionCompensation, MomentumObserver
from aerarm_ros.control.contact_reaction import ComplyingLaw, ContactReaction
from aerarm_ros.control.control_loop import ControlLaw, ControlLoop, ReferenceSource
from aerarm_ros.control.references.trajectory_follower import TrajectoryFollower
from aerarm_ros.hardware.bridge_modes import COMMANDABLE, to_switch_on
from aerarm_ros.motion.signals import ArmState, JointReference, Reaction
from aerarm_ros.ros.controllers.controller_parameters import scalar_or_array
from aerarm_ros.ros.controllers.payload_intake import PayloadIntake
from aerarm_ros.ros.controllers.state_node import (
    Attendant,
    PlanTopic,
    StateNode,
    state_node_parameters,
)
from aerarm_ros.ros.parameters.parameter import Parameter
from aerarm_ros.ros.parameters.parameter_table import ParameterTable
from aerarm_ros.ros.process.node_main import run_node
from aerarm_ros.ros.requests.arm_client import AT_END_PARAMETERS, ArmAtEnd

_DISTURBANCE_PERIOD = 10  # answered states


def controller_parameters(*parameters: Parameter) -> ParameterTable:
    """Return the given parameters together with the parameters that all controllers share."""
    return state_node_parameters(*parameters, *AT_END_PARAMETERS)


class ControllerNode(StateNode):
    """Run a control loop while the bridge accepts commands.

    While the bridge ignores commands (the motors are off or the arm is stopped), the controller
    resets its loop. Control therefore starts at the present posture, even if a person moved the
    arm. Before the controller ends, it requests that the bridge holds the arm, if the parameter
    `at_end` is 'hold'.

    A controller is one file in `nodes/controllers`, whose name is the name of the executable and of
    the node. The file contains the table of its parameters, a class derived from this one, and its
    `main`. The class defines `make_follower` and `make_law`.

    Attributes
    ----------
    parameters
        Parameters of the node, made by `controller_parameters`. A live parameter with the name of
        an attribute of the law sets this attribute.
    loop, law, follower
        The control loop, its control law, and the source of the references.
    """

    parameters: ClassVar[ParameterTable]
    loop: ControlLoop[Any]
    law: Any
    follower: Any
    _payload: PayloadIntake | None
    _reaction: ContactReaction | None

    def __init__(self) -> None:
        super().__init__(self._name(), self.parameters)

    @classmethod
    def main(cls, args: Sequence[str] | None = None) -> int:
        """Run the node; the docstring of its module is the description in the help."""
        description = sys.modules[cls.__module__].__doc__
        return run_node(cls._name(), cls, args, cls.parameters, description)

    @classmethod
    def _name(cls) -> str:
        return cls.__module__.rpartition('.')[2]

    # Methods for derived controllers to override.

    def make_follower(self) -> ReferenceSource[Any]:
        """Return the source of the references; raises ValueError for invalid parameters."""
        raise NotImplementedError

    def make_law(
        self, dynamics: MovingBaseDynamics, friction: FrictionCompensation
    ) -> ControlLaw[Any]:
        """Return the control law; raises ValueError for invalid parameters."""
        raise NotImplementedError

    def make_observer(
        self, dynamics: MovingBaseDynamics, friction: FrictionCompensation
    ) -> MomentumObserver | None:
        """Return the disturbance observer, None if the parameter `observer_gain` is zero."""
        gain = self.values.observer_gain
        return MomentumObserver(dynamics, gain, friction) if gain else None

    def make_loop(self) -> ControlLoop[Any]:
        """Return the control loop with the law, the follower and the observer."""
        values, arm = self.values, self.arm
        dynamics, friction = arm.dynamics(values), arm.friction(values)
        self.follower = self.make_follower()
        self.law = self.make_law(dynamics, friction)
        observer = self.make_observer(dynamics, friction)
        limit = values.compensation * arm.limits.effort_max
        return ControlLoop(arm.limits, self.follower, self.law, observer, self.base, limit)

    def subscribe(self) -> None:
        """Subscribe to the topics of the references that the arm follows."""

    def before_update(self, state: ArmState, now: float) -> None:
        """Prepare the computation of the next command; called in the loop's thread."""

    def check_parameter(self, name: str, value: Any) -> None:
        """Raise ValueError unless a new gain has one value, or as many as the law needs."""
        self._for_law(name, value)

    def on_parameter(self, name: str, value: Any) -> None:
        """Set the attribute of the law that has the parameter's name."""
        setattr(self.law, name, self._for_law(name, value))

    def _for_law(self, name: str, value: Any) -> Any:
        present = getattr(self.law, name, None)
        if not isinstance(present, np.ndarray):
            return value
        return non_negative(name, scalar_or_array(value), len(present))

    # For derived controllers.

    def attend(self, attendant: Attendant) -> None:
        """Add an attendant, which the loop calls at every joint state."""
        self._attendants.append(attendant)

    def publish_plan(self, ahead: Callable[[Any], JointReference | None]) -> None:
        """Publish the planned motion; `ahead` returns the references for times (M,) [s]."""

        def after_state(times: NDArray[np.float64]) -> JointReference | None:
            return ahead(1e-9 * self.stamp_ns + times)

        names = self.arm.config.joint_names
        self.attend(PlanTopic(self.node, names, lambda: self.stamp_ns, after_state))

    def take_payload(self) -> None:
        """Subscribe to the payload estimate, if payload compensation is enabled."""
        if self.values.hand_over == 0.0:
            return
        self._payload = PayloadIntake(self)
        self.listen(topics.PAYLOAD, self._payload.take)
        self.attend(self._payload)

    def react_to_contact(self, follower: TrajectoryFollower, law: ComplyingLaw) -> ContactReaction:
        """Subscribe to contacts, and return the reaction that `contact_reaction` selects."""
        values = self.values
        reaction = ContactReaction(
            follower, self.loop, law, values.retreat_time, values.comply_stiffness
        )
        reaction.reaction = Reaction(values.contact_reaction)

        def take(message: Bool, _: float) -> None:
            # Without control there is no motion that a contact could stop.
            if self._mode in COMMANDABLE:
                reaction.report(message.data, 1e-9 * self.stamp_ns)

        self.listen(topics.CONTACT, take)
        self._reaction = reaction
        return reaction

    def require_commandable(self, what: str) -> None:
        """Raise RejectedInputError, about topic or action `what`, if the arm must not move."""
        if self._mode not in COMMANDABLE:
            mode = self._mode or 'unknown'
            raise RejectedInputError(
                f"{what} rejected, because the arm is in mode '{mode}': first run "
                f'{to_switch_on(mode)}'
            )

    def take_references(self, topic: Topic, act: Callable[[Any, float], None]) -> None:
        """Subscribe to a reference topic; reject its messages while the bridge ignores commands."""

        def take(message: Any, now: float) -> None:
            self.require_commandable(topic.name)
            act(message, now)

        self.listen(topic, take)

    # Methods that StateNode calls.

    def build(self) -> None:
        """Create the control loop."""
        self.loop = self.make_loop()
        self._codec = JointStateCdr(self.arm.config.joint_names)
        self._mode = ''
        self._answered = self._logged = 0
        self._attendants: list[Attendant] = []
        self._payload = None
        self._reaction = None

    def connect(self) -> None:
        """Advertise the command and disturbance topics, and subscribe to the arm's mode."""
        self._commands = self.advertise(topics.JOINT_COMMAND)
        self._disturbance = self.advertise(topics.DISTURBANCE)
        self._arm_at_end = ArmAtEnd(self.node, self.values)
        self.listen(topics.ARM_MODE, self._on_mode)
        self.subscribe()

    def answer(self, stamp_ns: int, state: ArmState) -> None:
        """Compute and publish the joint command for a joint state."""
        if self._mode not in COMMANDABLE:
            self.loop.release()
            self.answers.withdraw()
            for attendant in self._attendants:
                attendant.give_up(f"the arm is in mode '{self._mode}'")
            return
        now = stamp_ns * 1e-9
        self.before_update(state, now)
        if self._reaction is not None:
            self._reaction.update(state.q, now)
        command = self.loop.update(state, now)
        if command is None:
            return
        payload = self._codec.pack(stamp_ns, *command)
        latency_ns = self.since_state_ns()
        self.answers.publish(self._commands, payload)
        # The bridge has its command, so the following work delays no other node.
        self.count_answer(latency_ns)
        self._log_begin(state)
        self.loop.observe()
        for attendant in self._attendants:
            attendant.update()
        self._answered += 1
        if self.loop.disturbance is not None and self._answered % _DISTURBANCE_PERIOD == 0:
            self._disturbance.publish(self._codec.pack(stamp_ns, effort=self.loop.disturbance))

    def leave(self) -> None:
        """If `at_end` is 'hold', request that the bridge holds the arm."""
        if self._mode in COMMANDABLE and self.answers.are_kept:
            self._arm_at_end.leave()

    def close(self) -> None:
        """Destroy the ROS entities of the attendants, then the node."""
        for attendant in self._attendants:
            attendant.destroy()
        super().close()

    def warning(self) -> str:
        """Return the warning for /diagnostics, or an empty string."""
        if self._mode not in COMMANDABLE:
            return f"the arm is in mode '{self._mode}': run {to_switch_on(self._mode)}"
        if self.loop.base is not None and (problem := super().warning()):
            return problem
        if self._payload is not None and self._payload.problem:
            return self._payload.problem
        reaction = self._reaction
        if (
            reaction is None
            or reaction.reaction is Reaction.REPORT
            or not reaction.is_silent(1e-9 * self.stamp_ns)
        ):
            return ''
        return (
            f"contact_reaction is '{reaction.reaction.value}', but no node publishes the topic "
            'contact: start contact_estimator'
        )

    def describe(self) -> dict[str, object]:
        """Return the values of this controller for /diagnostics."""
        loop = self.loop
        values = {
            **super().describe(),
            'arm mode': self._mode,
            'activations': loop.take_overs,
            'joint states skipped': loop.skipped,
        }
        if self._payload is not None:
            values |= self._payload.describe()
        if self._reaction is not None and self._reaction.reaction is not Reaction.REPORT:
            values['reactions to contact'] = self._reaction.count
        if loop.base is None:
            values['base motion'] = (
                'not used, because the boards control velocity and need no model torque'
            )
        if loop.disturbance is not None:
            values['disturbance [Nm]'] = loop.disturbance.round(3).tolist()
        return values

    def _log_begin(self, state: ArmState) -> None:
        """Log the posture at which control starts, once per activation of the loop."""
        if self.loop.take_overs == self._logged:
            return
        self._logged = self.loop.take_overs
        where = ', '.join(
            f'{name} {angle:.2f}'
            for name, angle in zip(self.arm.config.joint_names, state.q.tolist(), strict=True)
        )
        self.node.get_logger().info(
            f'control starts at the joint positions {where} rad', throttle_duration_sec=1.0
        )

    def _on_mode(self, message: String, _: float) -> None:
        self._mode = message.data
        if self._mode not in COMMANDABLE:
            self.answers.withdraw()
