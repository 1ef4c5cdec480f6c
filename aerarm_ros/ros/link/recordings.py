"""Recording of bags on the drone, and their transfer to the ground computer."""

from __future__ import annotations

import json
import os
import shutil
import struct
import tempfile
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from math import inf
from pathlib import Path
from types import SimpleNamespace

from rclpy.node import Node
from rclpy.serialization import deserialize_message
from std_msgs.msg import String

from aerarm_msgs_py import topics
from aerarm_msgs_py.bags.bag_writer import is_being_written
from aerarm_msgs_py.live_topics import RawReader
from aerarm_ros.link.connection import PROMPT, Connection, SentMessage
from aerarm_ros.link.fetch import BLOCK, Fetch, FileServer, is_name, questions
from aerarm_ros.ros.process.node_process import NodeProcess

BAG_REQUESTS, BAG_REPORTS, QUESTIONS, BLOCKS = range(1006, 1010)
"""Channels for recording requests, for reports, for requests of bag blocks, and for bag blocks."""
RECORD, WATCH, FINISH = 'record', 'watch', 'finish'
"""Requests of the ground computer: record a bag, report its state, or complete and fetch it."""
REQUESTED, RECORDING, ENDED, STORED, WAITING, FETCHING, COMPLETE, FAILED = (
    *('requested', 'recording', 'ended', 'stored'),
    *('waiting', 'fetching', 'complete', 'failed'),
)
"""States of a recording in reports. `ENDED` means that the recording ended, but not because of a
request. `WAITING` means that the link first fetches another bag.
"""

METADATA = 'metadata.yaml'
_REPORT_PERIOD = 0.5  # [s]
_MATCHING_TIME = 20.0  # [s] for the recorder to find a bridge on a busy computer
_SILENCE_MAX = 600.0  # [s] without a datagram of the ground; then the drone completes the bag
_BURST = 3  # datagrams of blocks per step, which fit into the socket's buffer
_START_LIFETIME = 2.0  # [s] in which a request to record must reach the drone
_STALL = 1.0  # [s] without a block, after which the ground requests the bag again
_SERVED_MAX = 4  # bags that the drone offers at the same time
_IDS_MAX = 16  # requests that wait for an answer


class _RejectedError(Exception):
    """The drone rejects a request; the message states the reason."""


