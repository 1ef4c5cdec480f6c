"""Recorded, held-back and random datagrams, in simulated time."""

import random
import struct
import zlib
from typing import Any

import pytest
from bad_link import KEY, TICK, Link

from aerarm_ros.link.connection import MESSAGE_MAX, PROMPT, URGENT, Connection


def ground() -> Connection:
    return Connection(KEY, 'ground', 'drone', 9_000.0)


def recorded(link: Link, side: str) -> list[bytes]:
    """What an attacker has recorded on the way to a side."""
    return [datagram for to, datagram in link.spy if to == side]


def recorded_starts(link: Link, count: int) -> list[bytes]:
    """The first datagrams of several grounds."""
    return [ground().datagram(*link.clocks('ground')) for _ in range(count)]


@pytest.fixture
def link() -> Link:
    link = Link()
    link.run(3.0)
    assert link.drone.is_joined and link.ground.is_joined
    return link


def test_recorded_datagrams_change_nothing(link: Link) -> None:
    link.ground.send(2, b'go', PROMPT)
    link.run(1.0, lambda: link.came['drone'])
    assert link.payloads('drone') == [b'go']
    commands = recorded(link, 'drone')[:-1]
    for datagram in [*recorded_starts(link, 20), *commands, *commands]:
        assert link.drone.receive(datagram, *link.clocks('drone')) == []
        assert not link.drone.is_newest  # the drone sends to the address of the newest datagram
    # Nor do answers to them that an attacker passes on.
    link.run(2.0)
    for datagram in [*recorded_starts(link, 20), *commands]:
        link.drone.receive(datagram, *link.clocks('drone'))
        if link.drone.answer is not None:
            link.ground.receive(link.drone.answer, *link.clocks('ground'))
            if link.ground.answer is not None:
                link.drone.receive(link.ground.answer, *link.clocks('drone'))
        link.run(TICK)
    assert link.drone.peers == link.ground.peers == 1


def test_a_held_back_datagram_of_a_former_ground_does_not_replace_the_present_one(link) -> None:
    link.is_cut = True
    link.ground.send(2, b'go', PROMPT)
    link.run(0.1)
    held = recorded(link, 'drone')[-5:]
    link.ground, link.is_cut = ground(), False
    link.run(5.0, lambda: link.drone.peers == 2)
    link.run(3.0)
    for datagram in held:
        assert link.drone.receive(datagram, *link.clocks('drone')) == []
    link.run(3.0)
    assert link.drone.peers == 2
    assert b'go' not in link.payloads('drone')


def test_a_held_back_handshake_is_too_old(link: Link) -> None:
    second = ground()
    link.drone.receive(second.datagram(*link.clocks('ground')), *link.clocks('drone'))
    second.receive(link.drone.answer or b'', *link.clocks('ground'))
    held = second.datagram(*link.clocks('ground'))
    link.run(11.0)
    assert link.drone.receive(held, *link.clocks('drone')) == []
    assert link.drone.peers == 1


@pytest.mark.parametrize('delay', [0.3, 0.6, 1.5])
@pytest.mark.parametrize('side', ['drone', 'ground'])
def test_one_handshake_is_enough_on_a_slow_link(delay: float, side: str) -> None:
    link = Link(delay=delay)
    link.run(20.0)
    assert link.drone.peers == link.ground.peers == 1
    fresh = ground() if side == 'ground' else Connection(KEY, 'drone', 'ground', 26_000.0)
    setattr(link, side, fresh)
    link.run(40.0)
    assert sorted((link.drone.peers, link.ground.peers)) == [1, 2]
    assert link.drone.is_up(link.clocks('drone')[0])


@pytest.mark.parametrize('each', [1, 5])
def test_a_flood_of_starts_neither_cuts_the_live_ground_nor_keeps_a_new_one_out(link, each) -> None:
    starts = recorded_starts(link, 300)
    source = random.Random(4)

    def flood() -> None:
        for datagram in source.sample(starts, each):
            link.drone.receive(datagram, *link.clocks('drone'))

    peers, before = link.drone.peers, len(link.came['ground'])
    for _ in range(200):
        flood()
        link.drone.set_value(1, b'state')
        link.run(TICK)
    assert link.drone.peers == peers
    assert len(link.came['ground']) - before > 190
    link.ground = ground()
    for _ in range(250):
        flood()
        link.run(TICK)
    assert link.drone.peers == peers + 1
    assert link.ground.is_up(link.now)


