"""Motion of the emulated arm with contact forces added to the measured torques."""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from carrying_run import COLD, CarryingRun

from aerarm_ros.identification.recording.recording import Recording
from aerarm_ros.online.contact_detector import ContactDetector, ContactSettings
from aerarm_ros.online.external_torque import ExternalTorque, ResidualBound, free_rows
from aerarm_ros.online.replay import KnownArm

GAIN = 60.0
SMALL = ContactSettings(confirmation=0.01, payload_mass=0.5, payload_size=0.15)


def known_arm(run: CarryingRun) -> KnownArm:
    """Return the arm of a model that was identified on a cold day."""
    truth = run.truth
    friction = np.array([truth.viscous, COLD * truth.coulomb, truth.load_friction])
    return KnownArm(run.robot(), truth.rotor_inertia, friction)


def recording(run: CarryingRun, first: float, last: float) -> Recording:
    """Return the states between two times [s]."""
    inside = (run.rows[:, 0] >= first) & (run.rows[:, 0] < last)
    time, q, dq, tau = np.hsplit(run.rows[inside], [1, 5, 9])
    names = run.robot().joint_names
    return Recording('run', names, time.ravel(), q, dq, tau, np.zeros(4, bool))


def learnt(run: CarryingRun, motion: Recording) -> ResidualBound:
    """Return thresholds from free motion."""
    return ResidualBound.learnt(
        free_rows(ExternalTorque(known_arm(run), GAIN), motion, lambda: False), GAIN
    )


def detector(run: CarryingRun, bound: ResidualBound) -> ContactDetector:
    """Return a detector of the arm."""
    return ContactDetector(ExternalTorque(known_arm(run), GAIN), bound, SMALL)


@dataclass(frozen=True)
class Touch:
    """A constant force [N] in the base frame on the tool, between two times [s]."""

    begin: float
    end: float
    force: tuple[float, float, float]

    def added(self, run: CarryingRun, motion: Recording) -> Recording:
        """Return the motion with the force in the drives' torques."""
        model = run.robot().model
        data = model.createData()
        tau = motion.tau.copy()
        tool = model.getFrameId('tool0')
        inside = (motion.time >= self.begin) & (motion.time < self.end)
        for row in np.flatnonzero(inside):
            jacobian = pin.computeFrameJacobian(
                model, data, motion.q[row], tool, pin.LOCAL_WORLD_ALIGNED
            )
            tau[row] -= jacobian[:3].T @ np.array(self.force)
        fields = (motion.name, motion.joint_names, motion.time, motion.q, motion.dq)
        return Recording(*fields, tau, motion.dead_effort)
