"""The controllers as processes on the emulated arm, over real DDS."""

import re
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from controller_bench import LIMIT, NAMES, ControllerBench, trajectory
from forked_executable import run
from geometry_msgs.msg import InertiaStamped, PoseStamped, WrenchStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import Imu, JointState
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from aerarm_msgs_py import topics
from aerarm_ros.description.robot import load_robot
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.ros.process.node_process import NodeProcess


@pytest.fixture
def bench(
    tmp_path: Path, ros_node: Node, request: pytest.FixtureRequest
) -> Iterator[ControllerBench]:
    marker = request.node.get_closest_marker('pace')
    bench = ControllerBench(tmp_path, ros_node, pace=marker.args[0] if marker else 'lockstep')
    with bench.hardware:
        bench.start()
        yield bench


def test_gravity_compensation_moves_to_set_points_and_releases_the_arm(
    bench: ControllerBench,
) -> None:
    with bench.controller('gravity_compensation') as process:
        set_points = bench.publisher(topics.SET_POINT)
        bench.wait(lambda: bench.mode == 'running', 'commands')
        goal = [0.4, 1.2, -0.3, 0.5]
        set_point = JointState(name=NAMES[::-1], position=goal[::-1])
        bench.wait_for_posture(goal, 0.005, lambda: set_points.publish(set_point))
        set_points.publish(JointState(name=NAMES, position=[0.0, 9.0, 0.0, 0.0]))
        bench.wait(lambda: any('joint2 at 9 rad' in p for p in bench.problems), 'a rejection')
        # Guided by hand, and by nobody's hand here, it stays about where it is.
        bench.set_parameter('gravity_compensation', 'hand_guiding', True)
        end = time.monotonic() + 1.5
        bench.wait(lambda: time.monotonic() > end, 'the fading of the gains')
        assert np.abs(bench.q - goal).max() < 0.05
        assert bench.mode == 'running'
        process.stop()
    assert process.returncode == 0


@pytest.mark.parametrize('feedback', ['host', 'boards'])
def test_computed_torque_executes_a_trajectory(bench: ControllerBench, feedback: str) -> None:
    bench.keep(topics.PLANNED_MOTION)
    with bench.controller('computed_torque', feedback=feedback, compensation=0.2):
        trajectories = bench.publisher(topics.JOINT_TRAJECTORY)
        bench.wait(lambda: bench.mode == 'running', 'commands')
        goal = [-0.3, 1.5, 0.4, -0.4] if feedback == 'host' else [0.2, 1.7, 0.0, 0.3]
        motion = trajectory(goal, 1.5)
        bench.wait_for_posture(goal, 0.02, lambda: trajectories.publish(motion))
        trajectories.publish(trajectory(goal, 1.0, ['joint1', 'joint2', 'joint3', 'elbow']))
        bench.wait(lambda: any('elbow' in p for p in bench.problems), 'a rejection')
        assert np.abs(bench.q - goal).max() < 0.02

        def planned() -> np.ndarray:
            plan = bench.heard.get(topics.PLANNED_MOTION.name)
            if not isinstance(plan, JointTrajectory):
                return np.full(4, np.nan)
            assert plan.joint_names == NAMES
            assert plan.points[-1].time_from_start.nanosec == 100_000_000
            return np.array(plan.points[-1].positions)

        bench.wait(lambda: np.abs(planned() - goal).max() < 1e-9, 'a plan to stay there')


@pytest.mark.parametrize('name', ['kinematic_control', 'impedance_control'])
def test_the_tool_reaches_a_target(bench: ControllerBench, name: str) -> None:
    kinematics = Kinematics(load_robot())
    bench.keep(topics.TOOL_POSE)
    with bench.controller(name):
        targets = bench.publisher(topics.TOOL_TRAJECTORY)
        bench.wait(lambda: bench.mode == 'running', 'commands')
        goal = kinematics.position(np.array([0.3, 1.1, 0.3, 0.9]))
        message = PoseStamped()
        message.header.frame_id = 'base_link'
        p = message.pose.position
        p.x, p.y, p.z = goal.tolist()
        # Impedance: the spring of 300 N/m against what friction is left.
        tolerance = 0.005 if name == 'kinematic_control' else 0.02
        bench.wait(
            lambda: np.linalg.norm(kinematics.position(bench.q) - goal) < tolerance,
            f'{goal}',
            lambda: targets.publish(message),
        )

        def told() -> np.ndarray:
            pose = bench.heard[topics.TOOL_POSE.name].pose.position
            return np.array([pose.x, pose.y, pose.z])

        # It is told at the host's time: the first one heard may be of before.
        bench.wait(lambda: topics.TOOL_POSE.name in bench.heard, 'the tool pose')
        bench.wait(lambda: np.linalg.norm(told() - goal) < 0.1, 'the tool pose at the target')
        message.header.frame_id = 'map'
        bench.wait(
            lambda: any('base_link' in p for p in bench.problems),
            'a rejection',
            lambda: targets.publish(message),
        )


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


