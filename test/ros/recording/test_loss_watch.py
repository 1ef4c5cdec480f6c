import re

import pytest

from aerarm_ros.ros.recording import LossWatch, receive_buffer_need, receive_buffer_problem

MS = 1_000_000


def watch_of(depth: int = 4000, dropped: list[int] | None = None) -> LossWatch:
    counter = dropped or [0]
    return LossWatch(depth, lambda: counter[0])


def pass_for(watch: LossWatch, begin: int, length: int, disk: int = 0) -> None:
    """Note a pass [ms]."""
    watch.note_pass(begin * MS, (begin + length) * MS, disk * MS)


def gap(watch: LossWatch, topic: str, count: int, begin: int, end: int, far: bool = False) -> None:
    """Note a gap [ms]."""
    watch.note_gap(topic, count, begin * MS, end * MS, far)


def test_each_gap_is_reported_once_with_begin_and_end() -> None:
    watch = watch_of()
    assert watch.news() == []
    gap(watch, '/a', 3, 1000, 1004)
    gap(watch, '/b', 2, 1003, 1006)
    gap(watch, '/a', 1, 5000, 5002)
    first, second = watch.news()
    assert 'losing messages: 3 of /a, 2 of /b, from ' in first
    assert re.search(r':01\.000 to \S+:01\.006, cause: processor', first)
    assert ' 1 of /a, from ' in second
    assert watch.news() == []
    assert watch.last is not None
    assert watch.last.counts == {'/a': 1}


def test_a_pass_that_the_disk_took_names_the_disk() -> None:
    watch = watch_of()
    pass_for(watch, 0, 900, disk=800)
    gap(watch, '/a', 500, 100, 600)
    (text,) = watch.news()
    assert 'cause: disk: the disk was too slow' in text


def test_a_pass_that_another_program_took_names_the_processor() -> None:
    watch = watch_of(depth=10)
    pass_for(watch, 0, 900, disk=10)
    gap(watch, '/a', 500, 100, 600, far=True)
    (text,) = watch.news()
    assert 'cause: processor: this computer was too busy' in text
    assert 'parameter depth, 10 now' in text


def test_losses_from_another_host_without_local_delay_are_attributed_to_the_network() -> None:
    watch = watch_of()
    for begin in range(0, 1000, 10):
        pass_for(watch, begin, 10, disk=9)
    gap(watch, '/a', 5, 100, 106, far=True)
    (text,) = watch.news()
    assert 'cause: link: the network between both hosts lost messages' in text


def test_a_pause_shorter_than_the_queue_does_not_explain_a_loss() -> None:
    watch = watch_of(depth=4000)
    pass_for(watch, 0, 200)
    gap(watch, '/a', 5, 100, 106, far=True)
    assert 'cause: link' in watch.news()[0]


def test_a_full_receive_buffer_of_the_kernel_is_named_with_the_command() -> None:
    dropped = [7]
    watch = watch_of(dropped=dropped)
    dropped[0] = 20
    gap(watch, '/a', 5, 100, 106, far=True)
    gap(watch, '/a', 5, 3100, 3106, far=True)  # none was dropped since
    first, second = watch.news()
    assert 'cause: processor' in first
    assert 'sudo sysctl -w net.core.rmem_default=' in first
    assert 'cause: link' in second


def test_datagrams_that_were_dropped_long_before_a_gap_do_not_explain_it() -> None:
    dropped = [7]
    watch = watch_of(dropped=dropped)
    pass_for(watch, 0, 10)
    dropped[0] = 20  # for example by another program, before the first gap of the recording
    for begin in range(10, 9000, 10):
        pass_for(watch, begin, 10)
    gap(watch, '/a', 5, 8500, 8506, far=True)
    assert 'cause: link' in watch.news()[0]


def test_one_overflow_explains_the_gaps_of_all_topics() -> None:
    dropped = [7]
    watch = watch_of(dropped=dropped)
    dropped[0] = 20
    gap(watch, '/a', 5, 100, 106, far=True)
    gap(watch, '/b', 5, 100, 106, far=True)
    (text,) = watch.news()
    assert '5 of /a, 5 of /b' in text
    assert 'cause: processor' in text


@pytest.mark.parametrize(('size', 'is_enough'), [(212_992, False), (64_000_000, True)])
def test_the_receive_buffer_is_compared_with_the_need(
    size: int, is_enough: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('aerarm_ros.ros.recording._receive_buffer', lambda: size)
    problem = receive_buffer_problem(5)
    assert (problem == '') == is_enough
    need = receive_buffer_need(5)
    assert need == 1_600_000  # five topics, 0.25 s, 1,280 bytes of memory for each message
    if problem:
        assert f'sudo sysctl -w net.core.rmem_default={need} net.core.rmem_max={need}' in problem
