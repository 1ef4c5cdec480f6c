"""The header of what is told of the arm in its base's frame."""

from __future__ import annotations

from builtin_interfaces.msg import Time
from std_msgs.msg import Header

BASE_FRAME = 'base_link'


def base_header(stamp_ns: int) -> Header:
    """Return a header with the stamp of a state [ns since the epoch]."""
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    return Header(stamp=Time(sec=seconds, nanosec=nanoseconds), frame_id=BASE_FRAME)
