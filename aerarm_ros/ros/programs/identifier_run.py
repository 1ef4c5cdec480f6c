"""`identifier`: read bags, identify the model, and write the result files."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from aerarm_msgs_py.storage.read_limits import ReadLimits
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import STANDARD_GRAVITY, load_robot
from aerarm_ros.identification.conditioning.motion_check import ConditioningOptions
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.files.estimate_file import (
    estimate_yaml,
    estimated_arm,
    payload_yaml,
    read_estimate,
)
from aerarm_ros.identification.files.identified_robot import (
    LoadFriction,
    equivalent_friction,
    identified_mjcf,
    identified_sdf,
    identified_urdf,
    unwritten,
)
from aerarm_ros.identification.files.result_directory import MARKER, ResultDirectory
from aerarm_ros.identification.files.summary import (
    ExportError,
    ReportExtras,
    export_errors,
    summarise,
)
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.identify import IdentificationOptions, Stopwatch, identify
from aerarm_ros.identification.joint_model import LinkBounds, TermKind
from aerarm_ros.identification.recording.recording import BagFacts, JointMapping, Recording
from aerarm_ros.identification.recording.table_file import TABLES, TableOptions
from aerarm_ros.identification.report import report_html
from aerarm_ros.identification.solvers.solvers import DEFAULT, check_solvers
from aerarm_ros.ros.process.process_end import print_notice
from aerarm_ros.ros.programs.identifier_bags import (
    IdentifierBags,
    RecordedBag,
    bag_names,
    hold_out,
    repeated_bags,
)
from aerarm_ros.ros.programs.identifier_options import result_folder

if TYPE_CHECKING:  # only for type annotations
    from aerarm_ros.identification.payload import Payload

RESULT_FILES = (
    *('estimate.yaml', 'identified.urdf', 'identified.xml', 'identified.sdf', 'payload.yaml'),
    *('report.html', MARKER),
)
"""Names of the files that `identifier` writes."""


def write_result(
    result: IdentificationResult,
    directory: ResultDirectory,
    extras: ReportExtras,
    stopwatch: Stopwatch,
) -> tuple[str, ...]:
    """Write all result files; return warnings about the files.

    Raises
    ------
    IdentificationError
        If a file cannot be written.
    """
    estimate = result.recommended.estimate
    with stopwatch.stage('writing'):
        viscous, coulomb = equivalent_friction(estimate, result.identification)
        directory.write('estimate.yaml', estimate_yaml(result, estimate, viscous, coulomb))
        load = estimate.joint_values(TermKind.LOAD.value)
        others = equivalent_friction(estimate, result.identification, beside_load=True)
        friction = (viscous, coulomb, LoadFriction(load, *others))
        urdf = identified_urdf(result.robot, estimate.inertial, *friction)
        notes = (*urdf.warnings, *unwritten(estimate))
        result.warnings.extend(text for text in notes if text not in result.warnings)
        directory.write('identified.urdf', urdf.text)
        rotors = estimate.joint_values(TermKind.ROTOR.value)
        values = (estimate.inertial, viscous, coulomb, rotors)
        directory.write('identified.xml', identified_mjcf(result.robot, *values))
        directory.write('identified.sdf', identified_sdf(result.robot, *values))
        if extras.payload is not None:
            directory.write('payload.yaml', payload_yaml(estimate, extras.payload))
        directory.write('report.html', report_html(result, extras))
    directory.write_json(MARKER, summarise(result, stopwatch.seconds, extras))
    return notes


_NAME = 'identifier'
_NAME_WIDTH = 13
_ROLES = ('identification', 'validation')


def exports_text(exports: Sequence[ExportError], judged: Sequence[Recording]) -> str:
    """Return a table with the largest torque error, over the bags, of the model in each file."""
    bags = judged[0].name if len(judged) == 1 else f'the worst of {len(judged)} bags'
    lines = [f'Low-passed torque error [%] on {bags}, of the model in each written file']
    width = max((len(error.file) for error in exports), default=0)
    for error in exports:
        worst = max(error.filtered[-len(judged) :])
        lines.append(f'{error.file.ljust(width)}  {worst:6.2f}  {error.contents}')
    return '\n'.join(lines)


def terminal_table(result: IdentificationResult, facts: Mapping[str, BagFacts]) -> str:
    """Return a table of each solver's torque error on each bag, and facts about each bag.

    Parameters
    ----------
    facts : mapping
        Facts about each bag, by the bag's name.
    """
    groups = zip(_ROLES, (result.identification, result.validation), strict=True)
    bags = [(role, bag.samples.name) for role, columns in groups for bag in columns]
    width = max(22, *(len(text) for heading in bags for text in heading)) + 2
    lines = ['Torque error [%], filtered / only the measured torque filtered (raw)']
    for row in zip(*bags, strict=True):
        lines.append(' ' * _NAME_WIDTH + ''.join(text.rjust(width) for text in row))
    for name, solution in result.solutions.items():
        cells = [
            f'{bag.filtered:.2f} / {bag.filtered_measured:.2f} ({bag.raw:.2f})'.rjust(width)
            for bag in (*solution.identification, *solution.validation)
        ]
        if not solution.estimate.physically_consistent:
            cells.append('  not physically consistent')
        lines.append(name.ljust(_NAME_WIDTH) + ''.join(cells))
    if result.gravity.tilt > 0.0:
        degrees = math.degrees(result.gravity.tilt)
        lines.append(
            f'the estimated gravity differs by {degrees:.2f} degrees from the direction of '
            '--gravity; the result uses the estimated gravity'
        )
    lines += [f'{bag}: {known.text}' for bag, known in facts.items()]
    return '\n'.join(lines)


_MB = 2**20  # bytes


class RecordedArm:
    """URDF, drive configuration and recordings of one arm, read as the options specify.

    Parameters
    ----------
    options : argparse.Namespace
        Options of `identifier_options.add_arm_options`.
    paths : sequence of Path
        All bags and tables that the program will read.
    whole : bool
        Whether to use all messages of a bag, even those recorded while the arm rests.

    Attributes
    ----------
    config : ArmConfig or None
        Configuration of the arm; None if --urdf names another arm and --config is not given.
    messages : list of str
        Warnings from reading the bags, to which callers may add.
    read : dict
        Content of each bag that was read, by the bag's name.

    Raises
    ------
    IdentificationError, DescriptionError, ConfigError
        If an option, the URDF or the configuration is wrong.
    """

    def __init__(
        self, options: argparse.Namespace, paths: Sequence[Path], whole: bool = False
    ) -> None:
        self._names = bag_names(paths)
        tables = any(path.suffix.lower() in TABLES for path in paths)
        given = {
            '--degrees': options.degrees,
            '--rate': options.rate is not None,
            '--numbered-from': options.numbered_from is not None,
        }
        for option in () if tables else [name for name, is_given in given.items() if is_given]:
            raise IdentificationError(
                f'{option} applies to tables (.csv, .npz) only, but all inputs are bags, which '
                'contain stamps, joint names and angles in rad: remove the option'
            )
        # The packaged configuration describes the motors of the packaged arm only.
        is_known = options.config is not None or options.urdf is None
        self.config = load_arm_config(options.config) if is_known else None
        gravity = options.gravity
        if gravity is None:
            gravity = self.config.gravity_in_base if self.config else STANDARD_GRAVITY
        self.robot = load_robot(options.urdf, gravity_in_base=gravity, locked=options.lock)
        mapping = JointMapping(
            rename=dict(options.rename),
            prefix=options.tf_prefix,
            ignored=tuple(options.ignore),
            locked=tuple(options.lock),
            effort_gain=dict(options.effort_gain),
        )
        limits = ReadLimits(_MB * options.bag_part, options.bag_ratio)
        table = TableOptions(options.rate, options.degrees, options.numbered_from)
        self._bags = IdentifierBags(
            options.topic, self.robot.joint_names, mapping, limits, table, whole
        )
        self.messages = self._bags.messages
        self.read: dict[str, RecordedBag] = {}

    def name(self, path: Path) -> str:
        """Return the short name of a bag, for messages and tables."""
        return self._names[path]

    def recording(self, path: Path) -> Recording:
        """Read and return the recording of a bag, or raise BagError or IdentificationError."""
        name = self._names[path]
        self.read[name] = self._bags.read(path, name)
        return self.read[name].recording

    def facts(self) -> dict[str, BagFacts]:
        """Return, for each bag that was read, which messages were used and which are missing."""
        return {name: bag.facts for name, bag in self.read.items()}


UNCALIBRATED = 0.1
"""Assumed relative standard deviation of a torque constant from a data sheet or a paper."""


def gain_deviation(options: argparse.Namespace) -> float:
    """Return the relative standard deviation of the effort gains from `--effort-gain-std`."""
    usual = UNCALIBRATED if options.effort_gain else 0.0
    return usual if options.effort_gain_std is None else float(options.effort_gain_std)


class IdentifierRun:
    """Identify an arm with the options of the command line.

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
        check_solvers(options.solvers)
        paths: list[Path] = [*options.bag, *options.validation, *options.payload]
        self._arm = RecordedArm(options, paths)
        self._exports: Sequence[ExportError] = ()

    def execute(self) -> str:
        """Identify the arm, write the result folder, and return a table for the terminal.

        Raises
        ------
        IdentificationError, BagError
            If a bag cannot be used for identification, or the result cannot be written.
        """
        options = self._options
        with ResultDirectory(
            result_folder(options, 'identification'), files=RESULT_FILES
        ) as directory:
            identification, validation = self._read()
            result = self._identify(identification, validation)
            print_notice(_NAME, *result.warnings)
            payload = self._payload(result)
            self._write(result, payload, directory)
        _print_replaced(directory)
        lines = [terminal_table(result, self._arm.facts())]
        lines.append(exports_text(self._exports, validation or identification))
        if payload is not None:
            lines.append(f'Payload: {payload.mass:.4g} ± {payload.std[0]:.2g} kg')
        return '\n'.join(lines) + f'\nReport: {directory.target / "report.html"}'

    def _read(self) -> tuple[list[Recording], list[Recording]]:
        with self._stopwatch.stage('reading'):
            identification = [self._recording(path) for path in self._options.bag]
            validation = [self._recording(path) for path in self._options.validation]
        self._arm.messages += repeated_bags(self._options.bag, self._options.validation)
        identification, held_out = hold_out(identification, self._options.holdout)
        return identification, validation + held_out

    def _recording(self, path: Path) -> Recording:
        _progress(f'reading {self._arm.name(path)}')
        return self._arm.recording(path)

    def _identify(
        self, identification: Sequence[Recording], validation: Sequence[Recording]
    ) -> IdentificationResult:
        options = self._options
        _progress('identifying')
        chosen = IdentificationOptions(
            conditioning=_conditioning(options),
            friction=options.friction,
            coupled=tuple(options.coupled),
            solvers=tuple(options.solvers) or DEFAULT,
            bounds=LinkBounds(
                tuple(options.total_mass) if options.total_mass else None, options.bound_centres
            ),
            tilt=not options.exact_gravity,
            progress=lambda solver: _progress(f'solving by {solver}'),
        )
        result = identify(
            self._arm.robot, self._arm.config, identification, validation, chosen, self._stopwatch
        )
        result.warnings[:0] = self._arm.messages
        return result

    def _payload(self, result: IdentificationResult) -> Payload | None:
        if not self._options.payload:
            return None
        from aerarm_ros.identification.payload import identify_payload

        _progress('identifying the payload')
        known = len(self._arm.messages)
        with self._stopwatch.stage('reading'):
            recordings = [self._recording(path) for path in self._options.payload]
        print_notice(_NAME, *self._arm.messages[known:])
        result.warnings.extend(self._arm.messages[known:])
        with self._stopwatch.stage('payload'):
            return identify_payload(result, recordings, gain_deviation(self._options))

    def _write(
        self, result: IdentificationResult, payload: Payload | None, directory: ResultDirectory
    ) -> None:
        _progress('writing the report')
        extras = replace(self._extras(result), payload=payload)
        print_notice(_NAME, *write_result(result, directory, extras, self._stopwatch))
        self._exports = extras.exports

    def _extras(self, result: IdentificationResult) -> ReportExtras:
        extras = ReportExtras(facts=self._arm.facts(), exports=export_errors(result))
        if self._options.truth is None:
            return extras
        from aerarm_ros.identification.truth import inertial_torque_errors, load_truth

        truth = load_truth(self._options.truth, result.fit.model)
        errors = inertial_torque_errors(
            truth,
            [solution.estimate for solution in result.solutions.values()],
            [*result.identification, *result.validation],
        )
        return replace(extras, truth=truth, truth_errors=errors)