class DroneRecordings:
    """Run a recorder on the drone for the ground computer, and send bags to that computer.

    Parameters
    ----------
    node
        Node of the link; the recorder runs in its namespace.
    connection
        Connection to the ground computer.
    values
        Parameters of `ground_link`, of which `bags` is the folder for bags.
    """

    def __init__(self, node: Node, connection: Connection, values: SimpleNamespace) -> None:
        self._node = node
        self._connection = connection
        self._folder = Path(values.bags).expanduser()
        self._logs: Path | None = None
        self._process: NodeProcess | None = None
        self._name = self._record_id = self._reason = ''
        self._ended: dict[str, str] = {}
        self._finish_ids: deque[str] = deque(maxlen=_IDS_MAX)
        self._served: dict[int, _Served] = {}
        self._places: deque[tuple[int, bytes]] = deque(maxlen=512)
        self._number = int(time.time()) & 0xFFFF
        self._report_due = self._patience = inf
        self._status = RawReader(node, topics.RECORDER_STATUS)
        self._has_states = self._is_ending = False

    def take_request(self, content: bytes) -> None:
        """Execute a request of the ground: record a bag, report its state, or complete it."""
        request = json.loads(content)
        name, do, key = (str(request[field]) for field in ('name', 'do', 'id'))
        actions = {RECORD: self._record, WATCH: self._watch, FINISH: self._finish}
        if not is_name(name):
            text = f"'{name}' is no valid bag name: use only letters, digits, _, - and ."
            self._report(key, name, FAILED, text)
        elif do not in actions:
            text = (
                f"the drone does not know the request '{do}': install the same version of "
                'aerarm_ros on both hosts'
            )
            self._report(key, name, FAILED, text)
        else:
            self._try(actions[do], name, key)

    def _try(self, action: Callable[[str, str], None], name: str, key: str) -> None:
        """Run an action for a request; report to the ground if the drone rejects the request."""
        try:
            action(name, key)
        except _RejectedError as error:
            self._report(key, name, FAILED, str(error))
        except OSError as error:
            text = f'the folder {self._folder} on the drone cannot be used: {error}'
            self._report(key, name, FAILED, text)

    def fail(self, error: Exception) -> None:
        """Report an error of the recording, and request the recorder to complete its bag."""
        if self._process is not None and self._process.returncode is not None:
            self._process = None
        elif self._is_ending:
            return  # reported before
        self._reason = f'the recording of {self._name} on the drone failed: {error}'
        self._report(self._record_id, self._name, FAILED, self._reason)
        self._ask_to_end()

    def take_question(self, content: bytes) -> None:
        """Store the numbers of the blocks that the ground requests."""
        number, places = questions(content)
        if number in self._served:
            self._places.extend((number, place) for place in places)

    def update(self, now: float, last_received: float) -> None:
        """Check the recorder, and complete the bag after 10 min without datagrams of the ground."""
        if self._process is None:
            return
        if self._process.returncode is not None:
            self._end()
        elif not self._is_ending and 0.0 < now - last_received - _SILENCE_MAX < inf:
            self._reason = (
                f'the drone completed the bag, because the ground was silent for {_SILENCE_MAX:g} s'
            )
            self._node.get_logger().warning(f'bag {self._name}: {self._reason}')
            self._ask_to_end()
        elif now > self._report_due:
            is_recording = self._is_recording()
            self._report_due = now + (2.0 if is_recording else 0.1)
            if is_recording:
                self._report(self._record_id, self._name, RECORDING)

    def send(self, send: Callable[[bytes], bool]) -> bool:
        """Send at most three requested blocks of bags; return whether further blocks are waiting.

        Parameters
        ----------
        send
            Function that sends a datagram and returns whether the socket accepted it.
        """
        for _ in range(_BURST):
            if not self._places:
                return False
            number, place = self._places[0]
            served = self._served.get(number)
            now_ns = time.monotonic_ns()
            try:
                answer = served.server.answer(place) if served is not None else b''
            except (struct.error, IndexError):
                answer = b''
            except BlockingIOError:
                return True  # the disk is busy
            except OSError as error:
                answer = b''
                self._withdraw(number, error)
            if answer:
                datagram = self._connection.single(BLOCKS, answer, now_ns, time.time_ns())
                if not send(datagram):
                    return False  # the next step sends it
            self._places.popleft()
        return bool(self._places)

    def close(self) -> None:
        """Complete the bag of a running recording, and delete the recorder's logs."""
        if self._process is not None:
            self._process.stop()
        for served in self._served.values():
            served.server.close()
        if self._logs is not None:
            shutil.rmtree(self._logs, ignore_errors=True)
        self._status.destroy()

    def _record(self, name: str, key: str) -> None:
        if self._process is not None and name == self._name:
            self._watch(name, key)
            return
        if self._process is not None:
            raise _RejectedError(
                f'the drone is still recording {self._name}: end that recording first'
            )
        bag = self._folder / name
        if bag.exists():
            raise _RejectedError(
                f'the drone already has a bag {name}: choose another name, or fetch that bag with '
                f"'arm fetch {name}'"
            )
        self._logs = self._logs or Path(tempfile.mkdtemp(prefix='aerarm_recordings_'))
        self._folder.mkdir(parents=True, exist_ok=True)
        self._process = NodeProcess(
            'recorder',
            ('--ros-args', '-r', f'__ns:={self._node.get_namespace()}', '--'),
            {'bag': str(bag)},
            log=self._logs / f'{name}.log',
        )
        # The recorder inherits the real-time priority of this process, which would slow the bridge.
        with suppress(OSError):
            os.sched_setscheduler(self._process.pid, os.SCHED_OTHER, os.sched_param(0))
        self._name, self._record_id, self._reason = name, key, ''
        self._has_states = self._is_ending = False
        self._report_due, self._patience = 0.0, inf
        self._node.get_logger().info(f'recording {bag} for the ground')

    def _is_recording(self) -> bool:
        """Return whether the recorder records joint states; it begins 1 to 2 s after its start.

        If no bridge runs, the method returns True after 20 s.
        """
        bag = self._folder / self._name
        message = self._status.take_newest()
        if message is not None and not self._has_states:
            states = self._node.resolve_topic_name(topics.JOINT_STATES.name)
            with suppress(ValueError, LookupError, TypeError):  # another program's message
                status = json.loads(deserialize_message(message[0], String).data)
                self._has_states = status['bag'] == str(bag) and states in status['matched']
        if not (bag / METADATA).is_file():
            return False
        self._patience = min(self._patience, time.monotonic() + _MATCHING_TIME)
        return self._has_states or time.monotonic() > self._patience

    def _watch(self, name: str, key: str) -> None:
        """Schedule a report of a running recording, or report now that the recording has ended."""
        if self._process is not None and name == self._name:
            self._record_id, self._report_due = key, 0.0
            return
        text = self._ended.get(name, 'ground_link on the drone was restarted during the recording')
        self._report_end(name, key, text)

    def _report_end(self, name: str, key: str, text: str) -> None:
        has_bag = (self._folder / name / METADATA).is_file()
        self._report(key, name, ENDED, text, has_bag=has_bag)

    def _finish(self, name: str, key: str) -> None:
        if self._process is None or name != self._name:
            self._offer(name, key)
            return
        if key not in self._finish_ids:
            self._finish_ids.append(key)
        if (self._folder / name / METADATA).is_file():
            self._reason = self._reason or 'a request to fetch the bag ended the recording'
            self._ask_to_end()

    def _ask_to_end(self) -> None:
        """Signal the recorder once to complete its bag; a second signal would kill the recorder."""
        if self._process is not None and not self._is_ending:
            self._is_ending = True
            self._process.ask_to_end()

    def _end(self) -> None:
        assert self._process is not None
        status = self._process.stop()
        words = self._process.tail(1)
        self._process = None
        if status:
            self._reason = f'the recorder on the drone failed (exit status {status}): {words}'
        text = self._reason or f'the recorder on the drone ended without a request: {words}'
        self._node.get_logger().info(f'recording of {self._name} ended: {text}')
        self._ended = {self._name: text}
        self._report_end(self._name, self._record_id, text)
        while self._finish_ids:
            key = self._finish_ids.popleft()
            if status:
                advice = f"run 'arm fetch {self._name}' to fetch the incomplete bag"
                self._report(key, self._name, FAILED, f'{text}; {advice}')
            else:
                self._try(self._offer, self._name, key)

    def _offer(self, name: str, key: str) -> None:
        """Offer a bag to the ground, or reject the request."""
        bag = self._folder / name
        if not (bag / METADATA).is_file():
            raise _RejectedError(f'the drone has no bag {name} in {self._folder}')
        if is_being_written(bag):
            raise _RejectedError(
                f'another recorder on the drone is still recording {name}: end that recorder, then '
                f"run 'arm fetch {name}'"
            )
        number = (self._number + 1) & 0xFFFF
        server = FileServer(bag, number)
        for other, served in list(self._served.items()):
            if served.name == name and served.server.manifest == server.manifest:
                number = other  # a repeated request does not interrupt the fetch
                break
        else:
            self._number = number
            while len(self._served) >= _SERVED_MAX:
                self._served.pop(next(iter(self._served))).server.close()
            self._served[number] = _Served(name, key, server)
        served = self._served[number]
        served.key = key
        self._report(key, name, STORED, number=number, files=served.server.manifest)

    def _withdraw(self, number: int, error: OSError) -> None:
        """Cancel the transfer of a bag, and report to the ground that it is unreadable."""
        served = self._served.pop(number)
        served.server.close()
        self._report(served.key, served.name, FAILED,
                     f'the drone cannot read the bag {served.name}: {error}')  # fmt: skip

    def _report(self, key: str, name: str, state: str, text: str = '', **more: object) -> None:
        content = {'id': key, 'name': name, 'state': state, 'text': text, **more}
        self._connection.send(BAG_REPORTS, json.dumps(content).encode())


