"""Memory growth of five nodes at 1 kHz, and frame rate of the view page.

These nodes run as processes: `fake_hardware`, `computed_torque`, which swings the arm back and
forth, `base_reaction`, `recorder` and `view`, with a connected client. Every two seconds the
benchmark reads the unshared memory of each process, and its proportional and resident set size
(PSS, RSS). The PSS also changes with other users of shared libraries. After a warm-up a line is
fitted to each size. Its uncertainty is twice the standard error, increased for correlated samples.
The client counts frames. For an endurance test use `--minutes 60`. On a computer with other users
use `--priority 0`, `--period 0.004` (then only every fourth message is sent), and `--page-only`,
which omits recorder and base_reaction.
"""

import argparse
import socket
import tempfile
import time
from contextlib import ExitStack, suppress
from pathlib import Path

import numpy as np
from rclpy.duration import Duration
from rclpy.node import Node
from timing.node_run import processor_time, ros_node
from timing.onlooker import Onlooker
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from aerarm_msgs_py import topics
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.ros.executors import spin_until
from aerarm_ros.ros.process.node_process import NodeProcess
from aerarm_ros.ros.requests.arm_client import ArmClient, ArmClientError

PERIOD = 2.0  # [s] between two readings
WARM_UP = 0.25  # fraction of the run
SWING = 0.3  # [rad] to each side


def memory(pid: int) -> tuple[float, ...]:
    """Return the unshared memory, the PSS and the RSS of a process [KiB]."""
    lines = Path(f'/proc/{pid}/smaps_rollup').read_text().splitlines()[1:]
    sizes = {line.split(':')[0]: float(line.split()[1]) for line in lines}
    return sizes['Private_Clean'] + sizes['Private_Dirty'], sizes['Pss'], sizes['Rss']


def slope(times: np.ndarray, size: np.ndarray) -> tuple[float, float]:
    """Return the slope of (k,) sizes over times (k,), and twice its standard error.

    Consecutive samples are correlated, so their effective number is reduced by the correlation of
    neighbouring residuals.
    """
    time = times - times.mean()
    rate = time @ size / (time @ time)
    rest = size - size.mean() - rate * time
    spread = rest @ rest
    if spread < 1e-9:
        return rate, 0.0
    alike = min(max(rest[1:] @ rest[:-1] / spread, 0.0), 0.99)
    error = np.sqrt(spread / (len(size) - 2) / (time @ time))
    return rate, 2.0 * error * np.sqrt((1.0 + alike) / (1.0 - alike))


class ToAndFro:
    """Publisher that moves all joints to both sides of the home configuration.

    Parameters
    ----------
    node
        Owner of the publisher.
    """

    def __init__(self, node: Node) -> None:
        config, topic = load_arm_config(), topics.JOINT_TRAJECTORY
        self._names, self._middle = config.joint_names, np.array(config.rest_position)
        self._side = SWING
        self._publisher = node.create_publisher(topic.type, topic.name, topic.qos)
        while not self._publisher.get_subscription_count():
            time.sleep(0.05)

    def turn(self) -> None:
        """Send the arm to the other side; call again before it arrives."""
        self._side = -self._side
        point = JointTrajectoryPoint(positions=(self._middle + self._side).tolist())
        point.time_from_start = Duration(seconds=1.2 * PERIOD).to_msg()
        self._publisher.publish(JointTrajectory(joint_names=self._names, points=[point]))


