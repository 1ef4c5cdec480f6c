"""`payload_estimator --bag`: estimate a payload from bags, without ROS."""

from __future__ import annotations

import argparse
import dataclasses
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np
import yaml

from aerarm_ros.identification.conditioning.motion_check import ConditioningOptions
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.files.estimate_file import estimated_arm, payload_yaml, read_estimate
from aerarm_ros.identification.files.result_directory import MARKER, ResultDirectory
from aerarm_ros.identification.payload import calibrate_gains
from aerarm_ros.identification.recording.recording import Recording
from aerarm_ros.identification.solvers.estimate import Estimate
from aerarm_ros.online.payload_estimator import (
    FRICTION_NAMES,
    EstimatorSettings,
    OnlineEstimate,
    PayloadEstimator,
)
from aerarm_ros.online.replay import KnownArm, LoadChange, Replay, unexplained_torque
from aerarm_ros.ros.controllers.payload_parameters import ESTIMATOR_PARAMETERS, estimator_settings
from aerarm_ros.ros.parameters.parameter import Parameter
from aerarm_ros.ros.process.process_end import (
    INTERRUPTED,
    USER_ERROR,
    StopSignals,
    print_error,
    print_notice,
)
from aerarm_ros.ros.process.ros_arguments import OneLineParser, RosArguments, UsageError
from aerarm_ros.ros.programs.identifier_options import Option, add_arm_options, table_parser
from aerarm_ros.ros.programs.identifier_run import UNCALIBRATED, RecordedArm, gain_deviation


def main() -> int:
    """Estimate a payload, as this process's command line requests."""
    return replay('payload_estimator', sys.argv[1:])


_OPTIONS: tuple[Option, ...] = (
    ('--bag', {'nargs': '+', 'type': Path, 'required': True, 'metavar': 'DIR'},
        'recordings in chronological order: rosbag2 folders, or .mcap, .db3, .csv, .npz and ROS 1 '
        '.bag files. In the first recording the arm must start without payload'),
    ('--model', {'type': Path, 'metavar': 'FILE'},
        'identified model of the arm, estimate.yaml (default: the model in the URDF)'),
    ('--out', {'type': Path, 'metavar': 'DIR'}, 'folder for the results; needs --model'),
    ('--known-mass', {'type': float, 'metavar': 'KG'},
        'mass that the arm carries in all bags; the program calibrates the effort gains with this '
        'mass instead of estimating a payload; needs --model'),
)  # fmt: skip


_GAINS = 'effort_gains.yaml'
_NOISE = 'torque_noise'
_FILES = ('payload.yaml', _GAINS, MARKER)


def replay(name: str, arguments: Sequence[str]) -> int:
    """Estimate a payload from bags, and return the exit status, as `run_replay` defines it."""

    def run(options: argparse.Namespace, is_stopped: Callable[[], bool]) -> int:
        print(PayloadReplay(options, is_stopped).execute())
        return 0

    return run_replay(replay_parser(name), name, arguments, run, 'no files were written')


def run_replay(
    parser: OneLineParser,
    name: str,
    arguments: Sequence[str],
    run: Callable[[argparse.Namespace, Callable[[], bool]], int],
    after_stop: str,
) -> int:
    """Run a program that reads bags, and return the exit status.

    The exit status is the value that `run` returns, 2 for an invalid input, or 130 after a stop.

    Parameters
    ----------
    run
        The program. Its arguments are the options, and a function that returns whether the user
        requested a stop.
    after_stop
        Text of the message after a stop, for example 'no files were written'.
    """
    stops: list[bool] = []
    try:
        given = RosArguments(arguments)
        if given.parameters:
            raise UsageError(
                f'{given.parameters[0].name} is a parameter of the node and has no effect on bags: '
                f'pass an option instead, see {name} --bag DIR --help'
            )
        options = parser.parse_args(given.plain)
        with StopSignals(lambda: stops.append(True)):
            return run(options, lambda: bool(stops))
    except KeyboardInterrupt:
        print_error(name, f'interrupted, {after_stop}')
        return INTERRUPTED
    except (ValueError, OSError) as error:
        print_error(name, error)
        return USER_ERROR


def replay_parser(name: str) -> OneLineParser:
    """Return the parser of the options of `payload_estimator --bag`."""
    description = 'Estimate the payload from bags instead of topics.'
    parser = table_parser(f'{name} --bag', description, _OPTIONS)
    add_arm_options(parser)
    add_parameters(parser, ESTIMATOR_PARAMETERS, measured=_NOISE)
    return parser


