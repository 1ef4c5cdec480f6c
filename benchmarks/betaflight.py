"""Hover error caused by arm motion with Betaflight's firmware, for several feed-forward methods.

The firmware runs as a program on this host and contains attitude control, rate control and mixer.
`flight_control` provides the position loop and feed-forward, and commands the firmware by its
sticks in angle mode. The firmware does not wait for the simulation, so the emulated world follows
real time as far as the host can. The figures are valid only on a quiet host; the host's load is
printed. `make flight AUTOPILOT=betaflight` runs this benchmark.
"""

import argparse
import os
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path

from flying.arm_model import ArmModel
from flying.betaflight_program import HOW, BetaflightProgram, find_betaflight
from flying.flight_bench import FlightBench
from flying.flight_case import FlightCase
from flying.flight_page import Records, report
from flying.flight_program import PARTS, FlightProgram
from flying.flight_way import FlightWay, load_drone
from flying.node_bench import FAILURES, reason, ros_node
from rclpy.node import Node

from aerarm_ros.autopilot.betaflight_flight import BetaflightSetup

DRONE = 'hexarotor'
WAYS = {
    'integral': FlightWay('integral'),
    'posture, motion, lead': FlightWay('integral', posture=True, motion=True, lead=0.04),
}
# Cycles of 2 ms leave a margin on two cores; softer joints tolerate the resulting delay.
WORLD = (('pace', 'keep_up'), ('period', 0.002))
LAW = (('kp', [100.0]), ('kd', [20.0]))
GAINS = {'position_frequency': 1.6, 'position_damping': 0.9, 'position_integral': 0.3}


def fly(node: Node, program: Path, arm: ArmModel, ways: list[str], parts: list[str]) -> Records:
    """Return the flight record of each method, or the reason of a failure.

    The firmware is started for each method.
    """
    drone, found = load_drone(DRONE), {}
    for name in ways:
        flight = {**GAINS, 'loops': 'betaflight', **WAYS[name].switches}
        case = FlightCase(
            drone.mass, 'free', drone=drone, sensors=WORLD, flight=tuple(flight.items()),
            is_told=True, law=LAW,
        )  # fmt: skip
        try:
            with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
                place = Path(folder)
                stack.enter_context(BetaflightProgram(program, place, drone, BetaflightSetup()))
                bench = FlightBench(stack, node, place, case, arm)
                record = bench.fly(FlightProgram(parts=parts))
                found[name] = record
                print(f'{DRONE}, {name}: {"lost" if record.is_lost else "flown"}', flush=True)
        except FAILURES as error:
            found[name] = reason(error)
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--ways', nargs='*', default=list(WAYS), choices=list(WAYS))
    parser.add_argument('--out', type=Path, help='folder for the page')
    parser.add_argument('--parts', nargs='*', default=list(PARTS), choices=list(PARTS))
    ArmModel.add_options(parser)
    options = parser.parse_args()
    program = find_betaflight()
    if program is None:
        print(HOW)
        return 1
    with tempfile.TemporaryDirectory() as folder:
        arm = ArmModel.chosen(options, Path(folder))
        with ros_node() as node:
            records = fly(node, program, arm, options.ways, options.parts)
        load = f'load of the host {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores'
        by = f', flown by Betaflight; simulation pace keep_up; {load}.'
        report(options, {DRONE: records}, arm, by, 'flight_betaflight.html')
    return 0


if __name__ == '__main__':
    sys.exit(main())
