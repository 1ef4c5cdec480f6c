"""Bags written by this suite, for tests of the readers."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from aerarm_msgs_py.bags.bag import RecordedMessage, RecordedTopic
from aerarm_msgs_py.bags.bag_writer import BagWriter
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr

JOINT_STATE = 'sensor_msgs/msg/JointState'


@dataclass(frozen=True)
class BagOnDisk:
    """Content of the bags: alternating joint states and motor states, and a silent topic."""

    names: tuple[str, ...] = ('joint1', 'joint2', 'joint3', 'joint4')
    start_ns: int = 1_700_000_000_123_456_789
    period_ns: int = 1_000_000
    topics: Sequence[RecordedTopic] = (
        RecordedTopic('/joint_states', JOINT_STATE, depth=1, reliable=False),
        RecordedTopic('/motor_states', JOINT_STATE, depth=1, reliable=False),
        RecordedTopic('/arm_mode', 'std_msgs/msg/String', depth=1, latched=True),
    )

    def numbers(self, count: int) -> np.ndarray:
        """Return (count, 3, n) position, velocity, effort of joint_states."""
        return np.random.default_rng(1).normal(size=(count, 3, len(self.names)))

    def messages(self, count: int, first: int = 0) -> list[RecordedMessage]:
        """Return the messages of `count` cycles."""
        cdr = JointStateCdr(self.names)
        taken = []
        for k, values in enumerate(self.numbers(first + count)[first:], first):
            stamp = self.start_ns + k * self.period_ns
            for topic, scale in ((0, 1.0), (1, 10.0)):
                payload = cdr.pack(stamp, *(scale * values))
                taken.append(RecordedMessage(topic, payload, stamp + 50_000, stamp + 1000, k + 1))
        return taken


@pytest.fixture
def recording() -> BagOnDisk:
    return BagOnDisk()


@pytest.fixture
def write_bag(tmp_path: Path, recording: BagOnDisk) -> Callable[..., Path]:
    """Return a function that writes messages into a bag and returns its directory."""

    def write(messages=None, name='bag', compression='zstd', topics=recording.topics) -> Path:
        with BagWriter(tmp_path / name, topics, compression) as writer:
            for message in recording.messages(100) if messages is None else messages:
                writer.write(message)
        return tmp_path / name

    return write
