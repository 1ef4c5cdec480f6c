"""Connection over datagrams that sends lost messages again and limits the data rate.

Each message is repeated until the other end acknowledges it, independently of all others. A lost
datagram therefore delays one message of one channel, not the connection. Each datagram repeats
urgent messages until they are acknowledged. A command has a lifetime, because a motion requested
before a loss of connection must not begin after it. A channel can also have a value, of which
only the newest is sent, once and if the rate permits.

The connection has no sockets and no clock: its owner passes datagrams and times.
"""

from __future__ import annotations

import struct
import zlib
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from math import inf
from typing import NamedTuple

from aerarm_ros.link.sealed import OVERHEAD, Session

DATAGRAM_MAX = 1200
"""Largest size of a datagram [bytes]; networks forward this size without fragmentation."""
HEADERS = 42
"""Size of a datagram's Ethernet, IPv4 and UDP headers [bytes], which the rate limit counts."""
SILENCE = 1.0
"""Time without a received datagram [s] after which the connection counts as lost."""

MESSAGE_MAX = 2 * 1024 * 1024
"""Largest size of a message [bytes]."""

URGENT, PROMPT, BULK = range(3)
"""Priorities of messages.

Each datagram repeats `URGENT` messages until they are acknowledged. `PROMPT` messages precede
values, and `BULK` messages use the remaining space of a datagram.
"""

_TIME, _CONFIRMED, _PART, _VALUE = range(4)
_ENTRY = struct.Struct('<BH')  # kind, length
_TIMES = struct.Struct('<qqqq')  # sent, monotonic; sent, system; last received: sent, received
_CONFIRM = struct.Struct('<IQ')  # all parts below a number were received; bits of the next 64
_PART_HEAD = struct.Struct('<IHIHHB')  # number, channel, message, part, parts, flags
_CHANNEL = struct.Struct('<H')
_SPAN = 64  # most parts in transit
_RESERVED = 16  # parts in transit that are reserved for urgent messages
_PART_MAX = DATAGRAM_MAX - OVERHEAD - 2 * _ENTRY.size - _TIMES.size - _CONFIRM.size - 24
VALUE_MAX = _PART_MAX
"""Largest size of a value [bytes]."""
_PACKED, _EXPIRES, _VOID, _LAST = 1, 2, 4, 8
_LATE_MAX = 0.5  # [s] above the usual delay; a command that arrives later is rejected
_DELAY_SPAN = 60.0  # [s] over which the fastest datagram gives the usual delay
_URGENT_EVERY, _AGAIN_MIN = 0.018, 0.1  # [s]
_CLOCK_SPAN = 10.0  # [s] over which the fastest exchange gives the clocks' offset
_BACKLOG, _BACKLOG_BYTES = 2000, 2 * MESSAGE_MAX  # messages
_HELD_MAX, _HELD_PART = 8 * MESSAGE_MAX, 100  # bytes of incomplete messages; overhead per part
_TURNS = 4
_FILL = 0.1  # [s]; unused rate of this time may be used later


class Received(NamedTuple):
    """Message or value that was received on a channel."""

    channel: int
    payload: bytes
    is_value: bool


@dataclass(eq=False)
class SentMessage:
    """Message in the send queue, with its state of delivery.

    Attributes
    ----------
    channel
        Channel, 0 to 65535. Messages with equal channel and priority arrive in order.
    priority
        `URGENT`, `PROMPT` or `BULK`.
    expires
        Time at which the message expires [s, monotonic].
    is_confirmed, is_expired
        Whether the other end has acknowledged the message, or its lifetime ended first.
    """

    channel: int
    payload: bytes
    priority: int = 1
    expires: float = inf
    is_confirmed: bool = False
    is_expired: bool = False
    _sequence: int = -1
    _left: int = 0  # parts that are not acknowledged
    _parts: list[_Part] = field(default_factory=list)

    def void(self) -> None:
        """Drop the message's content, as its lifetime is over or the backlog is full."""
        self.is_expired = True
        self.payload = b''
        for part in self._parts:
            part.flags |= _VOID
            part.content = b''


