"""The true arm follows its own motion, and derivatives are those of simulation."""

import mujoco
import numpy as np
import pytest

from aerarm_ros.identification.files.identified_robot import identified_mjcf
from aerarm_ros.identification.joint_model import ROTOR, JointModel, JointTerm, TermKind
from aerarm_ros.identification.rollout import (
    Rollout,
    RolloutWindows,
    rollout_error,
    simulated_model,
)


def test_rollouts_agree_with_another_engine(arm, robot, true_theta) -> None:
    """Friction as damping only: there the two say the same thing differently."""
    model = JointModel.uniform(
        robot.joint_names, robot.link_names, (JointTerm(TermKind.VISCOUS), ROTOR)
    )
    q = np.array([[0.3, 1.2, -0.4, 0.5]])
    dq = np.array([[0.5, -1.0, 0.8, 1.5]])
    tau = np.full((1, 101, 4), 0.2)
    windows = RolloutWindows(
        robot, 5e-3, q[:, None].repeat(101, 1), dq[:, None].repeat(101, 1), tau
    )
    theta = np.delete(true_theta, np.arange(44, 48))
    found = Rollout(model, windows).positions(theta)[0]
    text = identified_mjcf(robot, arm.inertial, arm.viscous, np.zeros(4), arm.rotor)
    engine = mujoco.MjModel.from_xml_string(text)
    engine.jnt_limited[:] = 0
    engine.opt.timestep, engine.opt.integrator = 1e-3, mujoco.mjtIntegrator.mjINT_RK4
    data = mujoco.MjData(engine)
    data.qpos, data.qvel, data.qfrc_applied = q[0], dq[0], tau[0, 0]
    for step in range(500):
        mujoco.mj_step(engine, data)
        if (step + 1) % 5 == 0:
            # Steps of 5 ms against those of 1 ms, of a higher order.
            assert found[(step + 1) // 5 - 1] == pytest.approx(data.qpos, abs=2e-3)
    assert np.abs(data.qpos - q[0]).max() > 0.5


def test_the_true_arm_strays_least(arm, robot, model, true_theta, samples_of) -> None:
    samples = samples_of(arm.recording(2))
    heavier = true_theta.copy()
    heavier[:40] *= 1.05
    broken = true_theta.copy()
    broken[48:] = -0.05  # less inertia than none
    thetas = {'true': true_theta, 'heavier': heavier, 'broken': broken}
    true, other, impossible = rollout_error(robot, model, samples, thetas)
    assert true.bag == 'motion'
    assert true.total < 1.5
    assert true.per_joint.max() < 5e-3
    assert other.total > 3.0 * true.total
    assert impossible.total > 100.0


@pytest.mark.parametrize('width', [0.0, 0.3])
def test_derivatives_are_those_of_simulation(arm, robot, true_theta, samples_of, width) -> None:
    terms = (JointTerm(TermKind.VISCOUS), JointTerm(TermKind.COULOMB, width), ROTOR)
    model = JointModel.uniform(robot.joint_names, robot.link_names, terms)
    windows = RolloutWindows.of(robot, [samples_of(arm.recording(1), seconds=6.0)])
    rollout = Rollout(model, windows)
    _, slopes = rollout.sensitivities(true_theta)
    for column in range(12):
        change = np.zeros_like(true_theta)
        change[40 + column] = 1e-5
        moved = [rollout.positions(true_theta + way * change) for way in (1.0, -1.0)]
        numeric = (moved[0] - moved[1]) / 2e-5
        left = np.linalg.norm(numeric - slopes[..., column])
        assert left < (0.15 if width == 0.0 else 0.03) * np.linalg.norm(numeric)


def test_the_model_of_a_simulation_has_the_friction_that_was_simulated(
    arm, robot, true_theta, samples_of
) -> None:
    elastic = JointTerm(TermKind.COULOMB, distance=0.03)
    terms = (JointTerm(TermKind.VISCOUS), elastic, ROTOR)
    model = JointModel.uniform(robot.joint_names, robot.link_names, terms)
    found = simulated_model(model)
    assert {(term.distance, term.width > 0.0) for _, term in found.joint_columns[4:8]} == {
        (0.0, True)
    }
    samples = samples_of(arm.recording(1), seconds=6.0)
    windows = RolloutWindows.of(robot, [samples])
    both = [Rollout(each, windows).positions(true_theta) for each in (model, found)]
    assert np.array_equal(*both)
