"""Test bench of flights in which the arm holds its tool in the world, or presses it on a wall.

All nodes are processes in lockstep.
"""

from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from builtin_interfaces.msg import Duration
from flying.arm_model import ArmModel
from flying.flight_case import write_drone
from flying.flight_record import FlightListener, FlightRecord
from flying.holding_case import HELD, ORDINARY, POSTURE, HoldingCase, PushingCase
from flying.node_bench import PATIENCE, NodeBench
from geometry_msgs.msg import PoseStamped, Transform, WrenchStamped
from rclpy.node import Node
from scipy.spatial.transform import Rotation
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from aerarm_msgs_py import topics
from aerarm_ros.control.checks import JointLimits
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.description.robot import load_robot
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.ros.executors import spin_until
from aerarm_ros.ros.requests.arm_client import ArmClient
from aerarm_ros.world.base_pose import BasePose
from aerarm_ros.world.reach import ArmReach

SETTLING = 2.0  # [s] after the target, before the evaluation
LENGTH, FREQUENCY, GROWTH = 0.2, 0.25, 2.0  # [m], [Hz], [s] of the path
_POINT = 0.05  # [s]
_BOUND_THINNED = 25  # one of so many rows for the physical bound
_REPORT = 2.5  # [s] of host time in which every node reports


@dataclass(frozen=True, eq=False, kw_only=True)
class HoldingRecord(FlightRecord):
    """Recorded data of a flight with the tool held in the world, since the target was sent.

    Attributes
    ----------
    tool_places, targets : (K, 3) ndarray
        Actual and desired tool positions in the world [m].
    diagnostics : str
        Last diagnostics of the controller, '' without a problem.
    bound : tuple of float
        Physical bound: largest distance [mm] of the target from all points that the arm could
        reach, and smallest distance [mm] that the drone could still move.
    """

    tool_places: np.ndarray
    targets: np.ndarray
    diagnostics: str = ''
    bound: tuple[float, float] = (np.nan, np.nan)

    @property
    def tool_errors(self) -> np.ndarray:
        """Distances of the tool from its target (K,) [mm]."""
        return 1e3 * np.linalg.norm(self.tool_places - self.targets, axis=1)

    def figures(self) -> tuple[float, ...]:
        """Return RMS and maximum of tool and drone error, bound [mm], tilt and heading [deg]."""
        rows = self.times > SETTLING
        tool = self.tool_errors[rows]
        drone = 1e3 * np.linalg.norm(self.places, axis=1)[rows]
        rms = [float(np.sqrt((x**2).mean())) for x in (tool, drone)]
        turns = (float(np.degrees(np.abs(x[rows]).max())) for x in (self.tilts, self.headings))
        return rms[0], float(tool.max()), rms[1], float(drone.max()), *self.bound, *turns

    def with_bound(self, drone: DroneConfig) -> 'HoldingRecord':
        """Return this record with the physical bound of an arm under this moving drone."""
        robot = load_robot(gravity_in_base=drone.gravity_in_base)
        reach = ArmReach(Kinematics(robot), JointLimits.from_config(load_arm_config()))
        mount, bounds = drone.mount, []
        for row in np.flatnonzero(self.times > SETTLING)[::_BOUND_THINNED]:
            body = Rotation.from_quat(self.attitudes[row]).as_matrix()
            place = self.places[row] + body @ mount.position
            pose = BasePose(place, np.zeros(3), body @ mount.rotation, np.zeros(3))
            q, target = self.postures[row], self.targets[row]
            beyond = reach.beyond_any(pose.to_base(target)[np.newaxis], q)
            bounds.append((beyond, -reach.margin(q, pose, target).least))
        beyond, least = 1e3 * np.array(bounds).max(axis=0)
        return replace(self, bound=(float(beyond), float(-least)))