def add_parameters(
    parser: OneLineParser, parameters: Iterable[Parameter], measured: str = ''
) -> None:
    """Add one option per node parameter; the parameter named `measured` has no fixed default."""
    for parameter in parameters:
        unit = f' [{parameter.unit}]' if parameter.unit else ''
        is_measured = parameter.name == measured
        default = 'measured from the first bag' if is_measured else '%(default)g'
        parser.add_argument(
            _option(parameter.name), type=float, metavar='X',
            default=None if is_measured else parameter.default,
            help=f'{parameter.description}{unit} (default: {default})',
        )  # fmt: skip


def check_parameters(options: argparse.Namespace, parameters: Iterable[Parameter]) -> None:
    """Raise IdentificationError if an option that `add_parameters` added has an invalid value."""
    for parameter in parameters:
        if problem := parameter.problem(getattr(options, parameter.name)):
            text = problem.removeprefix(f'parameter {parameter.name}')
            raise IdentificationError(f'{_option(parameter.name)}{text}')


def known_arm(
    recorded: RecordedArm, options: argparse.Namespace
) -> tuple[KnownArm, Estimate | None]:
    """Return the arm's model, and the estimate in the file of `--model`.

    Without `--model`, return the model in the URDF, and None instead of the estimate.
    """
    robot, config = recorded.robot, recorded.config
    if options.model is None:
        rotors = np.zeros(robot.n) if config is None else config.column('reflected_inertia')
        friction = np.array([robot.viscous, robot.coulomb, robot.load_friction])
        return KnownArm(robot, rotors, friction), None
    estimate = read_estimate(options.model, robot)
    if options.gravity is None:
        robot = robot.with_gravity(estimated_arm(options.model, robot.gravity_in_base)[1])
    return KnownArm.identified(robot, estimate), estimate


