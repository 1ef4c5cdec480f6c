"""FollowJointTrajectory with a client of rclpy, on the emulated arm; skipped without control_msgs.

test_trajectory_goals.py tests the goals without ROS.
"""

from collections.abc import Iterator
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from controller_bench import NAMES, ControllerBench, trajectory
from rclpy.action import ActionClient
from rclpy.node import Node

from aerarm_msgs_py import topics

HAS_ACTION = find_spec('control_msgs') is not None
needs_action = pytest.mark.skipif(
    not HAS_ACTION, reason='control_msgs is not installed: it comes with ROS 2 from apt'
)
GOAL = [0.3, 1.3, -0.2, 0.4]
AWAY = [-0.3, 1.6, 0.2, -0.4]


class ActionBench:
    """The emulated arm under computed_torque, and an action client."""

    def __init__(self, bench: ControllerBench) -> None:
        self.bench = bench
        self.action = import_module('control_msgs.action').FollowJointTrajectory
        self.client = ActionClient(
            bench.node, self.action, 'computed_torque/follow_joint_trajectory'
        )
        self.feedback: list = []
        bench.wait(self.client.server_is_ready, 'the action')

    def goal(self, q: list[float], seconds: float, names: list[str] = NAMES, **fields):
        return self.action.Goal(trajectory=trajectory(q, seconds, names), **fields)

    def send(self, goal):
        """Return the goal's handle."""
        return self.get(
            self.client.send_goal_async(goal, lambda m: self.feedback.append(m.feedback))
        )

    def result(self, handle) -> tuple[int, int, str]:
        """Return status, error code and text of a goal, once it has ended."""
        response = self.get(handle.get_result_async())
        return response.status, response.result.error_code, response.result.error_string

    def get(self, future):
        self.bench.wait(future.done, 'an answer')
        return future.result()


@pytest.fixture
def arm(tmp_path: Path, ros_node: Node) -> Iterator[ActionBench]:
    # An arm with deviations, as that of the launch files; the controller's defaults.
    bench = ControllerBench(tmp_path, ros_node, seed=0)
    with bench.hardware:
        bench.start()
        with bench.controller('computed_torque') as process:
            bench.wait(lambda: bench.mode == 'running', 'commands')
            arm = ActionBench(bench)
            yield arm
            arm.client.destroy()
            assert process.stop() == 0


@needs_action
def test_goals_of_an_action_client(arm: ActionBench) -> None:
    codes, tolerance = arm.action.Result, import_module('control_msgs.msg').JointTolerance
    # Reached, with feedback on the way.
    handle = arm.send(arm.goal(GOAL, 1.0))
    assert handle.accepted
    status, code, text = arm.result(handle)
    assert (status, code) == (GoalStatus.STATUS_SUCCEEDED, codes.SUCCESSFUL), text
    assert np.abs(arm.bench.q - GOAL).max() < 0.02
    feedback = arm.feedback[-1]
    assert feedback.joint_names == NAMES
    error = np.subtract(feedback.desired.positions, feedback.actual.positions)
    np.testing.assert_allclose(feedback.error.positions, error, atol=1e-12)
    # One point for now, where the arm is, is no stream that falls silent.
    assert arm.result(arm.send(arm.goal(GOAL, 0.0)))[0] == GoalStatus.STATUS_SUCCEEDED
    # Preempted by another, which is canceled.
    first = arm.send(arm.goal(AWAY, 20.0))
    second = arm.send(arm.goal(AWAY, 20.0))
    assert arm.result(first)[:2] == (GoalStatus.STATUS_ABORTED, codes.INVALID_GOAL)
    assert len(arm.get(second.cancel_goal_async()).goals_canceling) == 1
    assert arm.result(second)[:2] == (GoalStatus.STATUS_CANCELED, codes.SUCCESSFUL)
    # Tolerances that no arm keeps.
    tight = [tolerance(name='joint2', position=1e-7)]
    handle = arm.send(arm.goal(GOAL, 1.0, path_tolerance=tight))
    assert arm.result(handle)[:2] == (GoalStatus.STATUS_ABORTED, codes.PATH_TOLERANCE_VIOLATED)
    handle = arm.send(arm.goal(GOAL, 1.0, goal_tolerance=[tolerance(name='joint2', position=1e-9)]))
    assert arm.result(handle)[:2] == (GoalStatus.STATUS_ABORTED, codes.GOAL_TOLERANCE_VIOLATED)
    # What cannot be done is not accepted.
    assert not arm.send(arm.goal([0.0, 9.0, 0.0, 0.0], 1.0)).accepted
    assert not arm.send(arm.goal(GOAL, 1.0, [*NAMES[:3], 'elbow'])).accepted
    assert not arm.send(arm.goal(AWAY, 0.1)).accepted  # too fast
    ending = arm.goal(GOAL, 2.0)
    ending.trajectory.points[0].velocities = [0.0, 0.0, 0.0, 0.5]
    assert not arm.send(ending).accepted
    # The other joints stay.
    assert arm.result(arm.send(arm.goal([-0.5], 1.0, NAMES[2:3])))[0] == GoalStatus.STATUS_SUCCEEDED
    assert np.abs(arm.bench.q - [*GOAL[:2], -0.5, GOAL[3]]).max() < 0.02
    # A topic takes the arm, and an arm that is stopped takes no goal.
    handle = arm.send(arm.goal(AWAY, 20.0))
    arm.bench.publisher(topics.JOINT_TRAJECTORY).publish(trajectory(AWAY, 20.0))
    assert arm.result(handle)[:2] == (GoalStatus.STATUS_ABORTED, codes.INVALID_GOAL)
    handle = arm.send(arm.goal(AWAY, 20.0))
    arm.bench.call('e_stop')
    assert arm.result(handle)[:2] == (GoalStatus.STATUS_ABORTED, codes.INVALID_GOAL)
    arm.bench.wait(lambda: arm.bench.mode == 'fault', 'the stop')
    assert not arm.send(arm.goal(GOAL, 1.0)).accepted
