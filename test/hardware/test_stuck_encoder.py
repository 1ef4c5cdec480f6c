"""An encoder that sticks while its motor is driven is detected before the joint runs away."""

import numpy as np
import pytest
from attack_rig import AttackRig, Offer

NAN = np.nan


def effort(joint: int, torque: float):
    """Drive one joint by a torque [Nm], and hold the other joints."""
    others, one = np.zeros(4), np.full(4, NAN)
    others[joint], one[joint] = NAN, torque
    return lambda rig: Offer(velocity=others, effort=one)


def velocity(joint: int, speed: float):
    """Drive one joint at a speed [rad/s], and hold the other joints."""
    speeds = np.zeros(4)
    speeds[joint] = speed
    return lambda rig: Offer(velocity=speeds)


@pytest.mark.parametrize(
    ('posture', 'joint', 'source', 'wait', 'within', 'fastest'),
    [
        ([0.0, 1.2, 0.0, 0.0], 3, effort(3, 0.8), 0.05, 0.006, 4.2),
        ([0.0, 1.2, 0.0, -1.5], 3, effort(3, 9.3), 0.02, 0.006, 7.8),
        ([-2.0, 1.57, 0.0, 0.0], 0, effort(0, 3.0), 0.02, 0.006, 3.2),
        ([-2.0, 0.0, 0.0, 0.0], 0, velocity(0, 5.0), 0.01, 0.02, 1.2),
        # It sinks at first, under a load that leaves its drive little.
        ([0.0, 0.3, 0.0, 0.0], 1, velocity(1, 3.0), 0.02, 0.11, 0.6),
    ],
    ids=['constant', 'at the limit', 'axial', 'begin of a step', 'loaded, at its limit'],
)
def test_one_that_sticks_under_torque_is_found(
    config, robot, posture, joint, source, wait, within, fastest
):
    rig = AttackRig(config, robot, posture=posture, payload=0.2, seed=3).bring_up()
    rig.run(wait, source)
    place = config.joints[joint]
    rig.inject('stuck_encoder', place.board, place.channel)
    start, before = rig.now, len(rig.log.time)
    while not rig.bridge.gate.stop and rig.now < start + within:
        rig.cycle(source)
    rig.run(0.002)  # the frame that ends the torque
    assert f'joint{joint + 1} does not move' in rig.bridge.gate.stop
    assert np.abs(rig.log.dq[before:, joint]).max() < fastest
    # What stands on is let go.
    motor = rig.boards.boards[place.board].motors[place.channel]
    rig.run(0.06)
    assert motor.target_current == 0.0
    # And where it counts from is unknown.
    assert f'the zero of joint{joint + 1} is unknown' in rig.bridge.zeros.problem


def test_a_joint_held_or_moved_by_a_hand_is_not_suspect(config, robot):
    """An inverted base, an unknown payload, and an obstacle that does not yield."""
    rig = AttackRig(
        config, robot, posture=[0.4, 0.9, 0.0, 0.6], payload=0.2, seed=5, gravity=[0.0, 6.9, 6.9]
    ).bring_up()
    friction = rig.plant._friction_limit
    loose = friction.copy()
    rig.run(0.1, velocity(3, 0.5))
    friction[:] = 30.0
    rig.run(0.2)
    for share in np.linspace(1.0, -1.0, 100):
        rig.plant.gravity_in_base = [0.0, 6.9, 6.9 * share]
        rig.run(0.002)
    friction[:] = loose
    rig.run(0.1)
    assert rig.bridge.gate.stop == '', rig.bridge.faults
