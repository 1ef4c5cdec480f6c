"""The tool responds to a force like the specified spring and damper."""

import numpy as np
import pytest
from answering_base import answering_base, joint_acceleration

from aerarm_ros.control.laws.cartesian_impedance import CartesianImpedance
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.motion.signals import ArmState, TaskReference

CYCLE = 1e-3
START = np.array([0.3, 1.1, 0.4, 0.9])
STIFFNESS = np.array([300.0, 200.0, 400.0])
DAMPING = np.array([40.0, 40.0, 40.0])


@pytest.fixture
def kinematics(robot) -> Kinematics:
    return Kinematics(robot)


@pytest.fixture
def law(dynamics, kinematics) -> CartesianImpedance:
    return CartesianImpedance(dynamics, kinematics, STIFFNESS, DAMPING, rest=START)


def still(p) -> TaskReference:
    return TaskReference(np.array(p), np.zeros(3), np.zeros(3))


def test_a_force_deflects_the_tool_by_force_over_stiffness(
    dynamics, kinematics, frictionless_bench
) -> None:
    law = CartesianImpedance(dynamics, kinematics, STIFFNESS, DAMPING, START, rest_stiffness=0.0)
    start = kinematics.position(START)
    force = np.array([3.0, -2.0, 4.0])
    arm = frictionless_bench(START)
    for _ in range(20):
        # The force keeps its direction while the arm gives way.
        torque = kinematics.position_jacobian(arm.plant.position).T @ force
        arm.run(lambda s, now: law.update(s, still(start), CYCLE), 0.1, disturbance=torque)
    deflection = kinematics.position(arm.plant.position) - start
    np.testing.assert_allclose(deflection, force / STIFFNESS, atol=2e-4)


def test_follows_a_moving_reference(law, kinematics, frictionless_bench) -> None:
    start = kinematics.position(START)
    w, radius = 3.0, 0.05

    def reference(now):
        s, c = np.sin(w * now), np.cos(w * now)
        return TaskReference(
            start + radius * np.array([0.0, 1.0 - c, 0.0]),
            radius * w * np.array([0.0, s, 0.0]),
            radius * w**2 * np.array([0.0, c, 0.0]),
        )

    run = frictionless_bench(START).run(lambda s, now: law.update(s, reference(now), CYCLE), 2.0)
    tool = np.array([kinematics.position(q) for q in run.q])
    wanted = np.array([reference(t).p for t in run.time])
    # What dJ dq leaves.
    assert np.abs(tool - wanted).max() < 3e-3


def test_energy_with_the_spring_is_dissipated(dynamics, kinematics, frictionless_bench) -> None:
    law = CartesianImpedance(
        dynamics, kinematics, STIFFNESS, DAMPING, START, rest_stiffness=0.0, rest_damping=0.0
    )
    goal = kinematics.position(START) + [0.05, 0.05, -0.05]
    run = frictionless_bench(START).run(lambda s, now: law.update(s, still(goal), CYCLE), 0.6)
    errors = [goal - kinematics.position(q) for q in run.q]
    kinetic = [dynamics.fixed.kinetic_energy(*row) for row in zip(run.q, run.dq, strict=True)]
    energy = np.array(kinetic) + [0.5 * e @ (STIFFNESS * e) for e in errors]
    # The centrifugal terms are cancelled with the rest of n, so a little is exchanged with them.
    assert energy[-1] < 0.05 * energy[0]
    assert np.diff(energy).max() < 2e-3 * energy[0]


def test_the_posture_does_not_push_the_tool(dynamics, kinematics) -> None:
    stiff, free = (
        CartesianImpedance(
            dynamics, kinematics, STIFFNESS, DAMPING, START + 0.5, stiffness, 0.0,
            regularisation=1e-4,
        )
        for stiffness in (5.0, 0.0)
    )  # fmt: skip
    state = ArmState(START, np.zeros(4), np.zeros(4))
    reference = still(kinematics.position(START))
    difference = (
        stiff.update(state, reference, CYCLE).tau - free.update(state, reference, CYCLE).tau
    )
    ddq = np.linalg.solve(dynamics.fixed.inertia_matrix(START), difference)
    assert np.abs(ddq).max() > 1.0
    np.testing.assert_allclose(kinematics.position_jacobian(START) @ ddq, 0.0, atol=1e-4)


def test_on_a_free_base_the_tool_is_the_same_spring(carried, kinematics) -> None:
    """The law includes the effect of the base's response on the tool."""
    law = CartesianImpedance(
        carried, kinematics, STIFFNESS, DAMPING, START, rest_stiffness=0.0, regularisation=1e-4
    )
    wanted = np.array([0.8, -0.5, 0.3])
    reference = TaskReference(kinematics.position(START), np.zeros(3), wanted)
    state = ArmState(START, np.zeros(4), np.zeros(4))
    tau = law.update(state, reference, CYCLE, answering_base()).tau
    ddq = joint_acceleration(carried, START, np.zeros(4), tau)
    np.testing.assert_allclose(kinematics.position_jacobian(START) @ ddq, wanted, atol=1e-5)
