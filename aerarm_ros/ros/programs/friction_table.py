"""Friction over days and weeks as a table: what `payload_estimator --trend` prints."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from aerarm_ros.online.friction_trend import FrictionTrend
from aerarm_ros.online.trend_file import read_trend
from aerarm_ros.ros.process.exit_status import USER_ERROR, print_error
from aerarm_ros.ros.process.one_line_parser import OneLineParser


def show_trend(name: str, arguments: Sequence[str]) -> int:
    """Print what a command line asks for; return 0, or 2 if there is something to check."""
    parser = OneLineParser(prog=name, description='Shows how friction has changed.')
    parser.add_argument(
        '--trend', type=Path, required=True, metavar='FILE', help='a friction_file of the node'
    )
    options = parser.parse_args(arguments)
    try:
        print(trend_table(read_trend(options.trend)))
    except (ValueError, OSError) as error:
        print_error(name, error)
        return USER_ERROR
    return 0


def trend_table(trend: FrictionTrend) -> str:
    """Return a line for each coefficient, those that have clearly changed marked."""
    records, changes = trend.records, trend.changes()
    if not changes:
        return f'{len(records)} records: a trend needs two'
    dates = (datetime.fromtimestamp(records[index].time, UTC) for index in (0, -1))
    first, last = (f'{date:%Y-%m-%d %H:%M}' for date in dates)
    width = max(len(change.name) for change in changes)
    lines = [
        f'{len(records)} records, {first} to {last} UTC',
        f'  {"":{width}}  {"first":>9} {"last":>9}   a week',
    ]
    for change in changes:
        mark = '*' if change.is_clear else ' '
        rate = f'{change.rate:+.2g} ± {change.rate_std:.2g}'
        lines.append(f'{mark} {change.name:{width}}  {change.old:9.4f} {change.new:9.4f}   {rate}')
    clear = sum(change.is_clear for change in changes)
    lines.append(f'* {clear} of {len(changes)} changed by more than three standard deviations')
    return '\n'.join(lines)
