from aerarm_ros.hardware.boards.board_link import RestartWatch
from aerarm_ros.hardware.frames.board_messages import TIMESTAMP_PERIOD, BoardState


def watch(timestamp: float = 30.0, until_power_cycle: bool = True, **state: object) -> RestartWatch:
    """Return what has seen a board once."""
    seen = RestartWatch(until_power_cycle)
    assert not seen.saw(BoardState(timestamp=timestamp, **state), float('inf'))
    return seen


def test_a_continuing_clock_means_that_the_board_stayed_on() -> None:
    seen, time = watch(), 30.0
    for step, longest in [(1e-3, 1e-3), (5.0, 5.0), (0.0, 1e-3), (0.01, 3.0), (60.0, 61.0)]:
        time += step
        state = BoardState(timestamp=time % TIMESTAMP_PERIOD)
        assert not seen.saw(state, longest), (step, longest)


def test_a_restarted_clock_means_that_the_board_was_off() -> None:
    assert watch(30.0).saw(BoardState(timestamp=0.02), 0.02)
    assert watch(0.3).saw(BoardState(timestamp=0.05), 0.5)
    assert watch(64.0).saw(BoardState(timestamp=0.5), 0.5)
    # A tick back is a frame that was late; nobody else's clock runs ahead by so much.
    assert not watch(30.0).saw(BoardState(timestamp=29.998), 1e-3)
    assert not watch(30.0).saw(BoardState(timestamp=30.04), 1e-3)
    assert watch(30.0).saw(BoardState(timestamp=30.2), 1e-3)
    # A host whose clock goes back says nothing of the board.
    assert not watch(30.0).saw(BoardState(timestamp=30.001), -5.0)


def test_a_silence_as_long_as_the_clocks_period_is_a_restart() -> None:
    now = BoardState(timestamp=31.0)
    assert not watch(30.0).saw(now, 1.0 + 0.9 * TIMESTAMP_PERIOD)
    assert watch(30.0).saw(now, 1.0 + TIMESTAMP_PERIOD)


def test_a_pulse_that_was_met_is_forgotten_by_a_restart_only() -> None:
    for detected in ([True, False], [False, True]):
        assert watch(64.0, index_detected=detected).saw(BoardState(timestamp=65.0), 5.0)
        assert not watch(64.0).saw(BoardState(timestamp=65.0, index_detected=detected), 5.0)


def test_an_error_that_lasts_until_a_power_cycle_ends_by_one() -> None:
    now = BoardState(timestamp=65.0)
    assert watch(64.0, error=3).saw(now, 5.0)
    assert not watch(64.0, until_power_cycle=False, error=3).saw(now, 5.0)
    assert not watch(64.0, error=3).saw(BoardState(timestamp=65.0, error=3), 5.0)
