"""Bridge, controller and flight controller as processes in lockstep, and the arm's errors."""

import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import yaml
from flying.arm_model import ArmModel
from flying.arm_swing import ArmSwing
from flying.flight_case import FlightCase
from flying.scaled_drone import scaled_drone, write_drone
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.serialization import deserialize_message

from aerarm_msgs_py import topics
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_msgs_py.live_topics.raw_reader import RawReader
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.resources import resource
from aerarm_ros.ros.controllers.trajectory_output import trajectory_message
from aerarm_ros.ros.process.node_process import NodeProcess
from aerarm_ros.ros.requests.arm_client import ArmClient

LEAD = 2.5  # [s]
AHEAD = 0.06  # [s] that the drone is told of its arm ahead of time
PATIENCE = 300.0  # [s] of the host, which may be busy


class FlightListener:
    """What the arm and the drone say, with the world's time."""

    def __init__(self, node: Node) -> None:
        self._reader = RawReader(node, topics.JOINT_STATES, topics.ODOMETRY)
        self._codec = JointStateCdr(load_arm_config().joint_names)
        self.farthest = 0.0
        self.places: list[tuple[float, np.ndarray, float]] = []  # time [s], place [m], tilt [rad]

    def next(self) -> tuple[float, np.ndarray]:
        """Return time [s] and joint angles of the next state."""
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            self._reader.wait(0.1)
            odometry = self._reader.take_newest(1)
            if odometry is not None:
                self._note(deserialize_message(odometry[0], Odometry))
            message = self._reader.take_newest(0)
            sample = self._codec.unpack(message[0]) if message else None
            if sample is not None and sample.position is not None:
                return sample.stamp_ns * 1e-9, np.array(sample.position)
        raise TimeoutError(f'no joint states for {PATIENCE:g} s')

    def forget(self) -> None:
        """Forget where the drone was."""
        self.farthest = 0.0
        self.places.clear()

    def _note(self, message: Odometry) -> None:
        p, q = message.pose.pose.position, message.pose.pose.orientation
        place = np.array([p.x, p.y, p.z])
        self.farthest = max(self.farthest, float(np.linalg.norm(place)))
        tilt = np.arccos(min(1.0, 1.0 - 2.0 * (q.x * q.x + q.y * q.y)))
        stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        self.places.append((stamp, place, float(tilt)))

    def destroy(self) -> None:
        """Destroy the subscriptions."""
        self._reader.destroy()


class FlightBench:
    """Processes of one case, ready to move.

    Raises
    ------
    ValueError, TimeoutError, ArmClientError
        If one refuses, or does not answer.
    """

    def __init__(
        self, stack: ExitStack, node: Node, folder: Path, case: FlightCase, arm: ArmModel
    ) -> None:
        self.folder, self.node = folder, node
        world = {'seed': arm.seed, 'pace': 'lockstep', **dict(case.sensors)}
        law: dict[str, object] = {
            'base_motion': case.base,
            'path_tolerance': 10.0,
            'observer_gain': 0.0,
            **arm.law,
        }
        if case.mass:
            drone = case.drone or scaled_drone(case.mass)
            world['drone_file'] = write_drone(drone, folder / 'true.yaml')
            wrong = drone.with_errors(case.believed, case.believed)
            law['drone_file'] = write_drone(wrong, folder / 'believed.yaml')
            pilot = {'drone_file': law['drone_file'], **dict(case.flight)}
            if case.is_told:
                told = {'drone_file': law['drone_file'], 'lead': AHEAD, 'state_timeout': 10.0}
                self._start(stack, 'base_reaction', {**told, **arm.law})
                pilot.update({key: arm.law[key] for key in ('urdf',) if key in arm.law})
            # Else it knows the arm as drawn.
            self._start(stack, 'flight_control', pilot)
        else:
            law['config'] = world['config'] = _hanging(folder / 'arm.yaml')
        # Of a late IMU the controller does not know.
        deaf = () if case.hears_rotors else ('--ros-args', '-r', 'rotor_command:=unheard', '--')
        self.law = self._start(stack, 'computed_torque', law, deaf)
        self._start(stack, 'fake_hardware', world)
        self.listener = FlightListener(node)
        stack.callback(self.listener.destroy)
        topic = topics.JOINT_TRAJECTORY
        self.publisher = node.create_publisher(topic.type, topic.name, topic.qos)
        self.client = ArmClient(node)
        self._get_ready(is_flying=bool(case.mass))

    def move(self, motion: ArmSwing) -> tuple[np.ndarray, np.ndarray]:
        """Return times [s] since the begin, and errors (M, n) [mrad], between the ramps."""
        now, _ = self.listener.next()
        begin = round((now + LEAD) * 1e9)
        names = load_arm_config().joint_names
        self.publisher.publish(trajectory_message(motion, names, begin))
        self.listener.forget()
        samples = []
        while now < begin * 1e-9 + motion.duration:
            now, q = self.listener.next()
            samples.append((now - begin * 1e-9, q))
        self.client.wait_for_mode(['running'], 20.0)
        times = np.array([when for when, _ in samples])
        moving = motion.is_moving(times)
        q = np.array([angles for _, angles in samples])[moving]
        return times[moving], 1e3 * (q - motion.evaluate(times[moving])[0])

    def _get_ready(self, is_flying: bool) -> None:
        self.client.wait_for_mode(['idle'], PATIENCE)
        deadline = time.monotonic() + PATIENCE
        while not self.publisher.get_subscription_count():
            if self.law.returncode is not None:
                raise ValueError(self.law.tail(1))
            if time.monotonic() > deadline:
                raise TimeoutError(self.law.tail(3))
            time.sleep(0.05)
        if is_flying:
            self._wait_for_pilot()
        self.client.call('enable')
        self.client.wait_for_mode(['running'], PATIENCE)

    def _start(
        self, stack: ExitStack, name: str, values: dict, arguments: tuple[str, ...] = ()
    ) -> NodeProcess:
        log = self.folder / f'{name}.log'
        return stack.enter_context(NodeProcess(name, arguments, values, log=log))

    def _wait_for_pilot(self) -> None:
        """Wait until the flight controller answers, so that every run begins alike."""
        reader = RawReader(self.node, topics.ROTOR_COMMAND)
        deadline = time.monotonic() + PATIENCE
        while not (reader.wait(0.1) and reader.take_newest()):
            if time.monotonic() > deadline:
                raise TimeoutError('flight_control does not answer')
        reader.destroy()


def _hanging(path: Path) -> Path:
    """Write the arm's configuration, hung from a fixed base."""
    hanging = yaml.safe_load(resource('config', 'aerarm.yaml').read_text())
    hanging['gravity_in_base'] = [0.0, 0.0, 9.81]
    path.write_text(yaml.safe_dump(hanging))
    return path
