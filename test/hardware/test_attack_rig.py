"""The attack rig is exact, repeatable, and consistent with the frames."""

import numpy as np
import pytest
from attack_rig import PERIOD, AttackRig, Offer
from attack_world import EXCHANGE, READ, WAKE

from aerarm_ros.hardware.frames.frame_codec import FrameCodec
from aerarm_ros.hardware.frames.frame_profile import load_profile


def swing(rig):
    return Offer(velocity=0.8 * np.sin(3.0 * rig.now + np.arange(4)))


def test_the_same_attack_gives_the_same_figures(config, robot):
    def attack():
        rig = AttackRig(config, robot, posture=[0.1, 1.2, 0.2, 0.3], payload=0.2, seed=4)
        return rig.bring_up().run(0.1, swing)

    one, other = attack(), attack()
    assert np.array_equal(one.q, other.q)
    assert np.array_equal(one.dq, other.dq)
    assert one.q.shape == (100, 4)
    assert one.accepted == 100
    assert set(one.modes) == {'running'}


def test_frames_are_decoded_as_the_codec_does(config, robot):
    rig = AttackRig(config, robot).bring_up()
    rig.run(0.05, swing)
    codec = FrameCodec(load_profile(config.profile))
    for board in (0, 1):
        ours = rig.frames.commands(board)
        sent = [frame for _, number, frame, _ in rig.frames.rows if number == board]
        assert ours['good'].all()
        for name in ours.keys() - {'good'}:
            theirs = np.array([getattr(codec.decode_command(frame), name) for frame in sent])
            assert ours[name] == pytest.approx(theirs, rel=1e-9, abs=1e-9), name


def test_a_host_that_sleeps_lets_the_arm_live_on(config, robot):
    # 50 ms are more than the boards' time-out of 40 ms.
    rig = AttackRig(config, robot, delays=lambda cycle, at: 0.05 * (cycle == 5 and at == WAKE))
    rig.bring_up()
    start = rig.now
    log = rig.run(0.07, swing)
    assert len(log.modes) == 70 - 50
    assert len(log.time) == 70
    assert np.diff(log.time).max() == pytest.approx(PERIOD)
    assert rig.now == pytest.approx(start + 0.07)
    assert {board.error for board in rig.boards.boards} == {2}


def test_the_rig_can_delay_the_host_within_a_cycle(config, robot):
    points = {READ: 1e-3, f'{EXCHANGE} 1': 2e-3}
    rig = AttackRig(config, robot, delays=lambda cycle, at: points.get(at, 0.0) * (cycle == 5))
    rig.bring_up().run(0.02, swing)
    first, second = rig.frames.times(0)[-15:], rig.frames.times(1)[-15:]
    late = np.argmax(second - first)
    assert second[late] - first[late] == pytest.approx(2e-3)
    assert first[late] - first[late - 1] == pytest.approx(PERIOD + 1e-3)
