"""Recordings that the ground asks for: the drone records, the ground fetches the bag."""

from __future__ import annotations

import json
import os
import struct
import tempfile
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from math import inf
from pathlib import Path
from types import SimpleNamespace

from rclpy.node import Node
from rclpy.serialization import deserialize_message
from std_msgs.msg import String

from aerarm_msgs_py import topics
from aerarm_msgs_py.live_topics import RawReader
from aerarm_ros.link.connection import PROMPT, Connection, Message
from aerarm_ros.link.fetch import BLOCK, Fetch, FileServer, is_name
from aerarm_ros.ros.process.node_process import NodeProcess

BAG_REQUESTS, BAG_REPORTS, QUESTIONS, BLOCKS = range(1006, 1010)
"""Channels of requests and reports, and of questions about blocks and the blocks."""
RECORD, FINISH = 'record', 'finish'
"""What may be requested: to record a bag, or to complete it and fetch it."""
RECORDING, STORED, FETCHING, COMPLETE, FAILED = STATES = (
    'recording',
    'stored',
    'fetching',
    'complete',
    'failed',
)
"""States of a recording in reports."""

METADATA = 'metadata.yaml'
_REPORT_PERIOD = 0.5  # [s]
_MATCHING_TIME = 20.0  # [s] for the recorder to find a bridge on a busy computer
_SILENCE_MAX = 600.0  # [s] of the ground, after which the drone completes the bag
_BURST = 3  # datagrams of blocks per step: what the socket's buffer holds
_START_LIFETIME = 2.0  # [s] in which a request to record must reach the drone
_MALFORMED = (struct.error, IndexError, OSError)


