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
import os
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import rclpy
from flying.arm_model import ArmModel
from flying.holding_bench import HoldingBench, HoldingRecord
from flying.holding_case import CASES
from flying.holding_page import write_page
from flying.pushing_bench import PushingBench, PushingRecord
from flying.pushing_case import PUSHES
from rclpy.node import Node

from aerarm_ros.ros.requests.arm_client import ArmClientError

LINE = '{:20} {:>8} {:>6} {:>9} {:>6} {:>6} {:>9} {:>7} {:>8}  {}'
PUSH_LINE = '{:24} {:>8} {:>7} {:>10} {:>8} {:>6}  {}'
PUSH_HEADINGS = ('push', 'force N', 'peak N', 'across mm', 'stop mm', 'goal', '')
HEADINGS = (
    'flight', 'tool mm', 'max', 'drone mm', 'max', 'goal', 'beyond mm', 'left mm', 'tilt deg', ''
)  # fmt: skip


def fly(node: Node, name: str, arm: ArmModel, seconds: float) -> HoldingRecord | str:
    """Return the record of a flight, or the reason of a failure."""
    case = CASES[name]
    try:
        with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
            if case.wrong:
                arm = arm.with_errors(case.wrong, 1, Path(folder))
            return HoldingBench(stack, node, Path(folder), case, arm).fly(seconds)
    except (ValueError, TimeoutError, ArmClientError) as error:
        return ' '.join(str(error).split())[:160]


def push(node: Node, name: str, arm: ArmModel, seconds: float) -> PushingRecord | str:
    """Return the record of a flight with a wall, or the reason of a failure."""
    try:
        with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
            return PushingBench(stack, node, Path(folder), PUSHES[name], arm).push(seconds)
    except (ValueError, TimeoutError, ArmClientError) as error:
        return ' '.join(str(error).split())[:160]


def push_line(name: str, record: PushingRecord | str) -> str:
    """Return the line of a push for the table."""
    if isinstance(record, str):
        return PUSH_LINE.format(name, *['-'] * 5, record)
    goal = record.case.goal
    figures = ['' if np.isnan(value) else f'{value:.2f}' for value in record.figures()]
    asked = f'{goal:g}' if np.isfinite(goal) else ''
    return PUSH_LINE.format(name, *figures, asked, record.flight.diagnostics)


def line(name: str, record: HoldingRecord | str) -> str:
    """Return the line of a flight for the table."""
    if isinstance(record, str):
        return LINE.format(name, *['-'] * 8, record)
    goal = CASES[name].goal
    figures, bound = ([f'{value:.1f}' for value in x] for x in (record.figures(), record.bound))
    asked = f'{goal:g}' if goal < 100.0 else ''
    return LINE.format(name, *figures, asked, *bound, record.diagnostics)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--cases', nargs='*', default=[*CASES, *PUSHES], choices=[*CASES, *PUSHES])
    parser.add_argument('--model', choices=('identified', 'true'), default='identified')
    parser.add_argument('--arm-seed', type=int, default=7, help='seed of the identified arm')
    parser.add_argument('--seconds', type=float, default=12.0, help='duration of each flight [s]')
    parser.add_argument('--out', type=Path, help='folder for the page')
    options = parser.parse_args()
    os.environ['ROS_DOMAIN_ID'] = str(1 + os.getpid() % 100)
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    rclpy.init(args=[])
    node = rclpy.create_node('world')
    records: dict[str, HoldingRecord | str] = {}
    pushes: dict[str, PushingRecord | str] = {}
    print(LINE.format(*HEADINGS), flush=True)
    with tempfile.TemporaryDirectory() as folder:
        arm = ArmModel.true()
        if options.model == 'identified':
            arm = ArmModel.identified(node, Path(folder), options.arm_seed)
        for name in filter(CASES.__contains__, options.cases):
            records[name] = fly(node, name, arm, options.seconds)
            print(line(name, records[name]), flush=True)
        print(PUSH_LINE.format(*PUSH_HEADINGS), flush=True)
        for name in filter(PUSHES.__contains__, options.cases):
            pushes[name] = push(node, name, arm, options.seconds)
            print(push_line(name, pushes[name]), flush=True)
    rclpy.shutdown()
    if options.out:
        write_page(options.out / 'world.html', records, pushes, f'The arm model is {arm.name}.')
    return 0


if __name__ == '__main__':
    sys.exit(main())
