"""The controllers as processes on the emulated arm: inputs that move it, and rejected ones."""

import re
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from controller_bench import LIMIT, NAMES, ControllerBench, trajectory
from forked_executable import run
from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import Imu, JointState
from trajectory_msgs.msg import JointTrajectory

from aerarm_msgs_py import topics
from aerarm_ros.description.robot import load_robot
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.ros.process.node_process import NodeProcess

NAN = float('nan')
ROOT = Path(__file__).parents[3]


def reject(
    bench: ControllerBench,
    process: NodeProcess,
    publisher: Publisher,
    message: object,
    reason: str,
    place: Callable[[np.ndarray], np.ndarray] = lambda q: q,
) -> None:
    """Require that a message is rejected on diagnostics and in the log, and moves nothing.

    `place` returns what must not move for the joint positions.
    """
    bench.problems.clear()
    before = place(bench.q)

    def is_told() -> bool:
        is_diagnosed = any(reason in text for text in bench.problems)
        return is_diagnosed and reason in process.log.read_text()

    again = sender(publisher, message)  # the log has at most one rejection per second
    bench.wait(is_told, f'{reason} on diagnostics and in the log', again, 0.3)
    assert bench.mode == 'running'
    assert np.abs(place(bench.q) - before).max() < 0.02


def sender(publisher: Publisher, message: object) -> Callable[[], None]:
    return lambda: publisher.publish(message)


def far_away() -> JointTrajectory:
    message = trajectory([-1.0, 1.0, 0.0, 0.0], 0.0)
    message.points += trajectory([0.0, 1.5, 0.0, 0.0], 2.0).points
    return message


def execute_trajectories(bench: ControllerBench, feedback: str, goal: list[float]) -> None:
    bench.keep(topics.PLANNED_MOTION)
    given = {'feedback': feedback, 'compensation': 0.2, 'base_motion': 'full'}
    with bench.controller('computed_torque', **given) as process:
        trajectories = bench.publisher(topics.JOINT_TRAJECTORY)
        bench.wait(lambda: bench.mode == 'running', 'commands')
        motion = trajectory(goal, 1.5)
        bench.wait_for_posture(goal, 0.02, sender(trajectories, motion))

        def planned() -> np.ndarray:
            plan = bench.heard.get(topics.PLANNED_MOTION.name)
            if not isinstance(plan, JointTrajectory):
                return np.full(4, np.nan)
            assert plan.joint_names == NAMES
            assert plan.points[-1].time_from_start.nanosec == 100_000_000
            return np.array(plan.points[-1].positions)

        bench.wait(lambda: np.abs(planned() - goal).max() < 1e-9, 'a plan to stay there')
        if find_spec('control_msgs') is None:
            assert 'control_msgs is not installed, so the action' in process.tail(50)
        if feedback == 'boards':
            return
        for reason, message in (
            ('elbow', trajectory(goal, 2.0, [*NAMES[:3], 'elbow'])),
            ('rad away from joint1', far_away()),
            ('positions must be finite', trajectory([NAN, *goal[1:]], 2.0)),
        ):
            reject(bench, process, trajectories, message, reason)
        sample = Imu()
        sample.orientation.x = NAN
        reject(bench, process, bench.publisher(topics.IMU), sample, 'NaN')


def follow_set_points(bench: ControllerBench) -> None:
    with bench.controller('gravity_compensation') as process:
        set_points = bench.publisher(topics.SET_POINT)
        bench.wait(lambda: bench.mode == 'running', 'commands')
        goal = [0.4, 1.2, -0.3, 0.5]
        message = JointState(name=NAMES[::-1], position=goal[::-1])
        bench.wait_for_posture(goal, 0.005, sender(set_points, message))
        for reason, wrong in (
            ('joint2 at 9 rad is outside', JointState(name=NAMES, position=[0.0, 9.0, 0.0, 0.0])),
            (
                'set point: positions: point 0 has 3 instead of 4',
                JointState(name=NAMES, position=goal[:3]),
            ),
            (
                'set point: positions must be finite',
                JointState(name=NAMES, position=[NAN, *goal[1:]]),
            ),
        ):
            reject(bench, process, set_points, wrong, reason)
        bench.set_parameter('gravity_compensation', 'hand_guiding', True)
        end = time.monotonic() + 1.0
        bench.wait(lambda: time.monotonic() > end, 'the fading of the gains')
        assert np.abs(bench.q - goal).max() < 0.05
        assert bench.mode == 'running'
        assert process.stop() == 0, process.tail()


