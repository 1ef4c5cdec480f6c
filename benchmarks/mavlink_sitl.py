"""Hover error of PX4 or ArduCopter with the feed-forward of `mavlink_feedforward`, in real time.

PX4 or ArduCopter runs as a program on this host and flies a rigid drone whose arm swings
(`RigidFlight`). The node runs as a process with a MAVLink connection of its own. This program is
the firmware's simulator, publishes the set point, and publishes the arm's forecast as
`base_reaction` does. `PX4=<folder of a build>` or `ARDUPILOT=<folder of ArduPilot>` selects the
firmware. With `--silence`, set points stop for some seconds; then the autopilot's failsafe or its
last set point decides. `behind ms` is the total delay of the simulation behind real time.
Above some hundred milliseconds
the computer is too slow, and the errors are too large.
"""

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from firmware import GAINS
from flying.arm_swing import ArmSwing
from flying.firmware_program import (
    HOW,
    ArduPilotProgram,
    FirmwareProgram,
    Px4AllGains,
    Px4Program,
    find_ardupilot,
    find_px4,
)
from flying.flight_case import load_drone
from flying.node_bench import ros_node
from flying.rigid_flight import RigidFlight
from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from std_msgs.msg import Header

from aerarm_msgs_py import topics
from aerarm_ros.autopilot.ardupilot import ArduPilotSetup
from aerarm_ros.autopilot.ardupilot_flight import ArduPilotFirmware
from aerarm_ros.autopilot.firmware_flight import LockstepFirmware
from aerarm_ros.autopilot.px4_flight import Px4Firmware
from aerarm_ros.description.drone_config import GRAVITY, DroneConfig
from aerarm_ros.flight.flight_state import FlightState, FlightTarget
from aerarm_ros.motion.signals import Array
from aerarm_ros.ros.messages import inertia_message, wrench_message
from aerarm_ros.ros.process.node_process import NodeProcess
from aerarm_ros.ros.states.state_stream import base_header

_INSTANCE = 1 + os.getpid() % 200
_NODE_PORT = 18570 + _INSTANCE  # PX4's link for a ground station
_HELD = 0.004  # [s] of one step while the drone is held
_LOWERING = 1.0  # [s]


class Topics:
    """Publisher of set points and of the arm's forecast, in place of user and `base_reaction`.

    `at` returns no feed-forward to the simulation.
    """

    def __init__(self, node: Node, begin: Callable[[], float]) -> None:
        self._node, self._begin = node, begin
        self._places, self._inertias, self._wrenches = (
            node.create_publisher(topic.type, topic.name, topic.offered)
            for topic in (topics.FLIGHT_SET_POINT, topics.ARM_INERTIA, topics.MOTION_WRENCH)
        )

    def lead(self, place: Array) -> None:
        """Publish a set point of the drone."""
        message = PoseStamped()
        point = message.pose.position
        point.x, point.y, point.z = place.tolist()
        message.pose.orientation.w = 1.0
        self._places.publish(message)

    def offer_inertia(self, stamp: float, mass: float, com: Array, inertia: Array) -> None:
        """Publish the arm's mass properties at a time of the flight [s]."""
        self._inertias.publish(inertia_message(self._header(stamp), mass, com, inertia))

    def offer_motion(self, stamp: float, wrench: Array) -> None:
        """Publish the wrench of the arm's motion at a time of the flight [s]."""
        self._wrenches.publish(wrench_message(self._header(stamp), wrench))

    def at(self, now: float) -> None:
        """Return no feed-forward, because `mavlink_feedforward` adds it."""

    def _header(self, stamp: float) -> Header:
        return base_header(round(1e9 * (self._begin() + stamp)), '')


class PacedControl:
    """Flight control of `RigidFlight`: the firmware alone, in real time.

    Attributes
    ----------
    begin : float
        Wall time [s] of the flight's start; later by each delay of the simulation.
    behind : float
        Sum of the simulation's delays behind real time [s].
    """

    def __init__(
        self, firmware: LockstepFirmware, drone: DroneConfig, mass: float,
        silence: tuple[float, float],
    ) -> None:  # fmt: skip
        self._firmware, self._most = firmware, drone.column('thrust_max')
        self._lift = mass * GRAVITY / float(np.mean(self._most * drone.allocation[2]))
        self._silence = silence
        self._shares = np.zeros(drone.n)
        self._elapsed = 0.0
        self.begin = time.time()
        self.behind = 0.0
        self.topics: Topics | None = None

    def update(
        self, state: FlightState, target: FlightTarget, dt: float, arm: object = None
    ) -> Array:
        """Advance the firmware by `dt` [s] and wait until that time; return thrusts (n,) [N]."""
        if not self._firmware.is_flying:
            self._take_off(state, target)
        rise = self._firmware.rise * np.exp(-self._elapsed / _LOWERING)
        begin, length = self._silence
        if not begin <= self._elapsed < begin + length:
            self._lead(target.position, rise)
        self._note(self._firmware.step(state, dt))
        self._elapsed += dt
        late = self._wait(self.begin + self._elapsed)
        self.begin, self.behind = self.begin + late, self.behind + late
        return np.asarray(self._shares * self._most)

    def _take_off(self, state: FlightState, target: FlightTarget) -> None:
        until = time.time()
        while not self._firmware.is_flying:
            if self._firmware.wants_set_points:  # a set point ends ArduCopter's take-off
                self._lead(target.position, self._firmware.rise)
            self._note(self._firmware.hold(state, self._lift))
            until = max(until, time.time() - _HELD) + _HELD
            self._wait(until)
        self.begin = time.time()

    def _lead(self, place: Array, rise: float) -> None:
        if self.topics is not None:
            self.topics.lead(place + [0.0, 0.0, rise])

    def _note(self, shares: Array | None) -> None:
        if shares is not None:
            self._shares = np.clip(shares[: len(self._most)], 0.0, 1.0)

    def _wait(self, until: float) -> float:
        """Wait until a time of the system clock [s]; return by how much it has passed [s]."""
        left = until - time.time()
        time.sleep(max(left, 0.0))
        return max(-left, 0.0)