def _conditioning(options: argparse.Namespace) -> ConditioningOptions:
    return ConditioningOptions(options.fundamental, options.cutoff)


def _print_replaced(directory: ResultDirectory) -> None:
    if directory.replaced:
        print_notice(_NAME, f'{directory.target}: the new result replaced an earlier result')


def _progress(text: str) -> None:
    if sys.stderr.isatty():
        print_notice(_NAME, f'{text} ...')


_FILES = ('payload.yaml', MARKER)


class PayloadRun(IdentifierRun):
    """Identify only a payload, with the identified model of the arm from `--model`."""

    def execute(self) -> str:
        """Identify the payload, write the result files, and return the text to print.

        Raises
        ------
        IdentificationError, BagError, ConfigError
            If a bag or the model cannot be used, or the result cannot be written.
        """
        from aerarm_ros.identification.payload import weigh_payload

        options = self._options
        if options.bag or options.validation or not options.payload:
            raise IdentificationError(
                'with --model the identifier estimates only a payload: pass the bags with the '
                'payload as --payload, and remove --bag and --validation'
            )
        with ResultDirectory(result_folder(options, 'payload'), files=_FILES) as directory:
            robot = self._arm.robot
            estimate = read_estimate(options.model, robot)
            if options.gravity is None:
                robot = robot.with_gravity(estimated_arm(options.model, robot.gravity_in_base)[1])
            recordings = [self._recording(path) for path in options.payload]
            deviation = gain_deviation(options)
            payload = weigh_payload(robot, estimate, recordings, _conditioning(options), deviation)
            directory.write('payload.yaml', payload_yaml(estimate, payload))
            summary = {
                'model': str(options.model),
                'payload': {'mass': payload.mass, 'mass_standard_deviation': float(payload.std[0])},
            }
            directory.write_json(MARKER, summary)
            print_notice(_NAME, *self._arm.messages)
        _print_replaced(directory)
        return (
            f'Payload: {payload.mass:.4g} ± {payload.std[0]:.2g} kg\n'
            f'{directory.target / "payload.yaml"}'
        )
