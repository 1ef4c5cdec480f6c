"""Measure the period of the bridge's 1 kHz loop, on the host of the bridge.

Usage: python benchmarks/radio/loop_watch.py

The program uses the time at which the bridge published each joint state, so a delay of this program
has no effect. For each line `mark` on standard input, it prints a JSON object about the time since
the previous `mark`: number of joint states, time span, longest gap, number of gaps above 20 ms,
messages that this program lost, and missed cycles that the bridge reports.
"""

import json
import select
import sys
import time

import rclpy
from rclpy.serialization import deserialize_message

from aerarm_msgs_py import topics
from aerarm_msgs_py.live_topics import RawReader
from aerarm_ros.ros.process.node_process import stay_on_this_host, use_packaged_profile

GAP_NS = 20_000_000
_DEPTH = 8000
_BATCH = 0.02  # [s]


class Account:
    """Statistics of the joint states since the last `mark`."""

    def __init__(self) -> None:
        self.last_ns = self.first_ns = 0
        self.clear()

    def clear(self) -> None:
        """Reset the statistics; the newest state begins the next time span."""
        self.first_ns = self.last_ns
        self.states = self.longest_ns = self.gaps = 0

    def add(self, sent_ns: int) -> None:
        """Process a joint state that was published at a time [ns]."""
        if not self.last_ns:
            self.first_ns = self.last_ns = sent_ns
            return
        gap = sent_ns - self.last_ns
        self.last_ns = sent_ns
        self.states += 1
        self.longest_ns = max(self.longest_ns, gap)
        self.gaps += gap > GAP_NS

    def row(self) -> dict[str, object]:
        """Return the statistics."""
        span, longest = 1e-9 * (self.last_ns - self.first_ns), 1e-9 * self.longest_ns
        return {'states': self.states, 'span': span, 'longest': longest, 'gaps': self.gaps}


def main() -> None:
    """Receive joint states on this host until standard input ends."""
    stay_on_this_host()
    use_packaged_profile()
    rclpy.init()
    node = rclpy.create_node('loop_watch')
    reader = RawReader(
        node, topics.JOINT_STATES.queued(_DEPTH), topics.DIAGNOSTICS.queued(100), identify=True
    )
    account, missed, lost = Account(), 0, 0
    has_told = False
    while rclpy.ok():
        if reader.wait(0.1):
            time.sleep(_BATCH)
        while (message := reader.take(0)) is not None:
            account.add(message[1]['source_timestamp'])
        while (message := reader.take(1)) is not None:
            missed = _missed(message[0], missed)
        if account.states and not has_told:
            has_told = True
            print(json.dumps({'time': time.monotonic(), 'ready': True}), flush=True)
        if select.select([sys.stdin], [], [], 0.0)[0]:
            if not sys.stdin.readline():
                return
            now_lost = reader.lost(0) or 0
            row = {'time': time.monotonic(), **account.row(), 'missed': missed}
            print(json.dumps({**row, 'unread': now_lost - lost}), flush=True)
            lost = now_lost
            account.clear()


def _missed(payload: bytes, before: int) -> int:
    message = deserialize_message(payload, topics.DIAGNOSTICS.type)
    for status in message.status:
        values = {item.key: item.value for item in status.values}
        if 'missed cycles' in values:
            return int(values['missed cycles'])
    return before


if __name__ == '__main__':
    main()
