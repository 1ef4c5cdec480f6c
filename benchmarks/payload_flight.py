"""Payload estimation and compensation by the suite's nodes under a flying drone.

`fake_hardware`, `computed_torque`, `payload_estimator` and `flight_control` run as processes in
lockstep, so the figures do not depend on the host. The arm swings fast while the drone hovers.
After some seconds it picks up 0.2 kg, carries it for 11 s and puts it down. The messages on
`payload` are compared with the true payload. The arm's error is compared with that before the
pick-up, with and without payload compensation in the controller. `--noise` sets the IMU noise.
"""

import argparse
import sys
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import rclpy
from flying.arm_model import ArmModel
from flying.arm_swing import ArmSwing
from flying.flight_bench import LEAD, FlightBench
from flying.flight_case import WAYS, FlightCase, load_drone
from flying.flight_record import LOST
from flying.node_bench import ros_node
from geometry_msgs.msg import InertiaStamped
from rclpy.node import Node

from aerarm_msgs_py import topics

LOAD = [0.2, 0.1, 0.01, -0.02]  # [kg], and its position in the last joint's frame [m]
BARE = [0.0, *LOAD[1:]]
OBSERVER = 30.0  # [1/s] gain of the controller's observer
PICK_UP, CARRIED, AFTER = 6.0, 11.0, 1.0  # [s]
WAY, DRONE = 'integral', 'tilted_hexarotor'


@dataclass(frozen=True)
class Weighing:
    """Recorded data of one flight.

    Attributes
    ----------
    pick_up, put_down : float
        Time of the requests to the world [s].
    estimates : (K, 5) ndarray
        Time [s], mass [kg] and centre [m] of each message on `payload`.
    errors : (M, 5) ndarray
        Time [s], and the joints' errors [mrad].
    """

    pick_up: float
    put_down: float
    estimates: np.ndarray
    errors: np.ndarray

    def error(self, begin: float, end: float) -> float:
        """Return the RMS joint error between two times [mrad]."""
        inside = (self.errors[:, 0] > begin) & (self.errors[:, 0] < end)
        return float(np.sqrt(np.mean(self.errors[inside, 1:] ** 2)))

    def weighed(self, since: float) -> str:
        """Return the errors of mass and centre some seconds after the pick-up."""
        rows = self.estimates[self.estimates[:, 0] > self.pick_up + since]
        if not len(rows) or rows[0, 1] < 1e-3:
            return f'no payload found {since:g} s after the pick-up'
        mass, centre = rows[0, 1], rows[0, 2:]
        return (
            f'error of the mass {100.0 * abs(mass / LOAD[0] - 1.0):.1f} %, of the centre of mass '
            f'{1e3 * np.linalg.norm(centre - LOAD[1:]):.1f} mm, {since:g} s after the pick-up'
        )

    def text(self) -> str:
        """Return the results of a flight as text."""
        carrying = self.estimates[self.estimates[:, 1] > 1e-3]
        found = carrying[:1, 0] - self.pick_up
        gone = self.estimates[
            (self.estimates[:, 0] > self.put_down) & (self.estimates[:, 1] < 1e-3)
        ][:1, 0]
        bare = self.error(self.pick_up - 3.0, self.pick_up)
        later = self.error(self.pick_up + 2.0, self.pick_up + 10.0)
        lines = [
            f'pick-up detected after {_seconds(found)}, put-down detected after '
            f'{_seconds(gone - self.put_down)}',
            self.weighed(2.0),
            self.weighed(10.0),
            f'RMS joint error {bare:.2f} mrad before the pick-up, {later:.2f} mrad from 2 to 10 s '
            f'after it ({later / bare:.2f} times the error before)',
        ]
        return '\n'.join(f'  {line}' for line in lines)


def _seconds(times: np.ndarray) -> str:
    return f'{times[0]:.2f} s' if len(times) else 'nothing'


def weigh(node: Node, arm: ArmModel, noise: Sequence[float], share: float) -> Weighing:
    """Return the data of one flight, with a fraction of the payload compensated."""
    drone = load_drone(DRONE)
    sensors = (('imu_noise', list(noise)),)
    flight = tuple(WAYS[WAY].parameters(DRONE).items())
    case = FlightCase(drone.mass, 'free', drone=drone, sensors=sensors, flight=flight)
    law = arm.law | {'hand_over': share, 'observer_gain': OBSERVER}
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        bench = FlightBench(stack, node, Path(folder), case, replace(arm, law=law))
        base = {'drone_file': Path(folder) / 'believed.yaml', 'base_motion': 'free'}
        bench.start('payload_estimator', arm.law | base)
        estimates: list[tuple[float, ...]] = []

        def note(message: InertiaStamped) -> None:
            stamp, body = message.header.stamp, message.inertia
            centre = body.com.x, body.com.y, body.com.z
            estimates.append((stamp.sec + 1e-9 * stamp.nanosec, body.m, *centre))

        bench.listen(topics.PAYLOAD, note)
        return _fly(bench, estimates)


def _fly(bench: FlightBench, estimates: list[tuple[float, ...]]) -> Weighing:
    """Swing the arm, pick up the payload, carry it and put it down."""
    begin = bench.wait_until_still() + LEAD
    motion = ArmSwing('fast', PICK_UP + CARRIED + AFTER + 4.0)
    bench.send(motion, begin)
    orders = [(PICK_UP, LOAD), (PICK_UP + CARRIED, BARE)]
    when, rows, now = [], [], begin
    while now < begin + PICK_UP + CARRIED + AFTER:
        now, q = bench.listener.next()
        rclpy.spin_once(bench.node, timeout_sec=0.0)
        rows.append((now, *q))
        if len(when) < len(orders) and now > begin + orders[len(when)][0]:
            bench.change_world('payload', orders[len(when)][1])
            when.append(now)
    if bench.listener.farthest > LOST:
        raise ValueError('the drone was lost')
    table = np.array(rows)
    wanted = motion.evaluate(table[:, 0] - begin)[0]
    errors = np.column_stack([table[:, 0], 1e3 * (table[:, 1:] - wanted)])
    return Weighing(when[0], when[1], np.array(estimates).reshape(-1, 5), errors)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    ArmModel.add_options(parser, default='true')
    parser.add_argument(
        '--noise', type=float, nargs=2, default=(0.1, 0.003), help='IMU noise [m/s^2] and [rad/s]'
    )
    parser.add_argument(
        '--shares', type=float, nargs='*', default=(1.0, 0.0), help='compensated fractions'
    )
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        arm = ArmModel.chosen(options, Path(folder))
        for share in options.shares:
            with ros_node() as node:
                text = weigh(node, arm, options.noise, share).text()
            print(f'IMU noise {options.noise}, payload compensation {100.0 * share:.0f} %:\n{text}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
