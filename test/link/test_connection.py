"""Two connections over a bad link, in simulated time."""

import random
from math import inf

import pytest
from bad_link import KEY, TICK, Link

from aerarm_ros.link.connection import BULK, MESSAGE_MAX, URGENT, Connection


def connected(**link) -> Link:
    link = Link(**link)
    link.run(5.0, lambda: link.drone.is_joined and link.ground.is_joined)
    return link


@pytest.fixture(params=[0.0, 0.05, 0.2], ids=lambda loss: f'{loss:.0%} loss')
def link(request: pytest.FixtureRequest) -> Link:
    return connected(loss=request.param)


def test_messages_arrive_once_in_order_and_cannot_be_read_on_the_way(link: Link) -> None:
    sent = [b'secret' + bytes([k]) * (1 + 37 * k) for k in range(60)]
    for payload in sent:
        link.drone.send(3, payload, BULK)
        link.run(0.05)
    sent.append(random.Random(3).randbytes(400_000))  # hundreds of parts
    link.drone.send(3, sent[-1])
    link.run(60.0, lambda: not link.drone.waiting)
    assert link.payloads('ground') == sent
    assert not any(b'secret' in datagram for _, datagram in link.spy)


@pytest.mark.parametrize(('loss', 'limit'), [(0.05, 0.15), (0.2, 0.3)])
def test_an_urgent_message_arrives_in_99_of_100_within(loss: float, limit: float) -> None:
    times = []
    for seed in range(100):
        link = connected(loss=loss, seed=seed)
        link.ground.send(1, b'stop', URGENT)
        times.append(link.run(5.0, lambda link=link: link.came['drone']))
    assert sorted(times)[98] < limit


def test_an_urgent_message_during_a_cut_arrives_when_the_link_is_back(link: Link) -> None:
    link.cut(5.0)
    message = link.ground.send(1, b'stop', URGENT)
    link.run(60.0)
    assert not message.is_confirmed
    assert not link.ground.is_up(link.clocks('ground')[0])
    link.is_cut, link.loss = False, min(link.loss, 0.05)
    assert link.run(5.0, lambda: link.came['drone']) < 0.3
    link.run(1.0, lambda: message.is_confirmed)
    assert message.is_confirmed


def test_a_command_that_expired_in_a_cut_never_arrives(link: Link) -> None:
    link.is_cut = True
    message = link.go()
    link.run(5.0)
    link.is_cut = False
    link.ground.send(2, b'stay')
    link.run(5.0, lambda: link.came['drone'])
    assert link.payloads('drone') == [b'stay']
    assert message.is_expired and not message.is_confirmed


@pytest.mark.parametrize(('cut', 'up', 'both'), [(61.0, 3.0, 0.01), (0.0, 0.0, 3.0)])
def test_a_command_that_waited_in_the_radio_is_not_taken(cut, up, both) -> None:
    link = connected()
    link.run(2.0)
    link.cut(cut)
    link.is_cut, link.up_delay, link.delay = False, up, both
    link.go()
    link.run(10.0)
    assert link.payloads('drone') == []


def test_commands_pass_after_long_cuts_old_stops_and_a_longer_delay() -> None:
    for stops in (1, 2):  # kept during the cut
        link = connected()
        link.run(3.0)
        link.cut(1.0)
        for _ in range(stops):
            link.ground.send(1, bytes(45), URGENT)
        link.run(60.0)
        link.is_cut = False
        link.run(1.0, lambda link=link, stops=stops: len(link.came['drone']) == stops)
        link.go(b'go' * 20)
        link.run(2.0)
        assert link.payloads('drone')[stops:] == [b'go' * 20]
    link = connected()
    link.cut(1.0)
    link.now += 1e5
    link.drift = 1.0  # 10 ppm in a day: each datagram seems to take a second longer
    link.is_cut = False
    link.go()
    assert link.run(1.0, lambda: link.came['drone']) < 0.2
    link = connected()
    link.run(3.0)
    link.delay = 0.62  # for good
    link.run(120.0)
    for _ in range(5):
        link.go()
        link.run(3.0)
    assert link.payloads('drone') == [b'go'] * 5
    assert link.drone.delay < 0.02


