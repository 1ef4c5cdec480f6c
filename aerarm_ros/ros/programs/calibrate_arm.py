"""`arm calibrate`: move the arm through postures, wait in each, and record a bag."""

from __future__ import annotations

import argparse
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
_OWN = ('joint_states', 'arm_mode', 'imu', 'odometry')  # topics of the suite in the bag
_STILL = 0.01  # [rad/s] speed below which a joint is at rest
_WAY = 60  # checked postures of a path
_DISCOVERY = 3.0  # [s]
_RECORDER = 20.0  # [s] until the recorder records
_NEAR = 0.05  # [rad] largest error at a posture


class CalibrateArm:
    """Move the arm through postures, wait in each, and record.

    Parameters
    ----------
    node
        Node without executor.
    options
        Options of `arm calibrate`.
    """

    def __init__(self, node: Node, options: argparse.Namespace) -> None:
        self._node, self._options = node, options
        self._request = SetPointRequest(node)
        self._state: JointState | None = None
        self._joints: tuple[str, ...] = ()
        topic = topics.JOINT_STATES
        node.create_subscription(topic.type, topic.name, self._on_state, topic.qos)

    def run(self) -> None:
        """Select postures, start the recording, and move to each posture.

        Raises
        ------
        ArmClientError
            If arm, controller or sensor is missing, no postures can be selected, or one is not
            reached. The bag keeps the recording up to that point.
        """
        options = self._options
        if options.marker_normal and not options.camera:
            raise ArmClientError('--marker-normal needs --camera: add the position of the camera')
        if not spin_until(self._node, lambda: self._state is not None, options.timeout):
            raise ArmClientError('no joint_states received: check that a bridge runs')
        sensors = self._find_sensors()
        try:
            postures = self._choose()
        except ValueError as error:
            raise ArmClientError(str(error)) from None
        if options.dry_run:
            _print_postures(postures)
            return
        bag = Path(options.out or f'calibration_{datetime.now():%Y%m%d_%H%M%S}')
        if bag.exists():
            raise ArmClientError(f'{bag} already exists: name another bag with --out')
        recorded = [*_OWN, *(f'{name}={kind}' for name, kind in sensors)]
        with NodeProcess('recorder', parameters={'bag': bag, 'topics': recorded}) as recorder:
            if not spin_until(self._node, lambda: _has_begun(bag, recorder), _RECORDER):
                raise ArmClientError(
                    f'the recorder does not start to write {bag}: check the log of the recorder'
                )
            self._visit(postures)
        print(f'{bag} is recorded; next, run: calibrator --bag {bag}', flush=True)

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

        def is_allowed(q: Array) -> bool:
            return bool((np.abs(q - middle) <= half).all()) and checker.margin(q) > 0.0

        is_visible = None
        if options.camera:
            normal = np.array(options.marker_normal or (0.0, 0.0, 1.0))
            is_visible = faces_camera(geometry, np.array(options.camera), normal)
        choice = choose_postures(
            geometry, options.postures, is_allowed, is_visible, self._position(), options.seed
        )
        print_notice(
            'arm',
            f'{len(choice.q)} configurations for {choice.parameters} errors; log det of the '
            f'information is {choice.information:+.2f} per error higher than with random '
            'configurations',
        )
        return self._free_ways(choice.q, checker)

    def _free_ways(self, postures: Array, checker: ClearanceChecker) -> Array:
        """Return the postures in an order in which the straight path to each is free."""
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
                f'{len(left)} configurations are skipped, because no straight path to them is free',
            )
        if len(order) < len(postures) // 2:
            raise CalibrationError(
                'most configurations have no collision-free straight path: move the arm into the '
                'open first, or pass a smaller --span'
            )
        return postures[order]

    def _visit(self, postures: Array) -> None:
        options = self._options
        for number, posture in enumerate(postures, start=1):
            self._request.go(posture.tolist(), _NEAR, options.timeout, _say_wait)
            if not spin_until(self._node, self._is_still, options.timeout):
                raise ArmClientError(
                    f'the arm does not come to rest in configuration {number}: check the gains '
                    'of the controller'
                )
            self._wait(options.rest)
            print(f'configuration {number} of {len(postures)}', flush=True)

    def _wait(self, seconds: float) -> None:
        """Wait for a time [s] on the clock of the joint states."""
        begin = self._stamp()
        longest = self._options.timeout + 10.0 * seconds  # on a busy computer
        if not spin_until(self._node, lambda: self._stamp() - begin >= seconds, longest):
            raise ArmClientError('joint_states have stopped: check the log of the bridge')

    def _find_sensors(self) -> list[tuple[str, str]]:
        """Return topics and types of the sensors that measure the arm."""
        own = {self._node.resolve_topic_name(name) for name in topics.TOPICS}
        wanted = set(self._options.sensors)

        def found() -> list[tuple[str, str]]:
            listed = self._node.get_topic_names_and_types()
            sensors = [(n, k) for n, kinds in listed for k in kinds if k in SENSOR_TYPES]
            if wanted:
                return [(n, k) for n, k in sensors if n in wanted or n.lstrip('/') in wanted]
            return [(n, k) for n, k in sensors if n not in own and self._node.count_publishers(n)]

        spin_until(self._node, lambda: len(found()) >= max(1, len(wanted)), _DISCOVERY)
        # The markers of a motion capture are discovered one after the other.
        spin_until(self._node, lambda: False, 0.5)
        sensors = found()
        if not sensors or len(sensors) < len(wanted):
            raise ArmClientError(
                'no topic of markers or poses was found '
                f'({", ".join(sorted(wanted)) or ", ".join(SENSOR_TYPES)}): start the motion '
                'capture or the camera, or name the topics with --sensors'
            )
        print_notice('arm', f'sensors: {", ".join(name for name, _ in sensors)}')
        return sensors

    def _is_still(self) -> bool:
        assert self._state is not None
        return bool(np.abs(self._state.velocity).max(initial=0.0) < _STILL)

    def _position(self) -> Array:
        """Return the positions of the URDF's joints, in the order of the URDF."""
        assert self._state is not None
        positions = dict(zip(self._state.name, self._state.position, strict=False))
        missing = [name for name in self._joints if name not in positions]
        if missing:
            raise ArmClientError(
                f'joint_states have no position of joint {missing[0]}: check that --urdf belongs '
                'to the arm of the bridge'
            )
        return np.array([positions[name] for name in self._joints])

    def _stamp(self) -> float:
        assert self._state is not None
        stamp = self._state.header.stamp
        return float(stamp.sec + 1e-9 * stamp.nanosec)

    def _on_state(self, message: JointState) -> None:
        self._state = message


def _is_free(checker: ClearanceChecker, start: Array, end: Array) -> bool:
    share = np.linspace(0.0, 1.0, _WAY)[:, None]
    found = checker.sweep(start + share * (end - start), stop_below=True)
    return all(one.distance >= one.required for one in found.values())


def _has_begun(bag: Path, recorder: NodeProcess) -> bool:
    if recorder.returncode is not None:
        raise ArmClientError(
            f'the recorder has ended with status {recorder.returncode}: check its log'
        )
    return any(bag.glob('*.mcap'))


def _say_wait(what: str) -> None:
    print_notice('arm', f'waiting for {what}')


def _print_postures(postures: Array) -> None:
    for posture in postures:
        print(' '.join(f'{angle:.4f}' for angle in posture), flush=True)
