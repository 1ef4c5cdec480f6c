"""The written URDF, YAML and configuration reproduce the fitted calibration."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from measured_arm import CONFIG, LINK, ROBOT, MeasuredArm, own_chain

from aerarm_ros.calibration.calibrate import Calibration, calibrate
from aerarm_ros.calibration.files import calibrated_urdf, calibration_yaml, config_yaml, summary
from aerarm_ros.calibration.report import calibration_html, calibration_text
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.resources import resource
from aerarm_ros.description.robot import load_robot
from aerarm_ros.model.kinematics import Kinematics


@pytest.fixture(scope='module')
def calibration() -> Calibration:
    arm = MeasuredArm(4, frames=10)
    observations = arm.observe(arm.postures(30))
    return calibrate(own_chain(), observations, level='geometry', compliance=False)


def test_the_written_urdf_has_the_poses_of_the_fit(calibration: Calibration) -> None:
    fit = calibration.fit
    robot = load_robot(calibrated_urdf(calibration, with_offsets=True))
    q = MeasuredArm(4).postures(5, seed=3)
    poses = fit.geometry.poses(q, fit.errors)
    kinematics = Kinematics(robot, LINK)
    for k, row in enumerate(q):
        transform = kinematics.transform(row)
        np.testing.assert_allclose(transform[:3, 3], poses.position[k], atol=1e-12)
        np.testing.assert_allclose(transform[:3, :3], poses.rotation[k], atol=1e-12)


def test_urdf_and_configuration_together_have_them_too(
    calibration: Calibration, tmp_path: Path
) -> None:
    path = tmp_path / 'arm.yaml'
    path.write_text(config_yaml(calibration, resource('config', 'aerarm.yaml')))
    offsets = load_arm_config(path).column('offset') - CONFIG.column('offset')
    assert np.abs(offsets).max() > 1e-3
    robot = load_robot(calibrated_urdf(calibration, with_offsets=False))
    fit = calibration.fit
    q = MeasuredArm(4).postures(5, seed=3)
    poses = fit.geometry.poses(q, fit.errors)
    places = np.array([Kinematics(robot, LINK).position(row + offsets) for row in q])
    np.testing.assert_allclose(places, poses.position, atol=1e-7)
    # Everything else is unchanged.
    np.testing.assert_array_equal(robot.inertial_parameters, ROBOT.inertial_parameters)
    np.testing.assert_array_equal(robot.position_max, ROBOT.position_max)
    assert robot.urdf_text.count('Frames. A link') == 1  # its comments
    assert robot.urdf_text.count('calibrated geometry') == 1


def test_yaml_summary_and_pages_list_estimates_and_errors(calibration: Calibration) -> None:
    document = yaml.safe_load(calibration_yaml(calibration, 'arm.yaml'))
    assert document['offsets_in'] == 'arm.yaml'
    for joint, (value, deviation) in document['offsets'].items():
        assert joint in ROBOT.joint_names and abs(value) > deviation > 0.0
    places = document['frames']['mocap']['markers_in_link']
    assert set(places) == {'marker1', 'marker2', 'marker3', 'marker4'}
    listed = document['as_drawn']
    assert 'joint1.offset' in listed['absorbed']
    assert document['errors']['training']['after_mm'] < 0.2
    figures = summary(calibration)
    assert figures['postures'] == 30
    after = figures['errors']['training']['after_mm']
    assert f'{after:.2f} mm after calibration' in calibration_text(calibration)
    html = calibration_html(calibration, ['a mapping'])
    assert 'By marker and direction' in html and 'a mapping' in html
    assert html.count('<h2') >= 5
