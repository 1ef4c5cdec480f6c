"""The excitation node as a process against an arm as a process, over real DDS."""

import os
import re
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from bridge_client import BridgeClient
from forked_executable import ForkedProcess
from forked_executable import run as run_executable
from numpy.typing import ArrayLike
from quick_excitation import quick
from rclpy.node import Node
from trajectory_msgs.msg import JointTrajectory

from aerarm_msgs_py import topics
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.excitation.design_file import TrajectoryFile
from aerarm_ros.excitation.settings import load_excitation_config
from aerarm_ros.excitation.trajectory import FourierTrajectory
from aerarm_ros.ros.diagnostics import PATIENCE, REPETITION
from aerarm_ros.ros.process.node_process import NodeProcess, ros_environment

START = np.array([0.1, 1.4, -0.1, 0.2])
NAMES = ('joint1', 'joint2', 'joint3', 'joint4')
SHORT = {'fundamental': 0.8, 'amplitude': 0.1, 'return_to_start': False}


@pytest.fixture
def environment(ros_domain: dict[str, str]) -> dict[str, str]:
    return ros_domain


@contextmanager
def ideal_arm(tmp_path: Path, environment: dict[str, str], *options: str) -> Iterator[dict]:
    """Run the arm; its log is in the dictionary once the context has ended."""
    out = tmp_path / 'arm.npz'
    arguments = ['--out', str(out), *options]
    process = ForkedProcess('ideal_arm', arguments, ros_environment(environment), [None, None])
    seen: dict = {}
    try:
        yield seen
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(60.0)
    seen.update(np.load(out))


def run(tmp_path: Path, **parameters: object) -> tuple[int, str]:
    done = run_executable('excitation', parameters=quick(tmp_path, **parameters))
    return done.returncode, done.stderr + done.stdout


def wait_for_text(log: Path, text: str) -> None:
    deadline = time.monotonic() + 60.0
    while text not in log.read_text():
        assert time.monotonic() < deadline, log.read_text()
        time.sleep(0.05)


def test_plays_the_trajectory_and_comes_back(tmp_path: Path, environment) -> None:
    saved = tmp_path / 'played.yaml'
    with ideal_arm(tmp_path, environment, '--damped', '0.1') as seen:
        status, log = run(tmp_path, seed=4, save=saved, damped_share_max=0.9)
    assert status == 0, log
    assert 'done' in log
    assert_states_the_damping(log, excessive=False)
    assert seen['foreign'] == 0
    assert seen['efforts'] == 0  # in velocity mode only a stop takes one
    q, dq = seen['trace'][:, 1:5], seen['trace'][:, 5:]
    np.testing.assert_allclose(q[-1], START, atol=5e-3)
    np.testing.assert_allclose(dq[-1], 0.0, atol=5e-3)
    assert_no_jump(seen)
    assert_holds_a_period(seen, TrajectoryFile.load(saved).for_joints(NAMES))


def test_the_rotors_of_a_drone_slow_the_excitation_down(tmp_path: Path, environment) -> None:
    """The file holds the slowed trajectory, which the arm then plays."""
    saved = tmp_path / 'played.yaml'
    drone = {'drone_file': 'config/drone.yaml', 'heading_feedforward': True}
    with ideal_arm(tmp_path, environment, '--damped', '0.1') as seen:
        status, log = run(tmp_path, seed=4, save=saved, damped_share_max=0.001, **SHORT, **drone)
    assert status == 1, log
    assert_states_the_damping(log, excessive=True)
    found = re.search(r'\(([0-9.]+) times as long', log)
    assert found, log
    trajectory = TrajectoryFile.load(saved).for_joints(NAMES)
    assert trajectory.period == pytest.approx(1.25 * float(found[1]), rel=0.01)
    assert_holds_a_period(seen, trajectory)


def assert_states_the_damping(log: str, excessive: bool) -> None:
    told = re.search(r'damped the arm 2 times, for ([0-9.]+) s \(([0-9.]+)% of the motion\)', log)
    assert told is not None, log
    assert float(told[1]) >= 0.2
    assert ('the motion deviates from the plan' in log) == excessive


