"""Hover error caused by arm motion with an autopilot's firmware, for several feed-forward methods.

The firmware runs as a program on this host (SITL) and contains control loops and mixer. PX4 and
ArduCopter also contain an estimator; the emulated world is their simulator in lockstep, so the
figures do not depend on the host. `flight_control` is the companion that sends set points. For
Betaflight, `flight_control` provides the position loop and commands the firmware by its sticks in
angle mode. Betaflight does not wait for the simulation, so the emulated world follows real time as
far as the host can. Its figures are valid only on a quiet host; the host's load is printed. `make
flight AUTOPILOT=px4 PX4=<folder of a build>` runs this benchmark.
"""

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
from flying import betaflight_program
from flying.arm_model import ArmModel
from flying.arm_swing import PARTS, FlightProgram
from flying.betaflight_program import BetaflightProgram, find_betaflight
from flying.firmware_program import (
    HOW,
    ArduPilotProgram,
    FirmwareProgram,
    Px4AllGains,
    Px4Program,
    find_ardupilot,
    find_px4,
)
from flying.flight_bench import FlightBench
from flying.flight_case import DRONES, FlightCase, FlightWay, load_drone
from flying.flight_results import Records, report
from flying.node_bench import FAILURES, reason, ros_node
from rclpy.node import Node

from aerarm_ros.autopilot.betaflight_flight import BetaflightSetup
from aerarm_ros.autopilot.px4 import SENSORS, VISION
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.description.robot import load_robot
from aerarm_ros.flight.arm_load import MassProperties

PX4, ARDUPILOT, BETAFLIGHT = 'px4', 'ardupilot', 'betaflight'
FIND = {PX4: find_px4, ARDUPILOT: find_ardupilot, BETAFLIGHT: find_betaflight}
HOW = {**HOW, BETAFLIGHT: betaflight_program.HOW}
BASELINE, ACCELERATION, BEST = WAYS = 'integral', 'acceleration', 'posture, motion, lead'
_LEAD, _BETAFLIGHT_LEAD = 0.03, 0.04  # [s]
GAINS = (1.5, 6.5, 2.0)  # MPC_XY_P, MC_ROLL_P, MC_ROLLRATE_K
# Position loop of a drone with lateral thrust under PX4, in `flight_control`.
_POSITION = {'position_frequency': 5.0, 'height_frequency': 5.0}
# Tilted rotors give ten times the yaw moment, so PX4's default yaw loop would oscillate.
_FULL_YAW = {'mc_yawrate_p': 0.08, 'mc_yaw_tq_cutoff': 10.0}
IMU_NOISE = (0.03, 0.002)  # [m/s^2], [rad/s]
ODOMETRY_NOISE = (0.0005, 0.003, 0.001, 0.001)  # [m], [m/s], [rad], [rad/s] as with motion capture
# For Betaflight: cycles of 2 ms leave a margin on two cores; softer joints tolerate the delay.
_WORLD = (('pace', 'keep_up'), ('period', 0.002))
_LAW = (('kp', [100.0]), ('kd', [20.0]))
_STICK_GAINS = {'position_frequency': 1.6, 'position_damping': 0.9, 'position_integral': 0.3}
_INSTANCE = 10 + os.getpid() % 200  # determines ports that parallel flights do not use
_SETTLING = 15.0  # [s]; PX4's height integrator and hover thrust estimator are slow


def flight_case(
    drone: DroneConfig, way: str, instance: int, options: argparse.Namespace
) -> FlightCase:
    """Return the flight case of a drone and method."""
    fed, name = way != BASELINE, options.autopilot
    lead = _BETAFLIGHT_LEAD if name == BETAFLIGHT else _LEAD
    switches = FlightWay('', posture=fed, motion=fed, lead=lead if fed else 0.0).switches
    if name == BETAFLIGHT:
        flight = {**_STICK_GAINS, 'loops': BETAFLIGHT, **switches}
        return FlightCase(
            drone.mass, 'free', drone=drone, sensors=_WORLD, flight=tuple(flight.items()),
            is_told=True, law=_LAW,
        )  # fmt: skip
    flight = {
        'loops': f'{name}_sitl', 'autopilot_instance': instance,
        'autopilot_sensors': options.sensors, 'tilt_ahead': way != ACCELERATION, **switches,
    }  # fmt: skip
    if name == PX4:
        _, attitude, rate = options.gains
        holds = drone.is_fully_actuated if options.hold_heading is None else options.hold_heading
        yaw = {'mc_yawrate_p': _FULL_YAW['mc_yawrate_p']} if drone.is_fully_actuated else {}
        flight |= {'mc_att_p': attitude, 'mc_rate_k': rate, 'hold_heading': holds}
        flight |= {**_POSITION, **yaw}
    imu, odometry = list(options.imu_noise), list(options.odometry_noise)
    noise = (('imu_noise', imu), ('odometry_noise', odometry))
    return FlightCase(
        drone.mass, 'free', drone=drone, sensors=noise, flight=tuple(flight.items()),
        is_told=fed, told=(('rate', 1.0),), is_touched=False,
    )  # fmt: skip


