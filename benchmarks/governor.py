"""Arm motions that a governor slows down to the limits of the drone's rotors and heading.

A drone of 3 kg hovers while its arm moves. The joints follow their plan exactly, and the flight
controller receives noisy, late sensors (`RigidFlight`). Each motion is flown as requested and with
the governor, by flight controllers without and with feed-forward of the arm's motion, without and
with preview. The motions are a slow and a fast swing and a reach of 90 degrees (govern: slowed down
along the path), and the excitation (one factor). With `--stream`, points of the same motions arrive
at 100 Hz, and the governor limits velocity and acceleration. With `--carried`, the arm carries a
payload that neither governor nor flight controller knows.
"""

import argparse
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import yaml
from flying.arm_swing import PAYLOAD, FlightProgram
from flying.flight_case import DRONES, GAINS, height_frequency, load_drone
from flying.rigid_flight import RigidFlight
from numpy.typing import ArrayLike

from aerarm_ros.control.base.rotor_wrench import carrier_parameters
from aerarm_ros.control.checks import JointLimits, RejectedInputError
from aerarm_ros.control.references.joint_trajectory import JointTrajectory
from aerarm_ros.control.references.reference_chase import ReferenceChase
from aerarm_ros.control.references.trajectory_follower import FollowerTolerances, TrajectoryFollower
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.description.robot import load_robot
from aerarm_ros.flight.arm_load import ArmFeedForward
from aerarm_ros.flight.flight_control import FlightControl, FlightGains
from aerarm_ros.model.inertia import parameters_of_body
from aerarm_ros.model.whole_body_dynamics import WholeBodyDynamics
from aerarm_ros.motion.polynomial_path import PolynomialPath
from aerarm_ros.motion.signals import JointMotion, JointReference
from aerarm_ros.world.heading import HeadingControl
from aerarm_ros.world.rotor_governor import PacedMotion, RotorGovernor

CYCLE = 1e-3  # [s] of the controller
PARTS = 'slow', 'reach', 'fast', 'excitation'
# Preview time [s] of the feed-forward.
WAYS = {'feedback': None, 'feed-forward': 0.0, 'feed-forward, preview': 0.028}
LINE = '{:16} {:11} {:22} {:>9} {:>7} {:>12} {:>14} {:>10}'
HEADINGS = (
    'drone',
    'motion',
    'controller',
    'governor',
    'time s',
    'heading deg',
    'position mm',
    'tilt',
)


@dataclass(frozen=True, eq=False)
class Scaled:
    """Motion whose duration is multiplied by a factor."""

    motion: JointMotion
    factor: float

    @property
    def duration(self) -> float:
        """Duration [s]."""
        return self.factor * self.motion.duration

    def evaluate(self, time: ArrayLike) -> JointReference:
        """Return the reference (M, n) at times (M,) [s]."""
        return self.motion.evaluate(np.asarray(time) / self.factor).paced(1.0 / self.factor, 0.0)


@dataclass(frozen=True, eq=False)
class Points:
    """Motion that returns the reference (n,) for one time."""

    motion: JointMotion

    @property
    def duration(self) -> float:
        """Duration [s]."""
        return self.motion.duration

    def evaluate(self, time: float) -> JointReference:
        """Return the reference (n,) at a time [s]."""
        return JointReference(*(np.ravel(part) for part in self.motion.evaluate(time)))


def governor_of(
    drone: DroneConfig, share: float, heading: HeadingControl, unknown: float
) -> RotorGovernor:
    """Return the governor of the nominal arm under a drone."""
    robot = load_robot(gravity_in_base=drone.gravity_in_base)
    rotors = load_arm_config().column('reflected_inertia')
    whole = WholeBodyDynamics(robot, rotors, carrier_parameters(drone))
    return RotorGovernor(whole, drone, drone.gravity_in_base, share, heading, unknown)


def governed(governor: RotorGovernor, part: str, motion: JointMotion) -> JointMotion:
    """Return a motion as the nodes would play it."""
    points: PacedMotion = Points(motion)
    if part == 'excitation':
        return Scaled(motion, governor.slowdown(points))
    found = governor.govern(points)
    return motion if found is points else found


