"""Invalid inputs of a controller: rejected with a reason, while the arm does not move."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from controller_bench import NAMES, ControllerBench, trajectory
from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from sensor_msgs.msg import Imu, JointState
from trajectory_msgs.msg import JointTrajectory

from aerarm_msgs_py import topics
from aerarm_ros.ros.process.node_process import NodeProcess

HERE = [0.0, np.pi / 2, 0.0, 0.0]


@pytest.fixture
def bench(tmp_path: Path, ros_node: Node) -> Iterator[ControllerBench]:
    # Diagnostics are waited for, in the host's time: a world that runs ahead would only be busy.
    bench = ControllerBench(tmp_path, ros_node, pace='keep_up', period=0.004)
    with bench.hardware:
        bench.start()
        yield bench


def refuse(
    bench: ControllerBench, process: NodeProcess, send: Callable[[], None], reason: str
) -> None:
    """Require that an input is rejected on diagnostics and in the log, and moves nothing."""
    bench.problems.clear()

    def is_told() -> bool:
        is_diagnosed = any(reason in text for text in bench.problems)
        return is_diagnosed and reason in process.log.read_text()

    # The log tells no more than one a second.
    bench.wait(is_told, f'{reason} on diagnostics and in the log', send, 0.3)
    assert bench.mode == 'running'
    assert np.abs(bench.q - HERE).max() < 0.02


def backwards() -> JointTrajectory:
    message = trajectory(HERE, 2.0)
    message.points += trajectory(HERE, 1.0).points
    return message


def far_away() -> JointTrajectory:
    message = trajectory([1.0, 1.0, 0.0, 0.0], 0.0)
    message.points += trajectory(HERE, 2.0).points
    return message


TRAJECTORIES = {
    'joint2 at 5 rad is outside': lambda: trajectory([0.0, 5.0, 0.0, 0.0], 2.0),
    'elbow': lambda: trajectory(HERE, 2.0, [*NAMES[:3], 'elbow']),
    'times must increase': backwards,
    'rad away from joint1': far_away,
    'positions must be finite': lambda: trajectory([np.nan, *HERE[1:]], 2.0),
}


def imu(**orientation: float) -> Imu:
    message = Imu()
    message.linear_acceleration.z = 9.81
    message.orientation.w = 1.0
    for axis, value in orientation.items():
        setattr(message.orientation, axis, value)
    return message


def refuse_trajectories_and_imu_samples(bench: ControllerBench) -> None:
    with bench.controller('computed_torque', base_motion='full') as process:
        trajectories = bench.publisher(topics.JOINT_TRAJECTORY)
        bench.wait(lambda: bench.mode == 'running', 'commands')
        for reason, make in TRAJECTORIES.items():
            message = make()
            refuse(bench, process, lambda m=message: trajectories.publish(m), reason)
        imus = bench.publisher(topics.IMU)
        for reason, sample in (('length 0 instead of 1', imu(w=0.0)), ('NaN', imu(x=float('nan')))):
            refuse(bench, process, lambda s=sample: imus.publish(s), reason)


def refuse_set_points(bench: ControllerBench) -> None:
    with bench.controller('gravity_compensation') as process:
        set_points = bench.publisher(topics.SET_POINT)
        bench.wait(lambda: bench.mode == 'running', 'commands')
        for reason, message in (
            ('joint2 at 9 rad is outside', JointState(name=NAMES, position=[0.0, 9.0, 0.0, 0.0])),
            ('shoulder', JointState(name=['shoulder', *NAMES[1:]], position=HERE)),
            ('it has 3 positions: set 4', JointState(name=NAMES, position=HERE[:3])),
            ('set finite numbers', JointState(name=NAMES, position=[float('nan'), *HERE[1:]])),
        ):
            refuse(bench, process, lambda m=message: set_points.publish(m), reason)


def refuse_tool_targets(bench: ControllerBench, name: str) -> None:
    with bench.controller(name) as process:
        targets = bench.publisher(topics.TOOL_TRAJECTORY)
        bench.wait(lambda: bench.mode == 'running', 'commands')
        unreachable, not_a_number, elsewhere = PoseStamped(), PoseStamped(), PoseStamped()
        unreachable.pose.position.x = 3.0
        not_a_number.pose.position.y = float('nan')
        elsewhere.header.frame_id = 'map'
        for reason, message in (
            ('the reach of the arm', unreachable),
            ('three finite numbers', not_a_number),
            ("in the frame 'base_link'", elsewhere),
        ):
            refuse(bench, process, lambda m=message: targets.publish(m), reason)
            if name == 'impedance_control':
                break  # both check targets by the same code


def refuse_set_points_for_a_stopped_arm(bench: ControllerBench) -> None:
    with bench.controller('gravity_compensation') as process:
        bench.wait(lambda: bench.mode == 'running', 'commands')
        bench.call('e_stop')
        bench.wait(lambda: bench.mode == 'fault', 'the stop')
        set_points = bench.publisher(topics.SET_POINT)
        message = JointState(name=NAMES, position=HERE)
        reason = (
            "set_point rejected, because the arm is in mode 'fault': first run 'arm enable', or "
            'clear the fault'
        )
        bench.wait(
            lambda: reason in process.log.read_text(), reason, lambda: set_points.publish(message)
        )


def test_rejected_inputs_are_named_and_move_nothing(bench: ControllerBench) -> None:
    """One bridge holds the arm from controller to controller."""
    refuse_trajectories_and_imu_samples(bench)
    refuse_set_points(bench)
    for name in ('kinematic_control', 'impedance_control'):
        refuse_tool_targets(bench, name)
    refuse_set_points_for_a_stopped_arm(bench)
