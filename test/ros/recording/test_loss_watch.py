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
        watch.note_gap(topic, count, begin * MS, end * MS)
    first, second = watch.news()
    assert 'losing messages: 3 of /a, 2 of /b, from ' in first
    assert re.search(r':01\.000 to \S+:01\.006: end other programs', first)
    assert ' 1 of /a, from ' in second
    assert 'parameter depth, 4000 now' in second
    assert watch.news() == []


def test_the_receive_buffer_is_compared_with_the_need(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('aerarm_ros.ros.recording._receive_buffer', lambda: 1_600_000)
    # 0.25 s, 1,280 bytes of memory for each message
    assert receive_buffer_problem(5) == ''
    need = 1_920_000
    said = receive_buffer_problem(6)
    assert f'sudo sysctl -w net.core.rmem_default={need} net.core.rmem_max={need}' in said
