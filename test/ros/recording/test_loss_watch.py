import re

import pytest

from aerarm_ros.ros.recording import LossWatch, receive_buffer_problem

MS = 1_000_000


def test_each_gap_is_reported_once_with_begin_and_end() -> None:
    watch = LossWatch(4000)
    assert watch.news() == []
    for topic, count, begin, end in (
        ('/a', 3, 1000, 1004),
        ('/b', 2, 1003, 1006),
        ('/a', 1, 5000, 5002),
    ):
        watch.note_gap(topic, count, begin * MS, end * MS, is_remote=False)
    first, second = watch.news()
    assert 'losing messages: 3 of /a, 2 of /b, from ' in first
    assert re.search(r':01\.000 to \S+:01\.006, cause: processor: this computer', first)
    assert ' 1 of /a, from ' in second
    assert 'parameter depth, 4000 now' in second
    assert watch.news() == []
    assert watch.cause == 'processor'


@pytest.mark.parametrize(
    ('is_remote', 'depth', 'pass_ms', 'disk_ms', 'said'),
    [
        (False, 4000, 900, 800, 'disk: the disk was too slow'),
        (False, 4000, 900, 10, 'processor: this computer was too busy'),
        (True, 10, 900, 800, 'disk: the disk was too slow'),
        (True, 10, 900, 10, 'processor: this computer was too busy'),
        (True, 10, 10, 9, 'link: the network between both hosts lost messages'),
        # A pass that the queue outlasts explains no loss.
        (True, 4000, 900, 10, 'link: the network between both hosts lost messages'),
    ],
)
def test_a_long_pass_of_the_loop_or_the_network_is_the_cause(
    is_remote: bool, depth: int, pass_ms: int, disk_ms: int, said: str
) -> None:
    watch = LossWatch(depth, lambda: 7)
    for begin in range(0, 900, pass_ms):
        watch.note_pass(begin * MS, (begin + pass_ms) * MS, disk_ms * MS)
    watch.note_gap('/a', 500, 100 * MS, 600 * MS, is_remote)
    (text,) = watch.news()
    assert f'cause: {said}' in text


def test_a_receive_buffer_that_was_full_in_the_last_seconds_is_the_cause() -> None:
    dropped = [7]
    watch = LossWatch(4000, lambda: dropped[0])
    dropped[0] = 20  # one overflow explains the gaps of all topics
    for topic in ('/a', '/b'):
        watch.note_gap(topic, 5, 100 * MS, 106 * MS, is_remote=True)
    (text,) = watch.news()
    assert ' 5 of /a, 5 of /b, ' in text
    assert 'cause: processor (full buffer): ' in text
    assert 'sudo sysctl -w net.core.rmem_default=' in text
    assert watch.news() == []
    watch.note_gap('/a', 5, 8500 * MS, 8506 * MS, is_remote=True)
    assert 'cause: link' in watch.news()[0]


def test_the_receive_buffer_is_compared_with_the_need(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('aerarm_ros.ros.recording._receive_buffer', lambda: 1_600_000)
    # 0.25 s, 1,280 bytes of memory for each message
    assert receive_buffer_problem(5) == ''
    need = 1_920_000
    said = receive_buffer_problem(6)
    assert f'sudo sysctl -w net.core.rmem_default={need} net.core.rmem_max={need}' in said
