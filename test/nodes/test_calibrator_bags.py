"""Poses and frames of bags that `calibrator` uses, and options that name them."""

from argparse import Namespace
from pathlib import Path

import pytest
from geometry_msgs.msg import PointStamped, PoseStamped
from measured_arm import LINK, ROBOT, MeasuredArm, own_chain
from rclpy.serialization import serialize_message
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import JointState

from aerarm_msgs_py.bags.bag import RecordedMessage, RecordedTopic
from aerarm_msgs_py.bags.bag_writer import BagWriter
from aerarm_ros.calibration.calibrate import calibrate
from aerarm_ros.calibration.observations import CalibrationError, PoseSource
from aerarm_ros.nodes.calibrator import calibrator_parser
from aerarm_ros.ros.programs.calibrator_input import CalibratorInput, read_input, to_observations

TYPES = {'/joint_states': JointState, '/mocap/tip': PointStamped, '/camera/pose': PoseStamped}

STORE = get_typestore(Stores.ROS2_JAZZY)


def transforms(stamp: tuple[int, int], x: float) -> bytes:
    """Return a TFMessage with a frame of the URDF and a measured frame."""
    types = STORE.types
    time = types['builtin_interfaces/msg/Time'](*stamp)
    header = types['std_msgs/msg/Header'](time, 'world')
    made = [
        types['geometry_msgs/msg/TransformStamped'](
            header,
            name,
            types['geometry_msgs/msg/Transform'](
                types['geometry_msgs/msg/Vector3'](x, 0.0, 0.0),
                types['geometry_msgs/msg/Quaternion'](0.0, 0.0, 0.0, 1.0),
            ),
        )
        for name in (LINK, 'body')
    ]
    message = types['tf2_msgs/msg/TFMessage'](made)
    return bytes(STORE.serialize_cdr(message, 'tf2_msgs/msg/TFMessage'))


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Record an arm that rests in eight postures; the rotation of the camera pose is empty."""
    path = tmp_path_factory.mktemp('bags') / 'bag'
    arm = MeasuredArm(8)
    postures = arm.postures(8)
    topics = [
        RecordedTopic(name, f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}')
        for name, kind in TYPES.items()
    ]
    topics.append(RecordedTopic('/tf', 'tf2_msgs/msg/TFMessage'))
    with BagWriter(path, topics) as writer:
        for k in range(8 * 40):
            q = postures[k // 40]
            place = [float(x) for x in arm.true_positions(q[None])[0, 0]]
            state = JointState(name=list(ROBOT.joint_names), position=q.tolist())
            point, pose = PointStamped(), PoseStamped()
            for target in (point.point, pose.pose.position):
                target.x, target.y, target.z = place
            pose.pose.orientation.w = 0.0
            ns = round(1e9 * (1_700_000_000.0 + 0.05 * k))
            stamp = divmod(ns, 1_000_000_000)
            for message in (state, point, pose):
                message.header.stamp.sec, message.header.stamp.nanosec = stamp
            data = [serialize_message(message) for message in (state, point, pose)]
            for topic, payload in enumerate([*data, transforms(stamp, place[0])]):
                writer.write(RecordedMessage(topic, payload, ns, ns, 1))
    return path


def options(*arguments: str) -> Namespace:
    return calibrator_parser('calibrator', 'test').parse_args(arguments)


def read(bag: Path, *arguments: str) -> CalibratorInput:
    return read_input(bag, ROBOT.urdf_text, options(*arguments))


def test_frames_of_the_urdf_are_sensors_only_if_named(bag: Path) -> None:
    found = read(bag)
    assert {track.name for track in found.tracks} == {'mocap/tip', 'camera/pose', 'body'}
    assert any(f'not used: {LINK}' in text for text in found.mapping)
    named = read(bag, '--frames', LINK)
    assert {track.name for track in named.tracks} == {'mocap/tip', 'camera/pose', LINK}


@pytest.mark.parametrize('name', ['/body', 'body'])
def test_eye_in_hand_takes_names_with_and_without_a_slash(bag: Path, name: str) -> None:
    arguments = options('--eye-in-hand', name)
    found = to_observations(read(bag), own_chain(), arguments)
    in_hand = {s.name: s.eye_in_hand for s in found.sources if isinstance(s, PoseSource)}
    assert in_hand['body'] and not in_hand['camera/pose']


@pytest.mark.parametrize('name', ['/wing', '/mocap/tip'])
def test_eye_in_hand_rejects_names_without_rotations(bag: Path, name: str) -> None:
    with pytest.raises(CalibrationError) as error:
        to_observations(read(bag), own_chain(), options('--eye-in-hand', name))
    assert f'--eye-in-hand {name.lstrip("/")} is not a pose of {bag}' in str(error.value)


def test_a_pose_with_zero_quaternions_is_named(bag: Path) -> None:
    observations = to_observations(read(bag), own_chain(), options())
    with pytest.raises(CalibrationError) as error:
        calibrate(own_chain(), observations)
    assert 'camera/pose has no measurement in any posture: pass --ignore' in str(error.value)
