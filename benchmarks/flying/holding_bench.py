"""Test bench of flights in which the arm holds its tool in the world, as processes in lockstep."""

import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from builtin_interfaces.msg import Duration
from flying.arm_model import ArmModel
from flying.holding_case import HELD, ORDINARY, POSTURE, HoldingCase
from flying.node_bench import PATIENCE, NodeBench
from flying.scaled_drone import write_drone
from geometry_msgs.msg import PoseStamped, Transform
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from aerarm_msgs_py import topics
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_msgs_py.live_topics import RawReader
from aerarm_ros.control.base.base_motion import rotation_matrix
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.ros.executors import spin_until
from aerarm_ros.ros.requests.arm_client import ArmClient

SETTLING = 2.0  # [s] after the target, before the evaluation
LENGTH, FREQUENCY, GROWTH = 0.2, 0.25, 2.0  # [m], [Hz], [s] of the path
_POINT = 0.05  # [s]
_REPORT = 2.5  # [s] of host time in which every node reports


@dataclass(frozen=True, eq=False)
class HoldingRecord:
    """Recorded data of a flight with the tool held in the world.

    Attributes
    ----------
    times : (K,) ndarray
        Time since the target was sent [s].
    places : (K, 3) ndarray
        Positions of the drone's body in the world [m].
    attitudes : (K, 4) ndarray
        Quaternions (x, y, z, w).
    postures : (K, n) ndarray
        Joint angles [rad].
    tools, targets : (K, 3) ndarray
        Actual and desired tool positions in the world [m].
    diagnostics : str
        Last diagnostics of the controller, '' without a problem.
    """

    times: np.ndarray
    places: np.ndarray
    attitudes: np.ndarray
    postures: np.ndarray
    tools: np.ndarray
    targets: np.ndarray
    diagnostics: str = ''

    def figures(self) -> tuple[float, float, float, float]:
        """Return RMS and maximum of tool error and drone position error [mm]."""
        rows = self.times > SETTLING
        tool = 1e3 * np.linalg.norm(self.tools - self.targets, axis=1)[rows]
        drone = 1e3 * np.linalg.norm(self.places, axis=1)[rows]
        rms = [float(np.sqrt((x**2).mean())) for x in (tool, drone)]
        return rms[0], float(tool.max()), rms[1], float(drone.max())


