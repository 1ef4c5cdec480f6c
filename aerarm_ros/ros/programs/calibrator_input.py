"""Read postures, marker positions and poses for the calibrator from tables and bags."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from aerarm_msgs_py.bags.bag_reader import read_contents
from aerarm_msgs_py.bags.pose_series import IMU, ODOMETRY, TF, PoseSeries, read_poses
from aerarm_ros.calibration.chain import Chain
from aerarm_ros.calibration.observations import CalibrationError, Observations, Source
from aerarm_ros.calibration.plateaus import (
    Track,
    rest_observations,
    resting_arm,
    rotations,
    sources_of,
    time_offset,
)
from aerarm_ros.calibration.tables import read_postures
from aerarm_ros.description.urdf_document import UrdfDocument
from aerarm_ros.motion.signals import Array
from aerarm_ros.ros.programs.identifier_bags import collected_warnings

# Topics of this suite with positions that are no measurement of the arm.
_SUITE_TOPICS = ('tool_pose', 'tool_trajectory', 'tool_goal', 'arm_com', 'flight_set_point')
_MAX_STATES = 4_000_000


@dataclass(eq=False)
class JointPositions:
    """Joint positions of resting postures, or of a recorded motion.

    Attributes
    ----------
    position : (M, n) ndarray
        Positions of the n joints [rad].
    time : (M,) ndarray or None
        Time of each row [s]; None if each row is a posture in which the arm rests.
    """

    names: tuple[str, ...]
    position: Array
    time: Array | None = None

    def columns(self, names: Sequence[str]) -> Array:
        """Return the positions (M, k) [rad] of the k named joints."""
        return self.position[:, [self.names.index(name) for name in names]]


@dataclass(eq=False)
class CalibratorInput:
    """Content of one input file of the calibrator: a table of postures, or a recorded motion.

    Attributes
    ----------
    tracks : list of Track
        Measurements in the postures, or during the motion.
    mapping : list of str
        Texts that state how the program interprets the columns or topics.
    messages : list of str
        Warnings for the user.
    """

    path: Path
    joints: JointPositions
    tracks: list[Track] = field(default_factory=list)
    mapping: list[str] = field(default_factory=list)
    messages: list[str] = field(default_factory=list)


def read_input(path: Path, urdf: str, options: argparse.Namespace) -> CalibratorInput:
    """Read one input file of the calibrator, a table or a bag.

    Raises
    ------
    BagError, CalibrationError, DescriptionError
        If the file cannot be read, or contains no joint positions or no measurements.
    """
    if path.suffix.lower() == '.npz':
        raise CalibrationError(f'{path} is an npz file: the calibrator reads tables as .csv')
    if path.suffix.lower() == '.csv' and path.is_file():
        return _read_table(path, urdf, options)
    return _read_bag(path, urdf, options)


def to_observations(
    given: CalibratorInput, chain: Chain, options: argparse.Namespace
) -> Observations:
    """Return the postures in which the arm rests, with the measurements in each posture.

    Raises
    ------
    CalibrationError
        If the arm never rests, or the input has no measurements.
    """
    q, time = given.joints.columns(chain.robot.joint_names), given.joints.time
    tracks = [track for track in given.tracks if track.name not in options.ignore]
    if not tracks:
        by = '--ignore' if time is None else '--sensors, --frames and --ignore'
        raise CalibrationError(
            f'no markers or poses of {given.path} remain after the selection by {by}: check this'
        )
    poses = [track.name for track in tracks if track.rotation is not None]
    in_hand = _eye_in_hand(poses, given.path, options)
    if time is None:
        labels = tuple(f'{given.path.name}, row {k + 1}' for k in range(len(q)))
        return Observations(q, sources_of(tracks, in_hand), labels)
    offsets = {}
    for track in tracks:
        late, agreement = time_offset(time, q, track)
        offsets[track.name] = late
        given.mapping.append(
            f'the estimated time offset of {track.name} from the joint states is '
            f'{1e3 * late:+.0f} ms (correlation of marker speed and joint speed {agreement:.2f})'
        )
    rests = resting_arm(time, q)
    given.mapping.append(f'the arm rests in {len(rests.q)} postures')
    return rest_observations(rests, tracks, offsets, in_hand)


def _eye_in_hand(poses: Sequence[str], path: Path, options: argparse.Namespace) -> list[str]:
    """Return the names of poses that the option `--eye-in-hand` lists, without leading slashes."""
    names = [name.lstrip('/') for name in options.eye_in_hand]
    unknown = next((name for name in names if name not in poses), None)
    if unknown is not None:
        raise CalibrationError(
            f'--eye-in-hand {unknown} is not a pose of {path}: choose from '
            f'{", ".join(poses) or "none"}'
        )
    return names


def _read_table(path: Path, urdf: str, options: argparse.Namespace) -> CalibratorInput:
    document = UrdfDocument(urdf)
    known = [name for name, joint in document.joints.items() if joint.is_driven]
    rename = dict(options.rename)
    prismatic = [name for name in known if document.joints[name].kind == 'prismatic']
    table = read_postures(path, known, options.length_unit, options.degrees, rename, prismatic)
    joints = {name: own for name, own in table.joints.items() if name not in options.ignore}
    if not joints:
        raise CalibrationError(f'--ignore leaves no joint column of {path}: check this option')
    mapping = list(table.mapping)
    if table.unused:
        mapping.append(f'columns not used: {", ".join(table.unused)}')
    positions = JointPositions(tuple(joints), np.column_stack(list(joints.values())))
    return CalibratorInput(path, positions, list(table.measured.values()), mapping)


def _read_bag(path: Path, urdf: str, options: argparse.Namespace) -> CalibratorInput:
    messages: list[str] = []
    with collected_warnings(messages):
        joints, series, clock = _read_contents(path, options, options.sensors)
    used = {name: one for name, one in series.items() if _is_sensor(name, one, options)}
    # robot_state_publisher computes the frames of the links from the joint positions.
    links = [] if options.frames else sorted(
        name for name in UrdfDocument(urdf).links & used.keys() if used[name].kind == TF
    )  # fmt: skip
    for name in links:
        del used[name]
    tracks = [_track(name, one, *clock) for name, one in used.items()]
    if not tracks:
        listed = ', '.join(f'{name} ({one.kind})' for name, one in series.items()) or 'none'
        raise CalibrationError(
            f'the bag {path} has no topic with markers or poses of the arm: name such a topic with '
            f'--sensors. The bag contains these topics with positions: {listed}'
        )
    mapping = [f'joint states: {options.topic}']
    if links:
        mapping.append(
            f'tf frames of links of the URDF are not used: {", ".join(links)}. To use one of these '
            'frames, name it with --frames'
        )
    mapping += [f'{"marker" if t.rotation is None else "pose"}: {t.name}' for t in tracks]
    return CalibratorInput(path, joints, tracks, mapping, messages)


def _read_contents(
    path: Path, options: argparse.Namespace, sensors: Sequence[str]
) -> tuple[JointPositions, dict[str, PoseSeries], tuple[float, float]]:
    """Return a bag's joint states and poses, and time stamp and reception time of the first state.

    The joint states have increasing stamps and finite positions.
    """
    contents = read_contents(path, options.topic, most=_MAX_STATES)
    series = read_poses(path, sensors, options.frames)
    states, rename = contents.joint_states['/' + options.topic.lstrip('/')], dict(options.rename)
    _, order = np.unique(states.stamp, return_index=True)
    order = order[np.isfinite(states.position[order]).all(axis=1)]
    names = tuple(rename.get(name, name) for name in states.names)
    joints = JointPositions(names, states.position[order], states.stamp[order])
    return joints, series, (float(states.stamp[0]), float(states.log_time[0]))


@dataclass(eq=False)
class FlightRecording:
    """Measurements from the bag that `calibrator --mount` reads.

    Attributes
    ----------
    drone : Track
        Pose of the drone's body over time.
    imu : PoseSeries or None
        IMU samples, None if the bag has no IMU topic.
    markers : list of Track
        Positions of the markers on the arm over time.
    """

    joints: JointPositions
    drone: Track
    imu: PoseSeries | None
    markers: list[Track]


def read_flight(path: Path, options: argparse.Namespace) -> FlightRecording:
    """Read the bag for `calibrator --mount`, in which arm and drone move.

    Raises
    ------
    BagError, CalibrationError
        If the bag cannot be read, or does not contain the drone's pose.
    """
    sensors = [options.drone_pose, options.imu, *options.sensors] if options.sensors else []
    joints, series, clock = _read_contents(path, options, sensors)
    name, imu_name = ('/' + text.lstrip('/') for text in (options.drone_pose, options.imu))
    pose = series.pop(name, None) or series.pop(options.drone_pose, None)
    if pose is None or pose.kind == IMU or not np.isfinite(pose.quaternion).all():
        listed = ', '.join(f'{key} ({one.kind})' for key, one in series.items()) or 'none'
        raise CalibrationError(
            f'the bag {path} has no poses of the drone on the topic {name}: name the topic of the '
            f"drone's pose with --drone-pose. The bag contains these topics with positions: "
            f'{listed}'
        )
    imu = series.pop(imu_name, None)
    used = {key: one for key, one in series.items() if _is_sensor(key, one, options)}
    markers = [_track(key, one, *clock) for key, one in used.items()]
    return FlightRecording(
        joints,
        _track(name, pose, *clock),
        imu if imu is not None and imu.kind == IMU else None,
        [track for track in markers if track.rotation is None],
    )


def _is_sensor(name: str, series: PoseSeries, options: argparse.Namespace) -> bool:
    if series.kind in (ODOMETRY, IMU) or name in options.ignore:
        return False
    is_of_suite = name.rpartition('/')[2] in _SUITE_TOPICS and not options.sensors
    return not is_of_suite


def _track(name: str, series: PoseSeries, stamp: float, log_time: float) -> Track:
    """Return the poses of one topic as a track, with times on the clock of the joint states.

    `stamp` and `log_time` are the time stamp and the reception time of the first joint state [s].
    """
    time = series.stamp
    # The sensor's computer has another clock: use the reception times instead of the stamps.
    if abs((time[0] - stamp) - (series.log_time[0] - log_time)) > 60.0:
        time = series.log_time - log_time + stamp
    rotation = None
    if np.isfinite(series.quaternion).all(axis=1).any():
        rotation = rotations(series.quaternion)
    return Track(name.lstrip('/'), time, series.position, rotation)


def joined(parts: Sequence[Observations]) -> Observations:
    """Combine the postures of several input files that measure the same markers and poses.

    Raises
    ------
    CalibrationError
        If the files contain different markers or poses.
    """
    kinds = [[(type(source), source.unknowns) for source in part.sources] for part in parts]
    if any(kind != kinds[0] for kind in kinds):
        raise CalibrationError(
            'the files of --bag contain different markers or poses: calibrate each file '
            'separately, or exclude the differing markers and poses with --ignore'
        )
    sources = map(_stacked, *(part.sources for part in parts))
    labels = tuple(label for part in parts for label in part.labels)
    return Observations(np.vstack([part.q for part in parts]), tuple(sources), labels)


def _stacked(*parts: Source) -> Source:
    """Return one source with the measurements, one row per posture, of all parts."""
    names = [name for name, value in vars(parts[0]).items() if isinstance(value, np.ndarray)]
    values: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in names
    }
    return replace(parts[0], **values)
