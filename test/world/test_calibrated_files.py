"""The tool in the world, from the calibrator's files."""

from pathlib import Path

import numpy as np
from measured_arm import LINK, ROBOT, MeasuredArm, own_chain
from moving_drone import MovingDrone

from aerarm_ros.calibration.calibrate import calibrate
from aerarm_ros.calibration.files import calibrated_urdf
from aerarm_ros.calibration.geometry import ArmGeometry
from aerarm_ros.calibration.mount import calibrate_mount, drone_yaml
from aerarm_ros.control.base.base_motion import Mount
from aerarm_ros.description.drone_config import DroneConfig, load_drone_config
from aerarm_ros.description.resources import resource
from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.world.base_pose import BasePose, OdometryFrames


def marker_in_world(
    robot: Robot, drone: DroneConfig, moving: MovingDrone, t: float, on_link: np.ndarray
) -> np.ndarray:
    """Return the position (3,) that the files predict, as `world_control` computes it."""
    frames = OdometryFrames.of(drone, Mount.from_drone(drone))
    turn = moving.rotation(t)
    base = BasePose(
        moving.place(t) + turn @ frames.base_position,
        np.zeros(3),
        turn @ frames.base_rotation,
        np.zeros(3),
    )
    pose = Kinematics(robot, LINK).transform(moving.q(t))
    return base.to_world(pose[:3, 3] + pose[:3, :3] @ on_link)


def test_calibrated_files_predict_the_tool_in_the_world_within_1_mm(tmp_path: Path) -> None:
    arm, moving = MeasuredArm(8, frames=10), MovingDrone(8, made=True)
    observations = arm.observe(arm.postures(25))
    calibration = calibrate(own_chain(), observations, level='geometry', compliance=False)
    calibrated = load_robot(calibrated_urdf(calibration, with_offsets=True))
    found = calibrate_mount(
        ArmGeometry(calibrated, LINK), *moving.joints(late=0.0), moving.body(), moving.markers()
    )
    path = tmp_path / 'drone.yaml'
    path.write_text(drone_yaml(resource('config', 'drone.yaml'), found.pose, None))
    on_link = found.fit.states[0][12:15]
    errors = []
    for robot, drone in ((ROBOT, load_drone_config()), (calibrated, load_drone_config(path))):
        off = [
            marker_in_world(robot, drone, moving, t, on_link) - moving.marker_places(t)[0]
            for t in np.linspace(1.0, 19.0, 20)
        ]
        errors.append(float(np.sqrt(np.mean(np.sum(np.square(off), axis=1)))))
    assert errors[0] > 5e-3
    assert errors[1] < 1e-3