def assert_no_jump(seen: dict, most: ArrayLike = 15.0) -> None:
    """Acceleration stays below `most` [rad/s^2] through run-in, periods, run-out and return."""
    step = np.diff(seen['answered'])[:, np.newaxis]
    # Late or lost messages show as small corrections, never as more than a few times K.
    assert (np.abs(np.diff(seen['commanded'], axis=0)) < most * step + 0.02).all()


def assert_holds_a_period(seen: dict, trajectory: FourierTrajectory) -> None:
    """Find where the played period starts and compare it with the trajectory."""
    time, q = seen['trace'][:, 0] - seen['trace'][0, 0], seen['trace'][:, 1:5]
    offset = np.arange(0.0, trajectory.period, 0.02)
    wanted = trajectory.evaluate(offset).q
    errors = []
    for start in np.arange(0.0, time[-1] - trajectory.period, 2e-3):
        rows = np.minimum(np.searchsorted(time, start + offset), len(q) - 1)
        errors.append(np.abs(q[rows] - wanted).max())
    # The arm is a cycle late.
    assert min(errors) < 0.02


def test_drives_the_emulated_boards_and_continues_after_a_pause_of_a_renamed_clock(
    tmp_path: Path, environment, ros_node: Node
) -> None:
    log = tmp_path / 'excitation.log'
    given = {'seed': 3, 'pace': 'lockstep', 'encoders': 'absolute'}
    other_name = ('--ros-args', '-r', '/clock:=left/clock', '--')  # told to the bridge alone
    parameters = quick(tmp_path, state_timeout=0.2, **SHORT)
    with NodeProcess('fake_hardware', other_name, given, environment, tmp_path / 'arm.log') as arm:
        client = BridgeClient(ros_node)
        client.make_ready()
        plans: list[JointTrajectory] = []
        topic = topics.PLANNED_MOTION
        ros_node.create_subscription(topic.type, topic.name, plans.append, topic.qos)
        seen = len(client.modes)
        with NodeProcess('excitation', (), parameters, environment, log) as node:
            client.wait_for(lambda: ' s  excitation ' in log.read_text())
            os.kill(arm.pid, signal.SIGSTOP)
            time.sleep(0.5)
            os.kill(arm.pid, signal.SIGCONT)
            client.wait_for(lambda: node.returncode is not None)
            assert node.returncode == 0, log.read_text()
        client.wait_for(lambda: client.modes[seen:][-1:] == ['ready'])  # the arm is held
        assert 'damping' not in client.modes
    assert 'done' in log.read_text()
    # It said what it would do next: at the end, to stay.
    assert plans
    assert list(plans[-1].joint_names) == list(NAMES)
    np.testing.assert_allclose(plans[-1].points[-1].velocities, 0.0, atol=1e-6)


def test_full_mode_from_a_file_with_another_joint_order(tmp_path: Path, environment) -> None:
    bias = np.array(load_excitation_config().bias)
    coefficients = np.random.default_rng(1).uniform(-0.1, 0.1, (2, 4, 2))
    path = tmp_path / 'gentle.yaml'
    series = FourierTrajectory(0.8, bias[::-1], *coefficients)
    TrajectoryFile(series, NAMES[::-1], periods=1).save(path)
    saved = tmp_path / 'played.yaml'
    with ideal_arm(tmp_path, environment, '--full', '--reversed') as seen:
        status, log = run(
            tmp_path, mode='position_velocity_effort', trajectory=path, periods=0, save=saved
        )
    assert status == 0, log
    # As many periods as the file says.
    assert TrajectoryFile.load(saved).periods == 1
    np.testing.assert_allclose(seen['trace'][-1, 1:5], START, atol=2e-2)


