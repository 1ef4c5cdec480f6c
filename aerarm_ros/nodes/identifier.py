"""Identify an arm's dynamic parameters from recorded motion.

The identifier reads bags with joint states of any serial arm and needs no running ROS. It writes
estimate.yaml, identified.urdf, summary.json and report.html.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from aerarm_ros.ros.process.process_end import (
    USER_ERROR,
    print_error,
    run_offline,
    without_ros_arguments,
)
from aerarm_ros.ros.programs.identifier_options import identifier_parser

_NAME = 'identifier'


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the identifier; return exit status 0, or 2 for invalid input."""
    parser = identifier_parser(_NAME, __doc__)
    options = parser.parse_args(without_ros_arguments(arguments))
    if not (options.bag or options.model):
        parser.error('no input: pass --bag, or --model with --payload')
    return run_offline(_NAME, lambda: _run(options))


def _run(options: argparse.Namespace) -> int:
    # Imported here, so that --help is quick and Ctrl-C works from the start.
    import numpy as np

    from aerarm_msgs_py.storage.read_limits import BagError
    from aerarm_ros.description.config_reader import ConfigError, DescriptionError
    from aerarm_ros.identification.errors import IdentificationError
    from aerarm_ros.ros.programs.identifier_run import IdentifierRun, PayloadRun

    try:
        print((PayloadRun if options.model else IdentifierRun)(options).execute())
    except (BagError, ConfigError, DescriptionError, IdentificationError, OSError) as error:
        return _report(error)
    except np.linalg.LinAlgError as error:
        return _report(
            f'the calculation failed ({error}): check that masses and inertias of the URDF, and '
            'joint states, are plausible'
        )
    return 0


def _report(error: object) -> int:
    print_error(_NAME, error)
    return USER_ERROR
