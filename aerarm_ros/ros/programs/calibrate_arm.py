"""`arm calibrate`: move the arm to calibration postures, wait in each posture, and record a bag."""

from __future__ import annotations

import argparse
import sys
from datetime import datetime
from pathlib import Path

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import JointState

from aerarm_msgs_py import topics
from aerarm_ros.calibration.geometry import ArmGeometry
from aerarm_ros.calibration.observations import CalibrationError
from aerarm_ros.calibration.posture_choice import choose_postures, faces_camera
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.excitation.clearance import ClearanceChecker
from aerarm_ros.excitation.settings import load_excitation_config
from aerarm_ros.motion.signals import Array
from aerarm_ros.ros.executors import spin_until
from aerarm_ros.ros.process.node_process import NodeProcess
from aerarm_ros.ros.process.process_end import print_notice
from aerarm_ros.ros.requests.arm_client import ArmClientError
from aerarm_ros.ros.requests.motion_request import SetPointRequest

SENSOR_TYPES = (
    'geometry_msgs/msg/PointStamped',
    'geometry_msgs/msg/PoseStamped',
    'geometry_msgs/msg/TransformStamped',
    'tf2_msgs/msg/TFMessage',
)
_SUITE_TOPICS = ('joint_states', 'arm_mode', 'imu', 'odometry')  # recorded with the sensors
_REST_SPEED = 0.01  # [rad/s] speed below which a joint is at rest
_PATH_POINTS = 60  # number of postures checked for collisions on each straight path
_DISCOVERY_TIME = 3.0  # [s] time to discover the topics of the sensors
_RECORDER_TIME = 20.0  # [s] time limit until the recorder writes the bag
_TOLERANCE = 0.05  # [rad] largest joint position error at a posture