class HoldingBench(NodeBench):
    """Processes of one case in flight, with the tool held in the world.

    Raises
    ------
    ValueError, TimeoutError, ArmClientError
        If a process fails or does not respond.
    """

    def __init__(
        self, stack: ExitStack, node: Node, folder: Path, case: HoldingCase, arm: ArmModel
    ) -> None:
        super().__init__(stack, node, folder)
        self.case, self.drone = case, case.flown
        file = write_drone(self.drone, folder / 'drone.yaml')
        self.listener = FlightListener(node, self.drone.rotor_names)
        stack.callback(self.listener.destroy)
        told = {'lead': 0.06, 'rate': 1.0, 'measured_motion': False, **arm.law, **case.carried}
        self.start('base_reaction', told)
        pilot = {'drone_file': file, 'arm_wait': 5.0, **case.pilot, **arm.drawing}
        self.start('flight_control', pilot)
        law = {
            'drone_file': file,
            'base_motion': 'attitude' if case.law == ORDINARY else 'free',
            'imu_latency': 4e-3,
            **arm.law,
            **case.carried,
        }
        if case.law == HELD:
            self.start('computed_torque', law)
        else:
            law.update(posture=list(POSTURE), mass_ratio_min=0.0, **case.law_gains)
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
        begin, start = self._begin()
        if self.case.law != HELD:
            self._targets.publish(self._target(start))
            if self.case.path:
                self._motions.publish(self._path(start, begin, seconds))
        record = self._record(self.seen(seconds), begin, start)
        if self.case.path:
            record.targets[:] += swing(record.times, path_length(seconds))
        return record.with_bound(self.drone)

    def seen(self, seconds: float, is_new: bool = True) -> FlightRecord:
        """Return the record of a time [s], or extend the previous one."""
        if is_new:
            self.listener.forget()
        begin, _ = self.listener.next()
        while self.listener.next()[0] < begin + seconds:
            pass
        return self.listener.record()

    def _begin(self, settling: float = 2.0) -> tuple[float, np.ndarray]:
        """Return time [s] and tool position (3,) [m] after the time `settling` [s]."""
        before = self.seen(settling)
        return float(before.times[-1]), before.tools(self.drone)[-1]

    def _record(self, record: FlightRecord, begin: float, target: np.ndarray) -> HoldingRecord:
        """Return the record with one target, after the last diagnostics."""
        spin_until(self.node, lambda: False, _REPORT)
        return HoldingRecord(
            **vars(record.shifted(begin)),
            tool_places=record.tools(self.drone),
            targets=np.tile(target, (len(record.times), 1)),
            diagnostics=self.said('world_control'),
        )

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


_APPROACH = 4.0  # [s] for approach and rise of the force
_IMPACT = 0.5  # [s] after the first touch
_YIELD = 2.0  # [s] after the wall yields


@dataclass(frozen=True, eq=False, kw_only=True)
class PushingRecord(HoldingRecord):
    """Recorded data of a flight with a wall since the force was sent.

    The targets are those across the force.

    Attributes
    ----------
    forces : (K,) ndarray
        Force on the wall along its normal [N].
    case : PushingCase
    approach : float
        Time for approach and rise of the force [s].
    """

    forces: np.ndarray
    case: PushingCase
    approach: float = _APPROACH

    def figures(self) -> tuple[float, float, float, float]:
        """Return RMS and peak force error [N], error across, and distance of the stop [mm].

        The RMS values exclude approach and rise. A value that does not apply is NaN. The peak is
        the largest force within 0.5 s after the first touch.
        """
        case, forces = self.case, self.forces
        touches = np.flatnonzero(forces > 0.0)
        if not len(touches):
            return np.nan, np.nan, np.nan, np.nan
        touched = self.times[touches[0]]
        peak = float(forces[(self.times < touched + _IMPACT)].max())
        if case.yields_after:
            rows = self.times >= touched + case.yields_after
            along = self.tool_places[rows, 0]
            return np.nan, peak, np.nan, 1e3 * float((along - along[0]).max())
        rows = self.times > self.approach
        error = forces[rows] - case.force
        across = np.linalg.norm((self.tool_places - self.targets)[rows, 1:], axis=1)
        rms = float(np.sqrt((error**2).mean()))
        return rms, peak, 1e3 * float(np.sqrt((across**2).mean())), np.nan


class PushingBench(HoldingBench):
    """Processes of one case in flight, with a wall ahead of the tool."""

    case: PushingCase

    def push(
        self, seconds: float, settling: float = 2.0, approach: float = _APPROACH
    ) -> PushingRecord:
        """Return the record of approach, push and, if the case has a path, slide."""
        begin, start = self._begin(settling)
        self._targets.publish(self._target(start))
        message = WrenchStamped()
        message.header.frame_id = 'odom'
        message.wrench.force.x = self.case.force
        self._pushes.publish(message)
        case = self.case
        flight = self.seen(approach + _YIELD if case.yields_after else approach)
        now = float(flight.times[-1])
        if not case.yields_after:
            if case.path:
                self._motions.publish(self._path(start, now, seconds))
            flight = self.seen(seconds, is_new=False)
        stamps, forces = np.array(self.listener.forces).T
        record = self._record(flight, begin, start)
        if case.path:
            slides = flight.times > now
            record.targets[slides] += swing(flight.times[slides] - now, path_length(seconds))
        felt = np.interp(flight.times, stamps, forces)
        return PushingRecord(**vars(record), forces=felt, case=case, approach=approach)