@dataclass
class _Served:
    """Bag that the drone offers for transfer, and the identifier of the newest request for it."""

    name: str
    key: str
    server: FileServer


class GroundRecordings:
    """Forward recording requests of nodes on the ground to the drone, and fetch bags.

    Requests and reports are JSON objects on `record_request` and `record_report`. A request
    contains `id`, a text chosen by its sender. A report lists in `ids` the requests that it
    answers.

    Parameters
    ----------
    node
        Owner of subscription and publisher.
    connection
        Connection to the drone.
    values
        Parameters of `ground_link`, of which `fetch_rate` [Mbit/s] limits the transfer.
    """

    def __init__(self, node: Node, connection: Connection, values: SimpleNamespace) -> None:
        self._connection = connection
        self._rate = values.fetch_rate * 1e6 / 8.0 / (BLOCK + 100.0)  # blocks/s
        self._reader = RawReader(node, topics.RECORD_REQUEST.queued(10))
        self._publisher = topics.RECORD_REPORT.publisher(node)
        self._folders: dict[str, Path] = {}  # of requested bags, by request
        self._messages: dict[str, SentMessage] = {}
        self._fetch: Fetch | None = None
        self._fetched, self._number, self._folder = '', -1, Path()
        self._ids: deque[str] = deque(maxlen=_IDS_MAX)
        self._report_due = self._stalled_at = inf

    def update(self, now: float, is_due: bool) -> bool:
        """Forward recording requests and request blocks; return whether to send a datagram soon.

        `is_due` means that the next datagram may be sent now. The method requests blocks only if
        `is_due` is true, because a new block request replaces an unsent one.
        """
        while (message := self._reader.take()) is not None:
            self._take_local(deserialize_message(message[0], String).data, now)
        self._messages = {
            key: message
            for key, message in self._messages.items()
            if not (message.is_confirmed or message.is_expired)
        }
        fetch, connection = self._fetch, self._connection
        if fetch is None:
            return False
        if now > self._report_due:
            self._report_fetch()
        if not connection.is_up(now) or fetch.is_storing:
            self._stalled_at = now + _STALL
        elif now > self._stalled_at:
            # A restarted ground_link on the drone offers no bag before a request.
            self._stalled_at = now + _STALL
            self._forward(FINISH, self._fetched, self._ids[0], now + _START_LIFETIME)
        if not is_due:
            return True
        delay = connection.delay if connection.is_up(now) else inf
        try:
            question = fetch.question(now, delay, connection.round_trip)
        except OSError as error:
            self._fail(f'the folder {self._folder} cannot be used: {error.strerror}')
            return True
        if question is not None:
            connection.set_value(QUESTIONS, question)
        if fetch.is_complete:
            stored, size = fetch.stored, fetch.size
            text = str(self._folder)
            self._end({'state': COMPLETE, 'text': text, 'stored': stored, 'size': size})
        return True

    def take_report(self, content: bytes) -> None:
        """Start, continue or end the transfer of a bag according to a report of the drone."""
        report = json.loads(content)
        key, name, state = (str(report[field]) for field in ('id', 'name', 'state'))
        is_fetched = self._fetch is not None and key in self._ids
        if state == STORED:
            if key in self._folders:
                self._begin(name, key, report)
        elif state == FAILED and is_fetched:
            self._fail(str(report['text']))
        else:
            if state == FAILED:
                self._folders.pop(key, None)
            self._publish([key], {**report, 'text': str(report['text'])})

    def take_block(self, content: bytes) -> None:
        """Store a received block of the bag that is being fetched."""
        if self._fetch is None:
            return
        self._stalled_at = time.monotonic() + _STALL
        try:
            self._fetch.take(content)
        except OSError as error:
            self._fail(f'the folder {self._folder} cannot be used: {error.strerror}')

    def close(self) -> None:
        """Destroy the subscription, and close the incomplete file."""
        if self._fetch is not None:
            self._fetch.close()
        self._reader.destroy()

    def _take_local(self, text: str, now: float) -> None:
        try:
            request = json.loads(text)
            name, do, key = (str(request[field]) for field in ('name', 'do', 'id'))
            folder = Path(request['folder'])
        except (ValueError, LookupError, TypeError, RecursionError):
            return  # a malformed message of another program
        if do == FINISH and self._fetch is not None and self._fetched == name:
            if folder != self._folder:
                text = (
                    f'ground_link is already fetching {name} into {self._folder}: wait until the '
                    'transfer has finished'
                )
                self._publish([key], {'name': name, 'state': FAILED, 'text': text})
                return
            if key not in self._ids:
                self._ids.append(key)
            self._report_fetch()
            return
        if do == FINISH:
            self._folders[key] = folder
            while len(self._folders) > _IDS_MAX:
                del self._folders[next(iter(self._folders))]
        self._publish([key], {'name': name, 'state': REQUESTED, 'text': ''})
        self._forward(do, name, key, inf if do == FINISH else now + _START_LIFETIME)

    def _forward(self, do: str, name: str, key: str, expires: float) -> None:
        """Send a recording request to the drone, unless it was sent and awaits acknowledgement."""
        if key not in self._messages and len(self._messages) < _IDS_MAX:
            content = json.dumps({'do': do, 'name': name, 'id': key}).encode()
            self._messages[key] = self._connection.send(BAG_REQUESTS, content, PROMPT, expires)

    def _begin(self, name: str, key: str, report: dict[str, object]) -> None:
        if self._fetch is not None and name != self._fetched:
            text = f'ground_link first fetches the bag {self._fetched}'
            self._publish([key], {'name': name, 'state': WAITING, 'text': text})
            return
        number = int(str(report['number']))
        if self._fetch is not None:
            if number == self._number:
                return  # the answer to a repeated request
            self._fetch.close()
        else:
            self._ids.clear()
        if key not in self._ids:
            self._ids.append(key)
        self._fetched, self._number, self._folder = name, number, self._folders[key]
        self._report_due, self._stalled_at = 0.0, time.monotonic() + _STALL
        try:
            self._fetch = Fetch(self._folder, number, report.get('files'), self._rate)
        except (OSError, ValueError) as error:
            self._fail(str(error))

    def _fail(self, text: str) -> None:
        self._end({'state': FAILED, 'text': text})

    def _end(self, state: dict[str, object]) -> None:
        if self._fetch is not None:
            self._fetch.close()
        self._fetch = None
        for key in self._ids:
            self._folders.pop(key, None)
        self._publish(list(self._ids), {'name': self._fetched, **state})

    def _report_fetch(self) -> None:
        assert self._fetch is not None
        self._report_due = time.monotonic() + _REPORT_PERIOD
        self._publish(list(self._ids), {
            'name': self._fetched, 'state': FETCHING, 'text': '',
            'stored': self._fetch.stored, 'size': self._fetch.size,
        })  # fmt: skip

    def _publish(self, ids: list[str], state: dict[str, object]) -> None:
        silent = min(time.monotonic() - self._connection.last_received, 1e6)  # JSON has no infinity
        content = {**state, 'ids': ids, 'silent': round(silent, 2)}
        self._publisher.publish(String(data=json.dumps(content)))