class CalibrateArm:
    """Move the arm to calibration postures, and record joint states and sensors in each posture.

    Parameters
    ----------
    node
        Node that no executor spins.
    options
        Options of `arm calibrate`.
    """

    def __init__(self, node: Node, options: argparse.Namespace) -> None:
        self._node, self._options = node, options
        self._request = SetPointRequest(
            node, lambda what: print_notice('arm', f'waiting for {what}')
        )
        self._state = JointState()
        self._joints: tuple[str, ...] = ()
        topic = topics.JOINT_STATES
        node.create_subscription(topic.type, topic.name, self._on_state, topic.qos)

    def run(self) -> None:
        """Select postures, start the recording, and move the arm to each posture.

        Raises
        ------
        ArmClientError
            If arm, controller or sensor is missing, no postures can be selected, or the arm does
            not reach a posture. In the last case the bag contains the recording up to this posture.
        """
        options = self._options
        if options.marker_normal and not options.camera:
            raise ArmClientError('--marker-normal needs the position of the camera: add --camera')
        if not spin_until(self._node, lambda: bool(self._state.name), options.timeout):
            raise ArmClientError('no joint states received: check that the bridge runs')
        sensors = self._find_sensors()
        try:
            postures = self._choose()
        except ValueError as error:
            raise ArmClientError(str(error)) from None
        if options.dry_run:
            np.savetxt(sys.stdout, postures, '%.4f')
            return
        bag = Path(options.out or f'calibration_{datetime.now():%Y%m%d_%H%M%S}')
        if bag.exists():
            raise ArmClientError(f'the bag {bag} already exists: name another bag with --out')
        recorded = [*_SUITE_TOPICS, *(f'{name}={kind}' for name, kind in sensors)]
        with NodeProcess('recorder', parameters={'bag': bag, 'topics': recorded}) as recorder:
            if not spin_until(self._node, lambda: _has_begun(bag, recorder), _RECORDER_TIME):
                raise ArmClientError(
                    f'the recorder did not start to write {bag} within {_RECORDER_TIME:g} s: check '
                    'the log of the recorder'
                )
            self._visit(postures)
        print(f'the bag {bag} is recorded. Next, run: calibrator --bag {bag}', flush=True)

    def _choose(self) -> Array:
        options = self._options
        config = load_arm_config(options.config or None)
        robot = load_robot(
            options.urdf or None,
            gravity_in_base=config.gravity_in_base,
            joint_names=config.joint_names,
        )
        self._joints = robot.joint_names
        surroundings = load_excitation_config(options.excitation_config or None)
        checker = ClearanceChecker(
            robot,
            surroundings.self_clearance,
            surroundings.ground_clearance,
            surroundings.ground_height,
            unchecked_pairs=surroundings.unchecked_pairs,
        )
        geometry = ArmGeometry(robot, options.link or robot.link_names[-1])
        low, high = robot.posture_range
        middle, half = 0.5 * (low + high), 0.5 * options.span * (high - low)
        is_visible = None
        if options.camera:
            normal = np.array(options.marker_normal or (0.0, 0.0, 1.0))
            is_visible = faces_camera(geometry, np.array(options.camera), normal)

        def is_allowed(q: Array) -> bool:
            within = bool((np.abs(q - middle) <= half).all())
            visible = is_visible is None or is_visible(q)
            return within and visible and checker.margin(q) > 0.0

        choice = choose_postures(
            geometry, options.postures, is_allowed, self._position(), options.seed
        )
        print_notice(
            'arm',
            f'selected {len(choice.q)} postures to estimate {choice.parameters} geometry errors. '
            'Compared with random postures, the log-determinant of the information matrix is '
            f'higher by {choice.information:.2f} per geometry error',
        )
        return self._in_free_order(choice.q, checker)

    def _in_free_order(self, postures: Array, checker: ClearanceChecker) -> Array:
        """Order the postures such that the straight path to each next posture is collision-free."""
        left, at, order = list(range(len(postures))), self._position(), []
        while left:
            near = sorted(left, key=lambda k: float(np.abs(postures[k] - at).max()))
            free = next((k for k in near if _is_free(checker, at, postures[k])), None)
            if free is None:
                break
            order.append(free)
            left.remove(free)
            at = postures[free]
        if left:
            print_notice(
                'arm',
                f'skipped {len(left)} postures, because no straight path to these postures is '
                'collision-free',
            )
        if len(order) < len(postures) // 2:
            raise CalibrationError(
                'no collision-free straight path leads to most of the postures: move the arm away '
                'from obstacles first, or pass a smaller --span'
            )
        return postures[order]

    def _visit(self, postures: Array) -> None:
        options = self._options
        for number, posture in enumerate(postures, start=1):
            self._request.go(posture.tolist(), _TOLERANCE, options.timeout)
            if not spin_until(self._node, self._is_at_rest, options.timeout):
                raise ArmClientError(
                    f'the arm did not come to rest in posture {number} within '
                    f'{options.timeout:g} s: check the gains of the controller'
                )
            self._wait(options.rest)
            print(f'posture {number} of {len(postures)}', flush=True)

    def _wait(self, seconds: float) -> None:
        """Wait until the time stamps of the joint states have advanced by `seconds`."""
        begin = self._stamp()
        longest = self._options.timeout + 10.0 * seconds  # an emulated arm can be slow
        if not spin_until(self._node, lambda: self._stamp() - begin >= seconds, longest):
            raise ArmClientError('joint_states stopped arriving: check the log of the bridge')

    def _find_sensors(self) -> list[tuple[str, str]]:
        """Return the topic and the message type of each sensor that measures markers or poses."""
        own = {self._node.resolve_topic_name(name) for name in topics.TOPICS}
        wanted = set(self._options.sensors)

        def found() -> list[tuple[str, str]]:
            listed = self._node.get_topic_names_and_types()
            sensors = [(n, k) for n, kinds in listed for k in kinds if k in SENSOR_TYPES]
            if wanted:
                return [(n, k) for n, k in sensors if n in wanted or n.lstrip('/') in wanted]
            return [(n, k) for n, k in sensors if n not in own and self._node.count_publishers(n)]

        spin_until(self._node, lambda: len(found()) >= max(1, len(wanted)), _DISCOVERY_TIME)
        # The topics of a motion capture are discovered one after the other.
        spin_until(self._node, lambda: False, 0.5)
        sensors = found()
        if not sensors or len(sensors) < len(wanted):
            raise ArmClientError(
                'topics of markers or poses are missing; the program searched for '
                f'{", ".join(sorted(wanted)) or ", ".join(SENSOR_TYPES)}: start the motion '
                'capture or the camera, or name the topics with --sensors'
            )
        print_notice('arm', f'sensors: {", ".join(name for name, _ in sensors)}')
        return sensors

    def _is_at_rest(self) -> bool:
        return bool(np.abs(self._state.velocity).max(initial=0.0) < _REST_SPEED)

    def _position(self) -> Array:
        """Return the newest joint positions (n,) [rad], in the joint order of the URDF."""
        positions = dict(zip(self._state.name, self._state.position, strict=False))
        missing = [name for name in self._joints if name not in positions]
        if missing:
            raise ArmClientError(
                f'joint_states contain no position of joint {missing[0]}: check that --urdf '
                'describes the arm of the bridge'
            )
        return np.array([positions[name] for name in self._joints])

    def _stamp(self) -> float:
        stamp = self._state.header.stamp
        return float(stamp.sec + 1e-9 * stamp.nanosec)

    def _on_state(self, message: JointState) -> None:
        self._state = message


def _is_free(checker: ClearanceChecker, start: Array, end: Array) -> bool:
    share = np.linspace(0.0, 1.0, _PATH_POINTS)[:, None]
    found = checker.sweep(start + share * (end - start), stop_below=True)
    return all(one.distance >= one.required for one in found.values())


def _has_begun(bag: Path, recorder: NodeProcess) -> bool:
    if recorder.returncode is not None:
        raise ArmClientError(
            f'the recorder ended with exit status {recorder.returncode} before the arm moved: '
            'check the log of the recorder'
        )
    return any(bag.glob('*.mcap'))
