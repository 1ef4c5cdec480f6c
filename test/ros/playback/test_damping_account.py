import pytest

from aerarm_ros.ros.playback.motion_playback import DampingAccount

SECOND = 10**9


def account(*modes: tuple[float, str], begin: float = 0.0, end: float = 10.0) -> DampingAccount:
    account = DampingAccount()
    for when, mode in modes:
        account.note(mode, round(when * SECOND))
    account.begin_ns, account.end_ns = round(begin * SECOND), round(end * SECOND)
    return account


def test_each_time_is_counted_with_its_length() -> None:
    shaken = account(
        (0, 'running'), (2, 'damping'), (2.5, 'running'), (4, 'damping'), (5, 'running')
    )
    assert shaken.damped == (2, pytest.approx(1.5))
    assert shaken.share == pytest.approx(0.15)
    assert shaken.text == 'the bridge damped the arm 2 times, for 1.50 s (15.0% of the motion)'


def test_only_the_motion_counts() -> None:
    outside = account((0, 'damping'), (1, 'running'), (9, 'damping'), begin=1.0, end=9.0)
    assert outside.damped == (0, 0.0)
    across = account((0, 'damping'), (2, 'running'), (8, 'damping'), begin=1.0, end=9.0)
    assert across.damped == (2, pytest.approx(2.0))


def test_repeated_or_late_modes_are_counted_once_in_order() -> None:
    twice = account((3, 'damping'), (0, 'running'), (4, 'damping'), (5, 'running'))
    assert twice.damped == (1, pytest.approx(2.0))
    assert 'once' in twice.text
