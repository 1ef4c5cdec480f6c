"""Hover error caused by arm motion with PX4's firmware, for several feed-forward methods.

The firmware runs as a program on this host (SITL) and contains estimator, control loops and mixer.
The emulated world is its simulator in lockstep, so the figures do not depend on the host.
`flight_control` is the companion that sends set points. `make flight AUTOPILOT=px4 PX4=<folder of a
build>` runs this benchmark.
"""

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path

import numpy as np
from flying.arm_model import ArmModel
from flying.flight_bench import FlightBench
from flying.flight_case import FlightCase
from flying.flight_page import Records, report
from flying.flight_program import PARTS, FlightProgram
from flying.flight_way import DRONES, FlightWay, load_drone
from flying.node_bench import FAILURES, reason, ros_node
from flying.px4_program import HOW, Px4AllGains, Px4Program, Px4Setup, find_px4
from rclpy.node import Node

from aerarm_ros.autopilot.px4 import SENSORS, VISION
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.description.robot import load_robot
from aerarm_ros.flight.arm_load import MassProperties

WAYS = {
    'integral': FlightWay('px4'),
    'acceleration': FlightWay('px4', posture=True, motion=True, lead=0.03),
    'posture, motion, lead': FlightWay('px4', posture=True, motion=True, lead=0.03),
}
_LEANS = {'acceleration': False}
GAINS = (1.5, 6.5, 2.0)  # MPC_XY_P, MC_ROLL_P, MC_ROLLRATE_K
# Position loop of a drone with lateral thrust, in `flight_control`.
POSITION = {'position_frequency': 5.0, 'height_frequency': 5.0}
# Tilted rotors give ten times the yaw moment, so PX4's default yaw loop would oscillate.
_FULL_YAW = {'mc_yawrate_p': 0.08, 'mc_yaw_tq_cutoff': 10.0}
IMU_NOISE = (0.03, 0.002)  # [m/s^2], [rad/s]
ODOMETRY_NOISE = (0.0005, 0.003, 0.001, 0.001)  # [m], [m/s], [rad], [rad/s] as with motion capture
_INSTANCE = 10 + os.getpid() % 200  # determines ports that parallel flights do not use
_SETTLING = 15.0  # [s]; PX4's height integrator and hover thrust estimator are slow


def at_rest(drone: DroneConfig, arm: ArmModel) -> MassProperties:
    """Return drone and arm at rest as one body."""
    config, robot = load_arm_config(), load_robot(arm.law.get('urdf'))
    rest = np.array(config.rest_position)
    return MassProperties.of(drone, *MovingBaseDynamics(robot).composite_inertia(rest))


def flight_case(
    drone: DroneConfig, way: str, instance: int, options: argparse.Namespace
) -> FlightCase:
    """Return the flight case of a drone and method."""
    _, attitude, rate = options.gains
    holds = drone.is_fully_actuated if options.hold_heading is None else options.hold_heading
    flight = {
        'loops': 'px4_sitl', 'autopilot_instance': instance, 'mc_att_p': attitude,
        'mc_rate_k': rate, 'autopilot_sensors': options.sensors, 'hold_heading': holds,
        'tilt_ahead': _LEANS.get(way, True), **POSITION, **WAYS[way].switches,
        **({'mc_yawrate_p': _FULL_YAW['mc_yawrate_p']} if drone.is_fully_actuated else {}),
    }  # fmt: skip
    return noisy_case(drone, way, flight, options.imu_noise, options.odometry_noise)


def noisy_case(
    drone: DroneConfig, way: str, flight: dict[str, object],
    imu_noise: Sequence[float] = IMU_NOISE, odometry_noise: Sequence[float] = ODOMETRY_NOISE,
) -> FlightCase:  # fmt: skip
    """Return a flight case with parameters of `flight_control` and noise of the sensors."""
    noise = (('imu_noise', list(imu_noise)), ('odometry_noise', list(odometry_noise)))
    return FlightCase(
        drone.mass, 'free', drone=drone, sensors=noise, flight=tuple(flight.items()),
        is_told=WAYS[way].is_told, told=(('rate', 1.0),), is_touched=False,
    )  # fmt: skip


