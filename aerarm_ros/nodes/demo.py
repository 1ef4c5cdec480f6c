"""Move an emulated arm, record the motion, identify a model of the arm, and validate the model.

The demo starts the nodes as separate processes, as a user does with `ros2 run`. At the end it
prints a table of torque errors and the path of a report.
"""

from __future__ import annotations

import argparse
import os
import random
import sys
import time
from datetime import datetime
from pathlib import Path
from typing import NoReturn

from aerarm_ros.ros.emulation.emulated_world import KEEP_UP, LOCKSTEP
from aerarm_ros.ros.process.node_process import is_domain_free
from aerarm_ros.ros.process.process_end import INTERRUPTED, USER_ERROR, StopSignals
from aerarm_ros.ros.process.ros_arguments import OneLineParser
from aerarm_ros.ros.programs.demo_run import DemoError, DemoRun
from aerarm_ros.ros.programs.identifier_options import at_least_one
from aerarm_ros.ros.requests.arm_client import ArmClientError

# Name of a file that the demo deletes from the output folder when all results are complete.
INCOMPLETE = 'INCOMPLETE'


def main(arguments: list[str] | None = None) -> int:
    """Run the demo; return exit status 0 if the demo has written the identified model."""
    options = _parse(arguments)
    with StopSignals(_interrupt):
        return _run(options)


def _interrupt() -> NoReturn:
    raise KeyboardInterrupt


def _run(options: argparse.Namespace) -> int:
    _isolate_from_other_ros_graphs()
    out: Path = options.out
    try:
        if out.is_dir() and any(out.iterdir()):
            raise FileExistsError('the folder contains files')
        (out / 'logs').mkdir(parents=True)
        marker = out / INCOMPLETE
        marker.write_text(
            'The demo is still running, or ended before it had written all results.\n'
        )
    except OSError as error:
        reason = error.strerror or error
        print(
            f'demo: cannot write to the folder {out} ({reason}): pass another folder with --out',
            file=sys.stderr,
        )
        return USER_ERROR
    started = time.monotonic()
    run = DemoRun(out, options)
    try:
        lines = run.move_and_record()
        run.identify()
    except (DemoError, ArmClientError) as error:
        print(f'demo failed: {error}\ndemo: the results in {out} are incomplete', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(
            f'\ndemo: interrupted, all nodes were stopped; the results in {out} are incomplete',
            file=sys.stderr,
        )
        return INTERRUPTED
    marker.unlink()
    print(*lines, f'Time      {time.monotonic() - started:.0f} s', sep='\n')
    return 0


def _parse(arguments: list[str] | None) -> argparse.Namespace:
    parser = OneLineParser(prog='demo', description=__doc__.splitlines()[0])
    parser.add_argument(
        '--out',
        type=Path,
        default=Path('output') / datetime.now().strftime('demo_%Y%m%d_%H%M%S'),
        help='folder for bags, logs and results (default: output/demo_DATE_TIME)',
    )
    parser.add_argument('--seed', type=int, default=2,
        help='seed of the random trajectory for validation (default: %(default)s)')  # fmt: skip
    parser.add_argument('--arm-seed', type=int, default=7,
        help="seed of the simulated arm's random parameters (default: %(default)s)")  # fmt: skip
    parser.add_argument('--periods', type=at_least_one, default=2,
        help='number of periods of each trajectory, 10 s each (default: 2)')  # fmt: skip
    parser.add_argument('--pace', choices=(KEEP_UP, LOCKSTEP), default=KEEP_UP,
        help='parameter pace of the node fake_hardware, which controls the speed of simulation '
             'time (default: %(default)s)')  # fmt: skip
    parser.add_argument('--priority', type=int, default=80,
        help='SCHED_FIFO priority of the bridge; 0 selects the ordinary scheduler (default: '
             '%(default)s)')  # fmt: skip
    return parser.parse_args(arguments)


def _isolate_from_other_ros_graphs() -> None:
    """Restrict ROS communication to this computer, because the network may contain a real arm."""
    domains = random.sample(range(1, 101), 100)
    free = next(filter(is_domain_free, domains), domains[0])
    os.environ.setdefault('ROS_DOMAIN_ID', str(free))
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    for name in ('ROS_STATIC_PEERS', 'ROS_DISCOVERY_SERVER'):
        os.environ.pop(name, None)  # these settings connect to other hosts