def run_a_controller_of_one_file(bench: ControllerBench, monkeypatch: pytest.MonkeyPatch) -> None:
    """The example of the documentation, in a copy of the package that consists of links."""
    page = (ROOT / 'docs' / 'how-to' / 'drive_it.md').read_text()
    (example,) = re.findall(r'```python\n(.*?)```', page, re.DOTALL)
    copy, nodes = bench.folder / 'aerarm_ros', Path('nodes')
    for folder in (Path(), nodes, nodes / 'controllers'):
        (copy / folder).mkdir()
        for file in (ROOT / 'aerarm_ros' / folder).iterdir():
            if file.name not in ('nodes', 'controllers', '__pycache__'):
                (copy / folder / file.name).symlink_to(file)
    (copy / nodes / 'controllers' / 'spring.py').write_text(example)
    monkeypatch.setenv('PYTHONPATH', f'{bench.folder}:{ROOT}')
    monkeypatch.setenv('PYTHONSAFEPATH', '1')  # do not import from the working directory
    with bench.controller('spring', stiffness=50.0) as process:
        set_points = bench.publisher(topics.SET_POINT)
        bench.wait(lambda: bench.mode == 'running', 'commands')
        bench.set_parameter('spring', 'stiffness', 80.0)
        goal = [-0.2, 1.4, 0.3, 0.2]
        message = JointState(name=NAMES, position=goal)
        bench.wait_for_posture(goal, 0.02, sender(set_points, message))
        assert process.stop() == 0, process.tail()


def move_the_tool(bench: ControllerBench, name: str, posture: list[float]) -> None:
    kinematics = Kinematics(load_robot())
    bench.keep(topics.TOOL_POSE)
    with bench.controller(name) as process:
        targets = bench.publisher(topics.TOOL_TRAJECTORY)
        bench.wait(lambda: bench.mode == 'running', 'commands')
        goal = kinematics.position(np.array(posture))
        message = PoseStamped()
        message.header.frame_id = 'base_link'
        p = message.pose.position
        p.x, p.y, p.z = goal.tolist()
        # Impedance: the spring of 300 N/m against what friction is left.
        tolerance = 0.005 if name == 'kinematic_control' else 0.02
        bench.wait(
            lambda: np.linalg.norm(kinematics.position(bench.q) - goal) < tolerance,
            f'{goal}',
            sender(targets, message),
        )

        def told() -> np.ndarray:
            pose = bench.heard[topics.TOOL_POSE.name].pose.position
            return np.array([pose.x, pose.y, pose.z])

        bench.wait(lambda: np.linalg.norm(told() - goal) < 0.1, 'the tool pose at the target')
        if name == 'impedance_control':
            return  # both check targets by the same code
        unreachable, not_a_number, elsewhere = PoseStamped(), PoseStamped(), PoseStamped()
        unreachable.pose.position.x = 3.0
        not_a_number.pose.position.y = NAN
        elsewhere.header.frame_id = 'map'
        for reason, wrong in (
            ('the reach of the arm', unreachable),
            ('three finite numbers', not_a_number),
            ("in the frame 'base_link'", elsewhere),
        ):
            # Other joints may still move to the preferred posture.
            reject(bench, process, targets, wrong, reason, kinematics.position)


