"""The set point for the drone leads the arm slowly to the middle of its reach."""

import numpy as np
import pytest

from aerarm_ros.description.drone_config import load_drone_config
from aerarm_ros.description.resources import resource
from aerarm_ros.description.robot import Robot
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.world.base_pose import BasePose, _turned
from aerarm_ros.world.reach import DroneRequest

MIDDLE = np.array([0.0, 1.3, 0.0, 1.5])
YAW = _turned(np.array([0.0, 0.0, 0.7]))


def test_the_drone_goes_slowly_to_where_the_arm_is_in_the_middle_of_its_reach(robot: Robot) -> None:
    drone = load_drone_config(resource('config', 'drone.yaml'))
    kinematics, zero = Kinematics(robot), np.zeros(3)
    request = DroneRequest(kinematics, drone, MIDDLE, speed=0.1, deadband=0.03)

    def base(body: np.ndarray, place: np.ndarray) -> BasePose:
        """Return the pose of the arm's base under a drone at a place."""
        rotation = body @ drone.mount.rotation
        return BasePose(place + body @ np.array(drone.mount.position), zero, rotation, zero)

    start = np.array([1.0, -2.0, 3.0])
    # The drone tilts; only its heading counts.
    tilted = base(YAW @ _turned(np.array([0.0, 0.2, 0.0])), start)
    middle = base(YAW, start).to_world(kinematics.position(MIDDLE))
    for now, off in ((0.0, 0.0), (1.0, 0.02)):
        place, turn = request.update(now, middle + [off, 0.0, 0.0], tilted)
        assert place == pytest.approx(start), 'it stays within the dead band'
        assert turn == pytest.approx(YAW)
    goal = start + [0.3, 0.0, 0.4]
    elsewhere = base(np.eye(3), zero)  # The drone's own motion does not matter.
    places = [request.update(1.0 + 0.2 * k, middle + goal - start, elsewhere)[0] for k in range(30)]
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert steps[:24] == pytest.approx(0.02)
    assert places[-1] == pytest.approx(goal)
    request.reset()
    assert request.update(9.0, middle, tilted)[0] == pytest.approx(start)