def test_sigint_stops_smoothly_and_exits(tmp_path: Path, environment) -> None:
    log = tmp_path / 'excitation.log'
    parameters = quick(tmp_path, periods=20)
    with (
        ideal_arm(tmp_path, environment) as seen,
        NodeProcess('excitation', (), parameters, environment, log) as node,
    ):
        wait_for_text(log, ' s  excitation ')
        assert node.stop(signal.SIGINT) == 130
    assert 'stopped' in log.read_text()
    dq = seen['trace'][:, 5:]
    np.testing.assert_allclose(dq[-1], 0.0, atol=1e-2)
    assert seen['efforts'] > 0
    assert_no_jump(seen, load_arm_config().column('acceleration_max'))


@pytest.mark.parametrize(
    ('fault', 'message'),
    [
        ('--stuck-after', 'off its reference'),
        ('--silent-after', 'increase state_timeout'),
        ('--fault-after', "because arm_mode changed to 'fault': check the log of the bridge"),
    ],
)
def test_trouble_ends_the_motion(tmp_path: Path, environment, fault: str, message: str) -> None:
    with ideal_arm(tmp_path, environment, fault, '0.8'):
        # As long as a busy machine may pause, where silence is not what is tested.
        patience = 0.5 if fault == '--silent-after' else 10.0
        status, log = run(tmp_path, tracking_limit=0.1, state_timeout=patience)
    assert status == 1
    assert message in log


def run_until(tmp_path: Path, text: str, least: float, **parameters: object) -> tuple[str, int]:
    """Return the log of a refused run, given more time [s] on a busy machine to receive `text`."""
    for seconds in (least, 15, 60):
        status, log = run(tmp_path, wait_timeout=seconds, **parameters)
        assert status == 1
        if text in log:
            break
    return log, seconds


def test_starts_only_from_an_arm_that_is_held(tmp_path: Path, environment, ros_node: Node) -> None:
    with ideal_arm(tmp_path, environment, '--mode', 'idle') as seen:
        log, seconds = run_until(tmp_path, "arm_mode is '", 3, wait_for_recorder=True)
        # Now and then only.
        assert 1 <= log.count('waiting: ') <= 1 + (seconds - PATIENCE) // REPETITION
        assert "arm_mode is 'idle': run 'arm enable'" in log
        assert 'no recorder records joint_command and joint_states' in log
        topic = topics.JOINT_STATES
        second = ros_node.create_publisher(topic.type, topic.name, topic.qos)
        both = f'/ideal_arm and /{ros_node.get_name()}: stop all but one'
        log, _ = run_until(tmp_path, both, 2)  # names of new nodes arrive late on a busy machine
        assert both in log
        ros_node.destroy_publisher(second)
    assert len(seen['commanded']) == 0
    for mode, advice in (
        ('running', 'stop the node that commands the arm'),
        ('damping', 'holds the arm in place'),
    ):
        with ideal_arm(tmp_path, environment, '--mode', mode) as seen:
            log, _ = run_until(tmp_path, "arm_mode is '", 0.7)
        assert f"arm_mode is '{mode}': " in log
        assert advice in log
        assert len(seen['commanded']) == 0


def test_bad_input_is_one_line(tmp_path: Path, environment) -> None:
    # A file that breaks the limits is not played.
    wild = FourierTrajectory(0.1, np.array(load_excitation_config().bias), *np.full((2, 4, 5), 0.7))
    path = tmp_path / 'wild.yaml'
    TrajectoryFile(wild, NAMES).save(path)
    for parameters, message in (
        ({'amplitude': 2.0}, 'exceeds its limit in'),
        ({'trajectory': '/nowhere/file.yaml'}, '/nowhere/file.yaml cannot be read (No such file'),
        ({'trajectory': path}, f'{path} is infeasible: '),
        ({'drone_file': 'config/drone.yaml', 'rotor_share': 0.1}, 'could not hover'),
    ):
        status, log = run(tmp_path, **parameters)
        assert status == 1, (parameters, log)
        assert message in log
        assert log.strip().count('\n') == 0, log
    with ideal_arm(tmp_path, environment, '--start', '0', '-0.4', '0', '0') as seen:
        status, log = run(tmp_path)
    assert status == 1
    assert 'the start posture is infeasible: ground clearance' in log
    assert len(seen['commanded']) == 0
