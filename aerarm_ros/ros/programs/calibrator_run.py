"""`calibrator`: estimate an arm's geometry errors, and write URDF, YAML and report."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import numpy as np

from aerarm_ros.calibration.calibrate import Calibration, CalibrationOptions, HeldOut, calibrate
from aerarm_ros.calibration.files import calibrated_urdf, calibration_yaml, config_yaml, summary
from aerarm_ros.calibration.geometry import Tolerance
from aerarm_ros.calibration.observations import CalibrationError, Observations
from aerarm_ros.calibration.report import calibration_html, calibration_text
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.config_reader import config_path
from aerarm_ros.description.robot import read_urdf
from aerarm_ros.identification.files.result_directory import MARKER, ResultDirectory
from aerarm_ros.ros.process.process_end import print_notice
from aerarm_ros.ros.programs.calibrator_input import find_chain, joined, read_input, to_observations
from aerarm_ros.ros.programs.identifier_options import result_folder

URDF, YAML, CONFIG, REPORT = 'calibrated.urdf', 'calibration.yaml', 'arm.yaml', 'report.html'
RESULT_FILES = (URDF, YAML, CONFIG, REPORT, MARKER)
"""Names of the files that `calibrator` writes."""
_SEED = 0  # seed of the random choice of held-out postures


class CalibratorRun:
    """Calibrate an arm with the options of the command line.

    Parameters
    ----------
    options : argparse.Namespace
        Parsed arguments of the calibrator.

    Raises
    ------
    CalibrationError, ConfigError, DescriptionError
        If an option, the URDF or the configuration is wrong.
    """

    def __init__(self, options: argparse.Namespace) -> None:
        self._options = options
        length, angle = options.tolerance
        self._choice = CalibrationOptions(
            options.level,
            not options.no_compliance,
            options.eccentricity,
            Tolerance(1e-3 * length, 1e-3 * angle),
        )
        self._urdf, _ = read_urdf(options.urdf)
        # The packaged configuration fits only the packaged URDF.
        has_config = options.config is not None or options.urdf is None
        self._config_path = config_path(options.config, 'aerarm.yaml') if has_config else None
        self._config = load_arm_config(self._config_path) if has_config else None

    def execute(self) -> str:
        """Estimate the errors, write the result folder, and return a table for the terminal.

        Raises
        ------
        CalibrationError, BagError, IdentificationError
            If the input cannot be used, or the result cannot be written.
        """
        options = self._options
        with ResultDirectory(
            result_folder(options, 'calibration'), files=RESULT_FILES
        ) as directory:
            calibration, mapping = self._calibrate()
            self._write(calibration, mapping, directory)
        report = directory.target / REPORT
        return f'{calibration_text(calibration)}\nReport: {report}'

    def _calibrate(self) -> tuple[Calibration, list[str]]:
        options = self._options
        training = [read_input(path, self._urdf, options) for path in options.bag]
        validation = [read_input(path, self._urdf, options) for path in options.validation]
        gravity = options.gravity or (self._config.gravity_in_base if self._config else None)
        chain = find_chain([*training, *validation], self._urdf, options, gravity)
        observations = joined([to_observations(one, chain, options) for one in training])
        held_out = [
            HeldOut(one.path.stem, to_observations(one, chain, options)) for one in validation
        ]
        inputs = [*training, *validation]
        mapping = [f'{one.path.name}: {text}' for one in inputs for text in one.mapping]
        mapping.append(f'the measured markers and poses are attached to the link {chain.link}')
        if chain.ignored:
            mapping.append(
                f'these joints do not move {chain.link}, so the calibrator ignores them: '
                f'{", ".join(chain.ignored)}'
            )
        print_notice('calibrator', *mapping)
        if options.holdout > 0.0:
            observations, rest = _divided(observations, options.holdout)
            held_out.insert(0, HeldOut('held out', rest))
        result = calibrate(chain, observations, held_out, self._choice)
        result.messages[:0] = [text for one in training for text in one.messages]
        print_notice('calibrator', *result.messages)
        return result, mapping

    def _write(
        self, result: Calibration, mapping: Sequence[str], directory: ResultDirectory
    ) -> None:
        in_config = self._config is not None and set(result.joint_values('offset')) <= set(
            self._config.joint_names
        )
        directory.write(URDF, calibrated_urdf(result, with_offsets=not in_config))
        directory.write(YAML, calibration_yaml(result, CONFIG if in_config else URDF))
        if in_config and self._config_path is not None:
            directory.write(CONFIG, config_yaml(result, self._config_path))
            load_arm_config(directory.path(CONFIG))  # an invalid file discards the result
        directory.write_json(MARKER, summary(result))
        directory.write(REPORT, calibration_html(result, mapping))


def _divided(observations: Observations, share: float) -> tuple[Observations, Observations]:
    count = len(observations)
    out = round(share * count)
    if out < 1 or count - out < 1:
        raise CalibrationError(
            f'--holdout {share:g} of {count} postures leaves no posture for the fit or for the '
            'validation: pass another fraction, or record more postures'
        )
    order = np.random.default_rng(_SEED).permutation(count)
    return observations.rows(np.sort(order[out:])), observations.rows(np.sort(order[:out]))
