"""Test bench of a flight: bridge, arm controller and flight controller as processes in lockstep."""

import json
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import yaml
from flying.arm_model import ArmModel
from flying.arm_swing import PAYLOAD, ArmSwing, FlightProgram
from flying.compared_flight import ComparedFlightProcess
from flying.flight_case import FlightCase, scaled_drone, write_drone
from flying.flight_record import LOST, FlightListener, FlightRecord
from flying.node_bench import PATIENCE, NodeBench
from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient

from aerarm_msgs_py import topics
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.resources import resource
from aerarm_ros.motion.signals import JointMotion
from aerarm_ros.ros.process.node_process import NodeProcess
from aerarm_ros.ros.requests.arm_client import ArmClient
from aerarm_ros.ros.requests.motion_request import trajectory_message
from aerarm_ros.ros.requests.parameter_request import ParameterRequest

LEAD = 2.5  # [s]
QUICK_LEAD = 1.5  # [s]
SETTLING = 10.0  # [s] longest settling time
FOLLOWED = 0.3  # [rad] largest tracking error of a joint
ARM_WAIT = 5.0  # [s] on the host


class FlightBench(NodeBench):
    """Processes of one flight case, which are ready for an arm motion.

    Attributes
    ----------
    settling : float
        World time spent waiting for the drone to hover still [s].

    Raises
    ------
    ValueError, TimeoutError, ArmClientError
        If a process fails or does not respond.
    """

    def __init__(
        self, stack: ExitStack, node: Node, folder: Path, case: FlightCase, arm: ArmModel
    ) -> None:
        super().__init__(stack, node, folder)
        self.settling = SETTLING
        rotors: tuple[str, ...] = ()
        world = {'seed': arm.seed, 'pace': 'lockstep', 'encoders': 'absolute', **dict(case.sensors)}
        law: dict[str, object] = {
            'base_motion': case.base,
            'path_tolerance': 10.0,
            # Motions are not slowed down, because their effect on the drone is measured.
            'rotor_share': 0.0,
            'observer_gain': 0.0,
            **arm.law,
            **dict(case.law),
        }
        if case.mass:
            drone = case.drone or scaled_drone(case.mass)
            rotors = drone.rotor_names
            world['drone_file'] = write_drone(drone, folder / 'true.yaml')
            wrong = drone.with_errors(case.believed, case.believed)
            law['drone_file'] = write_drone(wrong, folder / 'believed.yaml')
            pilot = {'drone_file': law['drone_file']}
            if case.is_told:
                told = {'lead': case.ahead, **dict(case.told)}
                if case.is_touched:
                    told['drone_file'] = law['drone_file']
                self.start('base_reaction', {**told, **arm.law})
                pilot.update(arm.drawing)
                if world['pace'] == 'lockstep':
                    # Otherwise the timeliness of the arm's forecast would depend on the host.
                    pilot['arm_wait'] = ARM_WAIT
            # Without these parameters the flight controller uses the nominal arm.
            flight = {**pilot, **dict(case.flight)}
            process = ComparedFlightProcess if 'law' in flight else NodeProcess
            self.start('flight_control', flight, process=process)
        else:
            law['config'] = world['config'] = _hanging(folder / 'arm.yaml')
        # The controller does not compensate a delay of the IMU.
        deaf = () if case.hears_rotors else ('--ros-args', '-r', 'rotor_command:=unheard', '--')
        self.start('computed_torque', law, deaf)
        self._bridge = self.start('fake_hardware', world)
        self.listener = FlightListener(node, rotors)
        stack.callback(self.listener.destroy)
        self.publisher = self.publisher_of(topics.JOINT_TRAJECTORY)
        self.client = ArmClient(node, ['fake_hardware'], ['enable'])
        self._world = AsyncParameterClient(node, 'fake_hardware')
        self._places = self.publisher_of(topics.FLIGHT_SET_POINT)
        # Delayed odometry arrives only once the world runs, after the arm is enabled.
        self._is_late = 'odometry_delay' in dict(case.sensors)
        self._get_ready(is_flying=bool(case.mass))

    def move(self, motion: ArmSwing) -> tuple[np.ndarray, np.ndarray]:
        """Return times [s] since the start, and errors (M, n) [mrad], between the ramps."""
        now, _ = self.listener.next()
        begin = now + LEAD
        self.send(motion, begin)
        samples = []
        while now < begin + motion.duration:
            now, q = self.listener.next()
            samples.append((now - begin, q))
        self.client.wait_for_mode(['running'], 20.0)
        times = np.array([when for when, _ in samples])
        moving = motion.is_moving(times)
        q = np.array([angles for _, angles in samples])[moving]
        return times[moving], 1e3 * (q - motion.evaluate(times[moving])[0])

    def fly(self, program: FlightProgram) -> FlightRecord:
        """Return the record of drone and arm; the program starts at time 0, after the record.

        Raises
        ------
        ValueError
            If the arm does not follow its motion, so that the drone is not disturbed.
        """
        motion = program.motion
        begin, now = self.begin(motion), -np.inf
        # The payload acts some milliseconds after the request.
        payloads = list(zip(program.carrying, (PAYLOAD, []), strict=False))
        while now < begin + motion.duration and self.listener.farthest < LOST:
            now, _ = self.listener.next()
            if payloads and now > begin + payloads[0][0]:
                self.change_world('payload', payloads.pop(0)[1])
        for _, carried in payloads:
            self.change_world('payload', carried)
        record = self.listener.record().shifted(begin)
        if not record.is_lost and (off := record.largest_joint_error(motion)) > FOLLOWED:
            raise ValueError(f'the arm is {off:.2f} rad off its motion: {self._bridge.tail(1)}')
        return record

    def begin(self, motion: JointMotion) -> float:
        """Send a motion to the arm once the drone hovers; return its start [s]."""
        # Without a set point the drone stays at its first, noisy odometry position.
        self._places.publish(PoseStamped())
        begin = self.wait_until_still() + QUICK_LEAD
        self.send(motion, begin)
        return begin

    def send(self, motion: JointMotion, begin: float) -> None:
        """Send a motion that begins at a time [s], and forget what was recorded before."""
        names = load_arm_config().joint_names
        self.publisher.publish(trajectory_message(motion, names, round(begin * 1e9)))
        self.listener.forget()

    def change_world(self, name: str, numbers: list[float]) -> None:
        """Change a parameter of the emulated world without waiting."""
        kind = Parameter.Type.DOUBLE_ARRAY
        self._world.set_parameters([Parameter(name, kind, numbers)])

    def wait_until_still(self) -> float:
        """Return the time [s] at which the drone hovers at its set point, or the wait has ended."""
        self.listener.forget()
        begin, _ = self.listener.next()
        now, looked = begin, begin
        while now < begin + self.settling:
            now, _ = self.listener.next()
            if now > looked + 0.1:
                looked = now
                if self.listener.is_still():
                    break
        return now

    def switch(self, values: dict[str, object]) -> None:
        """Change the feed-forward settings of the flight controller."""
        request = ParameterRequest(self.node, 'flight_control', PATIENCE)
        for name, value in values.items():
            request.set(name, json.dumps(value))

    def _get_ready(self, is_flying: bool) -> None:
        """Enable the arm and wait for the release of the drone; a held drone looks still too."""
        self.client.wait_for_mode(['idle'], PATIENCE)
        self.wait('computed_torque', self.publisher.get_subscription_count)
        if is_flying:
            self._wait_for_pilot()
        self.client.call('enable')
        self.client.wait_for_mode(['running'], PATIENCE)
        if is_flying:
            self.wait('the drone', lambda: self.said('drone') == 'flying')

    def _wait_for_pilot(self) -> None:
        """Wait until the flight controller is available and responds, as in every run."""
        came: list[object] = []
        topic, node = topics.ROTOR_COMMAND, self.node
        commands = node.create_subscription(topic.type, topic.name, came.append, topic.qos)
        self.wait(
            'flight_control', lambda: came or (self._is_late and commands.get_publisher_count())
        )
        node.destroy_subscription(commands)


def _hanging(path: Path) -> Path:
    """Write the arm's configuration for hanging from a fixed base."""
    hanging = yaml.safe_load(resource('config', 'aerarm.yaml').read_text())
    hanging['gravity_in_base'] = [0.0, 0.0, 9.81]
    path.write_text(yaml.safe_dump(hanging))
    return path
