"""`identifier --each`: identify one arm per bag, and write one table and page for all bags."""

from __future__ import annotations

import argparse
import csv
import glob
import hashlib
import io
import json
import platform
import sys
import time
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np

from aerarm_ros.description.resources import write_whole
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.identification_result import judge, read_limits
from aerarm_ros.identification.recording.table_file import TABLES
from aerarm_ros.identification.report.fleet_page import fleet_page
from aerarm_ros.pages.html_text import package_version
from aerarm_ros.parallel import Failure, run_each
from aerarm_ros.ros.process.process_end import ProgressLine, print_notice
from aerarm_ros.ros.programs.identifier_options import result_folder
from aerarm_ros.ros.programs.identifier_run import IdentifierRun

Row = dict[str, str | float | int | bool | None]

OK, FAILED = 'ok', 'failed'
STD = '_std'
"""Suffix of the table columns that contain standard deviations."""
KEYS = ('bag', 'arm', 'date', 'status', 'reason')
"""First columns of the table; the row of a bag that was not identified has no other values."""


def identify(bag: Path, settings: argparse.Namespace) -> Row:
    """Identify an arm from one bag, and return the bag's row of the table.

    Parameters
    ----------
    bag : Path
        Recording; its last part (`settings.holdout`) serves for validation only.
    settings : argparse.Namespace
        Options of the identifier, and `arm_of_folder`. If `arm_of_folder` is true, the arm has the
        name of the bag's folder, otherwise the name in the URDF.

    Returns
    -------
    dict
        Value by column name, None for a missing value. The column of a parameter has the name of
        the parameter's regressor column. The column of the parameter's standard deviation has this
        name with the suffix `_std`.

    Raises
    ------
    BagError, ConfigError, DescriptionError, IdentificationError
        If the bag cannot be used for identification.
    """
    options = argparse.Namespace(**{**vars(settings), 'bag': [bag]})
    result, start, seconds = IdentifierRun(options).identified()
    estimate = result.recommended.estimate
    row = first_columns(bag, settings, result.robot.model.name)
    row['date'] = _date(start)
    row['status'] = OK
    row |= {
        'samples': result.samples,
        'seconds': seconds,
        'cutoff': result.conditioner.cutoff,
        'condition_number': _number(result.thesis_base.condition_number),
        'physically_consistent': estimate.physically_consistent,
    }
    for role, solver in product(('identification', 'validation'), ('cad_friction', 'sdp')):
        assessed = getattr(result.solutions[solver], role)
        for kind in ('filtered', 'raw'):
            error = getattr(assessed[0], kind) if assessed else None
            row[f'{role}_{solver}_{kind}'] = error
    limits = read_limits(settings.verify) if settings.verify else {}
    checks = judge(result, limits)
    row['verdict'] = all(check.passed for check in checks) if limits else None
    row['warnings'] = len(result.warnings)
    row['first_warning'] = result.warnings[0] if result.warnings else None
    std = np.full(len(estimate.theta), np.nan) if estimate.std is None else estimate.std
    for name, value, deviation in zip(estimate.model.columns, estimate.theta, std, strict=True):
        row[name], row[name + STD] = float(value), _number(float(deviation))
    row['aerarm_ros_version'] = package_version()
    row['python_version'] = platform.python_version()
    return row


def first_columns(bag: Path, settings: argparse.Namespace, robot: str = '') -> Row:
    """Return the first columns of a bag's row, with the status `failed` and without a reason."""
    arm = bag.resolve().parent.name if settings.arm_of_folder else robot
    return {'bag': str(bag), 'arm': arm, 'date': None, 'status': FAILED, 'reason': None}


def _date(start: float) -> str | None:
    """Return the start of a recording [s since 1970] as text; None for tables without a date."""
    day = 86400.0
    if start < day:
        return None
    return datetime.fromtimestamp(start, UTC).isoformat(timespec='seconds')


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


