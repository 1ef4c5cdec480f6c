"""Estimate the external joint torque of an arm and detect contact, without a contact sensor.

The node compares the measured torque with the torque of the identified model. It publishes
`external_torque`, `contact` (yes or no), `contact_confidence` and `contact_force`. The contact
thresholds are in `residuals_file`, which `contact_estimator --free BAG --out DIR` learns from a
recording without contact. With --bag DIR the program searches recordings for contact instead
(--bag DIR --help lists the options).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64

from aerarm_msgs_py import topics
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.identification.files.estimate_file import read_estimate
from aerarm_ros.motion.signals import ArmState
from aerarm_ros.online.contact_detector import Cause, ContactDetector, ContactReport
from aerarm_ros.online.contact_place import ContactLocator, ContactPlace
from aerarm_ros.online.external_torque import ExternalTorque
from aerarm_ros.online.replay import KnownArm
from aerarm_ros.ros.controllers.contact_parameters import (
    CONTACT_ESTIMATOR_PARAMETERS,
    FILE_PARAMETERS,
    contact_settings,
    read_residuals,
)
from aerarm_ros.ros.controllers.controller_parameters import MODEL_PARAMETERS, load_share
from aerarm_ros.ros.controllers.state_node import StateNode, state_node_parameters
from aerarm_ros.ros.messages import wrench_message
from aerarm_ros.ros.process.node_main import run_node
from aerarm_ros.ros.states.state_stream import base_header

NAME = 'contact_estimator'

PARAMETERS = state_node_parameters(
    *FILE_PARAMETERS, *CONTACT_ESTIMATOR_PARAMETERS, *MODEL_PARAMETERS
)


class ContactEstimatorNode(StateNode):
    """Node that estimates external torque and contact from joint states, and publishes both."""

    answers_every_state = False
    # No joint state may be left out; the queue holds the states of half a second.
    states_waiting = 500

    def __init__(self) -> None:
        super().__init__(NAME, PARAMETERS)

    def build(self) -> None:
        """Create the torque observer, the contact detector and the contact locator."""
        values, names = self.values, self.arm.robot.joint_names
        if not values.residuals_file:
            raise ValueError(
                'residuals_file is not set: learn the contact thresholds from a recording without '
                'contact (contact_estimator --free BAG --model estimate.yaml --out DIR), and set '
                'residuals_file to DIR/residuals.yaml'
            )
        self.base = self.arm.measured_base(values)
        known, dynamics = self._known_arm()
        bound = read_residuals(Path(values.residuals_file), names)
        external = ExternalTorque(known, bound.gain, dynamics)
        self._detector = ContactDetector(
            external, bound, contact_settings(values), self.arm.limits.effort_max
        )
        self.arm.load(self._detector, values)
        self._locator = ContactLocator(known.robot)
        self._period_ns = round(1e9 / values.rate)
        self._sent_ns = -self._period_ns
        self._was_in_contact = False
        self._place: ContactPlace | None = None
        self._report: ContactReport | None = None

    def connect(self) -> None:
        """Create the publishers of external torque, contact, confidence and contact force."""
        self._torque = self.advertise(topics.EXTERNAL_TORQUE)
        self._contact = self.advertise(topics.CONTACT)
        self._confidence = self.advertise(topics.CONTACT_CONFIDENCE)
        self._force = self.advertise(topics.CONTACT_FORCE)

    def answer(self, stamp_ns: int, state: ArmState) -> None:
        """Process a joint state; publish at `rate`, and immediately if a contact begins or ends."""
        now = stamp_ns * 1e-9
        if self.base.problem(now):
            return
        report = self._detector.update(state, now, self.base.motion(now))
        if report is None:
            if self._was_in_contact:
                self._was_in_contact = False
                self._contact.publish(Bool(data=False))
            return
        changed = report.in_contact != self._was_in_contact
        if not changed and 0 <= stamp_ns - self._sent_ns < self._period_ns:
            return
        self._sent_ns, self._was_in_contact, self._report = stamp_ns, report.in_contact, report
        self._send(stamp_ns, state, report)
        self.count_answer()

    def warning(self) -> str:
        """Return why the node cannot detect contact, or an empty string."""
        return super().warning() or self._detector.problem

    def describe(self) -> dict[str, object]:
        """Return the newest contact estimate, for /diagnostics."""
        described: dict[str, object] = {
            **super().describe(),
            'contacts': sum(event.cause is Cause.CONTACT for event in self._detector.events),
        }
        report = self._report
        if report is None:
            return {**described, 'contact': 'unknown'}
        described['contact'] = 'yes' if report.in_contact else 'no'
        described['confidence'] = round(report.confidence, 3)
        described['external torque [Nm]'] = report.torque.round(4).tolist()
        described['threshold [Nm]'] = report.threshold.round(4).tolist()
        if report.in_contact and self._place is not None:
            described['touched link'] = self._place.link
            described['force is determined'] = self._place.is_determined
        if self._detector.payload_mass is not None:
            described['undeclared payload [kg]'] = round(self._detector.payload_mass, 4)
        return described

    def _known_arm(self) -> tuple[KnownArm, MovingBaseDynamics]:
        """Return the arm and its dynamics model, from `model_file` or from the URDF."""
        values, robot = self.values, self.arm.robot
        if not values.model_file:
            load = np.zeros(robot.n) + load_share(values, robot)
            friction = np.array([robot.viscous, robot.coulomb, load])
            dynamics = self.arm.dynamics(values)
            return KnownArm(robot, np.zeros(robot.n), friction), dynamics
        known = KnownArm.identified(robot, read_estimate(Path(values.model_file), robot))
        return known, MovingBaseDynamics(known.robot, known.rotor_inertia)

    def _send(self, stamp_ns: int, state: ArmState, report: ContactReport) -> None:
        header = base_header(stamp_ns, self.arm.robot.base_link)
        names = list(self.arm.config.joint_names)
        self._torque.publish(JointState(header=header, name=names, effort=report.torque.tolist()))
        self._contact.publish(Bool(data=report.in_contact))
        self._confidence.publish(Float64(data=report.confidence))
        event = self._detector.event
        if not report.in_contact or event is None:
            return
        change = report.torque - event.reference
        self._place = self._locator.locate(state.q, change, event.threshold)
        if self._place is None:
            return
        force, at = self._place.force, self._place.point_in_base
        wrench = np.concatenate([force, np.cross(at, force)])
        self._force.publish(wrench_message(header, wrench))


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node(NAME, ContactEstimatorNode, args, PARAMETERS, __doc__)
