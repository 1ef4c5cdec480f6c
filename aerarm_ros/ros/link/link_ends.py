"""The two processes of `ground_link`, on the drone and on the ground computer."""

from __future__ import annotations

import contextlib
import select
import socket
import struct
import time
import zlib
from collections import deque
from collections.abc import Callable
from math import inf, isfinite, isnan
from types import SimpleNamespace

from rclpy.node import Node
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from aerarm_msgs_py import topics
from aerarm_msgs_py.topics import Topic
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.link.connection import Connection, Received
from aerarm_ros.link.sealed import looks_sealed
from aerarm_ros.ros.diagnostics import PERIOD, DiagnosticsPublisher
from aerarm_ros.ros.graph import DuplicatePublisherCheck, endpoint_name
from aerarm_ros.ros.link.recordings import (
    BAG_REPORTS,
    BAG_REQUESTS,
    BLOCKS,
    QUESTIONS,
    DroneRecordings,
    GroundRecordings,
)
from aerarm_ros.ros.link.relayed_services import DroneServices, GroundServices
from aerarm_ros.ros.link.relayed_topics import (
    CALLS,
    OFFERED,
    RESULTS,
    STOP_RESULTS,
    STOPS,
    DroneTopics,
    GroundTopics,
)

CONTINUE, STOP, HOME = 'continue', 'stop', 'home'


class GroundWatchdog:
    """Stop the arm or move it home if no datagrams arrive from the ground computer.

    Each action is one message on one topic, because a controller may process messages of two topics
    in any order. A controller that receives a set point during a motion first stops on its path.

    Parameters
    ----------
    node
        Owner of the publishers.
    values
        `ground_timeout` [s], 0 for no action; `ground_lost`; `config` and `tf_prefix` of the arm.

    Attributes
    ----------
    problem
        Description of the last action; empty while the ground computer is connected.
    """

    def __init__(self, node: Node, values: SimpleNamespace) -> None:
        self.problem = ''
        self._node = node
        self._timeout, self._action = values.ground_timeout, values.ground_lost
        config = load_arm_config(values.config or None)
        self._home = JointState(
            name=[f'{values.tf_prefix}{name}' for name in config.joint_names],
            position=[float(angle) for angle in config.rest_position],
        )
        self._topic: Topic = topics.SET_POINT if self._action == HOME else topics.JOINT_TRAJECTORY
        self._requests = self._topic.publisher(node)

    @property
    def text(self) -> str:
        """Action of the watchdog and its timeout, for diagnostics."""
        if not self._timeout:
            return CONTINUE
        return f'{self._action} after {self._timeout:g} s'

    def update(self, now: float, last_received: float) -> None:
        """If the connection is lost at the time `now` [s], stop the arm or move it home once.

        Before the ground has connected once, the watchdog does not act.
        """
        is_lost = 0.0 < self._timeout < now - last_received < inf
        if not is_lost:
            self.problem = ''
        elif not self.problem:
            self.problem = f'the ground is silent: {self._act()}'
            self._node.get_logger().warning(self.problem)

    def warning(self) -> str:
        """Return a warning if a controller does not subscribe to the watchdog's message, or ''."""
        names = self._ignorant()
        if not names:
            return ''
        return (
            f"ground_lost is '{self._action}', but {names} does not subscribe to "
            f'{self._topic.name}: run computed_torque or gravity_compensation, or set '
            f'ground_lost:={CONTINUE}'
        )

    def _act(self) -> str:
        if self._action == CONTINUE:
            return 'the motion continues'
        self._requests.publish(self._home if self._action == HOME else JointTrajectory())
        names = self._ignorant()
        if names:
            return f'the motion continues, because {names} does not subscribe to {self._topic.name}'
        if self._action == HOME:
            return 'the arm returns to its home configuration'
        return 'the motion stops along its path'

    def _ignorant(self) -> str:
        """Return the nodes that command the arm but do not subscribe to the watchdog's message."""
        if not self._timeout or self._action == CONTINUE:
            return ''
        commands = self._node.resolve_topic_name(topics.JOINT_COMMAND.name)
        requests = self._node.resolve_topic_name(self._topic.name)
        controllers = map(endpoint_name, self._node.get_publishers_info_by_topic(commands))
        receivers = map(endpoint_name, self._node.get_subscriptions_info_by_topic(requests))
        return ' and '.join(sorted({*controllers} - {*receivers, ''}))


