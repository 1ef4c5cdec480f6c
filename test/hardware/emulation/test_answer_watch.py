import pytest

from aerarm_ros.hardware.emulation.emulated_transport import AnswerWatch

MS = 1_000_000
NOW = 1_000 * MS


def test_a_controller_that_never_answered_is_not_awaited() -> None:
    assert not AnswerWatch(MS, 0).awaits(NOW)


@pytest.mark.parametrize('lag', [0, 3])
def test_awaits_an_answer_that_is_later_than_the_lag(lag: int) -> None:
    watch = AnswerWatch(MS, lag)
    watch.note(NOW, NOW)
    assert not watch.awaits(NOW + lag * MS)
    assert watch.awaits(NOW + (lag + 1) * MS)


@pytest.mark.parametrize(
    'stamp', [NOW + MS, NOW - MS // 2, NOW - 21 * MS, 0], ids=['future', 'own', 'stale', 'none']
)
def test_a_stamp_of_no_recent_state_is_no_answer(stamp: int) -> None:
    watch = AnswerWatch(MS, 0)
    watch.note(NOW, NOW)
    watch.note(stamp, NOW)
    assert not watch.expects
    assert not watch.awaits(NOW + 5 * MS)


def test_after_a_time_out_the_next_answer_resumes_waiting_with_a_larger_lag() -> None:
    watch = AnswerWatch(MS, 0)
    watch.note(NOW, NOW)
    watch.give_up()
    assert not watch.awaits(NOW + 10 * MS)
    watch.note(NOW + 10 * MS, NOW + 10 * MS)
    assert not watch.awaits(NOW + 11 * MS)
    assert watch.awaits(NOW + 12 * MS)


def test_a_controller_of_every_tenth_state_is_not_waited_for_in_the_end() -> None:
    watch = AnswerWatch(MS, 0)
    given_up = 0
    for state in range(200):
        now = NOW + state * MS
        if watch.awaits(now):
            watch.give_up()
            given_up += 1
        if state % 10 == 0:
            watch.note(now, now)
    assert given_up <= 3


def test_discards_the_previous_controller() -> None:
    watch = AnswerWatch(MS, 2)
    watch.note(NOW, NOW)
    watch.give_up()
    watch.note(NOW, NOW)
    watch.forget()
    assert not watch.expects
    watch.note(NOW, NOW)
    assert watch.awaits(NOW + 3 * MS)
