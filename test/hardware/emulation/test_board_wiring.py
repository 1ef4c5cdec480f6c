"""Wiring errors: the counted joints and driven motors differ from the configuration."""

import numpy as np
import pytest

from aerarm_ros.hardware.emulation.emulation import make_emulated_transport
from aerarm_ros.hardware.emulation.fault_injection import FaultRequest


def counted(boards, joint, travel):
    """Return the changes of all motors' counts when a joint is turned by an angle [rad]."""
    boards.advance(0.0)
    boards.advance(1e-3)
    encoders = [motor.encoder for board in boards.boards for motor in board.motors]
    before = np.array([encoder.position for encoder in encoders])
    q = boards.plant.position
    q[joint] += travel
    boards.plant.reset(q)
    boards.advance(2e-3)
    return np.array([encoder.position for encoder in encoders]) - before


@pytest.fixture
def boards(config, robot):
    return make_emulated_transport(config, robot, None)


@pytest.mark.parametrize(
    ('fault', 'motors'),
    [
        (None, [27.0, 0.0]),
        (('wrong_ratio', 1, 1, 31.0), [31.0, 0.0]),
        (('wrong_sign', 1, 1, None), [-27.0, 0.0]),
        (('swapped_channels', 1, 0, None), [0.0, 27.0]),
    ],
)
def test_the_count_of_joint4_is_that_of_the_wiring(boards, fault, motors):
    boards.advance(0.0)
    boards.advance(1e-3)
    if fault is not None:
        FaultRequest(*fault).apply(boards)
    own, other = motors
    expected = np.array([0.0, 0.0, other, own]) * 0.1
    assert counted(boards, 3, 0.1) == pytest.approx(expected, abs=0.01)


def test_encoder_counts_continue_when_the_wiring_changes(boards):
    boards.advance(0.0)
    boards.advance(1e-3)
    encoders = [motor.encoder for board in boards.boards for motor in board.motors]
    before = [encoder.position for encoder in encoders]
    FaultRequest('wrong_ratio', 0, 1, 31.0).apply(boards)
    boards.advance(2e-3)
    assert [encoder.position for encoder in encoders] == pytest.approx(before, abs=0.002)


def test_a_weak_driver_measures_the_delivered_current(rig):
    rig.inject('weak_driver', 0, 0)
    motor = rig.boards.boards[0].motors[0]
    rig.run(0.03, lambda _: (None, None, [2.0, 0.0, 0.0, 0.0]))
    assert motor.target_current == pytest.approx(2.0 / 0.8557, rel=0.02)
    assert motor.measured_current == pytest.approx(0.5 * motor.target_current, rel=0.02)
    assert rig.bridge.tau[0] == pytest.approx(1.0, abs=0.05)


def test_a_joint_with_high_friction_stays_where_a_healthy_one_moves(make_rig):
    ways = []
    for factor in (1.0, 8.0):
        rig = make_rig()
        rig.inject('high_friction', 0, 0, factor)
        rig.bring_up()
        before = rig.plant.position[0]
        rig.run(0.2, lambda _: (None, None, [0.8, 0.0, 0.0, 0.0]))
        ways.append(abs(rig.plant.position[0] - before))
    assert ways[0] > 0.05
    assert ways[1] < 1e-3


def test_wiring_outlives_a_power_cycle(boards):
    FaultRequest('wrong_sign', 1, 1).apply(boards)
    FaultRequest('power_cycle', 1).apply(boards)
    assert counted(boards, 3, 0.1)[3] == pytest.approx(-2.7, abs=0.01)
