"""When to say what is being waited for."""

from __future__ import annotations

from collections.abc import Sequence

# Shorter waits are ordinary [s]; what goes on is repeated as often as a person looks [s].
PATIENCE, REPETITION = 2.0, 5.0


class WaitingNotice:
    """Turns what is missing into a line now and then.

    Parameters
    ----------
    now
        When the wait begins [s].
    """

    def __init__(self, now: float) -> None:
        self._due = now + PATIENCE

    def update(self, missing: Sequence[str], now: float) -> str:
        """Return what to say at the time `now` [s], '' if nothing."""
        if not missing or now < self._due:
            return ''
        self._due = now + REPETITION
        return f'waiting: {"; ".join(missing)}'
