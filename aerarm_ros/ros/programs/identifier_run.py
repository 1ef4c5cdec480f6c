"""One run of the identifier: bags in, files and a table out."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, replace
from pathlib import Path

from aerarm_ros.identification.assessment.bag_energy import bag_energies
from aerarm_ros.identification.assessment.identification_result import IdentificationResult
from aerarm_ros.identification.assessment.truth import inertial_torque_errors, load_truth
from aerarm_ros.identification.assessment.verdict import Verdict, judge, read_limits
from aerarm_ros.identification.conditioning.conditioning_options import ConditioningOptions
from aerarm_ros.identification.files.result_directory import MARKER, ResultDirectory
from aerarm_ros.identification.files.summary import summarise
from aerarm_ros.identification.identify import IdentificationOptions, identify
from aerarm_ros.identification.parameters.link_bounds import LinkBounds
from aerarm_ros.identification.payload.identify_payload import identify_payload
from aerarm_ros.identification.payload.payload import Payload
from aerarm_ros.identification.recording.identification_error import IdentificationError
from aerarm_ros.identification.recording.recording import Recording
from aerarm_ros.identification.report.report import ReportExtras
from aerarm_ros.identification.solvers.solvers import FAST
from aerarm_ros.identification.stopwatch import Stopwatch
from aerarm_ros.ros.programs.identifier_bags import repeated_bags
from aerarm_ros.ros.programs.identifier_files import RESULT_FILES, write_result
from aerarm_ros.ros.programs.identifier_table import terminal_table
from aerarm_ros.ros.programs.recorded_arm import RecordedArm, pair


class IdentifierRun:
    """What the command line asks for.

    Parameters
    ----------
    options : argparse.Namespace
        Parsed arguments of the identifier.

    Raises
    ------
    IdentificationError, DescriptionError, ConfigError, BagError
        If an argument, the URDF or the configuration is wrong.
    """

    def __init__(self, options: argparse.Namespace) -> None:
        self._options = options
        self._stopwatch = Stopwatch()
        if not 0.0 <= options.holdout < 1.0:
            raise IdentificationError(f'--holdout {options.holdout:g} must lie in 0 .. 1')
        paths: list[Path] = [*options.bag, *options.validation, *options.payload]
        self._arm = RecordedArm(options, paths)
        self._limits = read_limits(options.verify) if options.verify else {}
        self._verdict: Verdict | None = None

    @property
    def passed(self) -> bool:
        """Whether the result keeps the limits that were asked for; True without any."""
        return self._verdict is None or self._verdict.passed

    def execute(self) -> str:
        """Identify, write the result, and return a table for the terminal.

        Raises
        ------
        IdentificationError, BagError
            If a bag can't be identified from, or the result can't be written.
        """
        options = self._options
        default = Path('output') / time.strftime('identification_%Y%m%d_%H%M%S', options.started)
        with ResultDirectory(options.out or default, files=RESULT_FILES) as directory:
            identification, validation = self._read()
            result = self._identify(identification, validation)
            payload = self._payload(result)
            self._write(result, payload, directory)
        tell_replaced(directory)
        lines = [terminal_table(result, self._arm.facts())]
        if payload is not None:
            lines.append(f'Payload: {payload.mass:.4g} ± {payload.std[0]:.2g} kg')
        if self._verdict is not None:
            lines.append(self._verdict.text)
        return '\n'.join(lines) + f'\nReport: {directory.target / "report.html"}'

    def _read(self) -> tuple[list[Recording], list[Recording]]:
        with self._stopwatch.stage('reading'):
            identification = [self._recording(path) for path in self._options.bag]
            validation = [self._recording(path) for path in self._options.validation]
        self._arm.messages += repeated_bags(self._options.bag, self._options.validation)
        share = self._options.holdout
        if share > 0.0:
            cut = 1.0 - share
            first, last = f' [first {100 * cut:g} %]', f' [last {100 * share:g} %]'
            validation += [recording.part(cut, 1.0, last) for recording in identification]
            identification = [recording.part(0.0, cut, first) for recording in identification]
        return identification, validation

    def _recording(self, path: Path) -> Recording:
        _progress(f'reading {self._arm.name(path)}')
        return self._arm.recording(path)

    def _identify(
        self, identification: Sequence[Recording], validation: Sequence[Recording]
    ) -> IdentificationResult:
        options = self._options
        _progress('identifying')
        chosen = IdentificationOptions(
            conditioning=ConditioningOptions(
                fundamental=options.fundamental,
                harmonics=options.harmonics,
                cutoff=options.cutoff,
                filter=options.filter,
                exact_stamps=options.exact_stamps,
            ),
            friction=options.friction,
            coupled=tuple(pair(text, '--coupled') for text in options.coupled),
            solvers=tuple(options.solvers) or FAST,
            bounds=LinkBounds(
                tuple(options.total_mass) if options.total_mass else None, options.bound_centres
            ),
            tilt=not options.exact_gravity,
            rollouts=options.rollouts,
            progress=lambda solver: _progress(f'solving by {solver}'),
        )
        result = identify(
            self._arm.robot, self._arm.config, identification, validation, chosen, self._stopwatch
        )
        result.warnings[:0] = self._arm.messages
        tell(result.warnings)
        return result

    def _payload(self, result: IdentificationResult) -> Payload | None:
        if not self._options.payload:
            return None
        _progress('identifying the payload')
        known = len(self._arm.messages)
        with self._stopwatch.stage('reading'):
            recordings = [self._recording(path) for path in self._options.payload]
        tell(self._arm.messages[known:])
        result.warnings.extend(self._arm.messages[known:])
        with self._stopwatch.stage('payload'):
            return identify_payload(result, recordings)

    def _write(
        self, result: IdentificationResult, payload: Payload | None, directory: ResultDirectory
    ) -> None:
        _progress('writing the report')
        with self._stopwatch.stage('writing'):
            extras = replace(self._extras(result), payload=payload)
            tell(write_result(result, directory, extras))
        summary = summarise(
            result, self._stopwatch.seconds, extras.truth_errors, payload, extras.facts
        )
        if self._limits:
            self._verdict = judge(result, self._limits)
            checks = [asdict(check) for check in self._verdict.checks]
            summary['verdict'] = {'passed': self._verdict.passed, 'checks': checks}
        directory.write_json(MARKER, summary)

    def _extras(self, result: IdentificationResult) -> ReportExtras:
        bags = self._arm.read.items()
        desired = {name: bag.desired for name, bag in bags if bag.desired is not None}
        config = self._arm.config
        energy = bag_energies(config, result) if config else {}
        joints = config.joints if config else ()
        used = {joint.name: joint.motor.resistance_text for joint in joints}
        extras = ReportExtras(desired, facts=self._arm.facts(), energy=energy, resistances=used)
        if self._options.truth is None:
            return extras
        truth = load_truth(self._options.truth, result.fit.model)
        errors = inertial_torque_errors(
            truth,
            [solution.estimate for solution in result.solutions.values()],
            [*result.identification, *result.validation],
        )
        return replace(extras, truth=truth, truth_errors=errors)


def tell(texts: Iterable[str]) -> None:
    """Print what the user should know, one line each."""
    for text in texts:
        print(f'identifier: {text}', file=sys.stderr)


def tell_replaced(directory: ResultDirectory) -> None:
    """Say so if the result took the place of an earlier one."""
    if directory.replaced:
        tell([f'{directory.target}: an earlier result was replaced'])


def _progress(text: str) -> None:
    if sys.stderr.isatty():
        print(f'identifier: {text} ...', file=sys.stderr)
