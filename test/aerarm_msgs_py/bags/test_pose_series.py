"""Points, poses, transforms and inertial measurements from a bag."""

from pathlib import Path

import numpy as np
from geometry_msgs.msg import PointStamped, PoseStamped
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import Imu

from aerarm_msgs_py.bags.bag import RecordedMessage, RecordedTopic
from aerarm_msgs_py.bags.bag_writer import BagWriter
from aerarm_msgs_py.bags.pose_series import read_poses

TOPICS = {
    '/marker': 'geometry_msgs/msg/PointStamped',
    '/body': 'geometry_msgs/msg/PoseStamped',
    '/tf': 'tf2_msgs/msg/TFMessage',
    '/odometry': 'nav_msgs/msg/Odometry',
    '/imu': 'sensor_msgs/msg/Imu',
}
# tf2_msgs need not be installed.
STORE = get_typestore(Stores.ROS2_JAZZY)


def transforms(k: int) -> bytes:
    types = {name.rpartition('/')[2]: kind for name, kind in STORE.types.items()}
    header = types['Header'](types['Time'](10 + k, 500_000_000), 'a frame' * k)
    turn = types['Quaternion'](0.0, 0.0, 0.0, 1.0)
    made = [
        types['TransformStamped'](
            header, name, types['Transform'](types['Vector3'](x, 0.0, 0.0), turn)
        )
        for name, x in (('tool', 5.0 * k), ('other', 0.0))
    ]
    message = types['TFMessage'](made)
    return bytes(STORE.serialize_cdr(message, 'tf2_msgs/msg/TFMessage'))


def messages(k: int) -> list[bytes]:
    point, pose, odometry, imu = PointStamped(), PoseStamped(), Odometry(), Imu()
    point.point.x = float(k)
    pose.pose.position.y, pose.pose.orientation.z, pose.pose.orientation.w = 2.0 * k, 0.6, 0.8
    odometry.pose.pose.position.z = 3.0 * k
    imu.angular_velocity.x, imu.linear_acceleration.z = 4.0 * k, 9.81
    for one in (point, pose, odometry, imu):
        one.header.stamp.sec, one.header.stamp.nanosec = 10 + k, 500_000_000
        one.header.frame_id = 'a frame' * k
    first, second, *others = map(serialize_message, (point, pose, odometry, imu))
    return [first, second, transforms(k), *others]


def test_every_kind_is_read_with_its_stamps(tmp_path: Path) -> None:
    topics = [RecordedTopic(name, kind) for name, kind in TOPICS.items()]
    with BagWriter(tmp_path / 'bag', topics) as writer:
        for k in range(3):
            for topic, payload in enumerate(messages(k)):
                writer.write(RecordedMessage(topic, payload, k * 10**9, k * 10**9, k + 1))
    found = read_poses(tmp_path / 'bag')
    assert set(found) == {'/marker', '/body', 'tool', 'other', '/odometry', '/imu'}
    np.testing.assert_array_equal(found['/marker'].stamp, [10.5, 11.5, 12.5])
    np.testing.assert_array_equal(found['/marker'].position[:, 0], [0.0, 1.0, 2.0])
    assert np.isnan(found['/marker'].quaternion).all()
    np.testing.assert_array_equal(found['/body'].quaternion[2], [0.0, 0.0, 0.6, 0.8])
    np.testing.assert_array_equal(found['/body'].position[:, 1], [0.0, 2.0, 4.0])
    np.testing.assert_array_equal(found['tool'].position[:, 0], [0.0, 5.0, 10.0])
    np.testing.assert_array_equal(found['/odometry'].position[:, 2], [0.0, 3.0, 6.0])
    np.testing.assert_array_equal(found['/imu'].angular_velocity[:, 0], [0.0, 4.0, 8.0])
    assert set(read_poses(tmp_path / 'bag', frames=['tool'])) == set(found) - {'other'}
    assert set(read_poses(tmp_path / 'bag', topics=['marker'])) == {'/marker'}