@contextmanager
def flying(
    node: Node, build: Path, drone: DroneConfig, way: str, arm: ArmModel,
    options: argparse.Namespace, number: int = 0,
) -> Iterator[tuple[FlightBench, Path]]:  # fmt: skip
    """Start PX4 and bring the drone into the air; yield its test bench and PX4's log."""
    yaw = _FULL_YAW if drone.is_fully_actuated else {}
    setup = Px4Setup(Px4AllGains.scaled(*options.gains, **yaw), options.sensors)
    instance = _INSTANCE + number
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        place, body = Path(folder), at_rest(drone, arm)
        program = Px4Program(build, place, drone, body, setup, instance)
        stack.enter_context(program)
        bench = FlightBench(stack, node, place, flight_case(drone, way, instance, options), arm)
        bench.settling = _SETTLING
        yield bench, program.log


Flying = Callable[
    [Node, Path, DroneConfig, str, ArmModel, argparse.Namespace, int],
    AbstractContextManager[tuple[FlightBench, Path]],
]


def fly(
    node: Node, build: Path, name: str, arm: ArmModel, options: argparse.Namespace, flying: Flying
) -> Records:
    """Return the flight record of each method, or the reason of a failure.

    The firmware is started for each method.
    """
    found: Records = {}
    for number, way in enumerate(options.ways):
        begin = time.monotonic()
        try:
            with flying(node, build, load_drone(name), way, arm, options, number) as (bench, _):
                ready = time.monotonic() - begin
                record = found[way] = bench.fly(FlightProgram(parts=options.parts))
                print(
                    f'{name}, {way}: {"lost" if record.is_lost else "flown"}, released after '
                    f'{ready:.0f} s, ended after {time.monotonic() - begin:.0f} s', flush=True,
                )  # fmt: skip
        except FAILURES as error:
            found[way] = reason(error)
    return found


def options_of(parser: argparse.ArgumentParser) -> None:
    """Add the options common to all flights with PX4."""
    parser.add_argument('--gains', nargs=3, type=float, default=GAINS,
                        metavar=('XY_P', 'ATT_P', 'RATE_K'))  # fmt: skip
    parser.add_argument('--sensors', choices=SENSORS, default=VISION)
    parser.add_argument('--imu-noise', nargs=2, type=float, default=IMU_NOISE, metavar='DEVIATION',
                        help='IMU noise [m/s^2] and [rad/s]')  # fmt: skip
    parser.add_argument('--odometry-noise', nargs=4, type=float, default=ODOMETRY_NOISE,
                        metavar='DEVIATION',
                        help='odometry noise [m, m/s, rad, rad/s]')  # fmt: skip
    parser.add_argument(
        '--hold-heading',
        action=argparse.BooleanOptionalAction,
        default=None,
        help='hold the heading (default: unless the rotors are in one plane)',
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options_of(parser)
    options, build = flight_options(parser), find_px4()
    if build is None:
        print(HOW)
        return 1
    note = (
        f'PX4 in lockstep, position from {options.sensors}; MPC_XY_P, MC_ROLL_P, MC_ROLLRATE_K '
        f'{", ".join(f"{gain:g}" for gain in options.gains)}.'
    )
    return fly_all(build, options, flying, note, 'flight_px4.html')


def flight_options(parser: argparse.ArgumentParser) -> argparse.Namespace:
    """Parse the options, with those of every benchmark that flies a firmware."""
    parser.add_argument('--drones', nargs='*', default=['hexarotor'], choices=list(DRONES))
    parser.add_argument('--ways', nargs='*', default=['integral', 'posture, motion, lead'],
                        choices=list(WAYS))  # fmt: skip
    parser.add_argument('--out', type=Path, help='folder for the page')
    parser.add_argument('--parts', nargs='*', default=list(PARTS), choices=list(PARTS))
    ArmModel.add_options(parser)
    return parser.parse_args()


def fly_all(build: Path, options: argparse.Namespace, flying: Flying, by: str, page: str) -> int:
    """Fly all drones and methods, print the table and write the page."""
    with tempfile.TemporaryDirectory() as folder:
        arm = ArmModel.chosen(options, Path(folder))
        with ros_node() as node:
            records = {
                name: fly(node, build, name, arm, options, flying) for name in options.drones
            }
        report(options, records, arm, f', flown by {by}', page)
    return 0


if __name__ == '__main__':
    sys.exit(main())
