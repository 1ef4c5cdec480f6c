"""Tunes a flight controller with each way to bear the arm's motion, all by the same search.

The drone hovers while its arm swings fast, with noise on all sensors and 8 ms of latency. Nelder
and Mead's search, as many flights for each, from the same frequencies; the cost is the RMS position
error. Prints what flying/gains.yaml holds.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml
from flying.arm_swing import ArmSwing
from flying.rigid_flight import RigidFlight
from scipy.optimize import minimize

from aerarm_ros.description.drone_config import DroneConfig, load_drone_config
from aerarm_ros.description.resources import resource
from aerarm_ros.flight.arm_feed_forward import ArmFeedForward
from aerarm_ros.flight.disturbance import Disturbance
from aerarm_ros.flight.disturbance_observer import DisturbanceObserver
from aerarm_ros.flight.flight_control import FlightControl
from aerarm_ros.flight.flight_gains import FlightGains
from aerarm_ros.flight.incremental_estimate import IncrementalEstimate

DRONES = {'tilted_hexarotor': ('drones', 'tilted_hexarotor.yaml'), 'hexarotor': ('drone.yaml',)}
GAINS = Path(__file__).with_name('flying') / 'gains.yaml'
LEAD = 0.028  # [s]
START = {'integral': 0.25, 'observer': 8.0, 'indi': 25.0, 'feed_forward': 0.25}
SIMPLEX = np.array([[0.0, 0.0, 0.0], [0.4, 0.0, 0.0], [0.0, 0.3, 0.0], [0.0, 0.0, 0.5]])
LOST = 1e3  # [mm]


def control(kind: str, drone: DroneConfig, flight: RigidFlight, values: np.ndarray):
    """Return controller and feed-forward of a kind with frequencies and third number."""
    position, attitude, third = values.tolist()
    gains = FlightGains(position_frequency=position, attitude_frequency=attitude)
    arm, estimate = None, None
    share = third if kind in ('integral', 'feed_forward') else 0.0
    gains = replace(gains, position_integral=share, attitude_integral=share)
    if kind == 'feed_forward':
        arm = ArmFeedForward(drone, flight.body, lead=LEAD)
    estimate: Disturbance | None = None
    if kind == 'observer':
        estimate = DisturbanceObserver(third)
    elif kind == 'indi':
        estimate = IncrementalEstimate(drone, third)
    return FlightControl(drone, flight.body, gains, estimate), arm


def tune(kind: str, drone: DroneConfig, flight: RigidFlight, flights: int) -> dict[str, object]:
    """Return the best numbers of a search, and what they reach."""
    tried = []

    def cost(logarithms: np.ndarray) -> float:
        values = np.exp(logarithms)
        errors = flight.fly(*control(kind, drone, flight, values))
        value = LOST if errors is None else errors.position
        tried.append((value, values))
        return value

    start = np.log([2.0, 9.0, START[kind]])
    options = {'initial_simplex': start + SIMPLEX, 'maxfev': flights}
    minimize(cost, start, method='Nelder-Mead', options=options)
    value, best = min(tried, key=lambda entry: entry[0])
    third = 'integral' if kind in ('integral', 'feed_forward') else 'observer_frequency'
    numbers = zip(('position_frequency', 'attitude_frequency', third), best, strict=True)
    rounded = {name: round(float(number), 3) for name, number in numbers}
    return {**rounded, 'position RMS [mm]': round(float(value), 1)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--flights', type=int, default=16, help='of each search')
    parser.add_argument('--seconds', type=float, default=5.0, help='of each flight')
    options, _ = parser.parse_known_args()
    for name, path in DRONES.items():
        drone = load_drone_config(resource('config', *path))
        flight = RigidFlight(drone, ArmSwing('fast', options.seconds))
        for kind in START:
            best = tune(kind, drone, flight, options.flights)
            print(yaml.safe_dump({f'{name}/{kind}': best}, sort_keys=False), end='', flush=True)


if __name__ == '__main__':
    main()
