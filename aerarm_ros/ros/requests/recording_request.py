"""Client on the ground that records on the drone, through the node `ground_link`."""

from __future__ import annotations

import json
import secrets
import time
from collections.abc import Callable, Sequence
from math import inf
from pathlib import Path

from rclpy.node import Node
from std_msgs.msg import String

from aerarm_msgs_py import topics
from aerarm_ros.hardware.bridge_modes import BRIDGES
from aerarm_ros.ros.executors import spin_until
from aerarm_ros.ros.link.recordings import (
    COMPLETE,
    ENDED,
    FAILED,
    FETCHING,
    FINISH,
    RECORD,
    RECORDING,
    REQUESTED,
    WAITING,
    WATCH,
)
from aerarm_ros.ros.process.process_end import StopSignals
from aerarm_ros.ros.requests.arm_client import ArmClientError
from aerarm_ros.ros.requests.bridge_service import discovery_time

_ASK_AGAIN = 0.5  # [s]
_PATIENCE = 60.0  # [s] for the drone's recorder to start
_SILENT = 1.5  # [s] without a message of the drone, after which its silence is reported
_PROGRESS = 1.0  # [s] between two lines of progress
_WATCH_EVERY = 2.0  # [s]


class RecordingRequest:
    """Record a bag on the drone, and copy the bag to this host through the node `ground_link`.

    Parameters
    ----------
    node
        Owner of publisher and subscription; the methods of this class spin it.
    name
        Name of the bag on both hosts.
    folder
        Folder of the bag on this host.
    show
        Called with each line of progress.
    """

    def __init__(self, node: Node, name: str, folder: Path, show: Callable[[str], None]) -> None:
        self._node = node
        self._name = name
        self._folder = folder
        self._print = show
        self._report: dict[str, object] = {}
        self._id = ''
        self._is_stopped = False
        self._publisher = topics.RECORD_REQUEST.publisher(node)
        topics.RECORD_REPORT.subscription(node, self._on_report)

    def is_on_ground(self) -> bool:
        """Return whether this host is on the ground, and reaches the bridge through `ground_link`.

        On the ground, the ROS graph contains nodes of this host, but no nodes on the drone.
        """
        node = self._node

        def is_known() -> bool:
            return bool(self._publisher.get_subscription_count()) or any(
                name in BRIDGES for name in node.get_node_names()
            )

        spin_until(node, is_known, discovery_time())
        return bool(self._publisher.get_subscription_count())

    def record(self) -> None:
        """Record on the drone until Ctrl-C, then fetch the bag.

        Raises
        ------
        ArmClientError
            If the drone does not record, the recording ends before Ctrl-C, or the bag cannot be
            stored.
        """
        deadline = time.monotonic() + _PATIENCE
        self._begin()
        with StopSignals(self._stop):
            self._ask_until(RECORD, (RECORDING, ENDED), deadline)
            self._print(
                f'the drone records {self._name}: Ctrl-C ends the recording and fetches the bag'
            )
            while not self._is_stopped and self._state != ENDED:
                self._ask(WATCH)
                spin_until(
                    self._node, lambda: self._is_stopped or self._state == ENDED, _WATCH_EVERY
                )
                self._expect_no_failure()
            ended = ''
            if self._state == ENDED:
                reason = self._report.get('text')
                ended = f'the recording {self._name} ended before Ctrl-C: {reason}'
                if not self._report.get('has_bag'):
                    raise ArmClientError(ended)
                self._print(ended)
            # A second Ctrl-C ends this process; ground_link continues to fetch the bag.
            self.fetch()
        if ended:
            raise ArmClientError(f'{ended}; {self._folder} contains the recording up to its end')

    def fetch(self) -> None:
        """End the recording on the drone, and copy its bag to this host.

        A loss of radio contact delays the copy, but does not end it.

        Raises
        ------
        ArmClientError
            If the drone has no bag of this name, or this host cannot store the bag.
        """
        self._begin()
        self._print(f'fetching {self._name} into {self._folder}')
        self._ask_until(FINISH, (WAITING, FETCHING, COMPLETE), inf)
        while self._state != COMPLETE:
            spin_until(self._node, lambda: self._state in (COMPLETE, FAILED), _PROGRESS)
            self._expect_no_failure()
            if self._state != COMPLETE:
                self._print(self._progress())
                self._ask(FINISH)  # a restarted ground_link fetches no bag before a request
        self._print(f'{self._folder}: {_megabytes(self._report.get("size"))} stored')

    def _begin(self) -> None:
        """Select a new request identifier; from now on, ignore reports with other identifiers."""
        self._id, self._report = secrets.token_hex(8), {}

    @property
    def _state(self) -> object:
        return self._report.get('state')

    def _ask_until(self, do: str, states: Sequence[str], deadline: float) -> None:
        has_reported = False
        while self._state not in states:
            self._ask(do)
            spin_until(self._node, lambda: self._state in (*states, FAILED), _ASK_AGAIN)
            self._expect_no_failure()
            if time.monotonic() > deadline:
                raise ArmClientError(
                    f'the drone does not record {self._name}: {self._silence() or "no answer"}; '
                    'check the status of ground_link in /diagnostics'
                )
            if not has_reported and self._silence():
                has_reported = True
                self._print(self._silence())

    def _ask(self, do: str) -> None:
        content = {'do': do, 'name': self._name, 'folder': str(self._folder), 'id': self._id}
        self._publisher.publish(String(data=json.dumps(content)))

    def _expect_no_failure(self) -> None:
        if self._state == FAILED:
            raise ArmClientError(str(self._report.get('text', '')))

    def _silence(self) -> str:
        if not self._publisher.get_subscription_count():
            return 'the node ground_link no longer runs on this host: start ground_side.launch.py'
        silent = float(str(self._report.get('silent', 0.0)))
        return f'no message from the drone for {silent:.0f} s' if silent > _SILENT else ''

    def _progress(self) -> str:
        stored, size = (self._report.get(key) for key in ('stored', 'size'))
        text = f'{_megabytes(stored)} of {_megabytes(size)}'
        if self._state != FETCHING:
            text = str(self._report.get('text', '')) or 'waiting for the drone'
        return ': '.join(filter(None, (text, self._silence())))

    def _on_report(self, message: String) -> None:
        try:
            report = json.loads(message.data)
        except ValueError:
            return
        if isinstance(report, dict) and self._id in report.get('ids', ()):
            if report.get('state') == REQUESTED:  # the drone's answer says more
                report = {**report, **self._report, 'silent': report.get('silent', 0.0)}
            self._report = report

    def _stop(self) -> None:
        self._is_stopped = True


def _megabytes(size: object) -> str:
    return f'{1e-6 * float(str(size or 0)):.2f} MB'
