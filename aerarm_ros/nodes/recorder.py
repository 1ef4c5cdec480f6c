"""Record the topics of this suite into an MCAP bag, at full rate and without conversion.

Usage: ros2 run aerarm_ros recorder --ros-args -p bag:=DIRECTORY
"""

import json
import sys
import time
from collections.abc import Sequence
from datetime import datetime

import rclpy
from rclpy.node import Node
from std_msgs.msg import String

from aerarm_msgs_py.bags.mcap_writer import COMPRESSIONS
from aerarm_msgs_py.storage.read_limits import BagError
from aerarm_msgs_py.topics import DIAGNOSTICS, JOINT_STATES, NEWEST, RECORDED_UNTIL, RECORDER_STATUS
from aerarm_ros.ros.diagnostics import PERIOD, DiagnosticsPublisher
from aerarm_ros.ros.executors import BackgroundExecutor
from aerarm_ros.ros.graph import DuplicatePublisherCheck, PublisherCheck
from aerarm_ros.ros.parameters.parameter import Parameter
from aerarm_ros.ros.parameters.parameter_table import ParameterTable
from aerarm_ros.ros.process.node_main import run_node
from aerarm_ros.ros.process.node_process import is_on_this_host
from aerarm_ros.ros.process.process_end import StopSignals
from aerarm_ros.ros.recording import SUITE_TOPICS, BagFeed, find_topics, receive_buffer_problem

NAME = 'recorder'
PARAMETERS = ParameterTable(
    Parameter('bag', '', 'folder of the new bag; recording_DATE_TIME if empty'),
    Parameter('topics', SUITE_TOPICS,
        'topics to record, each as the name of a topic of this suite, or as NAME=TYPE'),
    Parameter('compression', 'zstd', 'compression method of the bag', choices=tuple(COMPRESSIONS)),
    Parameter('depth', 4000,
        'length of the receive queue of each topic, in messages', minimum=10, maximum=100_000),
)  # fmt: skip

# The recorder reads messages in batches: waking up for each message of four 1 kHz topics would need
# ten times the processor time. The middleware stamps each message at reception.
_BATCH = 5e-3  # [s] between two batches
_WAIT = 0.1  # [s] longest wait for a message
_TAKEN_MAX = 1000  # messages of a topic per batch
_STATUS_PERIOD = 0.1  # [s]