class DroneRecordings:
    """Runs the recorder for the ground and serves its bags.

    Parameters
    ----------
    node
        In whose namespace the recorder runs.
    connection
        To the ground.
    values
        `bags`, the folder for bags.
    """

    def __init__(self, node: Node, connection: Connection, values: SimpleNamespace) -> None:
        self._node = node
        self._connection = connection
        self._folder = Path(values.bags).expanduser()
        self._logs: Path | None = None
        self._process: NodeProcess | None = None
        self._name = ''
        self._server: FileServer | None = None
        self._places: deque[bytes] = deque(maxlen=512)
        self._number = int(time.time()) & 0xFFFF
        self._report_due = self._patience = inf
        self._status = RawReader(node, topics.RECORDER_STATUS)
        self._has_states = self._is_ending = False

    def take_request(self, content: bytes) -> None:
        """Do what the ground requests."""
        request = json.loads(content)
        name = str(request['name'])
        if not is_name(name):
            self._report(
                name, FAILED, f"'{name}' is not a bag name: use letters, digits, _, - and ."
            )
            return
        try:
            if request['do'] == RECORD:
                self._record(name)
            elif request['do'] == FINISH:
                self._finish(name)
        except OSError as error:
            self._report(name, FAILED, f'{self._folder} on the drone: {error}')

    def fail(self, error: Exception) -> None:
        """Report an error of the recording, and let the recorder complete its bag."""
        self._report(self._name, FAILED, f'recording of {self._name} on the drone: {error}')
        if self._process is not None and self._process.returncode is not None:
            self._process = None
        self._ask_to_end()

    def take_question(self, content: bytes) -> None:
        """Note which blocks the ground asks for."""
        if self._server is not None:
            self._places.extend(self._server.blocks(content))

    def update(self, now: float, last_received: float) -> None:
        """Follow the recorder; complete the bag of a ground that stays away."""
        if self._process is None:
            return
        if self._process.returncode is not None:
            self._end()
        elif not self._is_ending and 0.0 < now - last_received - _SILENCE_MAX < inf:
            self._node.get_logger().warning(
                f'the ground has been silent for {_SILENCE_MAX:g} s: completing bag {self._name}'
            )
            self._ask_to_end()
        elif now > self._report_due:
            is_recording = self._is_recording()
            self._report_due = now + (2.0 if is_recording else 0.1)
            if is_recording:
                self._report(self._name, RECORDING)

    def send(self, send: Callable[[bytes], bool]) -> bool:
        """Send some of the blocks that were asked for; return whether there are more.

        Parameters
        ----------
        send
            Sends a datagram and returns whether the radio took it.
        """
        server = self._server
        for _ in range(_BURST):
            if server is None or not self._places:
                return False
            now_ns = time.monotonic_ns()
            try:
                answer = server.answer(self._places[0])
            except BlockingIOError:
                return True  # the disk is busy
            except _MALFORMED:
                self._places.popleft()
                continue
            if not send(self._connection.single(BLOCKS, answer, now_ns, time.time_ns())):
                return False  # the next step goes on with it
            self._places.popleft()
        return bool(self._places)

    def close(self) -> None:
        """Complete the bag that is being recorded."""
        if self._process is not None:
            self._process.stop()
        if self._server is not None:
            self._server.close()
        self._status.destroy()

    def _record(self, name: str) -> None:
        if self._process is not None:
            if name != self._name:
                self._report(name, FAILED, f'the drone records bag {self._name}: finish that first')
            return
        bag = self._folder / name
        if bag.exists():
            self._report(name, FAILED, f'the drone has a bag {name} already: choose another name, '
                         f"or fetch it with 'arm fetch {name}'")  # fmt: skip
            return
        self._logs = self._logs or Path(tempfile.mkdtemp(prefix='aerarm_recordings_'))
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            self._process = NodeProcess(
                'recorder',
                ('--ros-args', '-r', f'__ns:={self._node.get_namespace()}', '--'),
                {'bag': str(bag)},
                log=self._logs / f'{name}.log',
            )
        except OSError as error:
            self._report(name, FAILED, f'{self._folder} on the drone: {error.strerror}')
            return
        # It inherits the real-time priority of this process, and must not compete with the loop.
        with suppress(OSError):
            os.sched_setscheduler(self._process.pid, os.SCHED_OTHER, os.sched_param(0))
        self._name, self._has_states, self._is_ending = name, False, False
        self._report_due, self._patience = 0.0, inf
        self._node.get_logger().info(f'recording {bag} for the ground')

    def _is_recording(self) -> bool:
        """Tell whether the recorder has begun and found the bridge, which takes a second or two.

        Without a bridge it counts as recording after a while.
        """
        bag = self._folder / self._name
        message = self._status.take_newest()
        if message is not None and not self._has_states:
            status = json.loads(deserialize_message(message[0], String).data)
            states = self._node.resolve_topic_name(topics.JOINT_STATES.name)
            self._has_states = status['bag'] == str(bag) and states in status['matched']
        if not (bag / METADATA).is_file():
            return False
        self._patience = min(self._patience, time.monotonic() + _MATCHING_TIME)
        return self._has_states or time.monotonic() > self._patience

    def _finish(self, name: str) -> None:
        if self._process is not None and name == self._name:
            if (self._folder / name / METADATA).is_file():
                self._ask_to_end()
        else:
            self._offer(name)

    def _ask_to_end(self) -> None:
        """Let the recorder complete its bag; a second signal would end it at once."""
        if self._process is not None and not self._is_ending:
            self._is_ending = True
            self._process.ask_to_end()

    def _end(self) -> None:
        assert self._process is not None
        status = self._process.stop()
        words = self._process.tail(1)
        self._process = None
        if status:
            self._report(self._name, FAILED, f'the recorder failed on the drone: {words}')
        else:
            self._offer(self._name)

    def _offer(self, name: str) -> None:
        """Let the ground fetch a bag."""
        bag = self._folder / name
        if not (bag / METADATA).is_file():
            self._report(name, FAILED, f'the drone has no bag {name} in {self._folder}')
            return
        if self._server is not None:
            self._server.close()
        self._number = (self._number + 1) & 0xFFFF
        self._server = FileServer(bag, self._number)
        self._places.clear()
        self._report(name, STORED, number=self._number, files=self._server.manifest)

    def _report(self, name: str, state: str, text: str = '', **more: object) -> None:
        content = {'name': name, 'state': state, 'text': text, **more}
        self._connection.send(BAG_REPORTS, json.dumps(content).encode())


