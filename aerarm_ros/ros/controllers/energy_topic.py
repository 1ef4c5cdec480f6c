"""Where the arm's energy goes, on a topic."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout

from aerarm_msgs_py import topics
from aerarm_ros.energy.balance_meter import BalanceMeter
from aerarm_ros.energy.energy_balance import EnergyBalance
from aerarm_ros.energy.energy_model import EnergyModel
from aerarm_ros.motion.arm_state import ArmState
from aerarm_ros.ros.controllers.controller_parameters import ControlledArm, load_share

ROWS = (*EnergyBalance.PARTS, 'recovered')
_PERIOD = 0.1  # [s]


class EnergyTopic:
    """Adds up states, and publishes the total ten times a second of the arm's time.

    A row a cause: together what the supply gave, and last what it took back. A column a joint.

    Parameters
    ----------
    node
        Owner of the publisher.
    arm
        The arm.
    values
        Of `ENERGY_PARAMETERS`.

    Raises
    ------
    ValueError
        If a parameter cannot be used.
    """

    def __init__(self, node: Node, arm: ControlledArm, values: SimpleNamespace) -> None:
        model = EnergyModel(
            arm.config, arm.robot, values.rotor_inertia or None, load_share(values, arm.robot)
        )
        arm.load(model.dynamics, values)
        self._meter = BalanceMeter(model)
        self._resistances = {
            f'{joint.name} resistance [ohm]': joint.motor.resistance_text
            for joint in arm.config.joints
        }
        self._due = -np.inf
        topic, joints = topics.ENERGY, arm.config.joint_names
        self._publisher = node.create_publisher(topic.type, topic.name, topic.offered)
        rows, columns, n = 'cause: ' + ' '.join(ROWS), 'joint: ' + ' '.join(joints), len(joints)
        self._layout = MultiArrayLayout(
            dim=[
                MultiArrayDimension(label=rows, size=len(ROWS), stride=len(ROWS) * n),
                MultiArrayDimension(label=columns, size=n, stride=n),
            ]
        )

    def add(self, now: float, state: ArmState) -> None:
        """Take the state at `now` [s], and publish if it is due."""
        self._meter.add(now, state)
        if self._due - 2.0 * _PERIOD < now < self._due:  # else the clock may have been set back
            return
        self._due = now + _PERIOD - 0.5e-3  # states come with jitter
        total = self._meter.total
        joules = np.vstack([total.parts, total.recovered])
        self._publisher.publish(
            Float64MultiArray(layout=self._layout, data=joules.ravel().tolist())
        )

    def describe(self) -> dict[str, object]:
        """Tell the sums over the joints, and by which resistances."""
        total = self._meter.total
        told: dict[str, object] = {
            f'{name} [J]': round(float(value), 2)
            for name, value in zip(total.PARTS, total.parts.sum(axis=1), strict=True)
        }
        return {
            'energy metered for [s]': round(total.seconds, 2),
            'energy supplied [J]': round(float(total.supplied.sum()), 2),
            **told,
            'gaps left out': self._meter.gaps,
            **self._resistances,
        }
