"""The scene of an arm under its drone, on a real server without a browser."""

from collections.abc import Iterator
from contextlib import redirect_stdout
from io import StringIO

import numpy as np
import pinocchio as pin
import pytest
import viser

from aerarm_ros.description.drone_config import load_drone_config
from aerarm_ros.description.drone_urdf import with_drone
from aerarm_ros.description.robot import load_robot
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.ros.page.view_scene import ViewScene

HANGING = np.array([0.0, np.pi / 2, 0.0, 0.0])


@pytest.fixture
def server() -> Iterator[viser.ViserServer]:
    with redirect_stdout(StringIO()):
        server = viser.ViserServer(host='127.0.0.1', port=18091)
        yield server
        server.stop()


def test_the_tool_s_path_follows_the_drone(server: viser.ViserServer) -> None:
    arm = load_robot()
    robot = load_robot(with_drone(arm.urdf_text, load_drone_config()))
    scene = ViewScene(server, robot, 'tool0')
    scene.update(HANGING)
    place = Kinematics(robot, 'tool0').position(HANGING)
    np.testing.assert_allclose(place, scene._path[-1], atol=1e-9)
    before = scene._path[-1]
    assert before[2] < -0.7  # it hangs
    # Moved up by a metre and turned by a quarter about x: the arm points to +y.
    scene.move_base(np.array([0.0, 0.0, 1.0]), np.array([np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0]))
    scene.update(HANGING)
    expected = [before[0], -before[2], 1.0 + before[1]]
    np.testing.assert_allclose(scene._path[-1], expected, atol=1e-9)
    np.testing.assert_allclose(scene._base.position, [0.0, 0.0, 1.0])


def test_every_joint_is_drawn_where_the_kinematics_have_it(server: viser.ViserServer) -> None:
    robot = load_robot()
    scene = ViewScene(server, robot, 'tool0')
    for q in (HANGING, np.array([0.4, -0.7, 1.1, -0.3])):
        scene.update(q)
        placed = pin.SE3.Identity()
        for handle, link in zip(scene._joints, robot.link_names, strict=True):
            placed *= pin.SE3(pin.Quaternion(*handle.wxyz).matrix(), np.array(handle.position))
            expected = Kinematics(robot, link).transform(q)
            np.testing.assert_allclose(placed.homogeneous, expected, atol=1e-9)
        assert [handle.name.count('/') for handle in scene._joints] == [2, 3, 4, 5]
