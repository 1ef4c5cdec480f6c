"""Calibrate an arm's geometry, its mount and the drone's IMU from recorded measurements.

The calibrator reads tables and bags of any serial arm and needs no running ROS. The calibrator
writes calibrated.urdf, calibration.yaml, arm.yaml, summary.json and report.html, or drone.yaml.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from aerarm_ros.ros.process.offline import run_offline, without_ros_arguments
from aerarm_ros.ros.process.process_end import USER_ERROR, print_error
from aerarm_ros.ros.programs.calibrator_options import calibrator_parser

_NAME = 'calibrator'


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the calibrator; return 0, or 2 if the user must check an input."""
    parser = calibrator_parser(_NAME, __doc__)
    options = parser.parse_args(without_ros_arguments(arguments))
    if not options.bag:
        parser.error('the following arguments are required: --bag')
    return run_offline(_NAME, lambda: _run(options))


def _run(options: argparse.Namespace) -> int:
    # Imported here, so that --help is quick and Ctrl-C works from the start.
    import numpy as np

    from aerarm_msgs_py.storage.read_limits import BagError
    from aerarm_ros.calibration.observations import CalibrationError
    from aerarm_ros.description.config_reader import ConfigError, DescriptionError
    from aerarm_ros.identification.errors import IdentificationError
    from aerarm_ros.ros.programs.calibrator_mount import MountRun
    from aerarm_ros.ros.programs.calibrator_run import CalibratorRun

    try:
        print((MountRun if options.mount else CalibratorRun)(options).execute())
    except (
        BagError,
        CalibrationError,
        ConfigError,
        DescriptionError,
        IdentificationError,
        OSError,
    ) as error:
        print_error(_NAME, error)
        return USER_ERROR
    except np.linalg.LinAlgError as error:
        print_error(_NAME, f'{error}: check that positions and joint states are plausible')
        return USER_ERROR
    return 0


if __name__ == '__main__':
    sys.exit(main())
