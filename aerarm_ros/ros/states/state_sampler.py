"""The newest joint state, or other message like it, now and then, for nodes that serve people."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node

from aerarm_msgs_py import topics
from aerarm_msgs_py.codecs.joint_state_decoder import JointStateDecoder
from aerarm_msgs_py.codecs.payloads import Payloads
from aerarm_msgs_py.live_topics.raw_reader import RawReader
from aerarm_msgs_py.live_topics.topic import Topic

_COUNT_PERIOD = 1.0  # [s]


class StateSampler:
    """Takes what is newest on a topic and leaves the rest, at no cost per message.

    Parameters
    ----------
    node
        Owner of the subscription.
    names
        Joints wanted, n of them, in the order of the numbers returned.
    topic
        Of JointState; `joint_states` if not given.

    Attributes
    ----------
    missing
        Wanted joints that no message has had so far.
    unknown
        Wanted joints without a position in the newest message: those that are not homed.
    stamp_ns
        Stamp of the newest message [ns].
    """

    def __init__(
        self, node: Node, names: Sequence[str], topic: Topic = topics.JOINT_STATES
    ) -> None:
        self.missing: list[str] = []
        self.unknown: list[str] = []
        self.stamp_ns = 0
        self._names = list(names)
        self._may_be_partial = topic is not topics.JOINT_STATES
        self._reader = RawReader(node, topic)
        self._decoder = JointStateDecoder()
        self._counted = (time.monotonic(), 0)
        self._frequency = 0.0

    def newest(self) -> NDArray[np.float64] | None:
        """Return position, velocity, effort (3, n) [rad, rad/s, Nm], or None if nothing new came.

        What the message leaves empty is NaN; a state without positions is none.
        """
        message = self._reader.take_newest()
        if message is None:
            return None
        stamps, values = self._decoder.decode(Payloads.of([message[0]]))
        self.stamp_ns = int(stamps[0])
        known = self._decoder.names
        self.missing = [name for name in self._names if name not in known]
        if self.missing:
            return None
        state = values[0][:, [known.index(name) for name in self._names]]
        finite = np.isfinite(state[0]).tolist()
        self.unknown = [
            name for name, is_known in zip(self._names, finite, strict=True) if not is_known
        ]
        return state if self._may_be_partial or not self.unknown else None

    def frequency(self, now: float) -> float:
        """Return the publisher's rate [Hz] over the last second, from its own numbering.

        Parameters
        ----------
        now
            Monotonic time [s].
        """
        since, before = self._counted
        if now - since > _COUNT_PERIOD:
            total = self._reader.count() + (self._reader.lost() or 0)
            self._frequency = (total - before) / (now - since)
            self._counted = (now, total)
        return self._frequency

    def destroy(self) -> None:
        """Destroy the subscription."""
        self._reader.destroy()