class PayloadReplay:
    """Estimate a payload from bags with the options of the command line.

    Parameters
    ----------
    options : argparse.Namespace
        Options of `replay_parser`.
    is_stopped : callable
        Returns whether the user requested a stop.

    Raises
    ------
    IdentificationError, DescriptionError, ConfigError
        If an option, the URDF, the configuration or the model is wrong.
    """

    def __init__(self, options: argparse.Namespace, is_stopped: Callable[[], bool]) -> None:
        self._options = options
        self._is_stopped = is_stopped
        self._measures_noise = options.torque_noise is None
        if self._measures_noise:
            options.torque_noise = EstimatorSettings.torque_noise
        check_parameters(options, ESTIMATOR_PARAMETERS)
        self._gain_deviation = gain_deviation(options)
        for name in ('out', 'known_mass'):
            if getattr(options, name) is not None and not options.model:
                raise IdentificationError(
                    f'{_option(name)} needs an identified arm: pass its estimate.yaml with --model'
                )
        self._recorded = RecordedArm(options, options.bag)
        self._arm, self._estimate = known_arm(self._recorded, options)

    def execute(self) -> str:
        """Read the bags, write the output files, and return the results as text.

        Raises
        ------
        IdentificationError, BagError
            If a bag cannot be used, or the result cannot be written.
        """
        if self._options.known_mass is not None:
            return self._calibrate()
        if self._options.out is None:
            return self._found()[0]
        with ResultDirectory(self._options.out, files=_FILES) as directory:
            text, last = self._found()
            if not last.carries:
                raise IdentificationError(
                    'the arm carries no payload at the end of the last bag, so payload.yaml would '
                    'be empty: remove --out to print the estimate only'
                )
            assert self._estimate is not None
            directory.write('payload.yaml', payload_yaml(self._estimate, last.payload))
            found = {'mass': last.payload.mass, 'mass_standard_deviation': last.payload.std[0]}
            model = str(self._options.model)
            directory.write_json(MARKER, {'model': model, 'payload': found})
        return f'{text}\n{directory.target / "payload.yaml"}'

    def _found(self) -> tuple[str, OnlineEstimate]:
        replay, lines = None, []
        for path in self._options.bag:
            recording = self._recorded.recording(path)
            if replay is None:
                replay = Replay(self._arm, self._estimator_for(recording), self._is_stopped)
            changes = replay.play(recording)
            text = _changes_text(changes, replay.knocks)
            lines.append(f'{recording.name}: {recording.duration:.1f} s, {text}')
        print_notice('payload_estimator', *self._recorded.messages)
        last = None if replay is None else replay.estimate
        assert last is not None
        payload = last.payload.with_scale_deviation(self._gain_deviation)
        last = dataclasses.replace(last, payload=payload)
        return '\n'.join([*lines, *_payload_lines(last), *self._friction_lines(last)]), last

    def _estimator_for(self, first: Recording) -> PayloadEstimator:
        """Return the estimator; without `--torque-noise`, measure the noise in the first bag."""
        settings, noise = estimator_settings(self._options), None
        if self._measures_noise:
            noise = unexplained_torque(self._arm, first, settings.bandwidth, self._is_stopped)
            noise = np.fmax(noise, settings.torque_noise)  # also where it is unknown
        return self._arm.estimator(settings, noise)

    def _calibrate(self) -> str:
        """Calibrate the effort gains with the known mass, write files, and return a text."""
        assert self._estimate is not None
        recordings = [self._recorded.recording(path) for path in self._options.bag]
        found = calibrate_gains(
            self._recorded.robot,
            self._estimate,
            recordings,
            ConditioningOptions(),
            self._options.known_mass,
            self._gain_deviation or UNCALIBRATED,
        )
        names = self._arm.robot.joint_names
        before = dict(self._options.effort_gain)
        old = np.array([before.get(name, 1.0) for name in names])
        gains, std = old * found.factors, old * found.std
        rows = zip(names, old, gains, std, strict=True)
        lines = ['Effort gain of each joint, before -> after the calibration with the known mass:']
        lines += [f'  {name}: {a:.4g} -> {b:.4g} ± {s:.2g}' for name, a, b, s in rows]
        values = ' '.join(f'{name}={gain:.5g}' for name, gain in zip(names, gains, strict=True))
        share = float(np.median(found.std / found.factors))
        options = f'--effort-gain {values} --effort-gain-std {share:.2g}'
        centre = ', '.join(f'{value:.4f}' for value in found.payload.centre)
        lines.append(f'Centre of the known mass in the frame of {found.payload.link}: ({centre}) m')
        lines.append(f'Identify the arm again with: {options}')
        if self._options.out is None:
            return '\n'.join(lines)
        with ResultDirectory(self._options.out, files=_FILES) as directory:
            document = {
                'effort_gain': dict(zip(names, gains.round(6).tolist(), strict=True)),
                'standard_deviation': dict(zip(names, std.round(6).tolist(), strict=True)),
                'known_mass': float(self._options.known_mass),
            }
            directory.write(_GAINS, yaml.safe_dump(document, sort_keys=False))
            directory.write_json(MARKER, {'model': str(self._options.model)})
        return '\n'.join([*lines, str(directory.target / _GAINS)])

    def _friction_lines(self, last: OnlineEstimate) -> list[str]:
        """Return a table that compares the friction in the model with that in the last bag."""
        names = ', '.join(self._arm.robot.joint_names)
        lines = [f'Friction of {names}, in the model -> estimated at the end of the last bag:']
        rows = zip(self._arm.friction, last.friction, last.friction_std, strict=True)
        for name, row in zip(FRICTION_NAMES, rows, strict=True):
            values = zip(*row, strict=True)
            cells = (f'{old:.4f} -> {new:.4f} ± {std:.4f}' for old, new, std in values)
            lines.append(f'  {name}: {", ".join(cells)}')
        return lines


def _option(name: str) -> str:
    return f'--{name.replace("_", "-")}'


def _changes_text(changes: Sequence[LoadChange], knocks: Sequence[float]) -> str:
    parts = [
        f'{"picked up" if change.carries else "put down"} at {change.time:.2f} s'
        for change in changes
    ]
    texts = [', '.join(parts) or 'no payload was picked up or put down']
    if knocks:
        times = ', '.join(f'{time:.2f}' for time in knocks)
        texts.append(f'no payload explains the torque (contact or model error) at {times} s')
    return '; '.join(texts)


def _payload_lines(last: OnlineEstimate) -> list[str]:
    payload = last.payload
    if not last.carries:
        return [f'Payload: none above the detection limit of {2.0 * payload.std[0]:.2g} kg']
    centre = ', '.join(
        f'{value:.4f} ± {std:.2g}'
        for value, std in zip(payload.centre, payload.centre_std, strict=True)
    )
    inertial = ', '.join(f'{value:.6g}' for value in payload.inertial)
    return [
        f'Payload: {payload.mass:.4g} ± {payload.std[0]:.2g} kg at ({centre}) m in the frame of '
        f'{payload.link}',
        f'Inertial parameters of the payload: [{inertial}]; parameters that the motion does not '
        f'excite: {" ".join(last.unexcited) or "none"}',
    ]