JOURNAL, TABLE, COLUMNS, PAGE = 'rows.jsonl', 'fleet.csv', 'fleet.parquet', 'fleet.html'
_BAG_FILES = ('.mcap', '.db3', '.bag', *TABLES)
_LIST = '.txt'
# Options on which the content of a row does not depend.
_NOT_IN_ROWS = ('each', 'out', 'workers', 'worker_memory', 'started', 'bag')


class FleetRun:
    """Identify the arm in each bag, and store each row of the table as soon as it is known.

    Parameters
    ----------
    options : argparse.Namespace
        Parsed arguments of the identifier.

    Raises
    ------
    IdentificationError
        If --each names no bag, or another option contradicts --each.
    """

    def __init__(self, options: argparse.Namespace) -> None:
        given = {'--bag': options.bag, '--validation': options.validation}
        given |= {'--payload': options.payload, '--truth': options.truth}
        if wrong := [name for name, value in given.items() if value]:
            raise IdentificationError(
                f'{", ".join(wrong)} cannot be combined with --each: remove this option. To '
                'validate the models, pass --holdout'
            )
        self._bags = find_bags(options.each)
        folders = {bag.resolve().parent for bag in self._bags}
        self._settings = argparse.Namespace(**vars(options), arm_of_folder=len(folders) > 1)
        self._out = result_folder(options, 'fleet')
        self._rows: dict[str, Row] = {}

    @property
    def passed(self) -> bool:
        """Whether the torque errors of all identified bags satisfy the limits given by --verify."""
        return all(row.get('verdict') is not False for row in self._rows.values())

    def execute(self) -> str:
        """Identify the arm in each bag without a row, and return a summary for the terminal.

        Raises
        ------
        IdentificationError
            If the table cannot be written, or no bag could be used.
        """
        self._out.mkdir(parents=True, exist_ok=True)
        marks = {str(bag): self._mark(bag) for bag in self._bags}
        known = self._known(marks)
        self._rows |= known
        missing = [bag for bag in self._bags if str(bag) not in known]
        if known:
            print_notice(
                'identifier',
                f'the folder {self._out} already contains the results of {len(known)} of '
                f'{len(self._bags)} bags',
            )
        progress = ProgressLine('identifier', sys.stderr)
        try:
            with (self._out / JOURNAL).open('a', encoding='utf-8') as journal:
                for index, outcome in self._outcomes(missing):
                    row = self._row(missing[index], outcome)
                    self._rows[str(row['bag'])] = row
                    if not isinstance(outcome, Failure) or outcome.is_final:
                        entry = {'mark': marks[str(row['bag'])], 'row': row}
                        journal.write(json.dumps(entry, allow_nan=False) + '\n')
                        journal.flush()
                    tenth = str(10 * len(self._rows) // len(self._bags))
                    if progress.due(time.monotonic_ns(), tenth):
                        progress.show(f'{len(self._rows)} of {len(self._bags)} bags')
        finally:
            progress.close()
            self._write()
        return self._summary()

    def _outcomes(self, bags: Sequence[Path]) -> Iterator[tuple[int, Row | Failure]]:
        settings = self._settings
        function = partial(identify, settings=settings)
        yield from run_each(function, bags, settings.workers, settings.worker_memory)

    def _row(self, bag: Path, outcome: Row | Failure) -> Row:
        if not isinstance(outcome, Failure):
            return outcome
        return first_columns(bag, self._settings) | {'reason': outcome.reason}

    def _mark(self, bag: Path) -> str:
        """Return a hash of the bag's files and of the options that determine its row."""
        files = sorted(bag.iterdir()) if bag.is_dir() else [bag]
        facts = [(file.name, file.stat().st_size, file.stat().st_mtime_ns) for file in files]
        options = sorted(
            (name, str(value))
            for name, value in vars(self._settings).items()
            if name not in _NOT_IN_ROWS
        )
        return hashlib.sha256(repr((facts, options)).encode()).hexdigest()[:16]

    def _known(self, marks: dict[str, str]) -> dict[str, Row]:
        """Return rows that an earlier run stored, for bags and options that have not changed."""
        found: dict[str, Row] = {}
        path = self._out / JOURNAL
        if not path.is_file():
            if any(self._out.iterdir()):
                raise IdentificationError(
                    f'the folder {self._out} contains files of another program: name another '
                    'folder with --out'
                )
            return found
        for line in path.read_text(encoding='utf-8').splitlines():
            try:
                entry = json.loads(line)
                bag = str(entry['row']['bag'])
                if marks.get(bag) == entry['mark']:
                    found[bag] = entry['row']
            except (ValueError, KeyError, TypeError):
                continue  # the earlier run ended while it wrote this line
        return found

    def _write(self) -> None:
        rows = [self._rows[str(bag)] for bag in self._bags if str(bag) in self._rows]
        names = dict.fromkeys(name for row in rows for name in row)
        columns = [*KEYS, *(name for name in names if name not in KEYS)]
        text = io.StringIO(newline='')
        writer = csv.DictWriter(text, columns, lineterminator='\n')
        writer.writeheader()
        writer.writerows(rows)
        write_whole(self._out / TABLE, text.getvalue())
        write_whole(self._out / PAGE, fleet_page(rows))
        try:
            import pyarrow
            import pyarrow.parquet
        except ImportError:
            print_notice(
                'identifier',
                f'{COLUMNS} is not written, because the Python package pyarrow is missing: run '
                "pip install 'aerarm_ros[fleet]'",
            )
            return
        table = pyarrow.table({name: [row.get(name) for row in rows] for name in columns})
        partial_file = self._out / f'.{COLUMNS}.part'
        pyarrow.parquet.write_table(table, partial_file)
        partial_file.replace(self._out / COLUMNS)

    def _summary(self) -> str:
        failed = [row for row in self._rows.values() if row['status'] != OK]
        if len(failed) == len(self._rows):
            first = failed[0]
            raise IdentificationError(
                f'none of {len(failed)} bags could be identified. The first bag, '
                f'{first["bag"]}, failed: {first["reason"]}'
            )
        lines = [f'{len(self._rows) - len(failed)} of {len(self._rows)} bags identified']
        lines += [f'failed: {row["bag"]}: {row["reason"]}' for row in failed]
        lines += [f'Table: {self._out / TABLE}', f'Page: {self._out / PAGE}']
        return '\n'.join(lines)


def find_bags(given: Sequence[Path]) -> list[Path]:
    """Return the bags that the arguments of `--each` name, sorted and without duplicates.

    An argument is a bag, a folder to search for bags, a pattern, or a .txt file with one path per
    line.

    Raises
    ------
    IdentificationError
        If an argument names no bag.
    """
    found: list[Path] = []
    for path in given:
        bags = list(_bags_of(path))
        if not bags:
            raise IdentificationError(
                f'--each {path} names no bag: pass rosbag2 folders, {", ".join(_BAG_FILES)} '
                f'files, folders that contain bags, a quoted pattern, or a {_LIST} file with one '
                'path per line'
            )
        found += bags
    return sorted(dict.fromkeys(found))


def _bags_of(path: Path) -> Iterator[Path]:
    if (path / 'metadata.yaml').is_file():
        yield path
    elif path.is_dir():
        for entry in sorted(path.iterdir()):
            if entry.is_dir() or entry.suffix.lower() in _BAG_FILES:
                yield from _bags_of(entry)
    elif path.suffix == _LIST and path.is_file():
        lines = [line.strip() for line in path.read_text(encoding='utf-8').splitlines()]
        for line in lines:
            if line and not line.startswith('#'):
                yield from _bags_of(path.parent / line)
    elif path.is_file():
        yield path
    elif glob.has_magic(str(path)):
        for match in sorted(glob.glob(str(path), recursive=True)):
            yield from _bags_of(Path(match))
