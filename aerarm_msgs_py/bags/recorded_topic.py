"""What a bag says about one of its topics."""

from dataclasses import dataclass

# rosbag2 writes "no limit" as the largest number of nanoseconds, split like this.
_INFINITE = {'sec': 9223372036, 'nsec': 854775807}


@dataclass(frozen=True)
class RecordedTopic:
    """A topic to be written into a bag.

    Attributes
    ----------
    name
        Full name, for example '/arm/joint_states'.
    type
        For example 'sensor_msgs/msg/JointState'.
    depth, reliable, latched
        Quality of service its publishers offer; `ros2 bag play` publishes with it.
    """

    name: str
    type: str
    depth: int = 10
    reliable: bool = True
    latched: bool = False

    def qos_profile(self) -> dict[str, object]:
        """Return the quality of service as rosbag2's metadata (version 9) has it."""
        return {
            'history': 'keep_last',
            'depth': self.depth,
            'reliability': 'reliable' if self.reliable else 'best_effort',
            'durability': 'transient_local' if self.latched else 'volatile',
            'deadline': dict(_INFINITE),
            'lifespan': dict(_INFINITE),
            'liveliness': 'automatic',
            'liveliness_lease_duration': dict(_INFINITE),
            'avoid_ros_namespace_conventions': False,
        }