DRONE, GROUND = 'drone', 'ground'

_TICK = 0.02  # [s] for at most 50 datagrams per second from each end
_GROUND_TICK = 0.04  # [s] while the ground sends acknowledgements only
_CUT_TICK = 0.1  # [s] while the connection is lost
_POLL = 0.005  # [s] between two checks for requests on the ground
_RATES = {DRONE: 26_000.0, GROUND: 9_000.0}  # bytes/s: 0.28 Mbit/s in total
_BUFFER = 8192  # bytes; a slow radio must not queue old datagrams
_CLOCK_MAX = 0.02  # [s] offset of the clocks, above which the link warns
# [s] Shortest interruption that the link reports. At 20 % loss, single lost datagrams do not cause
# an interruption of this length.
_CUT_MIN = 0.4
_DATAGRAM_MAX = 2048
_STOP_CHANNELS = (STOPS, STOP_RESULTS)
_JOINS, _JOINS_TIME = 3, 10.0  # so many connections within so many seconds show several grounds
_DATAGRAMS_MAX = 64  # received in one step, so that a flood does not keep this end from sending
# Exceptions caused by messages of another version of `ground_link`, or by a full disk.
_MALFORMED = (
    *(OSError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError),
    *(RuntimeError, struct.error, zlib.error),  # errors of rclpy are RuntimeErrors
)
_Address = tuple[str, int]