def test_a_flood_of_starts_gets_less_than_it_sends(link: Link) -> None:
    before, size = link.drone.traffic.sent_bytes, 0
    link.run(1.0)
    steady = link.drone.traffic.sent_bytes - before
    for _ in range(50):
        for datagram in recorded_starts(link, 20):
            size += len(datagram)
            link.drone.receive(datagram, *link.clocks('drone'))
        link.run(TICK)
    assert link.drone.traffic.sent_bytes - before - 2 * steady < size


def test_random_bytes_raise_nothing(link: Link) -> None:
    source = random.Random(5)
    for _ in range(3000):
        datagram = source.randbytes(source.choice((0, 1, 16, 40, 41, 100, 1200)))
        assert link.drone.receive(datagram, *link.clocks('drone')) == []
    assert link.drone.rejected == 3000
    link.ground.send(2, b'go')
    assert link.run(1.0, lambda: link.came['drone']) < 0.1


def random_body(source: random.Random) -> bytes:
    """Entries of all kinds with random content, some with a wrong length."""
    body = b''
    for _ in range(source.randrange(1, 5)):
        kind = source.randrange(6)
        content = source.randbytes(source.choice((0, 2, 12, 15, 32, 60)))
        if source.random() < 0.5:
            fields = (source.randrange(80), 3, *map(source.randrange, (3, 3, 4, 16)))
            kind, content = 2, struct.pack('<IHIHHB', *fields) + content
        length = len(content) if source.random() < 0.9 else source.randrange(65536)
        body += struct.pack('<BH', kind, length) + content
    return body


def test_random_contents_of_an_authentic_end_raise_nothing() -> None:
    source = random.Random(6)
    for _ in range(30):
        link: Any = Link()
        link.run(0.1)
        session = link.ground._session
        for _ in range(60):
            link.drone.receive(session.seal(random_body(source)), *link.clocks('drone'))
            link.drone.send(5, b'event')
            link.drone.datagram(*link.clocks('drone'))
        assert link.drone._held < 1e6
        # A restart of the other end brings the connection back.
        link.ground = ground()
        link.run(3.0, lambda link=link: link.drone.peers == 2)
        link.came['drone'].clear()
        link.ground.send(2, b'go')
        link.run(1.0, lambda link=link: link.came['drone'])
        assert link.payloads('drone') == [b'go']


def part(number: int, sequence: int, index: int, count: int, flags: int, content: bytes) -> bytes:
    entry = struct.pack('<IHIHHB', number, 3, sequence, index, count, flags) + content
    return struct.pack('<BH', 2, len(entry)) + entry


def test_incomplete_messages_take_a_bounded_memory() -> None:
    link: Any = Link()
    link.run(0.1)
    session = link.ground._session
    before = link.drone._received_numbers[0]
    for number in range(before, before + 20_000):
        body = part(number, 1 + number, 0, 2, 0, bytes(1000))
        link.drone.receive(session.seal(body), *link.clocks('drone'))
    assert link.drone._held <= 8 * MESSAGE_MAX


def test_a_message_that_unpacks_to_gigabytes_is_dropped() -> None:
    link: Any = Link()
    link.run(0.1)
    session = link.ground._session
    bomb = zlib.compress(bytes(3 * MESSAGE_MAX), 9)
    parts = [bomb[k : k + 1000] for k in range(0, len(bomb), 1000)]
    assert len(parts) < 64
    for index, content in enumerate(parts):
        flags = 1 | 8 * (index == len(parts) - 1)
        body = part(index, 0, index, len(parts), flags, content)
        assert link.drone.receive(session.seal(body), *link.clocks('drone')) == []
    body = part(len(parts), 1, 0, 1, 8, b'next')
    (received,) = link.drone.receive(session.seal(body), *link.clocks('drone'))
    assert received.payload == b'next'


def test_a_new_ground_connects_soon_although_the_former_one_got_an_old_offer() -> None:
    link = Link()
    link.is_cut = True
    link.drone.receive(ground().datagram(*link.clocks('ground')), *link.clocks('drone'))
    link.run(4.8)
    link.is_cut = False
    link.run(2.0, lambda: link.drone.is_joined and link.ground.is_joined)
    link.run(0.5)
    link.ground = ground()
    link.ground.send(1, b'stop', URGENT)
    assert link.run(20.0, lambda: link.came['drone']) < 1.5
