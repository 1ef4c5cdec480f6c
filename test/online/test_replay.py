"""Recordings of an arm that picks up a payload, evaluated offline."""

from dataclasses import replace

import numpy as np
import pytest
from carrying_run import CarryingRun

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.joint_model import JointModel, JointTerm, TermKind
from aerarm_ros.identification.recording.recording import Recording
from aerarm_ros.identification.solvers.estimate import Estimate
from aerarm_ros.online.replay import KnownArm, Replay, unexplained_torque


@pytest.fixture
def arm(run: CarryingRun) -> KnownArm:
    truth = run.truth
    friction = np.array([truth.viscous, truth.coulomb, truth.load_friction])
    return KnownArm(run.robot(), truth.rotor_inertia, friction)


def recording(run: CarryingRun, first: float, last: float, start: float = 0.0) -> Recording:
    """Return the states between two times [s], as a bag whose beginning is another one's."""
    time, *columns = np.hsplit(run.rows[(run.rows[:, 0] >= first) & (run.rows[:, 0] < last)],
                               [1, 5, 9])  # fmt: skip
    q, dq, tau = columns
    names = run.robot().joint_names
    return Recording('bag', names, time.ravel() - first + start, q, dq, tau, np.zeros(4, bool))


def test_an_empty_and_a_loaded_bag_yield_the_payload_of_the_second(
    run: CarryingRun, arm: KnownArm
) -> None:
    replay = Replay(arm, arm.estimator())
    assert replay.play(recording(run, 0.6, run.pick_up, start=7.0)) == []
    (change,) = replay.play(recording(run, run.pick_up, run.pick_up + 2.0))
    assert change.carries
    assert change.time < 0.5
    assert replay.estimate is not None
    payload = replay.estimate.payload
    assert payload.mass == pytest.approx(run.payload[0], rel=0.05)
    assert np.linalg.norm(payload.centre - run.payload[1:4] / run.payload[0]) < 5e-3


def test_unusable_recordings_are_rejected(run: CarryingRun, arm: KnownArm) -> None:
    short, moving = recording(run, 0.6, 0.8), recording(run, 1.5, 2.0)
    loaded = recording(run, run.pick_up, run.pick_up + 1.2)
    for bad, words in (
        (loaded, 'bag: the arm carried a payload at the start'),
        (short, 'to learn from'),
        (replace(short, dq=None), 'no velocities'),
        (replace(short, time=100.0 * short.time), 'at 25 Hz or more'),
        (replace(moving, tau=np.ones_like(moving.tau)), 'effort of .* stays at 1 Nm'),
    ):
        with pytest.raises(IdentificationError, match=words):
            Replay(arm, arm.estimator()).play(bad)
    with pytest.raises(KeyboardInterrupt):
        Replay(arm, arm.estimator(), lambda: True).play(short)


def test_terms_that_are_not_followed_are_taken_off_the_torque(arm: KnownArm) -> None:
    robot = arm.robot
    terms = [(JointTerm(TermKind.VISCOUS), JointTerm(TermKind.OFFSET)), (), (), ()]
    terms[3] = (JointTerm(TermKind.FORWARD), JointTerm(TermKind.LOAD), JointTerm(TermKind.ROTOR))
    model = JointModel(robot.joint_names, robot.link_names, tuple(terms))
    columns = {TermKind.VISCOUS: 0.5, TermKind.OFFSET: 0.2, TermKind.FORWARD: 0.3,
               TermKind.LOAD: 0.04, TermKind.ROTOR: 0.01}  # fmt: skip
    joints = [columns[term.kind] for _, term in model.joint_columns]
    estimate = Estimate('', model, np.concatenate([robot.inertial_parameters.ravel(), joints]))
    known = KnownArm.identified(robot, estimate)
    assert known.rotor_inertia.tolist() == [0.0, 0.0, 0.0, 0.01]
    assert known.friction[:, [0, 3]].tolist() == [[0.5, 0.0], [0.0, 0.0], [0.0, 0.04]]
    dq = np.array([[1.0, 1.0, 1.0, 2.0], [-1.0, 0.0, 0.0, -2.0]])
    assert known.other_torque(dq).tolist() == [[0.2, 0.0, 0.0, 0.3], [0.2, 0.0, 0.0, 0.0]]


def test_a_push_is_no_payload(free: CarryingRun, arm: KnownArm) -> None:
    bag = recording(free, 0.7, 9.0)
    pushed = (bag.time > 4.0) & (bag.time < 5.3)
    tau = bag.tau.copy()
    tau[pushed, 3] += 0.4
    replay = Replay(arm, arm.estimator())
    assert replay.play(replace(bag, tau=tau)) == []
    (time,) = replay.knocks
    assert time == pytest.approx(4.0, abs=0.2)


def test_torque_noise_is_that_without_the_payload(run: CarryingRun, arm: KnownArm) -> None:
    bare = unexplained_torque(arm, recording(run, 0.6, run.pick_up), 30.0)
    partly = unexplained_torque(arm, recording(run, 0.6, run.pick_up + 0.8), 30.0)
    carrying = unexplained_torque(arm, recording(run, run.pick_up, run.put_down), 30.0)
    # The payload of 0.2 kg causes some 0.3 Nm.
    assert max(map(np.max, (bare, partly, carrying))) < 0.05
