"""How far the arm's motion moves the drone that carries it, over topics, by what is fed forward.

`fake_hardware`, `computed_torque`, `base_reaction` and `flight_control` run as processes, in
lockstep. The drone hovers at a place while the arm swings. Each way to bear that flies with the
gains that benchmarks/flight_gains.py found for it (flying/gains.yaml).
"""

import argparse
import os
import tempfile
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import rclpy
import yaml
from flight_gains import DRONES, GAINS
from flying.arm_model import ArmModel
from flying.arm_swing import MOTIONS, RAMP, ArmSwing
from flying.flight_bench import FlightBench
from flying.flight_case import FlightCase
from rclpy.node import Node

from aerarm_ros.description.drone_config import DroneConfig, load_drone_config
from aerarm_ros.description.resources import resource
from aerarm_ros.ros.requests.arm_client import ArmClientError

LINE = '{:17} {:26} {:5} {:>9} {:>7} {:>10} {:>6}'
HEADINGS = ('drone', 'against the arm', '', 'RMS [mm]', 'max', 'tilt [deg]', 'max')
# Which gains, and what is fed forward besides.
NOTHING = {'feed_posture': False, 'feed_motion': False}
WAYS = {
    'integral': ('integral', NOTHING),
    'observer': ('observer', {**NOTHING, 'rejection': 'observer'}),
    'INDI': ('indi', {**NOTHING, 'rejection': 'indi'}),
    'posture': ('feed_forward', {'feed_motion': False, 'feed_lead': 0.0}),
    'posture, motion': ('feed_forward', {'feed_lead': 0.0}),
    'posture, motion, lead': ('feed_forward', {}),
}


def parameters(drone: str, way: str) -> dict[str, object]:
    """Return what flight_control is given for one way to bear the arm."""
    kind, switches = WAYS[way]
    tuned = yaml.safe_load(GAINS.read_text())[f'{drone}/{kind}']
    gains = {name: value for name, value in tuned.items() if name.endswith('frequency')}
    if 'integral' in tuned:
        gains.update(position_integral=tuned['integral'], attitude_integral=tuned['integral'])
    return {**gains, **switches}


def fly(node: Node, name: str, drone: DroneConfig, way: str, seconds: dict[str, float]) -> None:
    """Fly one way and print its lines."""
    case = FlightCase(
        drone.mass, 'free', drone=drone, flight=tuple(parameters(name, way).items()), is_told=True
    )
    try:
        with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
            bench = FlightBench(stack, node, Path(folder), case, ArmModel.true())
            for motion, length in seconds.items():
                times, _ = bench.move(ArmSwing(motion, length))
                end = bench.listener.places[-1][0]
                begin = end - length + RAMP
                rows = [row for row in bench.listener.places if begin < row[0] < end - RAMP]
                away = np.array([1e3 * np.linalg.norm(place) for _, place, _ in rows])
                tilt = np.degrees([angle for _, _, angle in rows])
                figures = [f'{np.sqrt((row**2).mean()):.2f}' for row in (away, tilt)]
                largest = [f'{row.max():.2f}' for row in (away, tilt)]
                both = [text for pair in zip(figures, largest, strict=True) for text in pair]
                print(LINE.format(name, way, motion, *both), flush=True)
    except (ValueError, TimeoutError, ArmClientError) as error:
        text = ' '.join(str(error).split())[:160]
        print(LINE.format(name, way, '', *'----'), text, flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    tuned = list(dict.fromkeys(key.split('/')[0] for key in yaml.safe_load(GAINS.read_text())))
    parser.add_argument('--drones', nargs='*', default=tuned, choices=tuned)
    parser.add_argument('--ways', nargs='*', default=list(WAYS), choices=list(WAYS))
    parser.add_argument('--seconds', type=float, nargs=2, default=(8.0, 8.0),
                        help='length of the slow and of the fast motion')  # fmt: skip
    options, _ = parser.parse_known_args()
    os.environ['ROS_DOMAIN_ID'] = str(1 + os.getpid() % 100)
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    rclpy.init(args=[])
    node = rclpy.create_node('flight')
    print(LINE.format(*HEADINGS))
    seconds = {m: s for m, s in zip(MOTIONS, options.seconds, strict=True) if s > 0.0}
    for name in options.drones:
        drone = load_drone_config(resource('config', *DRONES[name]))
        for way in options.ways:
            fly(node, name, drone, way, seconds)
    rclpy.shutdown()


if __name__ == '__main__':
    main()
