"""Reports of a recorder to its own simulation, and reports to others."""

from builtin_interfaces.msg import Time
from quick_spinning import spin_until
from rclpy.node import Node

from aerarm_msgs_py.topics import RECORDED_UNTIL
from aerarm_ros.ros.emulation.emulated_world import RecordingWatch

START = 1_700_000_000  # [s]


def test_only_states_of_its_own_world_are_waited_for(ros_node: Node) -> None:
    watch = RecordingWatch(ros_node, START * 1_000_000_000)
    publisher = ros_node.create_publisher(Time, RECORDED_UNTIL.name, RECORDED_UNTIL.offered)
    assert spin_until(ros_node, publisher.get_subscription_count, 60.0)
    now_ns = (START + 3) * 1_000_000_000

    def is_behind_after(seconds: int, limit: float = 1.0) -> bool:
        publisher.publish(Time(sec=seconds))
        return bool(spin_until(ros_node, lambda: watch.is_behind(now_ns), limit))

    assert not is_behind_after(1)  # a second bridge's, in lockstep
    assert not is_behind_after(START + 3)
    assert is_behind_after(START + 1, 60.0)
    watch.destroy()
