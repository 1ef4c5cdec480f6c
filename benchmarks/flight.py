"""Hover error caused by arm motion, for several feed-forward methods of the flight controller.

`fake_hardware`, `computed_torque`, `base_reaction` and `flight_control` run as processes in
lockstep, so the figures do not depend on the host. The drone hovers while the arm swings slowly,
reaches out by 90 degrees in 1.5 s, swings fast, plays an excitation, and picks up an undeclared
payload of 0.2 kg. Each method uses gains from benchmarks/flight_gains.py (flying/gains.yaml). The
arm deviates from its model; all nodes use parameters that `identifier` estimates from a recorded
excitation (with `--model true` the arm equals its model). The sensors have no delay unless
`--latency` is given. `make flight` also writes a page.
"""

import argparse
import os
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from multiprocessing import get_context
from pathlib import Path

from flying.arm_model import ArmModel
from flying.arm_swing import PARTS, FlightProgram
from flying.flight_bench import FlightBench
from flying.flight_case import DRONES, WAYS, FlightCase, load_drone, ways_of
from flying.flight_record import FlightRecord
from flying.flight_results import report
from flying.node_bench import FAILURES, reason, ros_node
from rclpy.node import Node

Records = dict[str, FlightRecord | str]
# A flight in lockstep waits for its slowest process, which leaves cores idle.
AT_ONCE = (os.cpu_count() or 1) + 1


def jobs(names: list[str], ways: list[str]) -> list[tuple[str, list[str]]]:
    """Return drones with their methods in order, longest flights first.

    Methods with equal gains differ only in settings that can be switched in flight.
    """
    found: dict[tuple[str, str], list[str]] = {}
    for name in names:
        for way in ways:
            if way in ways_of(name):
                found.setdefault((name, WAYS[way].gains), []).append(way)
    by_length = sorted(found.items(), key=lambda job: -len(job[1]))
    return [(name, flown) for (name, _), flown in by_length]


def fly(
    number: int, name: str, ways: list[str], arm: ArmModel, options: argparse.Namespace
) -> Records:
    """Return the records of one drone's flights, or the reason of a failure."""
    found: Records = {}
    with ros_node(number) as node:
        while left := [way for way in ways if way not in found]:
            fly_until_lost(node, name, left, arm, options, found)
    return found


def fly_until_lost(
    node: Node, name: str, ways: list[str], arm: ArmModel, options: argparse.Namespace,
    found: Records,
) -> None:  # fmt: skip
    """Fly all methods in one simulation, until the drone is lost."""
    drone, program, late = load_drone(name), FlightProgram(parts=options.parts), options.latency
    flown, first = ways[0], WAYS[ways[0]]
    flight = {**first.parameters(name), **arm.drawing}
    if options.frequencies:
        position, attitude = options.frequencies
        flight |= {'position_frequency': position, 'height_frequency': position}
        flight['attitude_frequency'] = attitude
    case = FlightCase(
        drone.mass, 'free', drone=drone, is_told=first.is_told,
        sensors=(('imu_delay', late), ('odometry_delay', late)) if late else (),
        flight=tuple(flight.items()), told=(('rate', 1.0),), is_touched=False,
    )  # fmt: skip
    try:
        with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
            bench = FlightBench(stack, node, Path(folder), case, arm)
            for flown in ways:
                bench.switch(WAYS[flown].later(late).switches)
                record = found[flown] = bench.fly(program)
                print(f'{name}, {flown}: {"lost" if record.is_lost else "flown"}', flush=True)
                if record.is_lost:
                    return
    except FAILURES as error:
        found[flown] = reason(error)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--drones', nargs='*', default=['hexarotor'], choices=list(DRONES))
    parser.add_argument('--ways', nargs='*', default=list(WAYS), choices=list(WAYS))
    ArmModel.add_options(parser)
    parser.add_argument('--parts', nargs='*', default=list(PARTS), choices=list(PARTS))
    parser.add_argument(
        '--wrong',
        type=float,
        default=0.0,
        help="relative error of each link's mass, centre of mass and inertia in the model [-]",
    )
    parser.add_argument(
        '--wrong-seed',
        type=int,
        default=1,
        help='random seed for the signs of the model errors of --wrong',
    )
    parser.add_argument('--latency', type=float, default=0.0, help='delay of odometry and IMU [s]')
    parser.add_argument(
        '--frequencies',
        nargs=2,
        type=float,
        default=(),
        metavar='RAD_PER_S',
        help='frequencies of the position and attitude loops [rad/s], for all controllers',
    )
    parser.add_argument('--out', type=Path, help='folder for the page')
    options = parser.parse_args()
    first = os.getpid()  # process ids of workers may differ by less than the number of flights
    context = get_context('spawn')
    with (
        tempfile.TemporaryDirectory() as folder,
        ProcessPoolExecutor(AT_ONCE, mp_context=context) as pool,
    ):
        arm = pool.submit(ArmModel.chosen, options, Path(folder)).result()
        if options.wrong:
            arm = arm.with_errors(options.wrong, options.wrong_seed, Path(folder))
        flights = [
            (name, pool.submit(fly, number, name, ways, arm, options))
            for number, (name, ways) in enumerate(jobs(options.drones, options.ways), first)
        ]
        found: dict[str, Records] = {name: {} for name in options.drones}
        for name, flight in flights:
            found[name].update(flight.result())
        records = {
            name: {way: flown[way] for way in options.ways if way in flown}
            for name, flown in found.items()
        }
        by = f'; delay of the sensors {1e3 * options.latency:g} ms.'
        report(options, records, arm, by, 'flight.html')
    return 0


if __name__ == '__main__':
    sys.exit(main())
