"""Lost messages, while they are being lost."""

from __future__ import annotations

from collections.abc import Mapping


class LossWatch:
    """Says what was lost since the last look, and what to do against it.

    Parameters
    ----------
    depth
        Messages of a topic that may wait, as the recorder was told.
    """

    def __init__(self, depth: int) -> None:
        self._depth = depth
        self._known: dict[str, int] = {}

    def news(self, heard: Mapping[str, tuple[int, int | None]]) -> str:
        """Return a sentence about new losses, '' if there are none.

        Parameters
        ----------
        heard
            Messages that came, and lost ones (None: not known), of each topic so far.
        """
        known = self._known
        self._known = {name: lost or 0 for name, (_, lost) in heard.items()}
        news = {name: lost - known.get(name, 0) for name, lost in self._known.items()}
        losing = {name: count for name, count in news.items() if count > 0}
        if not losing:
            return ''
        counts = ', '.join(f'{count} of {name}' for name, count in losing.items())
        return (
            f'losing messages: {counts} just now. This machine is too busy or its disk too slow: '
            'end other programs, record fewer topics (parameter topics), or let more messages '
            f'wait (parameter depth, {self._depth} now)'
        )
