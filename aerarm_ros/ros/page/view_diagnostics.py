"""Diagnostics as tables for people."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape

LEVELS = ('OK', 'WARN', 'ERROR', 'STALE')
_ERROR, _STALE = 2, 3
_WAY_OUT = 'way out'
_COLORS = ('#2b8a3e', '#b06000', '#c92a2a', '#868e96')
_STATISTICS = ('mean', 'std', 'p50', 'p99', 'p99.9', 'max')
_TIMING_KEY = re.compile(rf'(.+) ({"|".join(map(re.escape, _STATISTICS))}) \[us\]')
# Column of the motors' table: what its keys on /diagnostics end with.
_MOTOR_COLUMNS = {
    'winding': 'winding [degC]',
    'housing': 'housing [degC]',
    'torque limit': 'torque limit [Nm]',
    'reduced in': 'time to reduction [s]',
    'power': 'power [W]',
}
_CELL = 'style="padding:1px 6px;text-align:right"'


@dataclass(frozen=True)
class ViewStatus:
    """One DiagnosticStatus as it arrived.

    Attributes
    ----------
    level
        0 OK, 1 WARN, 2 ERROR, 3 STALE.
    message
        What the publisher says.
    values
        Key to value.
    received
        Monotonic time of arrival [s].
    """

    level: int
    message: str
    values: Mapping[str, str] = field(default_factory=dict)
    received: float = 0.0


class ViewDiagnostics:
    """Newest status of every name, and how long ago it came.

    Parameters
    ----------
    stale_after
        Age at which a status is shown as stale [s]; publishers send once a second.
    gone_after
        Age at which it is shown no more: its node has ended [s].
    """

    def __init__(self, stale_after: float = 3.0, gone_after: float = 10.0) -> None:
        self._stale_after = stale_after
        self._gone_after = gone_after
        self._statuses: dict[str, ViewStatus] = {}

    def add(self, name: str, status: ViewStatus) -> None:
        """Store a status; it replaces the one of the same name."""
        # A copy: the thread that shows them reads the one before meanwhile.
        latest = {**self._statuses, name: status}
        self._statuses = {
            key: kept
            for key, kept in latest.items()
            if status.received - kept.received < self._gone_after
        }

    def way_out(self, now: float) -> str:
        """Return what ends the arm's fault, as its bridge tells it; '' without one."""
        texts = [
            status.values.get(_WAY_OUT, '')
            for _, status in self._present(now)
            if self._level(status, now) != _STALE
        ]
        return next(filter(None, texts), '')

    def timing_html(self, now: float) -> str:
        """Return a table of the quantiles [us] in all statuses, '' if none has any."""
        tables = [
            f'<b>{escape(name)}</b> {_badge(self._level(status, now))}{_timing_table(rows)}'
            f'<div>{escape(_counts(status.values))}</div>'
            for name, status in self._present(now)
            if (rows := timing_rows(status.values))
        ]
        return ''.join(tables)

    def motors_html(self, now: float) -> str:
        """Return a table of temperatures and torque limits, '' if no status has any."""
        tables = [
            f'<b>{escape(name)}</b> {_badge(self._level(status, now))}{_motor_table(rows)}'
            for name, status in self._present(now)
            if (rows := motor_rows(status.values))
        ]
        return ''.join(tables)

    def status_html(self, now: float) -> str:
        """Return one line for every status."""
        lines = [
            f'<div>{_badge(self._level(status, now))} <b>{escape(name)}</b> '
            f'{escape(status.message)}</div>'
            for name, status in self._present(now)
        ]
        return ''.join(lines) or '<i>nothing on /diagnostics yet</i>'

    def _level(self, status: ViewStatus, now: float) -> int:
        if now - status.received > self._stale_after:
            return _STALE
        # Anybody can publish there, and any byte.
        return status.level if status.level < len(LEVELS) else _ERROR

    def _present(self, now: float) -> list[tuple[str, ViewStatus]]:
        statuses = sorted(self._statuses.items())
        return [(n, status) for n, status in statuses if now - status.received < self._gone_after]


def timing_rows(values: Mapping[str, str]) -> dict[str, dict[str, str]]:
    """Return quantity -> statistic -> microseconds out of keys like 'period p99 [us]'."""
    rows: dict[str, dict[str, str]] = {}
    for key, value in values.items():
        match = _TIMING_KEY.fullmatch(key)
        if match:
            rows.setdefault(match[1], {})[match[2]] = value
    return rows


def motor_rows(values: Mapping[str, str]) -> dict[str, list[str]]:
    """Return joint -> a text a column, out of keys like 'joint2 winding [degC]'."""
    ends = list(_MOTOR_COLUMNS.values())
    joints = [key.removesuffix(f' {ends[0]}') for key in values if key.endswith(f' {ends[0]}')]
    return {joint: [values.get(f'{joint} {end}', '') for end in ends] for joint in joints}


def _motor_table(rows: Mapping[str, Sequence[str]]) -> str:
    heads = [f'{name} {end[end.index("[") :]}' for name, end in _MOTOR_COLUMNS.items()]
    return _table(_row('th', '', heads) + ''.join(_row('td', *row) for row in rows.items()))


def _timing_table(rows: Mapping[str, Mapping[str, str]]) -> str:
    head = _row('th', 'us', _STATISTICS)
    body = ''.join(
        _row('td', name, [row.get(statistic, '') for statistic in _STATISTICS])
        for name, row in rows.items()
    )
    return _table(head + body)


def _table(rows: str) -> str:
    table = f'<table style="border-collapse:collapse;font-size:0.85em">{rows}</table>'
    return f'<div style="overflow-x:auto">{table}</div>'  # a panel may be narrow


def _row(tag: str, name: str, cells: Sequence[str]) -> str:
    numbers = ''.join(f'<{tag} {_CELL}>{escape(cell)}</{tag}>' for cell in cells)
    return f'<tr><td>{escape(name)}</td>{numbers}</tr>'


def _counts(values: Mapping[str, str]) -> str:
    return ', '.join(f'{k}: {v}' for k, v in values.items() if not _TIMING_KEY.fullmatch(k))


def _badge(level: int) -> str:
    return f'<b style="color:{_COLORS[level]}">{LEVELS[level]}</b>'
