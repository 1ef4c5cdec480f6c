"""A connection over datagrams: messages without loss, newest values, a limited rate.

Each message is repeated until the other end acknowledges it, independently of all others. So a
lost datagram delays one message of one channel, not the connection. Each datagram repeats urgent
messages until they are acknowledged. A command has a lifetime, because a motion requested before a
loss of connection must not begin after it. Values are sent once, the newest first, as far as the
rate allows.

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

from aerarm_ros.link.sealed import NO_SESSION, OVERHEAD, Session

DATAGRAM_MAX = 1200
"""Bytes of a datagram: below any usual MTU, with room for a tunnel's headers."""
HEADERS = 42
"""Bytes of the headers of Ethernet, IPv4 and UDP, which count in the rate."""
SILENCE = 1.0
"""[s] without a datagram, after which the connection counts as lost."""

URGENT, PROMPT, BULK = range(3)
"""Priorities of messages: in each datagram until acknowledged, soon, or if there is room."""

_TIME, _CONFIRMED, _PART, _VALUE = range(4)
_ENTRY = struct.Struct('<BH')  # kind, length
_TIMES = struct.Struct('<qqqq')  # sent, monotonic; sent, system; last received: sent, received
_CONFIRM = struct.Struct('<IQ')  # all below this number, and which of the following 64
_PART_HEAD = struct.Struct('<IHIBBB')  # number, channel, message, part, parts, flags
_CHANNEL = struct.Struct('<H')
_SPAN = 64  # parts in transit
_RESERVED = 16  # of those, for urgent ones
_PART_MAX = DATAGRAM_MAX - OVERHEAD - 2 * _ENTRY.size - _TIMES.size - _CONFIRM.size - 24
_PACKED, _EXPIRES, _VOID, _LAST = 1, 2, 4, 8
_LATE_MAX = 0.5  # [s]; a command that was in transit for so much longer than usual is rejected
_URGENT_EVERY, _AGAIN_MIN = 0.018, 0.1  # [s]
_CLOCK_SPAN = 10.0  # [s] over which the fastest exchange gives the clocks' offset
_BACKLOG = 2000  # messages
_TURNS = 4
_FILL = 0.1  # [s] of the rate that may be saved up


class Received(NamedTuple):
    """A received message, or the value of a channel."""

    channel: int
    payload: bytes
    is_value: bool


@dataclass(eq=False)
class Message:
    """A message in transit.

    Attributes
    ----------
    channel
        Its channel, 0 to 65535; messages of a channel arrive in order.
    priority
        `URGENT`, `PROMPT` or `BULK`.
    expires
        Time at which the message expires [s, monotonic].
    is_confirmed, is_expired
        Whether it was acknowledged, or its lifetime ended first.
    """

    channel: int
    payload: bytes
    priority: int = 1
    expires: float = inf
    is_confirmed: bool = False
    is_expired: bool = False
    _parts: list[_Part] = field(default_factory=list)


@dataclass(eq=False)
class _Part:
    message: Message
    sequence: int
    index: int
    count: int
    flags: int
    content: bytes
    number: int = -1
    sent: float = -inf

    @property
    def size(self) -> int:
        """Bytes in a datagram."""
        return _ENTRY.size + _PART_HEAD.size + len(self.content)

    def packed(self) -> bytes:
        """Return the part as bytes."""
        head = self.number, self.message.channel, self.sequence, self.index, self.count, self.flags
        return _PART_HEAD.pack(*head) + self.content


class Traffic:
    """Bytes and datagrams since the start, headers included."""

    def __init__(self) -> None:
        self.sent = self.received = self.sent_bytes = self.received_bytes = 0


