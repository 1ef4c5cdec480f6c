"""`calibrator --mount` on a bag of a moving drone, up to the drone file."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from forked_executable import run
from geometry_msgs.msg import PointStamped
from measured_arm import ROBOT
from moving_drone import MovingDrone, angle
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import Imu, JointState

from aerarm_msgs_py.bags.bag import RecordedMessage, RecordedTopic
from aerarm_msgs_py.bags.bag_writer import BagWriter
from aerarm_ros.calibration.plateaus import Track
from aerarm_ros.description.drone_config import load_drone_config

START = 1_700_000_000.0  # [s] stamp of the first message


def stamped(message: Any, time: float) -> Any:
    """Return a message with a stamp."""
    ns = round(1e9 * (START + time))
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(ns, 1_000_000_000)
    return message


def fill(target: Any, values: np.ndarray) -> None:
    """Write the components of a vector or quaternion into a message."""
    for name, value in zip('xyzw', values, strict=False):
        setattr(target, name, float(value))


def poses(track: Track) -> Iterator[tuple[float, Any]]:
    """Yield messages of the drone's pose."""
    assert track.rotation is not None
    turns = Rotation.from_matrix(track.rotation).as_quat()
    for time, place, turn in zip(track.time, track.position, turns, strict=True):
        message = stamped(Odometry(), time)
        fill(message.pose.pose.position, place)
        fill(message.pose.pose.orientation, turn)
        yield time, message


def points(track: Track) -> Iterator[tuple[float, Any]]:
    """Yield messages of a marker."""
    for time, place in zip(track.time, track.position, strict=True):
        message = stamped(PointStamped(), time)
        fill(message.point, place)
        yield time, message


def joint_states(moving: MovingDrone, late: float) -> Iterator[tuple[float, Any]]:
    """Yield messages of the joints."""
    for time, q in zip(*moving.joints(late), strict=True):
        yield time, stamped(JointState(name=list(ROBOT.joint_names), position=q.tolist()), time)


def imu_samples(moving: MovingDrone, late: float) -> Iterator[tuple[float, Any]]:
    """Yield messages of the IMU."""
    for time, rate, force in zip(*moving.imu(late), strict=True):
        message = stamped(Imu(), time)
        fill(message.angular_velocity, rate)
        fill(message.linear_acceleration, force)
        yield time, message


def write_bag(path: Path, moving: MovingDrone) -> Path:
    """Write a bag with joint states, IMU, drone poses and markers."""
    streams = {'/joint_states': list(joint_states(moving, 0.035))}
    streams['/drone_pose'] = list(poses(moving.body()))
    streams |= {f'/mocap/{t.name}': list(points(t)) for t in moving.markers()}
    streams['/imu'] = list(imu_samples(moving, -0.02))
    types = {name: type(messages[0][1]) for name, messages in streams.items()}
    topics = [
        RecordedTopic(name, f'{one.__module__.split(".")[0]}/msg/{one.__name__}')
        for name, one in types.items()
    ]
    rows = sorted(
        ((time, k, message) for k, own in enumerate(streams.values()) for time, message in own),
        key=lambda row: row[0],
    )
    with BagWriter(path, topics) as writer:
        for time, k, message in rows:
            ns = round(1e9 * (START + time))
            writer.write(RecordedMessage(k, serialize_message(message), ns, ns, 1))
    return path


@pytest.fixture(scope='module')
def flight(tmp_path_factory: pytest.TempPathFactory) -> tuple[MovingDrone, Path]:
    moving = MovingDrone(5, duration=12.0)
    return moving, write_bag(tmp_path_factory.mktemp('flight') / 'bag', moving)


def test_a_bag_gives_mount_and_imu_within_1_mm_and_2_mrad(
    flight: tuple[MovingDrone, Path], tmp_path: Path
) -> None:
    moving, bag = flight
    command = ('calibrator', '--mount', '--bag', bag, '--drone-pose', '/drone_pose', '--out')
    done = run(*command, tmp_path / 'mount')
    assert done.returncode == 0, done.stderr
    found = load_drone_config(tmp_path / 'mount' / 'drone.yaml')
    for name in ('mount', 'imu'):
        one, true = getattr(found, name), getattr(moving.drone, name)
        assert np.linalg.norm(np.subtract(one.position, true.position)) < 1e-3, name
        assert angle(one.rotation, true.rotation) < 2e-3, name
    # Without an IMU, its pose stays.
    done = run(*command, tmp_path / 'other', '--imu', '/other')
    assert done.returncode == 0, done.stderr
    assert 'no IMU samples on /other' in done.stderr
    other = load_drone_config(tmp_path / 'other' / 'drone.yaml')
    assert (other.imu, other.mount) == (load_drone_config().imu, found.mount)


def test_a_bag_without_poses_of_the_drone_is_one_error(
    flight: tuple[MovingDrone, Path], tmp_path: Path
) -> None:
    done = run('calibrator', '--mount', '--bag', flight[1], '--out', tmp_path / 'mount')
    assert done.returncode == 2
    assert 'no poses of the drone on the topic /odometry' in done.stderr.splitlines()[-1]
    assert not (tmp_path / 'mount').exists()
