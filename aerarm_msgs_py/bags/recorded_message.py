"""One message on its way into a bag."""

from typing import NamedTuple


class RecordedMessage(NamedTuple):
    """A serialized message.

    Attributes
    ----------
    topic
        Index of its topic in the writer's list.
    payload
        Serialized message.
    log_time
        Time of reception [ns].
    publish_time
        Time of publication [ns].
    sequence
        Publication sequence number, 0 if unknown.
    """

    topic: int
    payload: bytes
    log_time: int
    publish_time: int
    sequence: int
