"""`identifier --compare`: compare two results of the identifier or of the motor bench."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.files.estimate_comparison import (
    EstimateComparison,
    compare_benches,
    compare_estimates,
)
from aerarm_ros.identification.files.result_directory import MARKER, ResultDirectory
from aerarm_ros.identification.report.report import comparison_page

_FILE, _BENCH, _PAGE = 'estimate.yaml', 'motor_bench.yaml', 'comparison.html'


class CompareRun:
    """Compare two results; with `--out`, also write an HTML page and a JSON file.

    Parameters
    ----------
    options : argparse.Namespace
        Parsed arguments of the identifier.

    Raises
    ------
    IdentificationError
        If --bag, --model or --payload is passed in addition to --compare.
    """

    passed = True

    def __init__(self, options: argparse.Namespace) -> None:
        if options.bag or options.model or options.payload:
            raise IdentificationError(
                '--compare compares two existing results: remove --bag, --model and --payload'
            )
        self._paths: list[Path] = [_estimate(path) for path in options.compare]
        self._out: Path | None = options.out

    def execute(self) -> str:
        """Compare the two results, write the output files, and return text for the terminal.

        Raises
        ------
        IdentificationError, ConfigError
            If a result cannot be read, or the output cannot be written.
        """
        benches = [path.name == _BENCH for path in self._paths]
        if any(benches) and not all(benches):
            raise IdentificationError(
                '--compare cannot compare a result of motor_bench with a result of identifier: '
                'pass two results of the same program'
            )
        compare = compare_benches if all(benches) else compare_estimates
        comparison = compare(*self._paths)
        lines = _lines(comparison)
        if self._out is not None:
            old, new = (path.resolve().parent.name for path in self._paths)
            with ResultDirectory(self._out, files=(MARKER, _PAGE)) as directory:
                directory.write(_PAGE, comparison_page(comparison, old, new))
                changes = [
                    asdict(c) | {'deviations': c.deviations, 'clear': c.is_clear}
                    for c in comparison.changes
                ]
                directory.write_json(
                    MARKER, {'changes': changes, 'unmatched': comparison.unmatched}
                )
            lines.append(f'Page: {directory.target / _PAGE}')
        return '\n'.join(lines)


def _estimate(path: Path) -> Path:
    if not path.is_dir():
        return path
    return path / (_BENCH if (path / _BENCH).is_file() else _FILE)


def _lines(comparison: EstimateComparison) -> list[str]:
    """Return one line per significantly different parameter, then lines with parameter counts."""
    clear = [change for change in comparison.changes if change.is_clear]
    lines = [
        f'{change.name}: {change.old:.4g} -> {change.new:.4g} {change.unit}'.rstrip()
        + f' ({change.deviations:+.1f} standard deviations)'
        for change in clear
    ]
    lines.append(
        f'{len(clear)} of {len(comparison.changes)} parameters differ by more than three '
        'standard deviations'
    )
    if comparison.unmatched:
        lines.append(
            f'{comparison.unmatched} linear combinations of parameters are identifiable in only '
            'one of the two results, so they are not compared'
        )
    return lines
