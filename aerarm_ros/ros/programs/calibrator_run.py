"""`calibrator`: estimate an arm's geometry errors, and write URDF, YAML and report."""

from __future__ import annotations

import argparse

import numpy as np

from aerarm_ros.calibration.calibrate import Calibration, calibrate
from aerarm_ros.calibration.chain import chain_of
from aerarm_ros.calibration.files import calibrated_urdf, calibration_yaml, config_yaml, summary
from aerarm_ros.calibration.geometry import Tolerance
from aerarm_ros.calibration.observations import CalibrationError, Observations
from aerarm_ros.calibration.report import calibration_html, calibration_text
from aerarm_ros.description.arm_config import ArmConfig, load_arm_config
from aerarm_ros.description.config_reader import config_path
from aerarm_ros.description.robot import STANDARD_GRAVITY, read_urdf
from aerarm_ros.identification.files.result_directory import MARKER, ResultDirectory
from aerarm_ros.ros.process.process_end import print_notice
from aerarm_ros.ros.programs.calibrator_input import joined, read_input, to_observations
from aerarm_ros.ros.programs.identifier_options import result_folder

URDF, YAML, CONFIG, REPORT = 'calibrated.urdf', 'calibration.yaml', 'arm.yaml', 'report.html'
RESULT_FILES = (URDF, YAML, CONFIG, REPORT, MARKER)
"""Names of the files that `calibrator` writes."""
_SEED = 0  # seed of the random choice of held-out postures


def calibrate_arm(options: argparse.Namespace) -> str:
    """Calibrate an arm, write the result folder, and return a table for the terminal.

    Parameters
    ----------
    options : argparse.Namespace
        Parsed arguments of the calibrator.

    Raises
    ------
    CalibrationError, ConfigError, DescriptionError, BagError, IdentificationError
        If an option or the input cannot be used, or the result cannot be written.
    """
    urdf, _ = read_urdf(options.urdf)
    # The packaged configuration fits only the packaged URDF.
    has_config = options.config is not None or options.urdf is None
    source = config_path(options.config, 'aerarm.yaml') if has_config else None
    config = None if source is None else load_arm_config(source)
    with ResultDirectory(result_folder(options, 'calibration'), files=RESULT_FILES) as directory:
        result, mapping = _calibrate(options, urdf, config)
        has_offsets = config is not None and set(result.joint_values('offset')) <= set(
            config.joint_names
        )
        directory.write(URDF, calibrated_urdf(result, with_offsets=not has_offsets))
        directory.write(YAML, calibration_yaml(result, CONFIG if has_offsets else URDF))
        if has_offsets and source is not None:
            directory.write(CONFIG, config_yaml(result, source))
            load_arm_config(directory.path(CONFIG))  # an invalid file discards the result
        directory.write_json(MARKER, summary(result))
        directory.write(REPORT, calibration_html(result, mapping))
    return f'{calibration_text(result)}\nReport: {directory.target / REPORT}'


def _calibrate(
    options: argparse.Namespace, urdf: str, config: ArmConfig | None
) -> tuple[Calibration, list[str]]:
    """Return the calibration, and texts that state how the program interprets the input."""
    training = [read_input(path, urdf, options) for path in options.bag]
    validation = [read_input(path, urdf, options) for path in options.validation]
    inputs = [*training, *validation]
    gravity = options.gravity or (config.gravity_in_base if config else STANDARD_GRAVITY)
    recorded = [n for n in inputs[0].joints.names if all(n in one.joints.names for one in inputs)]
    chain = chain_of(urdf, recorded, options.link, options.lock, gravity)
    observations = joined([to_observations(one, chain, options) for one in training])
    held_out = {one.path.stem: to_observations(one, chain, options) for one in validation}
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
        held_out = {'held out': rest, **held_out}
    length, angle = options.tolerance
    tolerance = Tolerance(1e-3 * length, 1e-3 * angle)
    compliance = not options.no_compliance
    result = calibrate(chain, observations, held_out, options.level, compliance, tolerance)
    result.messages[:0] = [text for one in training for text in one.messages]
    print_notice('calibrator', *result.messages)
    return result, mapping


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
