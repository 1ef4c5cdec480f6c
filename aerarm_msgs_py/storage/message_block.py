"""Some consecutive messages of one topic."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from aerarm_msgs_py.codecs.payloads import Payloads

_MOST = 8192  # messages of a block, so that what is made of one stays small


@dataclass(frozen=True)
class MessageBlock:
    """Serialized messages of one topic as they lie next to each other in a bag.

    Attributes
    ----------
    topic, type
        Topic and message type, for example '/joint_states', 'sensor_msgs/msg/JointState'.
    log_time
        (K,) time each message was received by the recorder [ns].
    sequence
        (K,) publication sequence numbers, 0 where the recorder didn't store them.
    payloads
        K serialized messages.
    """

    topic: str
    type: str
    log_time: NDArray[np.int64]
    sequence: NDArray[np.int64]
    payloads: Payloads

    def chosen(self, which: NDArray[np.bool_]) -> 'MessageBlock':
        """Return some of the messages, by a (K,) mask."""
        return replace(
            self,
            log_time=self.log_time[which],
            sequence=self.sequence[which],
            payloads=self.payloads.chosen(which),
        )

    def parts(self) -> Iterator['MessageBlock']:
        """Yield the messages as blocks of bounded length."""
        if len(self.payloads) <= _MOST:
            yield self
            return
        for start in range(0, len(self.payloads), _MOST):
            part = slice(start, start + _MOST)
            yield replace(
                self,
                log_time=self.log_time[part],
                sequence=self.sequence[part],
                payloads=self.payloads[part],
            )
