"""`calibrator --mount`: estimate the poses of arm and IMU on the drone, and write drone.yaml."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from aerarm_ros.calibration.chain import chain_of
from aerarm_ros.calibration.geometry import ArmGeometry
from aerarm_ros.calibration.mount import (
    FramePose,
    ImuResult,
    MountResult,
    calibrate_imu,
    calibrate_mount,
    drone_yaml,
)
from aerarm_ros.calibration.observations import CalibrationError
from aerarm_ros.description.config_reader import config_path
from aerarm_ros.description.drone_config import DroneConfig, PoseConfig, load_drone_config
from aerarm_ros.description.robot import read_urdf
from aerarm_ros.identification.files.result_directory import MARKER, ResultDirectory
from aerarm_ros.pages.html_text import origin, page, paragraph, section, table
from aerarm_ros.ros.process.process_end import print_notice
from aerarm_ros.ros.programs.calibrator_input import FlightRecording, read_flight
from aerarm_ros.ros.programs.identifier_options import result_folder

DRONE, REPORT = 'drone.yaml', 'report.html'
MOUNT_FILES = (DRONE, REPORT, MARKER)
"""Names of the files that `calibrator --mount` writes."""
_NOTE = (
    "Poses of the arm's base frame (mount) and of the IMU in the frame of the drone's body. Each "
    'deviation is a standard deviation that results from the fit. "Moved" is the distance and the '
    'rotation angle between the pose in the input drone file and the estimated pose.'
)


def calibrate_on_drone(options: argparse.Namespace) -> str:
    """Estimate the poses of arm and IMU on a drone, write the results, and return a table to print.

    Parameters
    ----------
    options : argparse.Namespace
        Parsed arguments of the calibrator.

    Raises
    ------
    CalibrationError, ConfigError, DescriptionError, BagError, IdentificationError
        If an option, a file or the bag is wrong, or the result cannot be written.
    """
    if len(options.bag) != 1:
        raise CalibrationError(
            '--mount needs exactly one recording, in which drone and arm move: pass one file to '
            '--bag'
        )
    source = config_path(options.drone, 'drone.yaml')
    drone, (urdf, _) = load_drone_config(source), read_urdf(options.urdf)
    with ResultDirectory(result_folder(options, 'mount'), files=MOUNT_FILES) as directory:
        flight = read_flight(options.bag[0], options)
        gravity, joints = drone.gravity_in_base.tolist(), flight.joints
        chain = chain_of(urdf, joints.names, options.link, options.lock, gravity)
        geometry = ArmGeometry(chain.robot, chain.link)
        q = joints.columns(chain.robot.joint_names)
        assert joints.time is not None
        mount = calibrate_mount(geometry, joints.time, q, flight.drone, flight.markers)
        imu = _imu(flight, options.imu, source.name)
        directory.write(DRONE, drone_yaml(source, mount.pose, imu.pose if imu else None))
        load_drone_config(directory.path(DRONE))  # an unreadable file discards the result
        rows = _rows(drone, mount, imu)
        found: dict[str, Any] = {'mount': _plain(mount.pose), 'joint_states_late': mount.late}
        if imu is not None:
            found |= {'imu': _plain(imu.pose), 'imu_late': imu.late}
        directory.write_json(MARKER, found)
        body = [paragraph(_NOTE, 'lead'), section('Poses', table(['quantity', 'value'], rows))]
        directory.write(REPORT, page('Calibration of mount and IMU', '', body, origin()))
    lines = [f'{name}: {value}' for name, value in rows]
    return '\n'.join([*lines, f'Report: {directory.target / REPORT}'])


def _imu(flight: FlightRecording, topic: str, source: str) -> ImuResult | None:
    """Estimate the pose of the IMU; if this fails, print the reason and return None."""
    values = flight.imu
    unchanged = f'{DRONE} keeps the pose of the IMU from the input file {source}'
    if values is None:
        print_notice(
            'calibrator', f'the bag has no IMU samples on {topic} (--imu), therefore {unchanged}'
        )
        return None
    try:
        return calibrate_imu(
            flight.drone, values.stamp, values.angular_velocity, values.linear_acceleration
        )
    except CalibrationError as error:
        print_notice(
            'calibrator', f'{unchanged}, because the calibration of the IMU failed: {error}'
        )
        return None


def _rows(drone: DroneConfig, mount: MountResult, imu: ImuResult | None) -> list[tuple[str, str]]:
    rows = [
        *_pose_rows('mount', mount.pose, drone.mount),
        ('marker residual [mm RMS per axis]', f'{1e3 * mount.fit.length:.2f}'),
        ('delay of joint states [ms]', f'{1e3 * mount.late:.1f}'),
    ]
    if imu is not None:
        rows += [
            *_pose_rows('imu', imu.pose, drone.imu),
            ('delay of IMU [ms]', f'{1e3 * imu.late:.1f}'),
            ('accelerometer bias [m/s^2]', _numbers(imu.bias, 3)),
        ]
    return rows


def _pose_rows(name: str, pose: FramePose, drawn: PoseConfig) -> list[tuple[str, str]]:
    turn = drawn.rotation.T @ pose.rotation
    angle = float(np.arccos(np.clip(0.5 * (np.trace(turn) - 1.0), -1.0, 1.0)))
    moved = float(np.linalg.norm(pose.position - np.array(drawn.position)))
    return [
        (f'{name} position [m]', _numbers(pose.position, 5)),
        (f'{name} position deviation [mm]', _numbers(1e3 * pose.position_std, 2)),
        (f'{name} rpy [rad]', _numbers(pose.rpy, 5)),
        (f'{name} rotation deviation [mrad]', _numbers(1e3 * pose.rotation_std, 2)),
        (
            f'{name} moved relative to the input drone file',
            f'{1e3 * moved:.2f} mm, {1e3 * angle:.2f} mrad',
        ),
    ]


def _plain(pose: FramePose) -> dict[str, Any]:
    names = ('position', 'rpy', 'position_std', 'rotation_std')
    return {name: getattr(pose, name).tolist() for name in names}


def _numbers(values: Any, digits: int) -> str:
    return ', '.join(f'{float(value):.{digits}f}' for value in values)