class LinkEnd:
    """Base class of the `ground_link` processes on the drone and on the ground computer.

    Parameters
    ----------
    node
        Owner of all ROS entities.
    values
        Parameters of `ground_link`.
    key
        Key that both ends share.
    """

    role = ''
    other = ''
    _topics: DroneTopics | GroundTopics
    _services: DroneServices | GroundServices
    _recordings: DroneRecordings | GroundRecordings
    _takers: dict[int, Callable[[bytes], None]]  # of channels that are not topics

    def __init__(self, node: Node, values: SimpleNamespace, key: bytes) -> None:
        self._node = node
        self._values = values
        self.connection = Connection(key, self.role, self.other, _RATES[self.role])
        self._diagnostics = DiagnosticsPublisher(node)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER)
        self._address: _Address | None = None
        self._sent = self._reported = -inf
        self._was_up = False
        self._key_problem = ''
        self._away = 0.0  # [s] length of the last interruption
        self._peers = 0
        self._joins: deque[float] = deque(maxlen=_JOINS)
        self._counted = (0, 0)
        self._malformed = 0
        self._refused = 0  # datagrams that the radio rejected
        self._only_host = ''  # address of the only accepted sender; any if empty
        self._stranger = ''  # address of a datagram that was ignored since the last report

    def step(self) -> None:
        """Wait at most 5 ms for datagrams, process them, and send a datagram periodically."""
        with contextlib.suppress(InterruptedError):
            select.select([self._socket], [], [], _POLL)
        before = self.connection.last_received
        # E-stops first, so that none waits for the publishing of other messages.
        for received in sorted(self._receive(), key=lambda r: r.channel not in _STOP_CHANNELS):
            try:
                self._take(received)
            except _MALFORMED as error:
                self._note_malformed(received, error)
        now = time.monotonic()
        if self.connection.last_received != before:
            self._note_return(before, now)
        if self.connection.peers != self._peers:
            self._peers = self.connection.peers
            self._joins.append(now)
            self._greet()
        is_prompt = self._update(now)
        if now - self._sent >= self._interval(now, is_prompt) and self._address is not None:
            self._send(now)
        if now - self._reported >= PERIOD:
            self._report(now)

    def close(self) -> None:
        """Complete the bag of a running recording, close the socket, and destroy subscriptions."""
        self._recordings.close()
        self._topics.destroy()
        self._socket.close()

    def _take(self, received: Received) -> None:
        taker = self._takers.get(received.channel)
        if taker is not None:
            taker(received.payload)
        else:
            self._topics.publish(received.channel, received.payload)

    # Methods that the ends override.

    def _update(self, now: float) -> bool:
        """Update relays and watchdog at `now` [s]; return whether to send a datagram soon."""
        raise NotImplementedError

    def _problem(self, now: float) -> str:
        raise NotImplementedError

    def _rows(self) -> dict[str, object]:
        raise NotImplementedError

    def _greet(self) -> None:
        """Send latched messages and services, because the other end has just started."""
        self._node.get_logger().info(f'the {self.other} is connected')
        self._services.greet()

    def _on_rejected(self, datagram: bytes, address: _Address) -> None:
        """Process a datagram that was not authentic."""

    def _interval(self, now: float, is_prompt: bool) -> float:
        if self.connection.has_urgent:
            return _TICK
        if not self.connection.is_up(now):
            return _CUT_TICK
        if self.role == DRONE or is_prompt or self.connection.waiting:
            return _TICK
        return _GROUND_TICK

    # Common methods.

    def _receive(self) -> list[Received]:
        came: list[Received] = []
        for _ in range(_DATAGRAMS_MAX):
            try:
                datagram, address = self._socket.recvfrom(_DATAGRAM_MAX)
            except OSError:  # no more data, or the other end has not started yet
                return came
            if self._only_host not in ('', address[0]):
                self._stranger = address[0]
                continue
            now_ns = time.monotonic_ns()
            connection = self.connection
            rejected = connection.rejected
            came += connection.receive(datagram, 1e-9 * now_ns, now_ns, time.time_ns())
            if connection.answer is not None:
                self._send_datagram(connection.answer, address)
            elif connection.rejected != rejected:
                self._on_rejected(datagram, address)
            elif connection.is_newest and self.role == DRONE:
                self._address = address
        return came

    def _send(self, now: float) -> None:
        self._sent = now
        now_ns = time.monotonic_ns()
        self._send_datagram(self.connection.datagram(1e-9 * now_ns, now_ns, time.time_ns()))

    def _send_datagram(self, datagram: bytes, address: _Address | None = None) -> bool:
        """Send a datagram, by default to the other end; return whether the socket accepted it."""
        address = address or self._address
        assert address is not None
        try:
            self._socket.sendto(datagram, address)
        except OSError:  # the radio's queue is full, or the radio is gone
            self._refused += 1
            return False
        return True

    def _note_malformed(self, received: Received, error: Exception) -> None:
        self._malformed += 1
        if self._malformed == 1:
            self._node.get_logger().warning(
                f'this host cannot decode channel {received.channel} of the {self.other} '
                f'({error!r}): install the same version of aerarm_ros on both hosts'
            )

    def _note_return(self, before: float, now: float) -> None:
        self._was_up = True
        self._key_problem = ''
        silent = now - before
        if _CUT_MIN < silent < inf:
            self._away = silent
            self._node.get_logger().info(f'the {self.other} is back after {silent:.2f} s')

    def _report(self, now: float) -> None:
        elapsed, self._reported = now - self._reported, now
        connection = self.connection
        if self._was_up and not connection.is_up(now):
            self._was_up = False
            self._node.get_logger().warning(f'the {self.other} is silent')
        traffic = connection.traffic
        counted = traffic.sent_bytes + traffic.received_bytes, traffic.sent + traffic.received
        rates = [(n - m) / elapsed for n, m in zip(counted, self._counted, strict=True)]
        self._counted = counted
        silent = now - connection.last_received
        rows: dict[str, object] = {
            'silent [s]': f'{silent:.2f}' if isfinite(silent) else 'never received',
            'last cut [s]': f'{self._away:.2f}',
            'round trip [ms]': f'{1e3 * connection.round_trip:.1f}',
            'clock offset [ms]': f'{1e3 * connection.clock_offset:.1f}',
            'traffic [kbit/s]': f'{8e-3 * rates[0]:.0f}',
            'packets [1/s]': f'{rates[1]:.0f}',
            'messages waiting': connection.waiting,
            'messages dropped': connection.dropped,
            'messages not understood': self._malformed,
            'datagrams rejected': connection.rejected,
            'datagrams refused by the interface': self._refused,
            **self._rows(),
        }
        problems = filter(None, (self._problem(now), self._usual_problem(now)))
        # The drone's status arrives on the ground too, and must not replace the ground's.
        self._diagnostics.report('; '.join(problems), rows, f'{self.role} side')
        self._stranger = ''

    def _usual_problem(self, now: float) -> str:
        connection = self.connection
        if self._stranger and not connection.is_up(now):
            return (
                f'ground_link ignores datagrams from {self._stranger}, because the parameter '
                f'{self.other} is {self._only_host}: set {self.other}:={self._stranger}, or leave '
                'the parameter empty'
            )
        if self._key_problem:
            return self._key_problem
        if len(self._joins) == _JOINS and now - self._joins[0] < _JOINS_TIME:
            return (
                f'the {self.other} connected {_JOINS} times within {_JOINS_TIME:g} s: run '
                'ground_link on one ground computer only'
            )
        if not connection.is_joined:
            return (
                f'no {self.other} found: check that ground_link runs there with the same key file'
            )
        if not connection.is_up(now):
            return f'the {self.other} has been silent for {now - connection.last_received:.1f} s'
        offset = connection.clock_offset
        if not isnan(offset) and abs(offset) > _CLOCK_MAX:
            side = 'ahead of' if offset > 0.0 else 'behind'
            return (
                f"the {self.other}'s clock is {1e3 * abs(offset):.0f} ms {side} this host's clock: "
                'run chrony or PTP on both hosts before you compare message stamps'
            )
        return ''


