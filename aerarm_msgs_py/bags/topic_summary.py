"""How much of a topic is in a bag."""

from dataclasses import dataclass


@dataclass(frozen=True)
class TopicSummary:
    """One topic of a bag.

    Attributes
    ----------
    type
        Message type, for example 'sensor_msgs/msg/JointState'.
    messages
        Messages in the bag.
    lost
        Messages that were published between the first and the last one and aren't in the
        bag; None where the recorder stored no publication sequence numbers.
    """

    type: str
    messages: int
    lost: int | None