def program_of(
    place: Path, folder: Path, drone: DroneConfig, arm: ArmModel, options: argparse.Namespace,
    instance: int,
) -> FirmwareProgram:  # fmt: skip
    """Return the firmware's program, configured for a drone."""
    if options.autopilot == BETAFLIGHT:
        return BetaflightProgram(place, folder, drone, BetaflightSetup())
    rest = np.array(load_arm_config().rest_position)
    dynamics = MovingBaseDynamics(load_robot(arm.law.get('urdf')))
    body = MassProperties.of(drone, *dynamics.composite_inertia(rest))
    if options.autopilot == ARDUPILOT:
        return ArduPilotProgram(place, folder, drone, body, instance, sensors=options.sensors)
    gains = Px4AllGains.scaled(*options.gains, **(_FULL_YAW if drone.is_fully_actuated else {}))
    return Px4Program(place, folder, drone, body, gains, instance, options.sensors)


@contextmanager
def flying(
    node: Node, drone: DroneConfig, way: str, arm: ArmModel, options: argparse.Namespace,
    number: int = 0,
) -> Iterator[tuple[FlightBench, Path]]:  # fmt: skip
    """Start the firmware and bring the drone into the air; yield its bench and the log."""
    instance = _INSTANCE + number
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        place = Path(folder)
        program = program_of(options.program, place, drone, arm, options, instance)
        stack.enter_context(program)
        bench = FlightBench(stack, node, place, flight_case(drone, way, instance, options), arm)
        if options.autopilot != BETAFLIGHT:
            bench.settling = _SETTLING
        yield bench, program.log


def fly(node: Node, name: str, arm: ArmModel, options: argparse.Namespace) -> Records:
    """Return the flight record of each method, or the reason of a failure.

    The firmware is started for each method.
    """
    found: Records = {}
    for number, way in enumerate(options.ways):
        begin = time.monotonic()
        try:
            with flying(node, load_drone(name), way, arm, options, number) as (bench, _):
                ready = time.monotonic() - begin
                record = found[way] = bench.fly(FlightProgram(parts=options.parts))
                print(
                    f'{name}, {way}: {"lost" if record.is_lost else "flown"}, released after '
                    f'{ready:.0f} s, ended after {time.monotonic() - begin:.0f} s', flush=True,
                )  # fmt: skip
        except FAILURES as error:
            found[way] = reason(error)
    return found


def parse(parser: argparse.ArgumentParser) -> argparse.Namespace:
    """Add the options of the firmware, and parse all; `program` is None without a firmware."""
    first = next((name for name, find in FIND.items() if find()), PX4)
    parser.add_argument('--autopilot', choices=list(FIND), default=first)
    parser.add_argument('--gains', nargs=3, type=float, default=GAINS,
                        metavar=('XY_P', 'ATT_P', 'RATE_K'), help="PX4's gains")  # fmt: skip
    parser.add_argument('--sensors', choices=SENSORS, default=VISION,
                        help='source of the position of PX4 or ArduPilot')  # fmt: skip
    parser.add_argument('--imu-noise', nargs=2, type=float, default=IMU_NOISE, metavar='DEVIATION',
                        help='IMU noise [m/s^2] and [rad/s]')  # fmt: skip
    parser.add_argument('--odometry-noise', nargs=4, type=float, default=ODOMETRY_NOISE,
                        metavar='DEVIATION',
                        help='odometry noise [m, m/s, rad, rad/s]')  # fmt: skip
    parser.add_argument(
        '--hold-heading',
        action=argparse.BooleanOptionalAction,
        default=None,
        help='hold the heading under PX4 (default: unless the rotors are in one plane)',
    )
    options = parser.parse_args()
    options.program = FIND[options.autopilot]()
    return options


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--drones', nargs='*', default=['hexarotor'], choices=list(DRONES))
    parser.add_argument('--ways', nargs='*', default=[BASELINE, BEST], choices=WAYS)
    parser.add_argument('--out', type=Path, help='folder for the page')
    parser.add_argument('--parts', nargs='*', default=list(PARTS), choices=list(PARTS))
    ArmModel.add_options(parser)
    options = parse(parser)
    if options.autopilot == BETAFLIGHT and ACCELERATION in options.ways:
        parser.error(f'--ways {ACCELERATION} is not available for Betaflight')
    if options.program is None:
        print(HOW[options.autopilot])
        return 1
    by = f', flown by ArduCopter in lockstep, position from {options.sensors}.'
    if options.autopilot == PX4:
        gains = ', '.join(f'{gain:g}' for gain in options.gains)
        by = (
            f', flown by PX4 in lockstep, position from {options.sensors}; '
            f'MPC_XY_P, MC_ROLL_P, MC_ROLLRATE_K {gains}.'
        )
    with tempfile.TemporaryDirectory() as folder:
        arm = ArmModel.chosen(options, Path(folder))
        with ros_node() as node:
            records = {name: fly(node, name, arm, options) for name in options.drones}
        if options.autopilot == BETAFLIGHT:
            load = f'{os.getloadavg()[0]:.1f} on {os.cpu_count()} cores'
            by = f', flown by Betaflight; simulation pace keep_up; load of the host {load}.'
        report(options, records, arm, by, f'flight_{options.autopilot}.html')
    return 0


if __name__ == '__main__':
    sys.exit(main())
