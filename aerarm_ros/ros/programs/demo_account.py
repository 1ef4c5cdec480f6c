"""What the demo's nodes say at their end: how fast the world ran, what was lost, what to do."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

_CYCLES = re.compile(
    r'\d+ cycles, the world ran at [\d.]+ % of real time(?P<slow>.*too slow.*)?$', re.MULTILINE
)
_MESSAGES = re.compile(r'\d+ messages, (?P<lost>\d+|unknown) lost$', re.MULTILINE)
_ADVICE = (
    'close what else computes, and give the nodes real-time priority '
    '(docs/how-to/raspberry_pi.md, "Real time")'
)


@dataclass(frozen=True)
class DemoAccount:
    """Last words of the bridge and of the recorders.

    Attributes
    ----------
    cycles
        Of the bridge.
    too_slow
        Whether the host would have kept a real arm waiting.
    messages
        Of the recorder of each motion.
    lost
        Messages lost, of each motion; None where the middleware does not number them.
    """

    cycles: str
    too_slow: bool
    messages: Mapping[str, str]
    lost: Mapping[str, int | None]

    @classmethod
    def read(cls, bridge: Path, recorders: Mapping[str, Path]) -> DemoAccount:
        """Read the logs of the bridge and of the motions' recorders, by the motions' names.

        Raises
        ------
        ValueError
            If a log ends without an account.
        """
        cycles = _last(_CYCLES, bridge)
        messages = {name: _last(_MESSAGES, log) for name, log in recorders.items()}
        return cls(
            cycles[0],
            cycles['slow'] is not None,
            {name: found[0] for name, found in messages.items()},
            {name: _count(found['lost']) for name, found in messages.items()},
        )

    def lines(self) -> Iterator[str]:
        """Yield what to print at the end, warnings last."""
        yield f'Bridge    {self.cycles}'
        for name, text in self.messages.items():
            yield f'Recorder  {name}: {text}'
        if self.too_slow:
            yield (
                'NOTE      the world waited for this host, so the result is as on a faster one; a '
                f'real arm would not have waited: {_ADVICE}'
            )
        if any(self.lost.values()):
            lost = sum(filter(None, self.lost.values()))
            yield f'WARNING   the bags lack {lost} messages: {_ADVICE}'


def _count(text: str) -> int | None:
    return None if text == 'unknown' else int(text)


def _last(pattern: re.Pattern[str], log: Path) -> re.Match[str]:
    found = list(pattern.finditer(log.read_text(errors='replace')))
    if not found:
        raise ValueError(f'{log} ends without an account of {pattern.pattern!r}')
    return found[-1]
