"""Tells when a board has been switched off and on."""

from __future__ import annotations

from aerarm_ros.hardware.frames.board_state import TIMESTAMP_PERIOD, BoardState

# That a board's clock may be ahead of the host's, or go back, between two answers [s], ...
_TICKS = 0.05
_DRIFT = 0.01  # ... and of the time between them


class RestartWatch:
    """Looks for what only a restart does to a board's answers.

    A restart may pass unseen between two answers, or while the board is not heard: the counts of
    its encoders begin anew all the same. Then its clock is not where it should be, an index pulse
    that was met since it was switched on is forgotten, or an error is gone that it keeps till then.

    Parameters
    ----------
    until_power_cycle
        Whether the board keeps an error until its supply was off.
    """

    def __init__(self, until_power_cycle: bool) -> None:
        self._until_power_cycle = until_power_cycle
        self._timestamp: float | None = None
        self._error = 0
        self._detected = (False, False)

    def saw(self, state: BoardState, longest: float) -> bool:
        """Take an answer; return whether the board restarted since the last one.

        Parameters
        ----------
        state
            What the board reports.
        longest
            Longest time since the last answer [s].
        """
        detected = (bool(state.index_detected[0]), bool(state.index_detected[1]))
        restarted = False
        if self._timestamp is not None:
            ahead = (state.timestamp - self._timestamp) % TIMESTAMP_PERIOD
            # A board that stood still beside the host is behind it; none is ahead.
            most = (1.0 + _DRIFT) * max(longest, 0.0) + _TICKS
            restarted = most < ahead < TIMESTAMP_PERIOD - _TICKS
            # In a silence as long as its period the clock shows nothing.
            restarted = restarted or most >= TIMESTAMP_PERIOD
            restarted = restarted or any(
                before and not now for before, now in zip(self._detected, detected, strict=True)
            )
            if self._until_power_cycle and self._error and not state.error:
                restarted = True
        self._timestamp, self._error, self._detected = state.timestamp, state.error, detected
        return restarted