def streamed(motion: JointMotion, governor: RotorGovernor | None) -> JointMotion:
    """Return the motion of an arm that receives points at 100 Hz, and of 6 s after the last."""
    limits, points = JointLimits.from_config(load_arm_config()), Points(motion)
    chase = None if governor is None else ReferenceChase(limits, governor.motion_limits)
    follower = TrajectoryFollower(limits, FollowerTolerances.uniform(limits.n), chase=chase)
    follower.take_over(points.evaluate(0.0).q)
    rows = []
    for cycle in range(round((motion.duration + 6.0) / CYCLE)):
        now = cycle * CYCLE
        if cycle % 10 == 0 and now < motion.duration:
            point = [[part.tolist()] for part in points.evaluate(now)]
            # A point beyond the limits is rejected, as by a node.
            with suppress(RejectedInputError):
                follower.follow(JointTrajectory(limits, limits.names, [0.0], *point), now)
        rows.append(follower.update(follower.reference.q, now, CYCLE))
    parts = [np.array(part) for part in zip(*rows, strict=True)]
    return PolynomialPath.quintic(CYCLE * np.arange(len(rows)), *parts)


def control(
    way: str, name: str, drone: DroneConfig, flight: RigidFlight
) -> tuple[FlightControl, ArmFeedForward | None]:
    """Return flight controller and feed-forward.

    Feedback alone uses the default gains of `flight_control`: with the gains of `make flight`, the
    drone crashes under a stretched arm at rest.
    """
    lead = WAYS[way]
    if lead is None:
        return FlightControl(drone, flight.body), None
    tuned = yaml.safe_load(GAINS.read_text())[f'{name}/feed_forward']
    position = tuned['position_frequency']
    gains = FlightGains(
        position, height_frequency(drone, position), tuned['attitude_frequency'],
        position_integral=tuned['integral'], attitude_integral=tuned['integral'],
    )  # fmt: skip
    return FlightControl(drone, flight.body, gains), ArmFeedForward(drone, flight.body, lead=lead)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--drones', nargs='*', default=['hexarotor'], choices=list(DRONES))
    parser.add_argument('--parts', nargs='*', default=list(PARTS), choices=PARTS)
    parser.add_argument('--swing', type=float, default=2.0, help='duration of the full swing [s]')
    parser.add_argument('--share', type=float, default=0.7, help='parameter rotor_share')
    parser.add_argument('--heading', type=float, default=5.0, help='heading_max [deg]')
    parser.add_argument(
        '--frequency', type=float, default=2.0, help='parameter heading_frequency [rad/s]'
    )
    parser.add_argument(
        '--unknown', type=float, default=0.25, help='parameter unknown_payload [kg]'
    )
    parser.add_argument(
        '--carried', type=float, default=0.0, help='mass of an unknown payload [kg]'
    )
    parser.add_argument(
        '--stream', action='store_true', help='stream the motion as points at 100 Hz'
    )
    options = parser.parse_args()
    place = np.array(PAYLOAD[1:])
    carried = parameters_of_body(options.carried, place, np.zeros((3, 3)))
    motions = {part.name: part.motion for part in FlightProgram(options.swing).parts}
    print(LINE.format(*HEADINGS))
    for name in options.drones:
        drone = load_drone(name)
        for part in options.parts:
            for way in WAYS:
                heading = HeadingControl(
                    np.radians(options.heading), options.frequency, WAYS[way] is not None
                )
                governor = governor_of(drone, options.share, heading, options.unknown)
                for word in ('off', 'on'):
                    motion = motions[part]
                    if options.stream:
                        motion = streamed(motion, governor if word == 'on' else None)
                    elif word == 'on':
                        motion = governed(governor, part, motion)
                    flight = RigidFlight(drone, motion, carried=carried)
                    errors = flight.fly(*control(way, name, drone, flight))
                    figures = ['crash', '-', '-']
                    if errors is not None:
                        numbers = errors.heading_max, errors.position_max, errors.tilt_max
                        figures = [f'{number:.1f}' for number in numbers]
                    row = name, part, way, word, f'{motion.duration:.1f}', *figures
                    print(LINE.format(*row), flush=True)


if __name__ == '__main__':
    main()
