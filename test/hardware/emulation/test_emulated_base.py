import numpy as np

from aerarm_ros.hardware.bridge_cycle import BridgeCycle
from aerarm_ros.hardware.emulation.emulated_motor import AlignmentTiming
from aerarm_ros.hardware.emulation.emulation import make_emulated_transport, mount_on_base
from aerarm_ros.simulation.base_profile import BASE_PROFILES, STILL, TILTED

CYCLE = 1e-3
LEANING = [0.0, 0.9, 0.0, 0.0]


def held_posture(config, robot, profile: str) -> np.ndarray:
    """Return where the boards hold the arm, after a second without a command."""
    config = config.with_encoders('absolute')
    transport = make_emulated_transport(
        config, robot, None, position=LEANING, alignment=AlignmentTiming(0.25, 0.25, 0.1)
    )
    plant = mount_on_base(transport, robot, BASE_PROFILES[profile])
    assert plant is transport.plant
    np.testing.assert_array_equal(plant.position, LEANING)
    bridge, now, ready_at = BridgeCycle(config, transport), 0.0, np.inf
    while now < min(ready_at + 1.0, 20.0):
        bridge.update(now)
        if bridge.mode == 'idle':
            bridge.enable()
        elif bridge.mode == 'ready':
            ready_at = min(ready_at, now)
        now += CYCLE
    assert bridge.mode == 'ready', bridge.faults
    return plant.position


def test_boards_hold_the_arm_on_a_tilted_base(config, robot):
    """On a base that leans sideways joint 1 carries weight too, and yields by its stiffness."""
    level, leaning = (held_posture(config, robot, profile) for profile in (STILL, TILTED))
    assert abs(level[0]) < 1e-3
    assert 2e-3 < abs(leaning[0]) < 0.05
    assert np.abs(leaning - LEANING).max() < 0.1
