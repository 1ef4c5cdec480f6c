"""world_control over topics in lockstep: hold the tool in the wind and press on a wall."""

import sys
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from forked_executable import run
from geometry_msgs.msg import PoseStamped, WrenchStamped
from rclpy.node import Node

from aerarm_msgs_py import topics
from aerarm_ros.description.resources import resource
from aerarm_ros.ros.executors import spin_until

sys.path.append(str(Path(__file__).parents[2] / 'benchmarks'))
from flying.arm_model import ArmModel
from flying.flight_case import scaled_drone, write_drone
from flying.holding_bench import PushingBench
from flying.holding_case import FULL, PushingCase

PATIENCE = 60.0  # [s] of the host, for diagnostics


class Requested(PushingCase):
    """A case in which world_control also publishes set points for the drone."""

    @property
    def law_gains(self) -> dict[str, object]:
        return {**super().law_gains, 'request_drone': True}


def test_the_tool_presses_on_a_wall_and_wrong_forces_are_reported(
    ros_domain: dict[str, str], ros_node: Node, tmp_path: Path
) -> None:
    case = Requested(drone=FULL, gap=0.02)
    wanted: list[PoseStamped] = []
    topics.FLIGHT_SET_POINT.subscription(ros_node, wanted.append)
    with ExitStack() as stack:
        bench = PushingBench(stack, ros_node, tmp_path, case, ArmModel.true())
        record = bench.push(0.8, settling=1.0, approach=2.8)
        error, peak, across, _ = record.figures()
        assert error < 0.5, 'RMS force error [N]'
        assert peak < 8.0, 'the impact must not exceed the set force by much [N]'
        assert across < 2.5, 'RMS tool error across the force [mm]'
        assert record.diagnostics == 'in order'
        # The arm is in the middle of its reach, so the drone is to stay.
        place = wanted[-1].pose.position
        assert wanted[-1].header.frame_id == 'odom'
        assert [place.x, place.y, place.z] == pytest.approx(record.places[-1], abs=0.05)

        def reported(force: list[float], frame: str, reason: str) -> bool:
            message = WrenchStamped()
            message.header.frame_id = frame
            message.wrench.force.x, message.wrench.force.y, message.wrench.force.z = force
            bench._pushes.publish(message)
            return spin_until(ros_node, lambda: reason in bench.said('world_control'), PATIENCE)

        assert reported([np.nan, 0.0, 0.0], 'odom', 'three finite numbers')
        assert reported([5.0, 0.0, 0.0], 'nowhere', "'nowhere'")
        target = bench._target(record.tool_places[-1])
        for w, reason in ((2.0, 'length 2 '), (np.nan, 'orientation is NaN')):
            target.pose.orientation.w = w
            bench._targets.publish(target)
            assert spin_until(ros_node, lambda: reason in bench.said('world_control'), PATIENCE)  # noqa: B023
        done = run('arm', 'press', '0', '5', '0', '--timeout', '60')
        assert done.returncode == 1
        assert "of the rotors' range" in done.stderr
        done = run('arm', 'press', '4', '0', '0', '--timeout', '60')
        assert (done.returncode, 'the tool presses with' in done.stdout) == (0, True), done.stderr
        # The contact has continued.
        bench.seen(0.2)
        assert abs(np.mean(bench.listener.forces, axis=0)[1] - 4.0) < 1.0
        assert run('arm', 'press', '0', '0', '0', '--timeout', '60').returncode == 0
        bench.seen(0.5)
        assert bench.listener.forces[-1][1] == 0.0
        assert spin_until(ros_node, lambda: bench.said('world_control') == 'in order', PATIENCE)


def test_a_drone_that_would_crash_is_rejected(ros_domain: dict[str, str], tmp_path: Path) -> None:
    file = write_drone(scaled_drone(2.0), tmp_path / 'drone.yaml')
    done = run('world_control', parameters={'drone_file': file, 'base_motion': 'free'})
    assert done.returncode == 1
    assert '1.34 times as heavy as the arm' in done.stderr


def test_a_set_point_for_the_drone_needs_the_middle_of_the_reach(
    ros_domain: dict[str, str],
) -> None:
    given = {'drone_file': str(resource('config', 'drone.yaml')), 'base_motion': 'free'}
    done = run('world_control', parameters={**given, 'request_drone': True})
    assert done.returncode == 1
    assert 'request_drone needs the drone and a posture' in done.stderr
