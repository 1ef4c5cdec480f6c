"""Stops on the emulated arm: frames, boards, MuJoCo, in virtual time."""

import numpy as np
import pytest
from attack_rig import AttackRig, Offer

from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.checks import JointLimits
from aerarm_ros.control.control_loop import ControlLoop
from aerarm_ros.control.laws.computed_torque import BoardComputedTorque
from aerarm_ros.control.references.joint_trajectory import JointTrajectory
from aerarm_ros.control.references.trajectory_follower import FollowerTolerances, TrajectoryFollower
from aerarm_ros.excitation.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.player import ExcitationPlayer, VelocityLaw
from aerarm_ros.excitation.settings import ExcitationConfig
from aerarm_ros.excitation.trajectory import MotionSequence, Stage, SteadyStroke
from aerarm_ros.motion.signals import ArmState

START = np.array([0.0, 0.9, 0.0, 0.0])


@pytest.mark.parametrize(('joint', 'travel', 'seconds'), [(1, 1.7, 1.05), (3, 1.9, 0.75)])
def test_the_arm_stops_as_its_reference_does(config, robot, joint, travel, seconds) -> None:
    limits = JointLimits.from_config(config)
    rig = AttackRig(config, robot, posture=START.tolist(), seed=3).bring_up()
    follower = TrajectoryFollower(limits, FollowerTolerances.uniform(4))
    dynamics = MovingBaseDynamics(robot, config.column('reflected_inertia'))
    loop = ControlLoop(limits, follower, BoardComputedTorque(dynamics))
    efforts: list[np.ndarray] = []

    def control(rig: AttackRig) -> Offer | None:
        bridge = rig.bridge
        state = ArmState(bridge.q.copy(), bridge.dq.copy(), bridge.tau.copy())
        command = loop.update(state, rig.now)
        if command is None:
            return None
        efforts.append(command.tau)
        return Offer(command.q, command.dq, command.tau, 'controller')

    rig.run(0.1, control)
    end = START.copy()
    end[joint] += travel
    follower.follow(JointTrajectory(limits, limits.names, [seconds], [end]), rig.now)
    rig.run(0.5 * seconds, control)
    before = follower.reference
    speed = before.dq[joint]
    assert speed > 2.9
    first = len(rig.log.q_rows)
    follower.stop(rig.now, 'canceled')
    rig.run(0.8, control)
    stopped = follower.reference.q
    least = speed**2 / (2.0 * limits.acceleration_max[joint])
    assert stopped[joint] - before.q[joint] < 1.5 * least
    after = rig.log.q[first:]
    overshoot = float((after[:, joint] - stopped[joint]).max())
    peak = np.abs(efforts[-800:]).max(axis=0) / limits.effort_max
    assert rig.log.faults == []
    assert overshoot < 0.02
    assert np.all(peak < 1.0)
    np.testing.assert_allclose(after[-1], stopped, atol=0.02)


def test_a_player_in_velocity_mode_stops_the_arm_in_time(config, robot) -> None:
    """Joint 2 lifts the arm; a velocity loop without feedforward needs 1.7 times the travel."""
    setup = ExcitationSetup.of_arm(robot, config, ExcitationConfig())
    start = np.array([0.0, 0.3, 0.0, 0.0])
    rig = AttackRig(config, robot, posture=start.tolist(), seed=3).bring_up()
    stroke = SteadyStroke(start, 1, 2.6, 1.5, 9.0)
    motion = MotionSequence([Stage('stroke', stroke)])
    player = ExcitationPlayer(motion, VelocityLaw(1.0, setup.limits.velocity), setup.stops)

    def control(rig: AttackRig) -> Offer | None:
        if player.done:
            return Offer(velocity=np.zeros(4), source='player')
        return Offer(*player.update(round(1e9 * rig.now), rig.bridge.q.copy()), 'player')

    rig.run(0.5 * stroke.duration, control)
    first, speed = len(rig.log.q_rows) - 1, rig.log.dq_rows[-1][1]
    assert speed > 1.4
    player.stop()
    rig.run(0.6, control)
    travelled = rig.log.q[first:, 1].max() - rig.log.q[first, 1]
    assert travelled < 1.5 * speed**2 / (2.0 * setup.limits.acceleration[1])
    assert rig.log.faults == []
    assert player.fault is None
