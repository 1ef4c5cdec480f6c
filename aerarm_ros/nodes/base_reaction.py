"""Tells the drone what the arm does to it: wrench at the mount, mass, centre, inertia, energy.

Everything is in base_link's axes, moments about its origin. `base_wrench` is the wrench of
the arm on the drone; `base_wrench_static` is its part due to gravity. `energy` tells what it takes
from the battery, and for what.
"""

import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
from geometry_msgs.msg import InertiaStamped, PointStamped, WrenchStamped
from numpy.typing import NDArray
from std_msgs.msg import Header

from aerarm_msgs_py import topics
from aerarm_ros.control.base.acceleration_estimate import AccelerationEstimate
from aerarm_ros.control.base.base_reaction import BaseReaction
from aerarm_ros.control.base.free_base_estimator import FREE
from aerarm_ros.control.control_loop import LONGEST_GAP
from aerarm_ros.motion.arm_state import ArmState
from aerarm_ros.ros.controllers.controller_parameters import ENERGY_PARAMETERS
from aerarm_ros.ros.controllers.energy_topic import EnergyTopic
from aerarm_ros.ros.controllers.state_node import StateNode, state_node_parameters
from aerarm_ros.ros.parameters.parameter import Parameter
from aerarm_ros.ros.process.node_main import run_node
from aerarm_ros.ros.states.base_header import base_header

NAME = 'base_reaction'

PARAMETERS = state_node_parameters(
    Parameter('rate', 100.0, 'how often the wrench is published', 'Hz', 1.0, 1000.0),
    Parameter('cutoff', 20.0, 'low-pass of the joint acceleration', 'Hz', 0.1, 500.0),
    *ENERGY_PARAMETERS,
)


class BaseReactionNode(StateNode):
    """Joint states in, `BaseReaction` out, at a rate of its own."""

    answers_every_state = False

    def __init__(self) -> None:
        super().__init__(NAME, PARAMETERS)

    def build(self) -> None:
        """Make the model and the acceleration's estimate."""
        if self.values.base_motion == FREE:
            # A wrench that contains the drone's own acceleration would come back by its rotors.
            self.base = self.arm.hovering_base(self.values)
        self._reaction = BaseReaction(self.arm.robot)
        self.arm.load(self._reaction.dynamics, self.values)
        self._acceleration = AccelerationEstimate(self.arm.config.n, self.values.cutoff)
        # A little less than a period: states come with jitter.
        self._period = 1.0 / self.values.rate - 0.5e-3
        self._last = self._due = -np.inf
        self._result: BaseReaction.ArmReaction | None = None

    def connect(self) -> None:
        """Advertise what the drone wants to know."""
        self._wrench = self.advertise(topics.BASE_WRENCH)
        self._static = self.advertise(topics.STATIC_WRENCH)
        self._inertia = self.advertise(topics.ARM_INERTIA)
        self._com = self.advertise(topics.ARM_COM)
        self._energy = EnergyTopic(self.node, self.arm, self.values)

    def answer(self, stamp_ns: int, state: ArmState) -> None:
        """Publish the reaction if it is due."""
        now = stamp_ns * 1e-9
        if now == self._last and self._result is not None:
            self._send(stamp_ns, self._result)  # an emulated arm tells its state again
            return
        dt, self._last = now - self._last, now
        if not 0.0 < dt < LONGEST_GAP:
            self._acceleration.reset()
            self._due = -np.inf  # the clock may have been set back
        ddq = self._acceleration.update(state.dq, dt)
        self._energy.add(now, state)
        if now < self._due:
            return
        self._due = now + self._period
        self._result = self._reaction.evaluate(state.q, state.dq, ddq, self.base.motion(now))
        self._send(stamp_ns, self._result)
        self.count_answer()

    def describe(self) -> dict[str, object]:
        """Tell the joules, too."""
        return {**super().describe(), **self._energy.describe()}

    def _send(self, stamp_ns: int, result: BaseReaction.ArmReaction) -> None:
        header = base_header(stamp_ns, self.arm.robot.base_link)
        self._wrench.publish(_wrench_message(header, result.wrench))
        self._static.publish(_wrench_message(header, result.static))
        self._com.publish(_point_message(header, result.com))
        self._inertia.publish(_inertia_message(header, result))


def _wrench_message(header: Header, wrench: NDArray[np.float64]) -> WrenchStamped:
    message = WrenchStamped(header=header)
    _fill(message.wrench.force, wrench[:3])
    _fill(message.wrench.torque, wrench[3:])
    return message


def _point_message(header: Header, point: NDArray[np.float64]) -> PointStamped:
    message = PointStamped(header=header)
    _fill(message.point, point)
    return message


def _inertia_message(header: Header, result: BaseReaction.ArmReaction) -> InertiaStamped:
    message = InertiaStamped(header=header)
    inertia, tensor = message.inertia, result.inertia.tolist()
    inertia.m = result.mass
    _fill(inertia.com, result.com)
    inertia.ixx, inertia.ixy, inertia.ixz = tensor[0]
    inertia.iyy, inertia.iyz, inertia.izz = tensor[1][1], tensor[1][2], tensor[2][2]
    return message


def _fill(message: Any, vector: NDArray[np.float64]) -> None:
    message.x, message.y, message.z = vector.tolist()


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node(NAME, BaseReactionNode, args, PARAMETERS, __doc__)


if __name__ == '__main__':
    sys.exit(main())