def firmware_of(
    flight: RigidFlight, folder: Path, stack: ExitStack
) -> tuple[LockstepFirmware, FirmwareProgram, dict[str, object]]:
    """Start the selected firmware; return it with the node's parameters for its gains.

    Raises
    ------
    ValueError
        If no firmware is selected.
    """
    drone, body = flight.drone, flight.body
    if (build := find_px4()) is not None:
        gains = Px4AllGains.scaled(*GAINS)
        program: FirmwareProgram = Px4Program(build, folder, drone, body, gains, _INSTANCE)
        parameters: dict[str, object] = {
            'attitude_gain': gains.mc_att_p, 'rate_gain': gains.mc_rate_k * gains.mc_rate_p,
            'integral_rate': gains.mc_rate_i / gains.mc_rate_p, 'hold_heading': False,
            'connection': f'udp:127.0.0.1:{_NODE_PORT}',
        }  # fmt: skip
        firmware: LockstepFirmware = Px4Firmware.instance(_INSTANCE)
    elif (path := find_ardupilot()) is not None:
        plan = ArduPilotSetup()
        program = ArduPilotProgram(path, folder, drone, body, _INSTANCE, _NODE_PORT)
        parameters = {
            'firmware': 'ardupilot', 'attitude_gain': plan.att_p, 'rate_gain': plan.rate_p,
            'integral_rate': plan.rate_i / plan.rate_p, 'connection': f'udp:{_NODE_PORT}',
        }  # fmt: skip
        firmware = ArduPilotFirmware.instance(_INSTANCE, drone)
    else:
        raise ValueError(f'{HOW["px4"]}. {HOW["ardupilot"]}')
    stack.callback(firmware.close)
    stack.enter_context(program)
    return firmware, program, parameters


def fly(node: Node, options: argparse.Namespace, is_told: bool) -> str:
    """Return the results of a flight as a line of the table."""
    flight = RigidFlight(load_drone('hexarotor'), ArmSwing(options.motion, options.seconds))
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        firmware, program, parameters = firmware_of(flight, Path(folder), stack)
        parameters['drone_file'] = 'config/drone.yaml'
        log = Path(folder) / 'node.log'
        stack.enter_context(NodeProcess('mavlink_feedforward', parameters=parameters, log=log))
        silence = options.seconds / 2, options.silence
        control = PacedControl(firmware, flight.drone, flight.body.mass, silence)
        control.topics = Topics(node, lambda: control.begin)
        found = flight.fly(control, control.topics if is_told else None)
        warnings = [line for line in log.read_text().splitlines() if 'WARN' in line]
    texts = '; '.join(text for text in firmware.texts if 'nvalid' in text or 'ailsafe' in text)
    way = 'feed-forward' if is_told else 'none'
    if found is None:
        return f'{way:14} lost after {flight.flown:.0%} {firmware.problem} {texts} {warnings}'
    return (
        f'{way:14} {found.position:6.1f} {found.position_max:8.1f} {found.heading_max:8.1f} '
        f'{1e3 * control.behind:8.0f}  {texts} {"; ".join(warnings)}'
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--motion', choices=('slow', 'fast'), default='slow', help='arm motion')
    parser.add_argument('--seconds', type=float, default=20.0, help='duration of the motion [s]')
    parser.add_argument('--silence', type=float, default=0.0, help='time without set points [s]')
    options = parser.parse_args()
    print('feed-forward   RMS mm   max mm  heading  behind ms')
    try:
        with ros_node() as node:
            for is_told in (False, True):
                print(fly(node, options, is_told), flush=True)
    except ValueError as error:
        print(error)
        return 1
    return 0


if __name__ == '__main__':
    sys.exit(main())