class HoldingBench(NodeBench):
    """Processes of one case in flight, with the tool held in the world.

    Raises
    ------
    ValueError, TimeoutError, ArmClientError
        If a process fails or does not respond.
    """

    recorded = topics.JOINT_STATES, topics.TRUE_ODOMETRY

    def __init__(
        self, stack: ExitStack, node: Node, folder: Path, case: HoldingCase, arm: ArmModel
    ) -> None:
        super().__init__(stack, node, folder)
        self.case, drone = case, case.flown
        file = write_drone(drone, folder / 'drone.yaml')
        self._mount = drone.mount
        self._kinematics = Kinematics(load_robot(gravity_in_base=drone.gravity_in_base))
        self._reader = RawReader(node, *self.recorded)
        stack.callback(self._reader.destroy)
        self._codec = JointStateCdr(load_arm_config().joint_names)
        told = {'lead': 0.06, 'rate': 1.0, 'measured_motion': False, **arm.law}
        self.start('base_reaction', told)
        pilot = {'drone_file': file, 'arm_wait': 5.0, **case.pilot, **arm.drawing}
        self.start('flight_control', pilot)
        law = {
            'drone_file': file,
            'base_motion': 'attitude' if case.law == ORDINARY else 'free',
            'imu_latency': 4e-3,
            **arm.law,
        }
        if case.law == HELD:
            self.start('computed_torque', law)
        else:
            law.update(posture=list(POSTURE), mass_ratio_min=0.0)
            odometry = ('--ros-args', '-r', 'odometry:=external_odometry', '--')
            self.start('world_control', law, odometry)
        world = {'seed': arm.seed, 'drone_file': file, **case.world}
        self.start('fake_hardware', world)
        inputs = topics.TOOL_TRAJECTORY, topics.TOOL_MOTION, topics.TOOL_FORCE
        self._targets, self._motions, self._pushes = map(self.publisher_of, inputs)
        client = ArmClient(node, ['fake_hardware'], ['enable'])
        client.wait_for_mode(['idle'], PATIENCE)
        self.wait('flight_control', lambda: node.count_publishers('rotor_command'))
        if case.law != HELD:
            names = [topic.name for topic in inputs]
            self.wait('world_control', lambda: all(map(node.count_subscribers, names)))
        client.call('enable')
        self.wait('the drone', lambda: self.said('drone') == 'flying')

    def fly(self, seconds: float) -> HoldingRecord:
        """Return the record of the tool after its target, which is its position at that time."""
        begin, *_, start = self._seen(2.0)[-1]
        if self.case.law != HELD:
            self._targets.publish(self._target(start))
            if self.case.path:
                self._motions.publish(self._path(start, begin, seconds))
        record = self._record(self._seen(seconds), begin, start)
        if self.case.path:
            record.targets[:] += swing(record.times, path_length(seconds))
        return record

    def _record(
        self, rows: list[tuple[float, ...]], begin: float, target: np.ndarray
    ) -> HoldingRecord:
        """Return the record of rows with one target, after the last diagnostics."""
        columns = [np.array(column) for column in zip(*rows, strict=True)]
        times, places, attitudes, postures, tools = columns
        targets = np.tile(target, (len(times), 1))
        spin_until(self.node, lambda: False, _REPORT)
        said = self.said('world_control')
        return HoldingRecord(times - begin, places, attitudes, postures, tools, targets, said)

    def _seen(self, seconds: float) -> list[tuple[float, ...]]:
        """Return rows of time, drone position and attitude, posture and tool position."""
        rows: list[tuple[float, ...]] = []
        q, deadline = None, time.monotonic() + PATIENCE
        while not rows or rows[-1][0] < rows[0][0] + seconds:
            if time.monotonic() > deadline:
                raise TimeoutError('the simulation does not advance')
            self._reader.wait(0.1)
            state = self._reader.take_newest(0)
            sample = self._codec.unpack(state[0]) if state else None
            if sample is not None and sample.position is not None:
                q = np.array(sample.position)
            raw = self._reader.take_newest(1)
            if raw is None or q is None:
                continue
            deadline = time.monotonic() + PATIENCE
            rows.append(self._row(deserialize_message(raw[0], Odometry), q))
        return rows

    def _row(self, message: Odometry, q: np.ndarray) -> tuple[float, ...]:
        p, r = message.pose.pose.position, message.pose.pose.orientation
        place, turn = np.array([p.x, p.y, p.z]), np.array([r.x, r.y, r.z, r.w])
        in_body = self._mount.position + self._mount.rotation @ self._kinematics.position(q)
        stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        return stamp, place, turn, q, place + rotation_matrix(turn) @ in_body

    def _target(self, place: np.ndarray) -> PoseStamped:
        message = PoseStamped()
        message.header.frame_id = 'odom'
        p, r = message.pose.position, message.pose.orientation
        p.x, p.y, p.z = place.tolist()
        r.w = 0.0  # arbitrary orientation
        return message

    def _path(self, centre: np.ndarray, begin: float, seconds: float) -> MultiDOFJointTrajectory:
        times = np.arange(0.0, path_length(seconds) + _POINT, _POINT)
        message = MultiDOFJointTrajectory(joint_names=['tool0'])
        message.header.frame_id = 'odom'
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(round(1e9 * begin), 10**9)
        for when, place in zip(
            times.tolist(), centre + swing(times, path_length(seconds)), strict=True
        ):
            transform = Transform()
            t = transform.translation
            t.x, t.y, t.z = place.tolist()
            transform.rotation.w = 0.0
            point = MultiDOFJointTrajectoryPoint(transforms=[transform])
            seconds_of_it, rest = divmod(round(1e9 * when), 10**9)
            point.time_from_start = Duration(sec=seconds_of_it, nanosec=rest)
            message.points.append(point)
        return message


def path_length(seconds: float) -> float:
    """Return the duration of a path for an evaluation time [s]."""
    return seconds + 2.0 * GROWTH


def swing(times: np.ndarray, length: float) -> np.ndarray:
    """Return the path about its centre (K, 3) [m], with ramps of 2 s."""
    grown = np.clip(np.minimum(times, length - times) / GROWTH, 0.0, 1.0)
    share = grown**3 * (10.0 - 15.0 * grown + 6.0 * grown**2)
    swing = 0.5 * LENGTH * share * np.sin(2.0 * np.pi * FREQUENCY * times)
    return np.outer(swing, [0.0, 1.0, 0.0])
