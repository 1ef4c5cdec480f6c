"""Convert messages of the topic /diagnostics to HTML tables for the page."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from aerarm_ros.pages.html_text import Html, macros

_ERROR, _STALE = 2, 3  # levels in view.html
# Ages [s] above which a status is stale, and above which its node has ended. Nodes publish their
# status once per second.
_STALE_AFTER, _GONE_AFTER = 3.0, 10.0
_HINT = 'recovery hint'
# Column of the motors' table, and the end of its keys on /diagnostics.
_MOTOR_COLUMNS = {
    'winding': 'winding [degC]',
    'housing': 'housing [degC]',
    'torque limit': 'torque limit [Nm]',
    'reduced in': 'time to reduction [s]',
    'power': 'power [W]',
}


def elements() -> Any:
    """Return the template macros of the file `view.html`, which create HTML elements."""
    return macros(Path(__file__).with_name('view.html'))


class _Status(NamedTuple):
    """Content of a DiagnosticStatus message, and the monotonic time of its arrival [s]."""

    level: int
    message: str
    values: Mapping[str, str]
    received: float


class ViewDiagnostics:
    """Store the newest diagnostic status of each name, and convert all stored statuses to HTML."""

    def __init__(self) -> None:
        self._statuses: dict[str, _Status] = {}

    def add(
        self, name: str, level: int, message: str, values: Mapping[str, str], now: float
    ) -> None:
        """Store a status under its name, and delete the statuses of nodes that have ended.

        `now` is the monotonic time of arrival [s].
        """
        # A copy, because the thread that shows the statuses may be reading the old one.
        present = dict(self._present(now))
        self._statuses = {**present, name: _Status(level, message, values, now)}

    def recovery_hint(self, now: float) -> str:
        """Return the recovery hint that the bridge publishes during a fault, or an empty string."""
        statuses = [one for _, one in self._present(now) if self._level(one, now) != _STALE]
        return next((one.values[_HINT] for one in statuses if one.values.get(_HINT)), '')

    def motors_html(self, now: float) -> Html:
        """Return HTML tables of the motors' temperatures and torque limits, or an empty string."""
        heads = [f'{name} {end[end.index("[") :]}' for name, end in _MOTOR_COLUMNS.items()]
        tables = [
            (name, self._level(status, now), rows.items())
            for name, status in self._present(now)
            if (rows := motor_rows(status.values))
        ]
        return Html(elements().tables(tables, heads))

    def status_html(self, now: float) -> Html:
        """Return HTML with one line per status: level, name and message."""
        lines = [
            (name, self._level(status, now), status.message) for name, status in self._present(now)
        ]
        return Html(elements().statuses(lines))

    def _level(self, status: _Status, now: float) -> int:
        if now - status.received > _STALE_AFTER:
            return _STALE
        # Any node can publish there, with any byte.
        return status.level if status.level <= _STALE else _ERROR

    def _present(self, now: float) -> list[tuple[str, _Status]]:
        known = sorted(self._statuses.items())
        return [(name, status) for name, status in known if now - status.received < _GONE_AFTER]


def motor_rows(values: Mapping[str, str]) -> dict[str, list[str]]:
    """Return the rows of the motors' table by joint name; a row contains one text per column.

    In a diagnostic status, the key of a value is, for example, 'joint2 winding [degC]'.
    """
    ends = list(_MOTOR_COLUMNS.values())
    joints = [key.removesuffix(f' {ends[0]}') for key in values if key.endswith(f' {ends[0]}')]
    return {joint: [values.get(f'{joint} {end}', '') for end in ends] for joint in joints}
