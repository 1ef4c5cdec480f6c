"""Payload compensation: move a controller's model to the payload estimate."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
from geometry_msgs.msg import InertiaStamped

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.model.regressor import MomentumRegressor
from aerarm_ros.motion.signals import ArmState
from aerarm_ros.online.payload_compensation import PayloadCompensation
from aerarm_ros.ros.controllers.controller_parameters import PAYLOAD, ControlledArm, body_of_message
from aerarm_ros.ros.parameters.parameter import Parameter, grouped

# [s] between updates of the model's payload.
_STEP = 0.005
_JUDGED = 0.02
_LONGEST = 0.1  # [s] longest interval between consecutive states

PAYLOAD_COMPENSATION_PARAMETERS = grouped(
    'Payload compensation',
    Parameter('hand_over', 0.0,
        'fraction of the payload estimate that the controller adds to its model; 0 '
                'ignores payload_estimator',
        '', 0.0, 1.0),
    Parameter('hand_over_mass_rate', 0.2,
        'rate at which the controller fades payload compensation in and out', 'kg/s', 1e-3, 10.0),
    Parameter('hand_over_centre_rate', 0.1,
        'rate at which '
        "the controller moves the payload's centre of mass in its model", 'm/s', 1e-3, 10.0),
)  # fmt: skip


class PayloadIntake:
    """Move the model's payload to the estimate on the topic `payload`, between two commands.

    PayloadIntake is an `Attendant` that adds the compensated payload to
    `payload.inertial_parameters`. Without new estimates the compensation stays until the arm's
    torques contradict it (`PayloadCompensation`).

    Parameters
    ----------
    arm
        Arm whose models receive the payload.
    values
        Parameters of the node.
    now
        Returns the stamp of the newest state [s], and the state.
    residual
        Returns the observed disturbance (n,) [Nm], None without an observer.
    base
        Returns the base's motion at a time [s].
    """

    def __init__(
        self,
        arm: ControlledArm,
        values: SimpleNamespace,
        now: Callable[[], tuple[float, ArmState | None]],
        residual: Callable[[], np.ndarray | None],
        base: Callable[[float], BaseMotion],
    ) -> None:
        self._arm = arm
        self._values = values
        self._now = now
        self._residual = residual
        self._base = base
        self._regressor = MomentumRegressor(arm.robot)
        self._hand_over = PayloadCompensation(
            values.hand_over, values.hand_over_mass_rate, values.hand_over_centre_rate
        )
        self._link = arm.robot.link_names[-1]
        self._updated = self._judged = -np.inf
        self._undone = 0
        self._own = getattr(values, PAYLOAD)

    def take(self, message: InertiaStamped, _: float) -> None:
        """Process a payload estimate; raises RejectedInputError if it is invalid."""
        if message.header.frame_id != self._link:
            raise RejectedInputError(
                f"payload rejected, because its frame is '{message.header.frame_id}' instead of "
                f"the last link '{self._link}': start payload_estimator with the same arm"
            )
        try:
            self._hand_over.offer(body_of_message(message))
        except ValueError as error:
            raise RejectedInputError(str(error)) from None

    def update(self) -> None:
        """Move the model's payload one step, and check whether the disturbance becomes smaller."""
        now, state = self._now()
        if not 0.0 <= now - self._updated < _LONGEST or state is None:
            self._updated = self._judged = now
            return
        if now - self._judged >= _JUDGED - 1e-4:
            self._judge(now, state)
        elapsed = now - self._updated
        if elapsed < _STEP - 1e-4:
            return
        self._updated = now
        before = self._hand_over.carried
        carried = self._hand_over.update(elapsed)
        own, last = getattr(self._values, PAYLOAD), self._own
        if carried is not before or own is not last:
            self._own = own
            self._arm.carry((carried + own if len(own) else carried).tolist())

    def give_up(self, reason: str) -> None:
        """Keep the compensated payload while the arm is not controlled."""

    def destroy(self) -> None:
        """Do nothing: this object owns no ROS entities."""

    def describe(self) -> dict[str, object]:
        """Return the compensated payload for diagnostics."""
        carried = self._hand_over.carried
        report: dict[str, object] = {'compensated payload [kg]': round(float(carried[0]), 4)}
        if self._undone:
            report['payload compensations withdrawn'] = self._undone
        return report

    @property
    def problem(self) -> str:
        """Problem of the payload compensation; empty if there is none."""
        if not self._hand_over.is_undone:
            return ''
        return (
            'the controller withdrew the payload compensation, because it increased the torque '
            'residual: check payload_estimator, and whether the arm touches something'
        )

    def _judge(self, now: float, state: ArmState) -> None:
        elapsed, self._judged = now - self._judged, now
        residual, carried = self._residual(), self._hand_over.carried
        if residual is None or not carried[0]:
            return
        base = self._base(now)
        _, force = self._regressor.evaluate(
            state.q, state.dq, base.specific_force, base.angular_velocity
        )
        self._undone += self._hand_over.judge(residual, force @ carried, elapsed)
