"""Some consecutive messages of one topic."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aerarm_msgs_py.codecs.payloads import Payloads


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