class Recorder:
    """Node that records a bag and reports the state of the recording.

    Messages on the latched topic `recorder_status` are JSON objects with `state` (recording, stored
    or failed), `bag`, and `matched`, the topics with a discovered publisher. Other nodes wait for
    such a message before they start a motion. /diagnostics contains the numbers of written and lost
    messages; the bag contains /diagnostics too.

    Attributes
    ----------
    status
        Exit status after `run`.

    Raises
    ------
    ValueError
        If a parameter is not allowed or the bag cannot be created.
    """

    def __init__(self) -> None:
        self.status = 0
        self._node = Node(NAME)
        values = PARAMETERS.declare(self._node)
        topics = find_topics(values.topics)
        self._depth = values.depth
        self._directory = values.bag or f'recording_{datetime.now():%Y%m%d_%H%M%S}'
        self._feed = BagFeed(self._node, topics, values.depth, self._directory, values.compression)
        self._streams = sum(topic.qos == NEWEST for topic in topics)
        self._until = RECORDED_UNTIL.publisher(self._node)
        self._check = PublisherCheck(self._node, topics)
        self._sources = DuplicatePublisherCheck(self._node, JOINT_STATES)
        self._status_publisher = RECORDER_STATUS.publisher(self._node)
        self._diagnostics = DiagnosticsPublisher(self._node)
        self._own = self._node.resolve_topic_name(DIAGNOSTICS.name)
        self._matched: list[str] = []
        self._status_due = self._report_due = 0.0
        self._stopped = False

    def run(self) -> None:
        """Record until SIGINT, SIGTERM, SIGHUP or a shutdown, then complete the bag."""
        self._node.get_logger().info(
            f'recording {len(self._feed.names)} topics into {self._directory}'
        )
        self._publish_status('recording')
        # Messages from this host use shared memory instead of the receive buffer.
        problem = '' if is_on_this_host() else receive_buffer_problem(self._streams)
        if problem:
            self._node.get_logger().warning(problem)
        with StopSignals(self._on_stop), BackgroundExecutor(self._node):
            try:
                self._record()
                self._feed.complete()
            except BagError as error:
                self.status = 1
                self._publish_status('failed')
                self._node.get_logger().fatal(str(error))
                return
            self._publish_status('stored')
            self._log_counts()

    def close(self) -> None:
        """Complete the bag if it is still incomplete, and destroy the node."""
        try:
            self._feed.complete()
        except BagError as error:
            if self.status == 0:  # the error has not been reported yet
                print(f'{NAME}: {error}', file=sys.stderr)
            self.status = 1
        self._feed.destroy()
        self._node.destroy_node()

    def _record(self) -> None:
        while not self._stopped and rclpy.ok():
            if self._feed.wait(_WAIT):
                time.sleep(_BATCH)
            self._feed.take(_TAKEN_MAX)
            if time.monotonic() > self._status_due:
                self._status_due = time.monotonic() + _STATUS_PERIOD
                self._update_matched()
                self._publish_recorded_until()
            if time.monotonic() > self._report_due:
                self._report_due = time.monotonic() + PERIOD
                self._report()
        if rclpy.ok():
            self._feed.take(self._depth)  # as many as the queue can hold

    def _update_matched(self) -> None:
        counts = self._feed.publishers()
        matched = [name for name, count in zip(self._feed.names, counts, strict=True) if count]
        self._warn(counts)
        if matched != self._matched:
            self._matched = matched
            self._publish_status('recording')
            self._node.get_logger().info(f'publishers found: {", ".join(matched) or "none"}')

    def _warn(self, matched: list[int]) -> None:
        """Log warnings about unrecordable publishers and several publishers of joint_states."""
        for text in filter(None, [*self._check.news(matched), self._sources.news()]):
            self._node.get_logger().warning(text)

    def _publish_recorded_until(self) -> None:
        """Publish the stamp of the newest recorded joint state; a simulation waits for it."""
        until = self._feed.until()
        if until:
            self._until.publish(until)

    def _publish_status(self, state: str) -> None:
        content = {'state': state, 'bag': str(self._directory), 'matched': self._matched}
        self._status_publisher.publish(String(data=json.dumps(content)))

    def _report(self) -> None:
        """Publish the state of the recording on /diagnostics, and log newly lost messages."""
        self._warn_of_losses()
        counts = self._feed.message_counts()
        losing = {name: lost for name, (_, lost) in counts.items() if lost}
        names = ', '.join(losing)
        problem = f'{sum(losing.values())} messages of {names} were lost'
        if self._feed.losses.cause:
            problem += f' (cause of the last loss: {self._feed.losses.cause})'
        messages, size = self._feed.written()
        values = {
            'bag': self._directory,
            'messages written': messages,
            'messages lost': self._feed.total_lost(),
            'messages waiting for the disk': self._feed.waiting,
            'topics without a message': ', '.join(self._feed.silent()) or 'none',
            'bytes written': size,
        }
        self._diagnostics.report(problem if losing else '', values)

    def _warn_of_losses(self) -> None:
        for text in self._feed.losses.news():
            self._node.get_logger().warning(text)

    def _log_counts(self) -> None:
        self._warn_of_losses()
        counts = self._feed.message_counts()
        for name, (count, lost) in counts.items():
            self._log(f'{name}: {count} messages, {"unknown" if lost is None else lost} lost', lost)
        for name in self._feed.silent():
            self._log(
                f'{name}: 0 messages, because the publisher sent none or all messages were lost',
                None,
            )
        if not counts.keys() - {self._own}:
            self._node.get_logger().warning(
                'no messages received: check that a bridge runs in this ROS domain (ROS_DOMAIN_ID)'
            )
        count = sum(count for count, _ in counts.values())
        total = self._feed.total_lost()
        self._log(f'{self._directory}: {count} messages, {total} lost', total)

    def _log(self, text: str, lost: object) -> None:
        # rclpy requires that one line of code always logs with the same severity.
        if lost in (0, None, 'at least 0'):
            self._node.get_logger().info(text)
        else:
            self._node.get_logger().warning(text)

    def _on_stop(self) -> None:
        self._stopped = True


def main(args: Sequence[str] | None = None) -> int:
    """Run the node and return its exit status."""
    return run_node(NAME, Recorder, args, PARAMETERS, __doc__)