@dataclass(eq=False)
class _Part:
    message: SentMessage
    index: int
    count: int
    flags: int
    content: bytes
    number: int = -1
    sent: float = -inf

    @property
    def size(self) -> int:
        """Number of bytes that this part needs in a datagram."""
        return _ENTRY.size + _PART_HEAD.size + len(self.content)

    def packed(self) -> bytes:
        """Encode this part of a message as bytes."""
        message = self.message
        head = self.number, message.channel, message._sequence, self.index, self.count, self.flags
        return _PART_HEAD.pack(*head) + self.content


class Traffic:
    """Counters of sent and received datagrams and bytes, including network headers."""

    def __init__(self) -> None:
        self.sent = self.received = self.sent_bytes = self.received_bytes = 0


class Connection:
    """One end of the connection between drone and ground.

    Parameters
    ----------
    key
        Key that both ends share.
    role, other_role
        Roles of this end and of the other end.
    rate
        Largest mean rate of sending, headers included [byte/s].

    Attributes
    ----------
    last_received
        Time of the last authentic datagram [s], -inf before the first.
    round_trip
        Smoothed round-trip time [s], NaN before the first exchange.
    clock_offset
        The other host's system clock minus this one's [s], NaN before the first exchange.
    traffic
        Numbers of bytes and datagrams.
    peers
        Number of times that the other end was found or restarted.
    is_newest
        Whether the datagram that was received last is the newest of the other end, so that its
        address is the current one.
    dropped
        Number of messages that did not fit into the backlog, and of values that did not fit into a
        datagram.
    delay
        Delay of the newest datagram minus the shortest delay of the last minute [s].
    """

    def __init__(self, key: bytes, role: str, other_role: str, rate: float) -> None:
        self.last_received = -inf
        self.round_trip = self.clock_offset = float('nan')
        self.traffic = Traffic()
        self.peers = self.dropped = 0
        self.is_newest = False
        self.delay = 0.0
        self._session = Session(key, role, other_role)
        self._rate = rate
        self._tokens, self._filled = 0.0, -inf
        self._values: dict[int, bytes] = {}
        self._messages: dict[SentMessage, None] = {}
        self._waiting = [deque[_Part]() for _ in range(3)]  # not sent yet, by priority
        self._moving: list[_Part] = []  # sent and not acknowledged
        self._their_times = (0, 0)
        self._least_trip, self._aged = inf, -inf
        self._exchanges: deque[tuple[float, float, float]] = deque()
        self._delays: deque[tuple[float, float]] = deque()
        self._next = self._confirmed_below = 0
        self._received_numbers = (0, 0)
        self._incoming: dict[tuple[int, int], dict[int, tuple[int, bytes]]] = {}
        self._held = 0
        self._expected: dict[int, int] = {}
        self._sequences: dict[int, int] = {}
        self._turn = 0

    # Sending

    def send(
        self, channel: int, payload: bytes, priority: int = PROMPT, expires: float = inf
    ) -> SentMessage:
        """Queue a message and return it, or drop it if it has more than `MESSAGE_MAX` bytes."""
        message = SentMessage(channel, payload, priority, expires)
        if len(payload) > MESSAGE_MAX:
            message.is_expired = True
            self.dropped += 1
            return message
        if len(self._messages) >= _BACKLOG:
            self._drop_oldest()
        self._messages[message] = None
        self._cut(message)
        if len(message._parts) > 1:
            while self._waiting_bytes() > _BACKLOG_BYTES and self._drop_oldest():
                pass
        return message

    def _waiting_bytes(self) -> int:
        return sum(part.size for waiting in self._waiting for part in waiting)

    def _drop_oldest(self) -> bool:
        """Drop the oldest unsent message of the lowest priority; return False if none exists.

        A partly sent message is not dropped, because the other end waits for its other parts.
        """
        for priority in (BULK, PROMPT):
            waiting = self._waiting[priority]
            old = next((part.message for part in waiting if part.message._sequence < 0), None)
            if old is not None:
                self.dropped += 1
                self.withdraw(old)
                return True
        return False

    def withdraw(self, message: SentMessage) -> None:
        """Drop a message, unless some of its parts were already sent."""
        if message in self._messages and message._sequence < 0:
            waiting = self._waiting[message.priority]
            self._waiting[message.priority] = deque(p for p in waiting if p.message is not message)
            message.void()
            del self._messages[message]

    def set_value(self, channel: int, payload: bytes) -> None:
        """Set the next value to send on a channel; drop a value too large for a datagram."""
        if len(payload) > VALUE_MAX:
            self.dropped += 1
        else:
            self._values[channel] = payload

    @property
    def waiting(self) -> int:
        """Number of messages that are not acknowledged yet."""
        return len(self._messages)

    @property
    def has_urgent(self) -> bool:
        """Whether an urgent message is not acknowledged yet."""
        return any(message.priority == URGENT for message in self._messages)

    @property
    def is_joined(self) -> bool:
        """Whether the handshake with the other end was completed once."""
        return self._session.is_joined

    @property
    def answer(self) -> bytes | None:
        """Datagram that answers the last received datagram, None if no answer is due."""
        return self._session.answer

    @property
    def rejected(self) -> int:
        """Number of received datagrams whose authentication with the shared key failed."""
        return self._session.rejected

    def is_up(self, now: float) -> bool:
        """Return whether a datagram was received during the last `SILENCE` seconds."""
        return now - self.last_received < SILENCE

    def datagram(self, now: float, now_ns: int, system_ns: int) -> bytes:
        """Return the next datagram to send.

        `now` [s] and `now_ns` [ns] are the same monotonic time, `system_ns` [ns] the system time.
        """
        if now > self._filled:
            filled = self._tokens + (now - self._filled) * self._rate
            self._tokens, self._filled = min(filled, _FILL * self._rate), now
        self._expire(now)
        sealed = self._session.seal(self._body(now, now_ns, system_ns)) if self.is_joined else None
        datagram = self._counted(sealed or self._session.greeting(now))
        # E-stops are sent at any cost; the debt must not delay later commands.
        self._tokens = max(self._tokens - len(datagram) - HEADERS, -_FILL * self._rate)
        return datagram

    def _body(self, now: float, now_ns: int, system_ns: int) -> bytes:
        their_ns, came_ns = self._their_times
        times = _TIMES.pack(now_ns, system_ns, their_ns, now_ns - came_ns if their_ns else 0)
        body = [_entry(_TIME, times), _entry(_CONFIRMED, _CONFIRM.pack(*self._received_numbers))]
        room = DATAGRAM_MAX - OVERHEAD - sum(map(len, body))
        body += [_entry(kind, content) for kind, content in self._contents(now, room)]
        return b''.join(body)

    def single(self, channel: int, payload: bytes, now_ns: int, system_ns: int) -> bytes:
        """Return a datagram with a single value, which the rate limit does not count.

        Call this method only after the other end has joined.
        """
        body = _entry(_TIME, _TIMES.pack(now_ns, system_ns, 0, 0))
        body += _entry(_VALUE, _CHANNEL.pack(channel) + payload)
        return self._counted(self._session.seal(body))

    def _counted(self, datagram: bytes) -> bytes:
        """Count a datagram in the traffic statistics, and return the datagram."""
        self.traffic.sent += 1
        self.traffic.sent_bytes += len(datagram) + HEADERS
        return datagram

    def _contents(self, now: float, room: int) -> Iterator[tuple[int, bytes]]:
        """Yield the content of the next datagram: parts of messages by priority, and values.

        In every fourth datagram, bulk parts precede values. After a loss of connection, the backlog
        of diagnostics therefore does not delay the states, nor the states the diagnostics.
        """
        may_send = self.is_up(now) and self._tokens > 0.0
        self._turn = (self._turn + 1) % _TURNS
        is_bulk_first = self._turn == 0
        for priority in (URGENT, PROMPT, BULK):
            if priority == URGENT or (may_send and (priority == PROMPT or is_bulk_first)):
                for content in self._parts_due(priority, now, room):
                    room -= _ENTRY.size + len(content)
                    yield _PART, content
        if not may_send:
            return  # A radio out of range must not queue old values.
        for channel, value in list(self._values.items()):
            size = _ENTRY.size + _CHANNEL.size + len(value)
            if size <= room:
                room -= size
                del self._values[channel]
                yield _VALUE, _CHANNEL.pack(channel) + value
        # Without spare tokens the next values would wait.
        if not is_bulk_first and self._tokens > 0.5 * _FILL * self._rate:
            yield from ((_PART, content) for content in self._parts_due(BULK, now, room))

    def _parts_due(self, priority: int, now: float, room: int) -> Iterator[bytes]:
        """Yield the message parts of this priority that are due at `now` and fit into `room`."""
        again = _AGAIN_MIN
        if self.round_trip == self.round_trip:
            again = max(again, 1.5 * self.round_trip + 0.06)
        if priority == URGENT:
            again = _URGENT_EVERY
        for part in self._moving:
            is_due = part.message.priority == priority and now - part.sent >= again
            if is_due and part.size <= room:
                part.sent = now
                room -= part.size
                yield part.packed()
        span = _SPAN if priority == URGENT else _SPAN - _RESERVED
        waiting = self._waiting[priority]
        while waiting and waiting[0].size <= room and self._next - self._confirmed_below < span:
            part = waiting.popleft()
            part.number, part.sent, self._next = self._next, now, self._next + 1
            message = part.message
            if message._sequence < 0:
                message._sequence = self._sequences.get(message.channel, 0)
                self._sequences[message.channel] = message._sequence + 1
            self._moving.append(part)
            room -= part.size
            yield part.packed()

    # Receiving

    def receive(self, datagram: bytes, now: float, now_ns: int, system_ns: int) -> list[Received]:
        """Process a received datagram: return its messages and values, set `is_newest`."""
        opened = self._session.open(datagram, now, self.is_up(now))
        self.is_newest = opened is not None and opened.is_newest
        if self.answer is not None:
            self._counted(self.answer)
        if opened is None:
            return []
        if opened.has_joined:
            self.peers += 1
            self._begin_again()
        self.last_received = now
        self.traffic.received += 1
        self.traffic.received_bytes += len(datagram) + HEADERS
        came: list[Received] = []
        is_late = False
        try:
            for kind, content in _entries(opened.body):
                if kind == _TIME:
                    is_late = self._on_times(_TIMES.unpack(content), now, now_ns, system_ns)
                elif kind == _CONFIRMED:
                    self._on_confirmed(*_CONFIRM.unpack(content))
                elif kind == _PART:
                    came += self._on_part(content, is_late)
                elif kind == _VALUE:
                    (channel,) = _CHANNEL.unpack_from(content)
                    came.append(Received(channel, content[_CHANNEL.size :], True))
        except struct.error:
            pass  # content of another version in an authentic datagram
        return came

    def _on_times(self, times: tuple[int, ...], now: float, now_ns: int, system_ns: int) -> bool:
        """Update round-trip time, clock offset and delay; return whether a datagram was late."""
        sent_ns, their_system_ns, our_ns, held_ns = times
        self._their_times = (sent_ns, now_ns)
        # A longer delay may be permanent, so the least round trip grows with time, but not during
        # a loss of connection.
        step, self._aged = min(now - self._aged, 0.1), now
        self._least_trip += step * _LATE_MAX / _DELAY_SPAN
        is_fresh = False
        if our_ns:
            # The other end received our datagram, held it, and answered.
            round_trip = max(0.0, 1e-9 * (now_ns - our_ns - held_ns))
            self._least_trip = min(self._least_trip, round_trip)
            # After a cut, datagrams from the radio's queue show neither the clocks' offset nor
            # the usual delay, even if all earlier datagrams are older than their span.
            is_fresh = round_trip < self._least_trip + _LATE_MAX
            smooth = self.round_trip
            is_new = smooth != smooth or round_trip < 0.5 * smooth
            self.round_trip = round_trip if is_new else 0.9 * smooth + 0.1 * round_trip
            offset = 1e-9 * (their_system_ns - system_ns) + 0.5 * round_trip
            if is_fresh or not self._exchanges:
                while self._exchanges and now - self._exchanges[0][0] > _CLOCK_SPAN:
                    self._exchanges.popleft()
                self._exchanges.append((now, round_trip, offset))
                self.clock_offset = min(self._exchanges, key=lambda exchange: exchange[1])[2]
        delay = 1e-9 * (now_ns - sent_ns)  # plus a constant: two monotonic clocks
        while is_fresh and self._delays and now - self._delays[0][0] > _DELAY_SPAN:
            self._delays.popleft()
        while self._delays and self._delays[-1][1] >= delay:
            self._delays.pop()
        self._delays.append((now, delay))
        self.delay = delay - self._delays[0][1]
        return self.delay > _LATE_MAX and not is_fresh

    def _on_confirmed(self, base: int, mask: int) -> None:
        self._confirmed_below = max(self._confirmed_below, min(base, self._next))
        left = []
        for part in self._moving:
            ahead = part.number - base
            if ahead >= 0 and not (ahead < _SPAN and mask >> ahead & 1):
                left.append(part)
                continue
            message = part.message
            message._left -= 1
            if not message._left:
                message.is_confirmed = not message.is_expired
                del self._messages[message]
        self._moving = left

    def _on_part(self, content: bytes, is_late: bool) -> list[Received]:
        number, channel, sequence, index, count, flags = _PART_HEAD.unpack_from(content)
        data = content[_PART_HEAD.size :]
        if is_late and flags & _EXPIRES:
            return []  # not acknowledged: sent again, unless its lifetime is over
        base, mask = self._received_numbers
        ahead = number - base
        if ahead < 0 or ahead >= _SPAN or mask >> ahead & 1:
            return []
        cost = len(data) + _HELD_PART
        if index >= count or self._held + cost > _HELD_MAX:
            return []
        mask |= 1 << ahead
        while mask & 1:
            base, mask = base + 1, mask >> 1
        self._received_numbers = base, mask
        parts = self._incoming.setdefault((channel, sequence), {})
        if index in parts:
            return []
        parts[index] = (flags, data)
        self._held += cost
        if len(parts) < count:
            return []
        return self._in_order(channel)

    def _in_order(self, channel: int) -> list[Received]:
        came: list[Received] = []
        while True:
            sequence = self._expected.get(channel, 0)
            parts = self._incoming.get((channel, sequence))
            if parts is None or not self._is_whole(parts):
                return came
            del self._incoming[channel, sequence]
            self._held -= sum(len(data) + _HELD_PART for _, data in parts.values())
            self._expected[channel] = sequence + 1
            payload = _joined(parts)
            if payload is not None:
                came.append(Received(channel, payload, False))

    @staticmethod
    def _is_whole(parts: dict[int, tuple[int, bytes]]) -> bool:
        last = max(parts)
        return len(parts) == last + 1 and bool(parts[last][0] & _LAST)

    # Messages

    def _begin_again(self) -> None:
        """Reset all sequence numbers and requeue all messages, as the other end restarted."""
        self._next = self._confirmed_below = 0
        self._received_numbers = (0, 0)
        self._incoming.clear()
        self._held = 0
        self._expected.clear()
        self._sequences.clear()
        self._moving = []
        for waiting in self._waiting:
            waiting.clear()
        self._messages = {m: None for m in self._messages if not m.is_expired}
        self._their_times = (0, 0)
        self._least_trip = inf
        self._delays.clear()
        self._exchanges.clear()
        for message in self._messages:
            message._sequence = -1
            self._cut(message)

    def _cut(self, message: SentMessage) -> None:
        """Compress a message, split it into parts, and queue the parts."""
        size = len(message.payload)
        packed = zlib.compress(message.payload, 6 if size < 2**16 else 1) if size > 200 else b''
        is_packed = bool(packed) and len(packed) < size
        content = packed if is_packed else message.payload
        flags = _PACKED * is_packed | _EXPIRES * (message.expires < inf)
        pieces = [content[k : k + _PART_MAX] for k in range(0, len(content), _PART_MAX)] or [b'']
        message._parts = [
            _Part(message, k, len(pieces), flags | _LAST * (k == len(pieces) - 1), piece)
            for k, piece in enumerate(pieces)
        ]
        message._left = len(pieces)
        self._waiting[message.priority].extend(message._parts)

    def _expire(self, now: float) -> None:
        """Drop the content of expired messages; only their numbers are still sent."""
        for message in self._messages:
            if message.expires < now and not message.is_expired:
                message.void()


def _entry(kind: int, content: bytes) -> bytes:
    return _ENTRY.pack(kind, len(content)) + content


def _entries(body: bytes) -> Iterator[tuple[int, bytes]]:
    place = 0
    while place < len(body):
        kind, length = _ENTRY.unpack_from(body, place)
        place += _ENTRY.size
        yield kind, body[place : place + length]
        place += length


def _joined(parts: dict[int, tuple[int, bytes]]) -> bytes | None:
    """Join the parts of a message; return None for a dropped or malformed message."""
    if any(flags & _VOID for flags, _ in parts.values()):
        return None
    payload = b''.join(parts[index][1] for index in sorted(parts))
    if not parts[0][0] & _PACKED:
        return payload
    unpacker = zlib.decompressobj()
    try:
        payload = unpacker.decompress(payload, MESSAGE_MAX)
    except zlib.error:
        return None
    return payload if unpacker.eof else None