def test_the_rate_stays_below_its_limit_whatever_is_sent(link: Link) -> None:
    before = link.drone.traffic.sent_bytes, link.sent
    for k in range(500):
        link.drone.send(3, bytes(400), BULK)
        link.drone.send(4, random.Random(k).randbytes(700), BULK)
        for channel in range(20):
            link.drone.set_value(channel, bytes(150))
        link.run(TICK)
    assert (link.drone.traffic.sent_bytes - before[0]) / 10.0 < 1.1 * 26_000.0
    assert (link.sent - before[1]) / 10.0 <= 101.0


def test_either_end_may_start_again(link: Link) -> None:
    link.drone.send(3, b'first')
    link.run(5.0, lambda: not link.drone.waiting)
    link.ground = Connection(KEY, 'ground', 'drone', 9_000.0)
    link.run(5.0, lambda: link.ground.is_joined and link.drone.peers == 2)
    link.drone.send(3, b'second')
    link.run(5.0, lambda: not link.drone.waiting)
    link.drone = Connection(KEY, 'drone', 'ground', 26_000.0)
    link.ground.send(5, b'third')
    link.run(5.0, lambda: link.came['drone'])
    assert link.payloads('ground') == [b'first', b'second']
    assert link.payloads('drone') == [b'third']


@pytest.mark.parametrize('ahead', [-30.0, 0.0, 30.0])
def test_the_offset_of_the_clocks_is_estimated(link: Link, ahead: float) -> None:
    link.ahead = ahead
    link.run(12.0)
    assert link.ground.clock_offset == pytest.approx(ahead, abs=6e-3)
    assert link.drone.clock_offset == pytest.approx(-ahead, abs=6e-3)
    assert 0.02 <= link.ground.round_trip < 0.06