class DroneEnd(LinkEnd):
    """Process of `ground_link` on the drone, which serves one ground computer."""

    role, other = DRONE, GROUND
    _topics: DroneTopics
    _services: DroneServices
    _recordings: DroneRecordings

    def __init__(self, node: Node, values: SimpleNamespace, key: bytes) -> None:
        super().__init__(node, values, key)
        try:
            self._socket.bind((values.address, values.port))
        except OSError as error:
            raise ValueError(
                f'UDP port {values.port} of {values.address} cannot be opened ({error.strerror}): '
                'stop the other ground_link of this host, or set another port or address'
            ) from None
        self._only_host = _ip_address(GROUND, values.ground) if values.ground else ''
        self._topics = DroneTopics(node, self.connection, values.rate, values.values_rate)
        self._services = DroneServices(node, self.connection)
        self._watchdog = GroundWatchdog(node, values)
        self._recordings = DroneRecordings(node, self.connection, values)
        self._ticked = -inf
        self._takers = {
            CALLS: lambda content: self._services.call(content, time.monotonic(), False),
            STOPS: lambda content: self._services.call(content, time.monotonic(), True),
            BAG_REQUESTS: self._recordings.take_request,
            QUESTIONS: self._recordings.take_question,
        }

    def _on_rejected(self, datagram: bytes, address: _Address) -> None:
        """Warn if no connection exists and the sender of a datagram uses another key."""
        is_up = self.connection.is_up(time.monotonic())
        if self._key_problem or is_up or not looks_sealed(datagram):
            return
        self._key_problem = (
            f'the key of {address[0]} differs from the key of this host '
            f"({self._values.key_file}): copy the drone's key file to the ground, use the same "
            'version of aerarm_ros on both hosts, and restart ground_link'
        )
        self._node.get_logger().warning(self._key_problem)

    def _update(self, now: float) -> bool:
        if now - self._ticked >= _TICK:
            self._ticked = max(self._ticked + _TICK, now - _TICK)
            self._services.update(now)  # first, for the answers to e-stops
            try:
                self._topics.update(now)
            except _MALFORMED as error:  # a message of another program must not block e-stops
                text = f'a message could not be relayed: {error}'
                self._node.get_logger().error(text, throttle_duration_sec=5.0)
            self._watchdog.update(now, self.connection.last_received)
            try:
                self._recordings.update(now, self.connection.last_received)
            except _MALFORMED as error:  # a full disk, for example, must not block e-stops
                self._recordings.fail(error)
        if self._address is not None:
            self._recordings.send(self._send_datagram)
        return False

    def _greet(self) -> None:
        super()._greet()
        self._topics.greet()

    def _problem(self, now: float) -> str:
        own = self._watchdog.problem or self._watchdog.warning(), self._topics.problem(now)
        return '; '.join(filter(None, own))

    def _rows(self) -> dict[str, object]:
        return {'if the ground is lost': self._watchdog.text}