class GroundRecordings:
    """Takes requests of this host to record on the drone, and fetches bags.

    Requests and reports are JSON objects on `record_request` and `record_report`.

    Parameters
    ----------
    node
        Owner of subscription and publisher.
    connection
        To the drone.
    values
        `fetch_rate` [Mbit/s].
    """

    def __init__(self, node: Node, connection: Connection, values: SimpleNamespace) -> None:
        self._connection = connection
        self._rate = values.fetch_rate * 1e6 / 8.0 / (BLOCK + 100.0)  # blocks/s
        self._reader = RawReader(node, topics.RECORD_REQUEST.queued(10))
        topic = topics.RECORD_REPORT
        self._publisher = node.create_publisher(topic.type, topic.name, topic.offered)
        self._folders: dict[str, Path] = {}
        self._state: dict[str, object] = {}
        self._message: Message | None = None
        self._fetch: Fetch | None = None
        self._fetched = ''
        self._report_due = inf

    def update(self, now: float, is_due: bool) -> bool:
        """Forward requests and ask for blocks; return whether there is something to send.

        A question replaces the one before, so blocks are only asked for if a datagram `is_due`.
        """
        while (message := self._reader.take()) is not None:
            self._take_local(deserialize_message(message[0], String).data, now)
        if now > self._report_due:
            self._report()
        fetch = self._fetch
        if fetch is None:
            return False
        if not is_due:
            return True
        connection = self._connection
        delay = connection.delay if connection.is_up(now) else inf
        question = fetch.question(now, delay, connection.round_trip)
        if question is not None:
            connection.set_value(QUESTIONS, question)
        return True

    def take_report(self, content: bytes) -> None:
        """Take what the drone reports."""
        report = json.loads(content)
        name = str(report['name'])
        if report['state'] == STORED and name in self._folders:
            self._begin(name, report)
        elif self._fetch is None or name != self._fetched:
            self._state = report
        self._report()

    def take_block(self, content: bytes) -> None:
        """Store a block of a bag."""
        fetch = self._fetch
        if fetch is None:
            return
        try:
            if content:
                fetch.take(content)
        except OSError as error:
            self._fail(f'{self._folders[self._fetched]}: {error.strerror}')
            return
        if fetch.is_complete:
            self._fetch = None
            folder = self._folders.pop(self._fetched)
            self._state = {'name': self._fetched, 'state': COMPLETE, 'text': str(folder),
                           'stored': fetch.stored, 'size': fetch.size}  # fmt: skip
            self._report()

    def destroy(self) -> None:
        """Destroy the subscription, and close the file that is being written."""
        if self._fetch is not None:
            self._fetch.close()
        self._reader.destroy()

    def _take_local(self, text: str, now: float) -> None:
        try:
            request = json.loads(text)
            name, do = str(request['name']), str(request['do'])
            folder = Path(request['folder'])
        except (ValueError, LookupError, TypeError):
            return  # of another program
        self._report()
        if do == FINISH:
            self._folders[name] = folder
            if self._fetch is not None and self._fetched == name:
                return  # on its way
        message = self._message
        if message is not None and not (message.is_confirmed or message.is_expired):
            return
        content = json.dumps({'do': do, 'name': name}).encode()
        expires = now + _START_LIFETIME if do == RECORD else inf
        self._message = self._connection.send(BAG_REQUESTS, content, PROMPT, expires)

    def _begin(self, name: str, report: dict[str, object]) -> None:
        if self._fetch is not None:
            self._fetch.close()
        self._fetched = name
        try:
            number, files = int(str(report['number'])), report['files']
            assert isinstance(files, list)
            self._fetch = Fetch(self._folders[name], number, files, self._rate)
        except (OSError, ValueError) as error:
            self._fail(str(error))
            return
        if self._fetch.is_complete:  # it was here already
            self.take_block(b'')

    def _fail(self, text: str) -> None:
        self._fetch = None
        self._folders.pop(self._fetched, None)
        self._state = {'name': self._fetched, 'state': FAILED, 'text': text}
        self._report()

    def _report(self) -> None:
        now = time.monotonic()
        self._report_due = now + _REPORT_PERIOD if self._fetch is not None else inf
        state = self._state
        if self._fetch is not None:
            state = {'name': self._fetched, 'state': FETCHING, 'text': '',
                     'stored': self._fetch.stored, 'size': self._fetch.size}  # fmt: skip
        silent = now - self._connection.last_received
        silent = min(silent, 1e6)  # JSON knows no infinity
        self._publisher.publish(String(data=json.dumps({**state, 'silent': round(silent, 2)})))
