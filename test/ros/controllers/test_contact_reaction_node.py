"""Controllers stop, retreat or comply when `contact` begins, as `contact_reaction` says."""

import threading
from pathlib import Path

import numpy as np
from controller_bench import ControllerBench, trajectory
from forked_executable import run
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool

from aerarm_msgs_py import topics
from aerarm_ros.ros.process.node_process import NodeProcess

HERE = np.array([0.0, 0.5 * np.pi, 0.0, 0.0])
GOAL = [0.9, 1.2, 0.4, -0.6]


def moved(bench: ControllerBench) -> float:
    """Return the share of the way from HERE to GOAL."""
    way = GOAL - HERE
    return float((bench.q - HERE) @ way / (way @ way))


def stop_on_the_path_and_return(bench: ControllerBench) -> None:
    with bench.controller('computed_torque') as process:
        goals, contact = bench.publisher(topics.JOINT_TRAJECTORY), bench.publisher(topics.CONTACT)
        # Before it has received the arm's mode, the controller rejects goals.
        bench.wait(lambda: bench.mode == 'running', 'commands')
        bench.set_parameter('computed_torque', 'contact_reaction', 'stop')
        goals.publish(trajectory(GOAL, 8.0))
        bench.wait(lambda: moved(bench) > 0.05, 'the motion')
        touch = Bool(data=True)
        bench.wait(
            lambda: np.abs(bench.dq).max() < 0.005, 'the stop', lambda: contact.publish(touch), 0.02
        )
        stopped = moved(bench)
        assert 0.05 < stopped < 0.9
        off = bench.q - HERE - stopped * (GOAL - HERE)
        assert np.abs(off).max() < 0.02
        back = trajectory(HERE.tolist(), 1.5)
        bench.wait_for_posture(HERE.tolist(), 0.02, lambda: goals.publish(back))
        assert process.stop() == 0, process.tail()


def restore_the_reaction_after_an_interruption(bench: ControllerBench) -> None:
    with bench.controller('computed_torque', contact_reaction='stop') as process:
        words = ('go', *map(str, GOAL), '--on-contact', 'retreat', '--timeout', '100')
        with NodeProcess('arm', words, {}, None, bench.folder / 'arm.log') as asking:
            bench.wait(lambda: moved(bench) > 0.05, 'the motion')
            assert bench.parameter('computed_torque', 'contact_reaction') == 'retreat'
            assert asking.stop() == 130, asking.tail()
        assert bench.parameter('computed_torque', 'contact_reaction') == 'stop'
        assert process.stop() == 0, process.tail()


def go_reports_the_contact(bench: ControllerBench) -> None:
    with bench.controller('gravity_compensation') as process:
        contact = bench.publisher(topics.CONTACT)
        bench.wait(lambda: bench.mode == 'running', 'commands')
        answers, start = [], bench.q
        words = ['-0.9', '1.9', '-0.4', '0.6']

        def go() -> None:
            answers.append(run('arm', 'go', *words, '--on-contact', 'retreat', '--timeout', '100'))

        def touch(_: JointState) -> None:
            if np.abs(bench.q - start).max() > 0.05:
                contact.publish(Bool(data=True))

        bench.listen(topics.JOINT_STATES, touch)
        asking = threading.Thread(target=go)
        asking.start()
        bench.wait(lambda: not asking.is_alive(), 'the answer')
        asking.join()
        (answer,) = answers
        assert answer.returncode == 1, answer.stderr
        assert 'stopped: contact (retreat)' in answer.stderr
        assert bench.parameter('gravity_compensation', 'contact_reaction') == 'report'
        assert process.stop() == 0, process.tail()


def test_a_contact_stops_the_motion(tmp_path: Path, ros_node: Node) -> None:
    """One bridge holds the arm from controller to controller."""
    bench = ControllerBench(tmp_path, ros_node, pace='keep_up', period=0.004)
    with bench.hardware:
        bench.start()
        stop_on_the_path_and_return(bench)
        restore_the_reaction_after_an_interruption(bench)
        go_reports_the_contact(bench)


def test_boards_cannot_comply(ros_domain: dict[str, str]) -> None:
    parameters = {'feedback': 'boards', 'contact_reaction': 'comply'}
    done = run('computed_torque', parameters=parameters)
    assert done.returncode == 1
    assert "with feedback 'boards' the arm cannot comply with contact" in done.stderr