def test_recorded_or_forged_datagrams_are_rejected(link: Link) -> None:
    link.ground.send(1, b'stop', URGENT)
    link.run(2.0, lambda: link.came['drone'])
    recorded = [datagram for side, datagram in link.spy if side == 'drone']
    before = link.drone.traffic.received
    clocks = link.clocks('drone')
    assert all(not link.drone.receive(datagram, *clocks) for datagram in recorded[-100:-1])
    # After a restart of the drone, too.
    link.drone = Connection(KEY, 'drone', 'ground', 26_000.0)
    assert not any(link.drone.receive(datagram, *clocks) for datagram in recorded)
    assert not link.drone.is_joined
    for datagram in recorded[-3:]:
        changed = bytearray(datagram)
        changed[len(changed) // 2] ^= 1
        assert link.drone.receive(bytes(changed), *clocks) == []
    stranger = Connection(bytes(32), 'ground', 'drone', 9_000.0)
    assert link.drone.receive(stranger.datagram(*link.clocks('ground')), *clocks) == []
    assert link.drone.last_received == -inf
    assert before > 0


def test_states_do_not_wait_behind_messages_queued_during_a_cut() -> None:
    link = Link()
    link.run(1.0)
    link.is_cut = True
    for k in range(600):  # diagnostics of a minute, not to be compressed
        link.drone.send(9, random.Random(k).randbytes(500), BULK)
        link.run(0.1)
    link.is_cut = False
    begin, before = link.now, len(link.came['ground'])
    while link.now < begin + 5.0:
        link.drone.set_value(1, b'state')
        link.run(0.02)
    values = [when for when, received in link.came['ground'][before:] if received.is_value]
    assert values[0] - begin < 0.2
    assert len(values) > 150
    # The backlog gets its share.
    bulk = [1 for _, received in link.came['ground'][before:] if received.channel == 9]
    assert len(bulk) > 30


def test_a_former_ground_that_returns_is_received_again() -> None:
    link = Link()
    link.run(5.0, lambda: link.drone.is_joined and link.ground.is_joined)
    first = link.ground
    for number in range(150):
        first.send(3, bytes([number]))
        link.drone.send(4, bytes([number]))
        link.run(0.05)
    link.ground = Connection(KEY, 'ground', 'drone', 9_000.0)
    link.run(5.0, lambda: link.ground.is_up(link.now) and link.drone.peers == 2)
    link.ground.send(3, b'second')
    link.run(2.0)
    link.ground = first
    link.came = {'drone': [], 'ground': []}
    link.run(3.0)
    first.send(5, b'stop', URGENT)
    link.drone.send(6, b'event')
    link.run(2.0)
    assert b'stop' in link.payloads('drone')
    assert b'event' in link.payloads('ground')
    assert not first.waiting
    assert not link.drone.waiting


@pytest.mark.parametrize('is_known', [False, True], ids=['no ground yet', 'ground lost'])
def test_the_backlog_is_bounded_and_keeps_urgent_messages(is_known: bool) -> None:
    link = Link()
    if is_known:
        link.run(5.0, lambda: link.drone.is_joined and link.ground.is_joined)
    link.cut(2.0)
    link.came = {'drone': [], 'ground': []}
    link.drone.send(7, b'urgent', URGENT)
    for number in range(5000):
        link.drone.send(3, number.to_bytes(2, 'little'), BULK)
    assert link.drone.waiting <= 2000
    assert link.drone.dropped >= 3000
    link.is_cut = False
    link.run(120.0, lambda: not link.drone.waiting)
    came = link.payloads('ground')
    assert b'urgent' in came
    assert came[-1] == (4999).to_bytes(2, 'little')
    assert len(came) == len(set(came))


@pytest.mark.parametrize('ahead', [0.0, 30.0])
def test_old_datagrams_change_neither_clock_nor_delay(ahead: float) -> None:
    link = connected()
    link.ahead = ahead
    link.run(12.0)
    link.cut(61.0)
    link.is_cut, link.delay = False, 3.0
    link.run(3.1)  # only datagrams of the radio's queue arrive
    assert link.drone.last_received > link.clocks('drone')[0] - 0.2
    assert link.drone.clock_offset == pytest.approx(-ahead, abs=6e-3)
    assert link.drone.delay == pytest.approx(3.0, abs=0.02)
    link.delay = 0.01
    link.run(3.0)  # some old datagrams arrive after the new ones
    link.go()
    assert link.run(1.0, lambda: link.came['drone']) < 0.1
    link.run(0.1)
    for end, offset in ((link.ground, ahead), (link.drone, -ahead)):
        assert end.clock_offset == pytest.approx(offset, abs=6e-3)
        assert end.delay < 0.02
        assert end.round_trip < 0.06


def test_too_long_messages_are_dropped_and_counted() -> None:
    link = connected()
    assert link.drone.send(9, bytes(MESSAGE_MAX + 1)).is_expired
    link.drone.set_value(1, bytes(1300))
    link.run(1.0)
    assert link.came['ground'] == []
    assert link.drone.dropped == 2


def test_a_backlog_of_long_messages_is_bounded() -> None:
    link = Link()
    link.run(2.0)
    sent = []
    for seed in range(20):  # 6 MB, which would take 4 minutes
        sent.append(link.drone.send(9, random.Random(seed).randbytes(300_000)))
        link.run(0.1)
    assert sum(len(message.payload) for message in sent if not message.is_expired) < 4.3e6
    link.drone.send(9, b'newest')
    link.run(600.0, lambda: not link.drone.waiting)
    came = link.payloads('ground')
    assert came[-1] == b'newest'
    assert len(came) + link.drone.dropped == 21
