"""How much of a motion was damped away."""

from __future__ import annotations

_DAMPED = 'damping'


class DampingAccount:
    """Counts how often and for how long a bridge damped the arm during a motion.

    A bridge damps when commands come too late, and follows the next one: the motion goes on,
    but it is not the one that was planned. Times are those of the monotonic clock.
    """

    def __init__(self) -> None:
        self._modes: list[tuple[int, str]] = []
        self._begin = self._end = 0

    def note(self, mode: str, now_ns: int) -> None:
        """Note a mode and when the bridge published it [ns]; from any thread."""
        self._modes.append((now_ns, mode))

    def begin(self, now_ns: int) -> None:
        """Note the beginning of the motion [ns]."""
        self._begin = self._end = now_ns

    def end(self, now_ns: int) -> None:
        """Note the end of the motion [ns]."""
        self._end = now_ns

    @property
    def damped(self) -> tuple[int, float]:
        """How often, and for how long [s], the arm was damped during the motion."""
        times, total = 0, 0
        modes = sorted(self._modes)
        ends = [when for when, _ in modes[1:]] + [self._end]
        before = ''
        for (start, mode), stop in zip(modes, ends, strict=True):
            overlap = min(stop, self._end) - max(start, self._begin)
            if mode == _DAMPED and overlap > 0:
                total += overlap
                times += before != _DAMPED
            before = mode
        return times, 1e-9 * total

    @property
    def share(self) -> float:
        """Share of the motion's time during which the arm was damped, 0 to 1."""
        duration = 1e-9 * (self._end - self._begin)
        return self.damped[1] / duration if duration > 0.0 else 0.0

    @property
    def text(self) -> str:
        """The same in words, '' if it never was."""
        times, seconds = self.damped
        if not times:
            return ''
        often = 'once' if times == 1 else f'{times} times'
        share = f'{self.share:.1%} of the motion'
        return f'the bridge damped the arm {often}, for {seconds:.2f} s ({share})'
