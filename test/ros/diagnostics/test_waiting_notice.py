from aerarm_ros.ros.diagnostics import PATIENCE, REPETITION, WaitingNotice


def test_a_long_wait_is_reported_and_repeated() -> None:
    notice = WaitingNotice(10.0)
    said = {time: notice.update(['a', 'b'], time) for time in (10.0, 11.9, 12.0, 16.9, 17.0)}
    assert said == {
        10.0: '',
        10.0 + PATIENCE - 0.1: '',
        10.0 + PATIENCE: 'waiting: a; b',
        10.0 + PATIENCE + REPETITION - 0.1: '',
        10.0 + PATIENCE + REPETITION: 'waiting: a; b',
    }


def test_no_notice_without_missing_inputs() -> None:
    assert WaitingNotice(0.0).update([], 100.0) == ''
