"""Payload compensation: adapt a controller's model to the estimate of `payload_estimator`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from geometry_msgs.msg import InertiaStamped

from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.model.regressor import MomentumRegressor
from aerarm_ros.motion.signals import ArmState
from aerarm_ros.online.payload_compensation import PayloadCompensation
from aerarm_ros.ros.controllers.controller_parameters import PAYLOAD
from aerarm_ros.ros.controllers.state_node import Attendant
from aerarm_ros.ros.messages import body_of_message

if TYPE_CHECKING:  # `controller_node` imports this module
    from aerarm_ros.ros.controllers.controller_node import ControllerNode

_STEP = 0.005  # [s] between two changes of the model's payload
_CHECK_PERIOD = 0.02  # [s] between two checks of the torque residual
_MAX_GAP = 0.1  # [s] longest interval between consecutive joint states


class PayloadIntake(Attendant):
    """Adapt the payload in the controller's models gradually to the estimate on topic `payload`.

    The payload in the models is the sum of the compensated estimate and the parameter
    `payload.inertial_parameters`. Without new estimates the compensation stays until the arm's
    torques contradict it (`PayloadCompensation`).

    Parameters
    ----------
    controller
        Controller whose models receive the payload.
    """

    def __init__(self, controller: ControllerNode) -> None:
        self._controller = controller
        self._arm, self._values = controller.arm, controller.values
        self._regressor = MomentumRegressor(self._arm.robot)
        self._compensation = PayloadCompensation(
            self._values.hand_over,
            self._values.hand_over_mass_rate,
            self._values.hand_over_centre_rate,
        )
        self._link = self._arm.robot.link_names[-1]
        self._updated = self._judged = -np.inf
        self._undone = 0
        self._own = getattr(self._values, PAYLOAD)

    def take(self, message: InertiaStamped, _: float) -> None:
        """Process a payload estimate; raises RejectedInputError if the estimate is invalid."""
        if message.header.frame_id != self._link:
            raise RejectedInputError(
                f"payload rejected, because its frame is '{message.header.frame_id}' instead of "
                f"the last link '{self._link}': start payload_estimator with the URDF of this node"
            )
        try:
            self._compensation.offer(body_of_message(message))
        except ValueError as error:
            raise RejectedInputError(str(error)) from None

    def update(self) -> None:
        """Change the models' payload by one step, or check if the torque residual decreases."""
        now, state = 1e-9 * self._controller.stamp_ns, self._controller.state
        if not 0.0 <= now - self._updated < _MAX_GAP or state is None:
            self._updated = self._judged = now
            return
        if now - self._judged >= _CHECK_PERIOD - 1e-4:
            self._judge(now, state)
        elapsed = now - self._updated
        if elapsed < _STEP - 1e-4:
            return
        self._updated = now
        before = self._compensation.carried
        carried = self._compensation.update(elapsed)
        own, last = getattr(self._values, PAYLOAD), self._own
        if carried is not before or own is not last:
            self._own = own
            self._arm.carry((carried + own if len(own) else carried).tolist())

    def describe(self) -> dict[str, object]:
        """Return the mass of the compensated payload, for /diagnostics."""
        carried = self._compensation.carried
        report: dict[str, object] = {'compensated payload [kg]': round(float(carried[0]), 4)}
        if self._undone:
            report['payload compensations withdrawn'] = self._undone
        return report

    @property
    def problem(self) -> str:
        """Warning that the controller withdrew the payload compensation, or an empty string."""
        if not self._compensation.is_undone:
            return ''
        return (
            'the controller withdrew the payload compensation, because the torque residual was '
            'larger with the payload than without: check payload_estimator, and whether the arm '
            'touches an object'
        )

    def _judge(self, now: float, state: ArmState) -> None:
        elapsed, self._judged = now - self._judged, now
        residual, carried = self._controller.loop.disturbance, self._compensation.carried
        if residual is None or not carried[0]:
            return
        base = self._controller.base.motion(now)
        _, force = self._regressor.evaluate(
            state.q, state.dq, base.specific_force, base.angular_velocity
        )
        self._undone += self._compensation.judge(residual, force @ carried, elapsed)