class Connection:
    """One end of the connection.

    Parameters
    ----------
    key
        Shared key.
    role, other_role
        Roles of this end and of the other end.
    rate
        Mean rate of sending, headers included [byte/s].

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
    greets
        Number of authentic datagrams from an end that has not received this end's session number
        yet.
    dropped
        Number of messages that did not fit into the backlog.
    delay
        By which the newest datagram was slower than the quickest of the last minute [s].
    """

    def __init__(self, key: bytes, role: str, other_role: str, rate: float) -> None:
        self.last_received = -inf
        self.round_trip = self.clock_offset = float('nan')
        self.traffic = Traffic()
        self.peers = self.greets = 0
        self.dropped = 0
        self.delay = 0.0
        self._session = Session(key, role)
        self._other_role = other_role
        self._peer = NO_SESSION
        self._former: set[bytes] = set()
        self._rate = rate
        self._tokens, self._filled = 0.0, -inf
        self._values: dict[int, bytes] = {}
        self._messages: deque[Message] = deque()
        self._greet: bytes | None = None
        self._their_times = (0, 0)
        self._exchanges: deque[tuple[float, float, float]] = deque()
        self._delays: deque[tuple[float, float]] = deque()
        self._next = self._confirmed_below = 0
        self._received_numbers = (0, 0)
        self._incoming: dict[tuple[int, int], dict[int, tuple[int, bytes]]] = {}
        self._expected: dict[int, int] = {}
        self._sequences: dict[int, int] = {}
        self._parts: list[_Part] = []
        self._turn = 0

    # Sending

    def send(
        self, channel: int, payload: bytes, priority: int = PROMPT, expires: float = inf
    ) -> Message:
        """Queue a message and return it."""
        message = Message(channel, payload, priority, expires)
        if len(self._messages) >= _BACKLOG:
            self._drop_oldest()
        self._messages.append(message)
        self._cut(message)
        return message

    def _drop_oldest(self) -> None:
        """Drop the oldest message that is least urgent.

        While the other end is present, the numbers of the message must still arrive, so only its
        content is dropped. After a long silence both ends begin again, with the messages left.
        """
        if self.is_joined and not self.is_up(self._filled):
            self._session.renew()
            self._former.clear()
            self._peer = NO_SESSION
            self._begin_again()
        droppable = (m for m in self._messages if m.priority != URGENT and m.expires > -inf)
        old = max(droppable, key=lambda m: m.priority, default=None)
        if old is None:
            return
        old.expires = -inf
        self.dropped += 1
        if not self.is_joined:
            old.is_expired = True
            self._messages.remove(old)
            self._parts = [part for part in self._parts if part.message is not old]

    def set_value(self, channel: int, payload: bytes) -> None:
        """Replace the value of a channel; it is sent once."""
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
        """Whether the other end was found."""
        return self._peer != NO_SESSION

    def is_up(self, now: float) -> bool:
        """Return whether a datagram arrived within `SILENCE`."""
        return now - self.last_received < SILENCE

    def datagram(self, now: float, now_ns: int, system_ns: int) -> bytes:
        """Return the datagram to send at `now` [s]; `now_ns` is the same time [ns]."""
        if now > self._filled:
            filled = self._tokens + (now - self._filled) * self._rate
            self._tokens, self._filled = min(filled, _FILL * self._rate), now
        self._expire(now)
        their_ns, came_ns = self._their_times
        times = _TIMES.pack(now_ns, system_ns, their_ns, now_ns - came_ns if their_ns else 0)
        body = [_entry(_TIME, times)]
        to, self._greet = self._greet or self._peer, None
        # A session that has only sent a greeting receives only a greeting.
        if to == self._peer and self.is_joined:
            body.append(_entry(_CONFIRMED, _CONFIRM.pack(*self._received_numbers)))
            room = DATAGRAM_MAX - OVERHEAD - sum(map(len, body))
            for kind, content in self._contents(now, room):
                body.append(_entry(kind, content))
        datagram = self._session.seal(to, b''.join(body))
        self._tokens -= len(datagram) + HEADERS
        self.traffic.sent += 1
        self.traffic.sent_bytes += len(datagram) + HEADERS
        return datagram

    def single(self, channel: int, payload: bytes, now_ns: int, system_ns: int) -> bytes:
        """Return a datagram with one value and nothing else, outside the bounded rate."""
        body = _entry(_TIME, _TIMES.pack(now_ns, system_ns, 0, 0))
        body += _entry(_VALUE, _CHANNEL.pack(channel) + payload)
        datagram = self._session.seal(self._peer, body)
        self.traffic.sent += 1
        self.traffic.sent_bytes += len(datagram) + HEADERS
        return datagram

    def _contents(self, now: float, room: int) -> Iterator[tuple[int, bytes]]:
        """Yield what fits: urgent parts, prompt parts that are due, values, then bulk.

        In every fourth datagram bulk comes before values, so that neither starves: after a cut the
        backlog of diagnostics must not hold up states, nor many states the diagnostics.
        """
        may_send = self.is_up(now) and self._tokens > 0.0
        self._turn = (self._turn + 1) % _TURNS
        order = sorted(self._parts, key=lambda part: part.message.priority)
        is_bulk_first = self._turn == 0
        for part in order:
            if part.message.priority == BULK and not is_bulk_first:
                continue
            if (part.message.priority == URGENT or may_send) and self._is_due(part, now, room):
                room -= part.size
                yield _PART, self._numbered(part, now)
        if not may_send:
            return  # A radio out of range must not queue old values.
        for channel, value in list(self._values.items()):
            size = _ENTRY.size + _CHANNEL.size + len(value)
            if size <= room:
                room -= size
                del self._values[channel]
                yield _VALUE, _CHANNEL.pack(channel) + value
        has_spare = self._tokens > 0.5 * _FILL * self._rate  # else the next values would wait
        for part in order:
            is_bulk = part.message.priority == BULK
            if has_spare and is_bulk and self._is_due(part, now, room):
                room -= part.size
                yield _PART, self._numbered(part, now)

    def _is_due(self, part: _Part, now: float, room: int) -> bool:
        """Tell whether a part fits, has a number or may get one, and is not under way."""
        is_urgent = part.message.priority == URGENT
        span = _SPAN if is_urgent else _SPAN - _RESERVED
        is_held = part.number < 0 and self._next - self._confirmed_below >= span
        again = _AGAIN_MIN
        if self.round_trip == self.round_trip:
            again = max(again, 1.5 * self.round_trip + 0.06)
        is_early = now - part.sent < (_URGENT_EVERY if is_urgent else again)
        return part.size <= room and not is_held and not is_early

    def _numbered(self, part: _Part, now: float) -> bytes:
        """Return a part that is sent now."""
        if part.number < 0:
            part.number, self._next = self._next, self._next + 1
        part.sent = now
        return part.packed()

    # Receiving

    def receive(self, datagram: bytes, now: float, now_ns: int, system_ns: int) -> list[Received]:
        """Process a datagram and return its contents in order."""
        opened = self._session.open(datagram, self._other_role)
        if opened is None:
            return []
        session, to, body = opened
        if to != self._session.own:
            self._greet = session  # one of the two ends restarted
            self.greets += 1
            return []
        if session != self._peer:
            if session in self._former:
                # The other end kept its numbers, so both ends must begin again.
                self._session.renew()
                self._former.clear()
            if self.is_joined:
                self._former.add(self._peer)
            self._peer = session
            self.peers += 1
            self._begin_again()
        self.last_received = now
        self.traffic.received += 1
        self.traffic.received_bytes += len(datagram) + HEADERS
        came: list[Received] = []
        is_late = False
        try:
            for kind, content in _entries(body):
                if kind == _TIME:
                    is_late = self._on_times(_TIMES.unpack(content), now, now_ns, system_ns)
                elif kind == _CONFIRMED:
                    self._on_confirmed(*_CONFIRM.unpack(content))
                elif kind == _PART:
                    came += self._on_part(content, is_late)
                elif kind == _VALUE:
                    (channel,) = _CHANNEL.unpack_from(content)
                    came.append(Received(channel, content[_CHANNEL.size :], True))
        except (struct.error, zlib.error):
            pass  # content of another version in an authentic datagram
        return came

    def _on_times(self, times: tuple[int, ...], now: float, now_ns: int, system_ns: int) -> bool:
        """Process the times of clocks and delays; return whether the datagram was late."""
        sent_ns, their_system_ns, our_ns, held_ns = times
        self._their_times = (sent_ns, now_ns)
        if our_ns:
            # The other end received our datagram, held it, and answered.
            round_trip = 1e-9 * (now_ns - our_ns - held_ns)
            smooth = self.round_trip
            self.round_trip = round_trip if smooth != smooth else 0.9 * smooth + 0.1 * round_trip
            offset = 1e-9 * (their_system_ns - system_ns) + 0.5 * round_trip
            while self._exchanges and now - self._exchanges[0][0] > _CLOCK_SPAN:
                self._exchanges.popleft()
            self._exchanges.append((now, round_trip, offset))
            self.clock_offset = min(self._exchanges, key=lambda exchange: exchange[1])[2]
        delay = 1e-9 * (now_ns - sent_ns)  # plus a constant: two monotonic clocks
        while self._delays and now - self._delays[0][0] > 60.0:
            self._delays.popleft()
        while self._delays and self._delays[-1][1] >= delay:
            self._delays.pop()
        self._delays.append((now, delay))
        self.delay = delay - self._delays[0][1]
        return self.delay > _LATE_MAX

    def _on_confirmed(self, base: int, mask: int) -> None:
        self._confirmed_below = max(self._confirmed_below, base)
        left = []
        for part in self._parts:
            ahead = part.number - base
            if part.number >= 0 and (ahead < 0 or (ahead < _SPAN and mask >> ahead & 1)):
                part.message._parts.remove(part)
                if not part.message._parts and not part.message.is_expired:
                    part.message.is_confirmed = True
            else:
                left.append(part)
        if len(left) != len(self._parts):
            self._parts = left
            self._messages = deque(message for message in self._messages if message._parts)

    def _on_part(self, content: bytes, is_late: bool) -> list[Received]:
        number, channel, sequence, index, count, flags = _PART_HEAD.unpack_from(content)
        data = content[_PART_HEAD.size :]
        if is_late and flags & _EXPIRES:
            return []  # not acknowledged: sent again, unless its lifetime is over
        base, mask = self._received_numbers
        ahead = number - base
        if ahead < 0 or ahead >= _SPAN or mask >> ahead & 1:
            return []
        mask |= 1 << ahead
        while mask & 1:
            base, mask = base + 1, mask >> 1
        self._received_numbers = base, mask
        parts = self._incoming.setdefault((channel, sequence), {})
        parts[index] = (flags, data)
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
            self._expected[channel] = sequence + 1
            if any(flags & _VOID for flags, _ in parts.values()):
                continue
            payload = b''.join(parts[index][1] for index in sorted(parts))
            if parts[0][0] & _PACKED:
                payload = zlib.decompress(payload)
            came.append(Received(channel, payload, False))

    @staticmethod
    def _is_whole(parts: dict[int, tuple[int, bytes]]) -> bool:
        last = max(parts)
        return len(parts) == last + 1 and bool(parts[last][0] & _LAST)

    # Messages

    def _begin_again(self) -> None:
        """Restart the numbers at zero, because the other end restarted."""
        self._next = self._confirmed_below = 0
        self._received_numbers = (0, 0)
        self._incoming.clear()
        self._expected.clear()
        self._sequences.clear()
        self._parts = []
        self._messages = deque(m for m in self._messages if not m.is_expired)
        self._their_times = (0, 0)
        self._delays.clear()
        self._exchanges.clear()
        for message in self._messages:
            self._cut(message)

    def _cut(self, message: Message) -> None:
        """Split a message into parts."""
        packed = zlib.compress(message.payload, 6) if len(message.payload) > 200 else b''
        is_packed = bool(packed) and len(packed) < len(message.payload)
        content = packed if is_packed else message.payload
        flags = _PACKED * is_packed | _EXPIRES * (message.expires < inf)
        sequence = self._sequences.get(message.channel, 0)
        self._sequences[message.channel] = sequence + 1
        pieces = [content[k : k + _PART_MAX] for k in range(0, len(content), _PART_MAX)] or [b'']
        message._parts = [
            _Part(message, sequence, k, len(pieces), flags | _LAST * (k == len(pieces) - 1), piece)
            for k, piece in enumerate(pieces)
        ]
        self._parts += message._parts

    def _expire(self, now: float) -> None:
        """Empty the parts of expired messages; the messages' numbers must still arrive."""
        for message in self._messages:
            if message.expires < now and not message.is_expired:
                message.is_expired = True
                for part in message._parts:
                    part.flags |= _VOID
                    part.content = b''


def _entry(kind: int, content: bytes) -> bytes:
    return _ENTRY.pack(kind, len(content)) + content


def _entries(body: bytes) -> Iterator[tuple[int, bytes]]:
    place = 0
    while place < len(body):
        kind, length = _ENTRY.unpack_from(body, place)
        place += _ENTRY.size
        yield kind, body[place : place + length]
        place += length