@pytest.mark.pace('keep_up')  # diagnostics are waited for, in the host's time
def test_base_reaction_knows_the_weight_and_follows_the_imu(bench: ControllerBench) -> None:
    for topic in (topics.BASE_WRENCH, topics.ARM_INERTIA):
        bench.keep(topic)
    weight = load_robot().inertial_parameters[:, 0].sum() * 9.81

    def force() -> np.ndarray:
        message = bench.heard.get(topics.BASE_WRENCH.name)
        if not isinstance(message, WrenchStamped):
            return np.full(3, np.nan)
        f = message.wrench.force
        return np.array([f.x, f.y, f.z])

    with (
        bench.controller('gravity_compensation'),
        bench.controller('base_reaction', base_motion='full'),
    ):
        bench.wait(lambda: bench.mode == 'running', 'commands')
        bench.wait(lambda: np.abs(force() - [0.0, 0.0, -weight]).max() < 0.3, 'the weight')
        bench.wait(lambda: topics.ARM_INERTIA.name in bench.heard, 'the inertia')
        inertia = bench.heard[topics.ARM_INERTIA.name]
        assert isinstance(inertia, InertiaStamped)
        assert inertia.inertia.m == pytest.approx(weight / 9.81)
        bench.wait(lambda: any('no IMU sample yet' in p for p in bench.problems), 'a warning')
        imus = bench.publisher(topics.IMU)
        tilted = Imu()
        tilted.orientation_covariance[0] = -1.0
        tilted.linear_acceleration.x, tilted.linear_acceleration.z = 4.0, 9.0

        felt = np.array([-4.0, 0.0, -9.0]) * weight / 9.81
        with repeated(bench, imus, tilted):
            bench.wait(lambda: np.abs(force() - felt).max() < 0.3, 'the tilt')
            # A faulty IMU: said so, and gravity falls back to the configured direction.
            tilted.angular_velocity.x = float('nan')
            bench.wait(lambda: any('NaN' in p for p in bench.problems), 'a rejection')
        bench.wait(lambda: np.abs(force() - [0.0, 0.0, -weight]).max() < 0.3, 'the fall-back')


def test_base_reaction_counts_no_states_that_it_need_not_answer(bench: ControllerBench) -> None:
    bench.keep(topics.BASE_WRENCH)
    with bench.controller('base_reaction') as process:
        bench.wait(lambda: topics.BASE_WRENCH.name in bench.heard, 'the wrench')
        process.stop()
    assert re.search(
        r'reaction: \d+ joint states answered, 0 inputs rejected; latency', process.tail()
    )


@pytest.mark.parametrize('name', ['gravity_compensation', 'base_reaction'])
def test_without_a_bridge_the_log_states_the_awaited_conditions(
    tmp_path: Path, ros_domain: dict[str, str], name: str
) -> None:
    with NodeProcess(name, log=tmp_path / 'log') as process:
        end = time.monotonic() + LIMIT
        while 'waiting: no joint states received: check that the bridge runs' not in process.tail():
            assert time.monotonic() < end
            time.sleep(0.05)
        process.stop()
    assert process.tail().splitlines()[-1] == f'{name}: no joint states received, 0 inputs rejected'


def test_an_arm_that_is_off_gets_no_commands(bench: ControllerBench) -> None:
    with bench.controller('computed_torque'):
        bench.wait(lambda: bench.mode == 'running', 'commands')
        client = bench.node.create_client(Trigger, 'fake_hardware/disable')
        client.call_async(Trigger.Request())
        bench.wait(lambda: bench.mode == 'idle', 'the motors to go off')
        bench.problems.clear()
        bench.wait(lambda: any("'idle'" in p for p in bench.problems), 'a warning')


@pytest.mark.parametrize(
    ('parameters', 'message'),
    [
        ({'kp': [1.0, 2.0]}, 'kp has 2 values, 4 are needed'),
        ({'load_friction': [0.1, 0.2]}, 'load-dependent friction has 2 values, 4 are needed'),
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
