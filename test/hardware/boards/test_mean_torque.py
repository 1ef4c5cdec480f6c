"""The published torque is the mean of a cycle, not its last sample."""

import numpy as np
import pytest

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.hardware.bridge_cycle import BridgeCycle
from aerarm_ros.hardware.emulation.emulated_motor import AlignmentTiming
from aerarm_ros.hardware.emulation.emulation import make_emulated_transport
from aerarm_ros.hardware.gate.command_intake import OfferedCommand

PERIOD = 1e-3
QUICK = AlignmentTiming(forward=0.25, reverse=0.25, hold=0.1)


@pytest.mark.parametrize('speed', [0.4, -0.4])
def test_measured_torque_is_the_mean_motor_torque(speed: float) -> None:
    config = load_arm_config().with_encoders('absolute')
    transport = make_emulated_transport(config, load_robot(), None, alignment=QUICK)
    plant, given = transport.plant, []
    apply = plant.apply_effort
    plant.apply_effort = lambda effort: (given.append(np.array(effort)), apply(effort))
    cycle, now, measured = BridgeCycle(config, transport), 0.0, []
    moving = np.array([speed, 0.0, speed, speed])
    while now < 2.8:
        now += PERIOD
        cycle.update(now)
        if cycle.mode == 'idle' and now < 0.1:
            cycle.enable()
        if cycle.mode in ('ready', 'running') and now > 1.3:
            cycle.command(OfferedCommand(config.joint_names, None, moving, None, 0.0, 'test'), now)
        if now > 1.8:
            measured.append(cycle.tau.copy())
        else:
            given.clear()
    assert cycle.dq[[0, 2, 3]] == pytest.approx(moving[[0, 2, 3]], rel=0.2)
    difference = np.mean(measured, axis=0) - np.mean(given, axis=0)
    # What joint 3 was off without the correction: 0.017 Nm.
    assert np.all(np.abs(difference[[0, 2, 3]]) < 0.003), difference


def test_torque_of_an_accelerating_joint_is_the_commanded_one() -> None:
    """Under torque control the boards have no gains, at any speed of the joint."""
    config = load_arm_config().with_encoders('absolute')
    cycle = BridgeCycle(
        config, make_emulated_transport(config, load_robot(), None, alignment=QUICK)
    )
    effort, now, measured = np.array([1.0, 0.0, 0.5, 0.0]), 0.0, []
    while len(measured) < 40:
        now += PERIOD
        cycle.update(now)
        if cycle.mode == 'idle' and now < 0.1:
            cycle.enable()
        if cycle.mode in ('ready', 'running') and now > 1.3:
            cycle.command(OfferedCommand(config.joint_names, None, None, effort, 0.0, 'test'), now)
        if now > 1.32:
            measured.append(cycle.tau.copy())
    assert np.all(cycle.dq[[0, 2]] > 0.3)
    np.testing.assert_allclose(np.mean(measured, axis=0)[[0, 2]], [1.0, 0.5], atol=0.01)