class GroundEnd(LinkEnd):
    """Process of `ground_link` on the ground computer, which connects to one drone."""

    role, other = GROUND, DRONE
    _topics: GroundTopics
    _services: GroundServices
    _recordings: GroundRecordings

    def __init__(self, node: Node, values: SimpleNamespace, key: bytes) -> None:
        super().__init__(node, values, key)
        if not values.drone:
            raise ValueError(
                'the parameter drone (address of the drone) is empty: set -p drone:=ADDRESS, for '
                'example drone:="\'10.0.0.2\'"'
            )
        self._address = _ip_address(DRONE, values.drone), values.port
        node.get_logger().info(
            f'looking for the drone at {":".join(map(str, self._address))} (UDP)'
        )
        self._expired = 0
        self._topics = GroundTopics(node, self.connection, self._note_expired)
        self._services = GroundServices(node, self.connection, self._log)
        self._recordings = GroundRecordings(node, self.connection, values)
        self._sole = DuplicatePublisherCheck(node, topics.JOINT_STATES)
        self._commands = node.resolve_topic_name(topics.JOINT_COMMAND.name)
        self._takers = {
            BAG_REPORTS: self._recordings.take_report,
            BLOCKS: self._recordings.take_block,
            OFFERED: self._services.take_offered,
            **dict.fromkeys(
                (RESULTS, STOP_RESULTS),
                lambda content: self._services.take_result(content, time.monotonic()),
            ),
        }

    def _update(self, now: float) -> bool:
        has_called = self._services.update(now)
        has_asked = self._recordings.update(now, now - self._sent >= _TICK)
        return self._topics.update(now) or has_called or has_asked

    def _problem(self, now: float) -> str:
        kept = self._services.kept_stops
        if kept:
            return f'the drone has NOT CONFIRMED the e-stop yet: {" and ".join(kept)}'
        return self._sole.problem() or self._remote_controllers()

    def _remote_controllers(self) -> str:
        """Return a warning about controllers on this host, because the link relays no commands."""
        ends = self._node.get_publishers_info_by_topic(self._commands)
        names = {endpoint_name(end) for end in ends} - {'', self._node.get_fully_qualified_name()}
        if not names:
            return ''
        return (
            f'{" and ".join(sorted(names))} cannot command the arm from this host: ground_link '
            'does not relay joint_command, because a late command damps the arm. Run the '
            'controller on the drone, or set AERARM_NETWORK=open on both hosts'
        )

    def _rows(self) -> dict[str, object]:
        return {
            'e-stops not confirmed': ' '.join(self._services.kept_stops) or 'none',
            'commands not delivered in time': self._expired,
        }

    def _note_expired(self, topic: str) -> None:
        self._expired += 1
        self._log(True, f'a command on {topic} did not reach the drone in time: send it again')

    def _log(self, is_warning: bool, text: str) -> None:
        # rclpy fixes the severity of each line of code that logs.
        if is_warning:
            self._node.get_logger().warning(text)
        else:
            self._node.get_logger().info(text)


def _ip_address(role: str, host: str) -> str:
    try:
        return socket.gethostbyname(host)
    except OSError as error:
        raise ValueError(
            f"the host name '{host}' in the parameter {role} is unknown ({error.strerror}): use "
            'an IP address'
        ) from None
