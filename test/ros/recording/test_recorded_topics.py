import pytest
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from sensor_msgs.msg import LaserScan

from aerarm_msgs_py import topics
from aerarm_ros.ros.parameters.parameter_table import ParameterError
from aerarm_ros.ros.recording import SUITE_TOPICS, as_recorded, find_topics


def test_the_suite_is_recorded_but_not_the_recorder() -> None:
    assert set(SUITE_TOPICS) == set(topics.TOPICS) - {'recorder_status', 'recorded_until', '/clock'}
    assert find_topics(SUITE_TOPICS) == [topics.TOPICS[name] for name in SUITE_TOPICS]


def test_another_topic_is_given_with_its_type() -> None:
    (scan,) = find_topics([' front/scan=sensor_msgs/msg/LaserScan'])
    assert (scan.name, scan.type) == ('front/scan', LaserScan)
    # Matches publishers of either kind.
    assert scan.qos.reliability == ReliabilityPolicy.BEST_EFFORT


@pytest.mark.parametrize(
    ('entries', 'said'),
    [
        (['joint_stats'], "'joint_stats' .*unknown: choose from joint_states, .*NAME=TYPE"),
        (['imu', 'imu'], 'name each topic once'),
        ([], 'name each topic once'),
        (['a=own_msgs/msg/Own'], "'own_msgs/msg/Own' in parameter topics is not installed"),
        (['a=std_msgs/msg/Own'], "'std_msgs/msg/Own' in parameter topics is not installed"),
        (['a='], "'' in parameter topics is not installed"),
        (['a=os'], "'os' in parameter topics is not installed"),
    ],
)
def test_a_bad_entry_is_refused_with_advice(entries: list[str], said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        find_topics(entries)


def test_a_recorder_has_a_deep_history_and_the_topic_s_own_reliability() -> None:
    deep = topics.ARM_MODE.queued(500)
    assert (deep.qos.depth, topics.ARM_MODE.qos.depth) == (500, 1)
    assert deep.qos.reliability == ReliabilityPolicy.RELIABLE
    assert deep.qos.durability == DurabilityPolicy.TRANSIENT_LOCAL


def test_the_bag_contains_the_publishers_quality_of_service() -> None:
    recorded = as_recorded(topics.JOINT_STATES, '/arm/joint_states')
    assert (recorded.name, recorded.type) == ('/arm/joint_states', 'sensor_msgs/msg/JointState')
    assert (recorded.depth, recorded.reliable, recorded.latched) == (1, True, False)
    assert as_recorded(topics.ARM_MODE, '/arm_mode').latched
