"""The metadata.yaml of a rosbag2 directory."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import yaml

from aerarm_msgs_py.bags.message_definition import message_definition
from aerarm_msgs_py.bags.recorded_topic import RecordedTopic

_VERSION = 9  # as ROS 2 Jazzy writes it


@dataclass
class BagMetadata:
    """What `ros2 bag info` shows.

    Attributes
    ----------
    file
        Name of the bag's one file.
    topics
        Its topics.
    counts
        Messages of each topic.
    start, end
        First and last time of reception [ns]; None while there are no messages.
    """

    file: str
    topics: Sequence[RecordedTopic]
    counts: list[int] = field(init=False)
    start: int | None = None
    end: int | None = None

    def __post_init__(self) -> None:
        self.counts = [0] * len(self.topics)

    def add(self, topic: int, log_time: int) -> None:
        """Count a message."""
        self.counts[topic] += 1
        if self.start is None or self.end is None:
            self.start = self.end = log_time
        elif log_time > self.end:
            self.end = log_time
        elif log_time < self.start:
            self.start = log_time

    def to_yaml(self) -> str:
        """Return the file's text."""
        content = {'rosbag2_bagfile_information': self._information()}
        return yaml.dump(content, Dumper=_NoAliases, sort_keys=False)

    def serialized(self) -> str:
        """Return the text that rosbag2 also puts into the MCAP file."""
        return yaml.dump(self._information(), Dumper=_NoAliases, sort_keys=False)

    def _information(self) -> dict[str, object]:
        start = self.start or 0
        extent = {
            'duration': {'nanoseconds': (self.end or 0) - start},
            'starting_time': {'nanoseconds_since_epoch': start},
            'message_count': sum(self.counts),
        }
        return {
            'version': _VERSION,
            'storage_identifier': 'mcap',
            **extent,
            'topics_with_message_count': [
                {'topic_metadata': _topic_metadata(topic), 'message_count': count}
                for topic, count in zip(self.topics, self.counts, strict=True)
            ],
            'compression_format': '',
            'compression_mode': '',
            'relative_file_paths': [self.file],
            'files': [{'path': self.file, **extent}],
            'custom_data': None,
            'ros_distro': 'jazzy',
        }


class _NoAliases(getattr(yaml, 'CSafeDumper', yaml.SafeDumper)):  # type: ignore[misc]
    """Dumper without anchors, which rosbag2's parser has no use for."""

    def ignore_aliases(self, data: object) -> bool:
        return True


def _topic_metadata(topic: RecordedTopic) -> dict[str, object]:
    return {
        'name': topic.name,
        'type': topic.type,
        'serialization_format': 'cdr',
        'offered_qos_profiles': [topic.qos_profile()],
        'type_description_hash': message_definition(topic.type).hash,
    }
