"""Position error of the tool in the world frame while wind moves the drone.

`fake_hardware`, `world_control`, `base_reaction` and `flight_control` run as processes in lockstep,
so the figures do not depend on the host. Wind of 1.5 N RMS below 0.5 Hz pushes a drone of 3 kg. The
arm's controller receives a 100 Hz odometry with a delay of 10 ms and noise of 1 mm and 5 mm/s. The
cases are: a tool held in place, a tool on a path of 20 cm, a poor odometry, light drones, a fully
actuated drone, and a wrong model of the arm. For comparison, the ordinary Jacobian and held joints
are used. The table also gives the physical bound of each flight: how far the target was beyond the
arm's reach at most, how far the drone could still move, and the largest tilt. Further cases press
the tool on a wall with a set force, slide along the wall, or lose the wall. `make world` writes a
page with a replay.
"""

import argparse
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from flying.arm_model import ArmModel
from flying.holding_bench import HoldingBench, HoldingRecord, PushingBench
from flying.holding_case import CASES, PUSHES
from flying.holding_page import holding_page
from flying.node_bench import FAILURES, reason, ros_node
from flying.pages import write_page
from rclpy.node import Node

# Format of a line, headings, and cases.
TABLES = (
    (
        '{:20} {:>8} {:>6} {:>9} {:>6} {:>9} {:>7} {:>8} {:>8} {:>6}  {}',
        (
            'flight',
            'tool mm',
            'max',
            'drone mm',
            'max',
            'beyond mm',
            'left mm',
            'tilt deg',
            'turn deg',
            'goal',
            '',
        ),
        CASES,
    ),
    (
        '{:24} {:>8} {:>7} {:>10} {:>8} {:>6}  {}',
        ('push', 'force N', 'peak N', 'across mm', 'stop mm', 'goal', ''),
        PUSHES,
    ),
)


def fly(node: Node, name: str, arm: ArmModel, seconds: float) -> HoldingRecord | str:
    """Return the record of a flight, with a wall in a push, or the reason of a failure."""
    try:
        with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
            if name in PUSHES:
                return PushingBench(stack, node, Path(folder), PUSHES[name], arm).push(seconds)
            case = CASES[name]
            if case.wrong:
                arm = arm.with_errors(case.wrong, 1, Path(folder))
            return HoldingBench(stack, node, Path(folder), case, arm).fly(seconds)
    except FAILURES as error:
        return reason(error)


def line(form: str, name: str, record: HoldingRecord | str) -> str:
    """Return the line of a flight for a table."""
    if isinstance(record, str):
        return form.format(name, *['-'] * (form.count('{') - 2), record)
    goal = (PUSHES.get(name) or CASES[name]).goal
    numbers = [*record.figures(), goal]
    shown = [f'{value:.4g}' if np.isfinite(value) else '' for value in numbers]
    return form.format(name, *shown, record.diagnostics)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--cases', nargs='*', default=[*CASES, *PUSHES], choices=[*CASES, *PUSHES])
    ArmModel.add_options(parser)
    parser.add_argument('--seconds', type=float, default=12.0, help='duration of each flight [s]')
    parser.add_argument('--out', type=Path, help='folder for the page')
    options = parser.parse_args()
    records: dict[str, HoldingRecord | str] = {}
    with tempfile.TemporaryDirectory() as folder:
        arm = ArmModel.chosen(options, Path(folder))
        with ros_node() as node:
            for form, headings, cases in TABLES:
                print(form.format(*headings), flush=True)
                for name in filter(cases.__contains__, options.cases):
                    records[name] = fly(node, name, arm, options.seconds)
                    print(line(form, name, records[name]), flush=True)
    if options.out:
        held, pushes = ({n: r for n, r in records.items() if n in x} for x in (CASES, PUSHES))
        body = holding_page(held, pushes, f'The arm model is {arm.name}.')
        title = 'The tool keeps its position while its drone moves'
        write_page(options.out / 'world.html', title, body)
    return 0


if __name__ == '__main__':
    sys.exit(main())
