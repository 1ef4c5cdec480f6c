"""How far an emulated world may run ahead of who commands it."""

from __future__ import annotations

_LAG_MAX = 20  # states; beyond it a command would be too old to be let in anyway


class AnswerWatch:
    """Follows which state was answered last, and says whether the next must wait for an answer.

    A controller stamps a command with the stamp of the state that it answers. Once one does, it is
    expected to go on, each answer at most `lag` states behind. Who does not within the patience of
    whoever waits is given up, until its next answer, and with a larger lag from then on: it may
    answer every tenth state only. A command with a stamp of its own is no answer, and nobody waits
    for the next.

    Parameters
    ----------
    period_ns
        From state to state [ns].
    lag
        Number of states that may be without an answer.
    """

    def __init__(self, period_ns: int, lag: int) -> None:
        self._period_ns = period_ns
        self._lag = self._first_lag = lag
        self._answered_ns = 0
        self._expects = False

    @property
    def expects(self) -> bool:
        """Whether somebody answers states."""
        return self._expects

    def note(self, stamp_ns: int, newest_ns: int) -> None:
        """Take note of a command with a stamp, while the newest state has another [ns]."""
        self._expects = self.is_answer(stamp_ns, newest_ns)
        self._answered_ns = stamp_ns

    def is_answer(self, stamp_ns: int, newest_ns: int) -> bool:
        """Whether a stamp [ns] is that of the newest state, or of one not long before."""
        states, rest = divmod(newest_ns - stamp_ns, self._period_ns)
        return 0 <= states <= _LAG_MAX and rest == 0

    def awaits(self, newest_ns: int) -> bool:
        """Whether the answer to the state of this stamp [ns], or one shortly before, is due."""
        return self._expects and newest_ns - self._answered_ns > self._lag * self._period_ns

    def give_up(self) -> None:
        """Expect nothing until the next answer, and from then on a little less."""
        self._expects = False
        self._lag = min(4 * self._lag + 1, _LAG_MAX)

    def forget(self) -> None:
        """Begin anew: nobody commands the arm."""
        self._expects = False
        self._lag = self._first_lag
