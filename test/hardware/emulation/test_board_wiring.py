"""Wiring errors: the counted joints and driven motors differ from the configuration."""

import numpy as np
import pytest

from aerarm_ros.hardware.emulation.emulation import make_emulated_transport
from aerarm_ros.hardware.emulation.fault_injection import FaultRequest


def counted(boards, joint, travel):
    """Return the changes of all motors' counts when a joint is turned by an angle [rad]."""
    encoders = [motor.encoder for board in boards.boards for motor in board.motors]
    before = np.array([encoder.position for encoder in encoders])
    q = boards.plant.position
    q[joint] += travel
    boards.plant.reset(q)
    boards.advance(3e-3)
    return np.array([encoder.position for encoder in encoders]) - before


@pytest.fixture
def boards(config, robot):
    boards = make_emulated_transport(config, robot, None)
    boards.advance(0.0)
    boards.advance(1e-3)
    return boards


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
    encoders = [motor.encoder for board in boards.boards for motor in board.motors]
    before = [encoder.position for encoder in encoders]
    if fault is not None:
        FaultRequest(*fault).apply(boards)
    boards.advance(2e-3)
    assert [encoder.position for encoder in encoders] == pytest.approx(before, abs=0.002)
    own, other = motors
    expected = np.array([0.0, 0.0, other, own]) * 0.1
    assert counted(boards, 3, 0.1) == pytest.approx(expected, abs=0.01)


def test_wiring_outlives_a_power_cycle(boards):
    FaultRequest('wrong_sign', 1, 1).apply(boards)
    FaultRequest('power_cycle', 1).apply(boards)
    assert counted(boards, 3, 0.1)[3] == pytest.approx(-2.7, abs=0.01)
