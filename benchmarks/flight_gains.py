"""Tuning of the flight controller's gains for each feed-forward method.

The drone hovers while its arm reaches out by 90 degrees, returns, and swings fast, with noise on
all sensors and 8 ms of latency. The gains minimize the RMS position error. The search (Nelder-Mead)
uses the same number of flights and the same two start values for each method. The output is the
content of flying/gains.yaml.
"""

import argparse
from dataclasses import replace

import numpy as np
import yaml
from flying.arm_swing import FlightProgram
from flying.compared_flight import DisturbanceObserver, IncrementalEstimate, RejectingFlight
from flying.firmware_program import Px4AllGains
from flying.flight_case import DRONES, height_frequency, load_drone
from flying.px4_loops import Px4Flight
from flying.rigid_flight import RigidFlight
from scipy.optimize import minimize

from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.flight.arm_load import ArmFeedForward
from aerarm_ros.flight.flight_control import FlightControl, FlightGains

LEAD = 0.028  # [s]
# Initial values of the searches: position and attitude frequency [rad/s], third number by kind.
STARTS = (2.0, 9.0), (5.0, 8.0)
INTEGRALS = 'integral', 'feed_forward'
THIRD = {'integral': 0.25, 'observer': 8.0, 'indi': 20.0, 'feed_forward': 0.25}
PX4_STARTS = [[1.0, 6.5, 3.0], [1.5, 8.0, 4.0]]
KINDS = [*THIRD, 'px4', 'px4_feed_forward']
# The search uses the arm's exact weight; a wrong weight must be compensated within seconds.
INTEGRAL_MIN = 0.1
SIMPLEX = np.array([[0.0, 0.0, 0.0], [0.4, 0.0, 0.0], [0.0, 0.3, 0.0], [0.0, 0.0, 0.5]])
LOST = 1e3  # [mm]


def control(kind: str, drone: DroneConfig, flight: RigidFlight, values: np.ndarray):
    """Return controller and feed-forward of a kind, for two frequencies and a third gain."""
    position, attitude, third = values.tolist()
    arm = ArmFeedForward(drone, flight.body, lead=LEAD) if 'feed_forward' in kind else None
    if 'px4' in kind:
        px4 = Px4AllGains.scaled(position, attitude, third)
        return Px4Flight(drone, flight.body, px4, holds_heading=False), arm
    height = height_frequency(drone, position)
    gains = FlightGains(position, height, attitude)
    if kind == 'observer':
        return RejectingFlight(drone, flight.body, gains, DisturbanceObserver(third)), arm
    if kind == 'indi':
        return RejectingFlight(drone, flight.body, gains, IncrementalEstimate(drone, third)), arm
    gains = replace(gains, position_integral=third, attitude_integral=third)
    return FlightControl(drone, flight.body, gains), arm


def tune(kind: str, drone: DroneConfig, flight: RigidFlight, flights: int) -> dict[str, object]:
    """Return the best parameters of a search, and their cost."""
    tried = []

    def cost(logarithms: np.ndarray) -> float:
        values = np.exp(logarithms)
        if kind in INTEGRALS:
            values[2] = max(values[2], INTEGRAL_MIN)
        errors = flight.fly(*control(kind, drone, flight, values))
        value = LOST * (2.0 - flight.flown) if errors is None else errors.position
        tried.append((value, values))
        return value

    starts = PX4_STARTS if 'px4' in kind else [[*start, THIRD[kind]] for start in STARTS]
    for start in np.log(starts):
        options = {'initial_simplex': start + SIMPLEX, 'maxfev': flights}
        minimize(cost, start, method='Nelder-Mead', options=options)
    value, best = min(tried, key=lambda entry: entry[0])
    names = ['position_frequency', 'attitude_frequency', 'integral']
    if 'px4' in kind:
        names = ['mpc_xy_p', 'mc_att_p', 'mc_rate_k']
    elif kind in ('observer', 'indi'):
        names[2] = 'observer_frequency'
    numbers = zip(names, best, strict=True)
    rounded = {name: round(float(number), 3) for name, number in numbers}
    return {**rounded, 'position RMS [mm]': round(float(value), 1)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--flights', type=int, default=16, help='number of flights per search')
    parser.add_argument('--seconds', type=float, default=1.0, help='duration of the fast swing [s]')
    parser.add_argument('--drones', nargs='*', default=list(DRONES), choices=list(DRONES))
    parser.add_argument('--kinds', nargs='*', default=KINDS, choices=KINDS)
    options = parser.parse_args()
    motion = FlightProgram(options.seconds).without('slow', 'excitation')
    for name in options.drones:
        drone = load_drone(name)
        flight = RigidFlight(drone, motion)
        for kind in options.kinds:
            if 'px4' in kind and drone.is_fully_actuated:
                continue  # PX4's loops do not support such a drone
            best = tune(kind, drone, flight, options.flights)
            print(yaml.safe_dump({f'{name}/{kind}': best}, sort_keys=False), end='', flush=True)


if __name__ == '__main__':
    main()
