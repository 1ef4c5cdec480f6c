"""Tells where the arm's energy goes: joules by joint and cause, since it was started.

On `energy`, as a table: a row a cause (copper, friction, gravity, inertia, unexplained, burnt,
standby: together what the supply gave; recovered: what it took back), a column a joint.
"""

import sys
from collections.abc import Sequence

import numpy as np
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout

from aerarm_msgs_py import topics
from aerarm_ros.energy.balance_meter import BalanceMeter
from aerarm_ros.energy.energy_balance import EnergyBalance
from aerarm_ros.energy.energy_model import EnergyModel
from aerarm_ros.motion.arm_state import ArmState
from aerarm_ros.ros.controllers.controller_parameters import ENERGY_PARAMETERS, one_or_each
from aerarm_ros.ros.controllers.state_node import StateNode, state_node_parameters
from aerarm_ros.ros.parameters.parameter import Parameter
from aerarm_ros.ros.process.node_main import run_node

NAME = 'energy_monitor'
ROWS = (*EnergyBalance.PARTS, 'recovered')

PARAMETERS = state_node_parameters(
    Parameter('rate', 10.0, 'how often the joules are published', 'Hz', 0.1, 100.0),
    *ENERGY_PARAMETERS,
)


class EnergyMonitorNode(StateNode):
    """Joint states in, the total of a `BalanceMeter` out, at a rate of its own."""

    answers_every_state = False

    def __init__(self) -> None:
        super().__init__(NAME, PARAMETERS)

    def build(self) -> None:
        """Make the model and the meter."""
        values, arm = self.values, self.arm
        model = EnergyModel(
            arm.config, arm.robot, values.rotor_inertia or None, one_or_each(values.load_friction)
        )
        arm.load(model.dynamics, values)
        self._meter = BalanceMeter(model)
        self._period = 1.0 / values.rate - 0.5e-3  # states come with jitter
        self._due = -np.inf

    def connect(self) -> None:
        """Advertise the table."""
        self._energy = self.advertise(topics.ENERGY)
        joints = self.arm.config.joint_names
        rows, columns, n = 'cause: ' + ' '.join(ROWS), 'joint: ' + ' '.join(joints), len(joints)
        self._layout = MultiArrayLayout(
            dim=[
                MultiArrayDimension(label=rows, size=len(ROWS), stride=len(ROWS) * n),
                MultiArrayDimension(label=columns, size=n, stride=n),
            ]
        )

    def answer(self, stamp_ns: int, state: ArmState) -> None:
        """Add the state up, and publish if it is due."""
        now = stamp_ns * 1e-9
        self._meter.add(now, state)
        if self._due - 2.0 * self._period < now < self._due:
            return
        self._due = now + self._period
        total = self._meter.total
        joules = np.vstack([total.parts, total.recovered])
        self._energy.publish(Float64MultiArray(layout=self._layout, data=joules.ravel().tolist()))
        self.count_answer()

    def describe(self) -> dict[str, object]:
        """Tell the sums over the joints."""
        total = self._meter.total
        told: dict[str, object] = {
            f'{name} [J]': round(float(value), 2)
            for name, value in zip(total.PARTS, total.parts.sum(axis=1), strict=True)
        }
        return {
            **super().describe(),
            'seconds metered': round(total.seconds, 2),
            'supplied [J]': round(float(total.supplied.sum()), 2),
            **told,
            'gaps left out': self._meter.gaps,
        }


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node(NAME, EnergyMonitorNode, args, PARAMETERS, __doc__)


if __name__ == '__main__':
    sys.exit(main())