@contextmanager
def repeated(bench: ControllerBench, publisher: Publisher, sample: Imu) -> Iterator[None]:
    """Publish IMU samples at a constant rate during the test."""
    over = threading.Event()

    def publish() -> None:
        while not over.wait(0.005):
            sample.header.stamp = bench.node.get_clock().now().to_msg()
            publisher.publish(sample)

    thread = threading.Thread(target=publish)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def know_the_weight_on_the_drone(bench: ControllerBench) -> None:
    """`base_reaction` publishes the arm's weight, turned by the IMU."""
    for topic in (topics.BASE_WRENCH, topics.ARM_INERTIA):
        bench.keep(topic)
    weight = load_robot().inertial_parameters[:, 0].sum() * 9.81

    def force() -> np.ndarray:
        if topics.BASE_WRENCH.name not in bench.heard:
            return np.full(3, np.nan)
        f = bench.heard[topics.BASE_WRENCH.name].wrench.force
        return np.array([f.x, f.y, f.z])

    with bench.controller('base_reaction', base_motion='full') as process:
        bench.wait(lambda: np.abs(force() - [0.0, 0.0, -weight]).max() < 0.3, 'the weight')
        bench.wait(lambda: topics.ARM_INERTIA.name in bench.heard, 'the inertia')
        mass = bench.heard[topics.ARM_INERTIA.name].inertia.m
        assert mass == pytest.approx(weight / 9.81)
        bench.wait(lambda: any('no IMU sample yet' in p for p in bench.problems), 'a warning')
        tilted = Imu()
        tilted.orientation_covariance[0] = -1.0
        tilted.linear_acceleration.x, tilted.linear_acceleration.z = 4.0, 9.0
        felt = np.array([-4.0, 0.0, -9.0]) * weight / 9.81
        with repeated(bench, bench.publisher(topics.IMU), tilted):
            bench.wait(lambda: np.abs(force() - felt).max() < 0.3, 'the tilt')
            # A faulty IMU is reported, and gravity falls back to the configured direction.
            tilted.angular_velocity.x = NAN
            bench.wait(lambda: any('NaN' in p for p in bench.problems), 'a rejection')
        bench.wait(lambda: np.abs(force() - [0.0, 0.0, -weight]).max() < 0.3, 'the fall-back')
        process.stop()
    assert re.search(r'reaction: \d+ joint states answered, \d+ inputs rejected', process.tail())


def obey_the_mode(bench: ControllerBench) -> None:
    """An arm that is off or stopped gets no commands and takes no set points."""
    with bench.controller('gravity_compensation') as process:
        set_points = bench.publisher(topics.SET_POINT)
        bench.wait(lambda: bench.mode == 'running', 'commands')
        bench.call('disable')
        bench.wait(lambda: bench.mode == 'idle', 'the motors to go off')
        bench.problems.clear()
        bench.wait(lambda: any("'idle'" in p for p in bench.problems), 'a warning')
        bench.call('e_stop')
        bench.wait(lambda: bench.mode == 'fault', 'the stop')
        message = JointState(name=NAMES, position=[0.0, 1.5, 0.0, 0.0])
        reason = "set_point rejected, because the arm is in mode 'fault'"
        bench.wait(lambda: reason in process.log.read_text(), reason, sender(set_points, message))
        assert bench.mode == 'fault'


def test_controllers_on_one_bridge(
    tmp_path: Path, ros_node: Node, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One bridge holds the arm from controller to controller."""
    bench = ControllerBench(tmp_path, ros_node, pace='keep_up')
    with bench.hardware:
        bench.start()
        know_the_weight_on_the_drone(bench)
        execute_trajectories(bench, 'host', [-0.3, 1.5, 0.4, -0.4])
        execute_trajectories(bench, 'boards', [0.2, 1.7, 0.0, 0.3])
        follow_set_points(bench)
        run_a_controller_of_one_file(bench, monkeypatch)
        move_the_tool(bench, 'kinematic_control', [0.3, 1.1, 0.3, 0.9])
        move_the_tool(bench, 'impedance_control', [0.1, 1.2, 0.2, 0.7])
        obey_the_mode(bench)


def test_without_a_bridge_the_log_states_the_awaited_conditions(
    tmp_path: Path, ros_domain: dict[str, str]
) -> None:
    with NodeProcess('gravity_compensation', log=tmp_path / 'log') as process:
        end = time.monotonic() + LIMIT
        while 'waiting: no joint states received: check that the bridge runs' not in process.tail():
            assert time.monotonic() < end
            time.sleep(0.05)
        process.stop()
    last = process.tail().splitlines()[-1]
    assert last == 'gravity_compensation: no joint states received, 0 inputs rejected'


@pytest.mark.parametrize(
    ('parameters', 'message'),
    [
        ({'kp': [1.0, 2.0]}, 'kp has 2 values, 4 are needed'),
        # What YAML makes of `off`.
        ({'base_motion': False}, 'base_motion must be a string, one of none, attitude, full'),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else '',
)
def test_a_wrong_parameter_is_one_clear_line(
    ros_domain: dict[str, str], parameters: dict[str, object], message: str
) -> None:
    done = run('computed_torque', parameters=parameters)
    assert done.returncode == 1
    said = done.stderr + done.stdout
    assert said.count('\n') <= 2
    assert message in said
