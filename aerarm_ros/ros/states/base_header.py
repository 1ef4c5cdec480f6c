"""The header of what is told of the arm in its base's frame."""

from __future__ import annotations

from builtin_interfaces.msg import Time
from std_msgs.msg import Header


def base_header(stamp_ns: int, base_link: str) -> Header:
    """Return a header with the stamp of a state [ns since the epoch], see `Robot.base_link`."""
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    return Header(stamp=Time(sec=seconds, nanosec=nanoseconds), frame_id=base_link)
