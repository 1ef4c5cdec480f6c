"""Payload of a controller's model for a published estimate."""

from types import SimpleNamespace

import numpy as np
import pytest

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.checks import JointLimits, RejectedInputError
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.model.dynamics import Dynamics
from aerarm_ros.motion.signals import ArmState
from aerarm_ros.online.information_filter import ball
from aerarm_ros.ros.controllers.controller_parameters import PAYLOAD, ControlledArm
from aerarm_ros.ros.controllers.payload_intake import PayloadIntake
from aerarm_ros.ros.messages import body_of_message, inertia_message
from aerarm_ros.ros.states.state_stream import base_header

CENTRE, INERTIA = np.array([0.1, 0.0, 0.0]), np.diag([1e-4, 2e-4, 2e-4])
OWN = ball(0.05, [0.05, 0.0, 0.0], 0.02)
Q = np.array([0.0, 0.5, 0.0, 0.3])


class IntakeRig:
    """An intake and its controller, in which time passes by hand."""

    def __init__(self, share: float) -> None:
        self.robot = load_robot()
        self.model, self.true = Dynamics(self.robot), Dynamics(self.robot)
        config = load_arm_config()
        self.arm = ControlledArm(config, self.robot, JointLimits.from_config(config))
        self.values = SimpleNamespace(hand_over=share, hand_over_mass_rate=0.2)
        self.values.hand_over_centre_rate = 1.0
        setattr(self.values, PAYLOAD, OWN.tolist())
        self.arm.load(self.model, self.values)
        self.now = 0.0
        self.true.carry(OWN)
        self.state = ArmState(Q, np.zeros(4), np.zeros(4))
        base = BaseMotion.still(self.robot.gravity_in_base)
        self.base = SimpleNamespace(motion=lambda _: base)
        self.intake = PayloadIntake(self)

    @property
    def stamp_ns(self) -> int:
        return round(1e9 * self.now)

    @property
    def loop(self) -> SimpleNamespace:
        return SimpleNamespace(disturbance=self.residual())

    def residual(self) -> np.ndarray:
        """What the observer finds, of an arm at rest."""
        return self.model.gravity(Q) - self.true.gravity(Q)

    def offer(self, mass: float) -> None:
        header = base_header(0, 'link4')
        self.intake.take(inertia_message(header, mass, CENTRE, INERTIA), 0.0)

    def wait(self, seconds: float) -> None:
        for _ in range(round(1e3 * seconds)):
            self.now += 1e-3
            self.intake.update()


def test_the_model_carries_it_on_top_of_its_own_payload() -> None:
    rig, header = IntakeRig(1.0), base_header(0, 'link4')
    rig.true.carry(OWN + body_of_message(inertia_message(header, 0.2, CENTRE, INERTIA)))
    rig.offer(0.2)
    rig.wait(1.5)
    assert rig.residual() == pytest.approx(0.0, abs=1e-9)
    assert rig.intake.describe() == {'compensated payload [kg]': 0.2}
    assert not rig.intake.problem


def test_a_wrong_payload_is_withdrawn_and_an_impossible_one_rejected() -> None:
    rig = IntakeRig(1.0)
    for frame, mass, words in (('tool0', 0.2, 'last link'), ('link4', -0.2, 'no body')):
        with pytest.raises(RejectedInputError, match=words):
            rig.intake.take(inertia_message(base_header(0, frame), mass, CENTRE, INERTIA), 0.0)
    rig.wait(0.5)
    assert rig.intake.describe() == {'compensated payload [kg]': 0.0}
    rig.offer(0.2)
    rig.wait(0.2)
    assert rig.intake.describe()['compensated payload [kg]'] != 0.0
    rig.wait(3.0)
    assert rig.residual() == pytest.approx(0.0, abs=1e-9)
    assert rig.intake.describe() == {
        'compensated payload [kg]': 0.0,
        'payload compensations withdrawn': 1,
    }
    assert 'check payload_estimator' in rig.intake.problem
