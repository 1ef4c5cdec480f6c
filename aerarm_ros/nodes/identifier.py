"""Identify an arm's dynamic parameters from recorded motion.

The identifier reads bags with joint states of any serial arm and needs no running ROS. It writes
estimate.yaml, identified.urdf, summary.json and report.html.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING

from aerarm_ros.ros.process.process_end import (
    USER_ERROR,
    print_error,
    run_offline,
    without_ros_arguments,
)
from aerarm_ros.ros.programs.identifier_options import identifier_parser

if TYPE_CHECKING:
    from aerarm_ros.ros.programs.fleet_run import FleetRun
    from aerarm_ros.ros.programs.identifier_compare import CompareRun
    from aerarm_ros.ros.programs.identifier_run import IdentifierRun

_NAME = 'identifier'
_LIMIT_EXCEEDED = 1  # exit status if a value exceeds its limit of --verify


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the identifier; return exit status 0, or 1 if --verify fails, or 2 for invalid input."""
    parser = identifier_parser(_NAME, __doc__)
    options = parser.parse_args(without_ros_arguments(arguments))
    if not (options.bag or options.model or options.compare or options.each):
        parser.error('no input: pass --bag, or --each, or --model with --payload, or --compare')
    return run_offline(_NAME, lambda: _run(options))


def _program(options: argparse.Namespace) -> IdentifierRun | CompareRun | FleetRun:
    # Only the modules of the requested program are imported.
    if options.compare:
        from aerarm_ros.ros.programs.identifier_compare import CompareRun

        return CompareRun(options)
    if options.each:
        from aerarm_ros.ros.programs.fleet_run import FleetRun

        return FleetRun(options)
    from aerarm_ros.ros.programs.identifier_run import IdentifierRun, PayloadRun

    return (PayloadRun if options.model else IdentifierRun)(options)


def _run(options: argparse.Namespace) -> int:
    # Imported here, so that --help is quick and Ctrl-C works from the start.
    import numpy as np

    from aerarm_msgs_py.storage.read_limits import BagError
    from aerarm_ros.description.config_reader import ConfigError, DescriptionError
    from aerarm_ros.identification.errors import IdentificationError

    try:
        run = _program(options)
        print(run.execute())
    except (BagError, ConfigError, DescriptionError, IdentificationError, OSError) as error:
        return _report(error)
    except np.linalg.LinAlgError as error:
        return _report(
            f'the calculation failed ({error}): check that masses and inertias of the URDF, and '
            'joint states, are plausible'
        )
    return 0 if run.passed else _LIMIT_EXCEEDED


def _report(error: object) -> int:
    print_error(_NAME, error)
    return USER_ERROR
