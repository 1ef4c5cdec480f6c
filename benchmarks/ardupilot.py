"""Hover error caused by arm motion with ArduCopter's firmware, for several feed-forward methods.

The firmware runs as a program on this host (SITL) and contains estimator, control loops and mixer.
The emulated world is its simulator in lockstep, so the figures do not depend on the host. `make
flight AUTOPILOT=ardupilot ARDUPILOT=<folder of ArduPilot>` runs this benchmark.
"""

import argparse
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from flying.ardupilot_program import HOW, ArduPilotProgram, find_ardupilot
from flying.arm_model import ArmModel
from flying.flight_bench import FlightBench
from flying.flight_case import FlightCase
from px4 import WAYS, at_rest, flight_options, fly_all, noisy_case
from rclpy.node import Node

from aerarm_ros.autopilot.ardupilot_setup import ArduPilotSetup
from aerarm_ros.autopilot.px4 import SENSORS, VISION
from aerarm_ros.description.drone_config import DroneConfig

_INSTANCE = 1 + os.getpid() % 200  # determines ports that parallel flights do not use
_SETTLING = 15.0  # [s]


def flight_case(
    drone: DroneConfig, way: str, instance: int, options: argparse.Namespace
) -> FlightCase:
    """Return the flight case of a drone and method."""
    flight = {
        'loops': 'ardupilot_sitl', 'autopilot_instance': instance,
        'autopilot_sensors': options.sensors, 'tilt_ahead': way != 'acceleration',
        **WAYS[way].switches,
    }  # fmt: skip
    return noisy_case(drone, way, flight)


@contextmanager
def flying(
    node: Node, program: Path, drone: DroneConfig, way: str, arm: ArmModel,
    options: argparse.Namespace, number: int = 0,
) -> Iterator[tuple[FlightBench, Path]]:  # fmt: skip
    """Start ArduCopter and bring the drone into the air; yield its bench and ArduCopter's log."""
    setup, instance = ArduPilotSetup(sensors=options.sensors), _INSTANCE + number
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        place = Path(folder)
        run = ArduPilotProgram(program, place, drone, at_rest(drone, arm), setup, instance)
        stack.enter_context(run)
        bench = FlightBench(stack, node, place, flight_case(drone, way, instance, options), arm)
        bench.settling = _SETTLING
        yield bench, run.log


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--sensors', choices=SENSORS, default=VISION)
    options, program = flight_options(parser), find_ardupilot()
    if program is None:
        print(HOW)
        return 1
    by = f'ArduCopter in lockstep, position from {options.sensors}.'
    return fly_all(program, options, flying, by, 'flight_ardupilot.html')


if __name__ == '__main__':
    sys.exit(main())
