"""Computed torque on an arm that picks up a payload, with payload compensation."""

import numpy as np
import pytest

from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.checks import JointLimits
from aerarm_ros.control.compensation import FrictionCompensation
from aerarm_ros.control.control_loop import ControlLoop
from aerarm_ros.control.laws.computed_torque import ComputedTorque
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.motion.signals import ArmState, JointReference
from aerarm_ros.online.payload_compensation import PayloadCompensation
from aerarm_ros.online.payload_estimator import PayloadEstimator
from aerarm_ros.simulation.arm_plant import ArmPlant, PlantParameters

CYCLE = 1e-3
PERIOD = 1.5  # [s] of the whole motion
MIDDLE = np.array([0.0, 1.0, 0.3, -0.4])
SWING = np.array([0.3, 0.3, 0.4, 0.5])
RATES = 2.0 * np.pi / PERIOD * np.array([1.0, 1.0, 2.0, 2.0])
COUNT = 2.0 * np.pi / 4096 / 27  # [rad] of an encoder, at the joint
NOISE = 0.01  # [Nm] of measured torque
PICK_UP, END = 2.5, 6.5


class SwingSource:
    """A periodic motion, begun at rest."""

    def take_over(self, q: np.ndarray) -> None:
        """It begins where it begins."""

    def update(self, q: np.ndarray, now: float, dt: float) -> JointReference:
        angle = RATES * now
        return JointReference(
            MIDDLE + SWING * (1.0 - np.cos(angle)),
            SWING * RATES * np.sin(angle),
            SWING * RATES**2 * np.cos(angle),
        )


@pytest.fixture(scope='module')
def rows() -> np.ndarray:
    """Return time, error and effort of every cycle, (M, 9)."""
    config, robot = load_arm_config(), load_robot()
    truth = PlantParameters.nominal(config, robot)
    plant = ArmPlant(robot, truth, MIDDLE)
    models = [MovingBaseDynamics(robot, truth.rotor_inertia) for _ in range(2)]
    known = (truth.viscous, truth.coulomb)
    friction = FrictionCompensation(*known, load_share=truth.load_friction)
    law = ComputedTorque(models[0], 400.0, 40.0, friction=friction)
    source = SwingSource()
    loop = ControlLoop(JointLimits.from_config(config), source, law)
    estimator = PayloadEstimator(models[1], *known, truth.load_friction)
    hand_over = PayloadCompensation(1.0, 0.2, 0.1)
    random = np.random.default_rng(0)
    effort, told = np.zeros(4), []
    for cycle in range(round(END / CYCLE)):
        now = CYCLE * cycle
        if cycle == round(PICK_UP / CYCLE):
            plant.grasp(truth.carrying(0.2, (0.1, 0.01, -0.02), 0.03))
        q = COUNT * np.round(plant.position / COUNT)
        state = ArmState(q, plant.velocity, effort + NOISE * random.normal(size=4))
        estimate = estimator.update(state, now)
        if estimate is not None:
            hand_over.offer(estimate.payload.inertial)
        if cycle % 5 == 0:
            models[0].carry(hand_over.update(5 * CYCLE))
        command = loop.update(state, now)
        if command is not None:
            effort = np.asarray(command.tau)
        plant.apply_effort(effort)
        plant.advance(CYCLE)
        told.append([now, *(q - source.update(q, now, CYCLE).q), *effort])
    return np.array(told)


def errors(rows: np.ndarray, begin: float) -> float:
    """Return the RMS error of a period [rad]."""
    taken = rows[(rows[:, 0] >= begin) & (rows[:, 0] < begin + PERIOD)]
    return float(np.sqrt(np.mean(taken[:, 1:5] ** 2)))


def test_two_seconds_after_a_pick_up_the_arm_follows_as_well_as_without(rows: np.ndarray) -> None:
    without, with_payload = errors(rows, PICK_UP - PERIOD), errors(rows, PICK_UP + 2.0)
    assert with_payload < 1.5 * without
    # The payload that the model does not have yet matters.
    picked_up = rows[(rows[:, 0] > PICK_UP) & (rows[:, 0] < PICK_UP + 0.3), 1:5]
    assert np.sqrt(np.mean(picked_up**2)) > 2.0 * without


def test_the_torque_does_not_step(rows: np.ndarray) -> None:
    step = np.abs(np.diff(rows[:, 5:], axis=0)).max(axis=1)
    time = rows[1:, 0]
    bare = step[(time > 0.5) & (time < PICK_UP)].max()
    assert step[time > PICK_UP + 0.02].max() < 1.5 * bare