def start(
    node: Node, arm: ArmClient, folder: Path, stack: ExitStack, options: argparse.Namespace
) -> tuple[dict[str, NodeProcess], ToAndFro, Onlooker]:
    """Start the nodes, enable the arm, and open the page."""
    with socket.socket() as probe:
        probe.bind(('127.0.0.1', 0))
        port = probe.getsockname()[1]
    nodes: dict[str, NodeProcess] = {}

    def run(name: str, **parameters: object) -> None:
        log = folder / f'{name}.log'
        nodes[name] = stack.enter_context(NodeProcess(name, (), parameters, log=log))

    if not options.page_only:
        run('recorder', bag=folder / 'bag')
    timing = {'period': options.period, 'realtime_priority': options.priority}
    run('fake_hardware', encoders='absolute', **timing)
    arm.wait_for_mode(['idle'], 60.0)
    arm.call('enable')
    arm.wait_for_mode(['ready'], 60.0)
    run('computed_torque', realtime_priority=max(0, options.priority - 1))
    if not options.page_only:
        run('base_reaction')
    run('view', port=port)
    arm.wait_for_mode(['running'], 60.0)
    swing = ToAndFro(node)
    deadline = time.monotonic() + 60.0
    while 'in a browser' not in nodes['view'].tail():
        if time.monotonic() > deadline:
            raise SystemExit(f'memory: the page is not served:\n{nodes["view"].tail()}')
        time.sleep(0.1)
    return nodes, swing, Onlooker(port)


def watch(
    nodes: dict[str, NodeProcess], node: Node, arm: ArmClient, swing: ToAndFro, minutes: float
) -> dict[str, np.ndarray]:
    """Swing the arm; return (k, 5) for each node: time [min], memory [KiB], processor [s].

    An arm that was damped because of late commands is held again, because an arm at rest gives no
    frames.
    """
    held = 0
    samples: dict[str, list[tuple[float, ...]]] = {name: [] for name in nodes}
    begun = time.monotonic()
    while (passed := (time.monotonic() - begun) / 60.0) < minutes:
        swing.turn()
        for name, process in nodes.items():
            if process.returncode is not None:
                raise SystemExit(f'memory: {name} has ended:\n{process.tail()}')
            samples[name].append((passed, *memory(process.pid), processor_time(process)))
        if spin_until(node, lambda: arm.mode == 'damping', PERIOD):
            with suppress(ArmClientError):  # the arm may no longer be damped
                arm.call('hold')
                held += 1
    print(f'the arm is {arm.mode} after {held} interruptions with damping')
    return {name: np.array(rows) for name, rows in samples.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        '--minutes', type=float, default=3.0, help='duration of the measurement [min]'
    )
    parser.add_argument('--period', type=float, default=1e-3, help='period of the bridge [s]')
    parser.add_argument(
        '--priority', type=int, default=80, help='SCHED_FIFO priority of the bridge; 0 for none'
    )
    parser.add_argument('--page-only', action='store_true', help='omit recorder and base_reaction')
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, ros_node() as node, ExitStack() as stack:
        arm = ArmClient(node, ['fake_hardware'])
        nodes, swing, onlooker = start(node, arm, Path(folder), stack, options)
        begun = time.monotonic() + 60.0 * WARM_UP * options.minutes
        samples = watch(nodes, node, arm, swing, options.minutes)
        mean, worst = onlooker.rates(begun)
        seen = f'{mean:.1f} frames per second, {worst:.1f} in the worst 10 s'
        if not onlooker.is_there:
            seen = 'the browser was disconnected, because the computer was too busy to count frames'
        for process in reversed(nodes.values()):
            process.stop()
        for name in ('fake_hardware', 'recorder'):
            print(nodes[name].tail(1) if name in nodes else f'no {name}')
    print(f'page: {seen}')
    print(f'{"":16} {"own":>8}  slope, MiB an hour: {"own":>5} {"PSS":>18} {"RSS":>18}  processor')
    for name, rows in samples.items():
        minutes, *sizes, used = rows[rows[:, 0] >= WARM_UP * options.minutes].T
        slopes = [
            f'{rate:+9.1f} ± {error:6.1f}'
            for rate, error in (slope(minutes / 60.0, x / 1024.0) for x in sizes)
        ]
        share = (used[-1] - used[0]) / (60.0 * (minutes[-1] - minutes[0]))
        own = f'{sizes[0][-1] / 1024:4.1f} MiB'
        print(f'{name:16} {own} {"":7} {" ".join(slopes)} {share:9.1%}')


if __name__ == '__main__':
    main()
