"""State-to-command latency and processor load of the nodes, compared with the design's limit.

First two dedicated processes, with raw bytes and with plain rclpy, run at 1 kHz over real DDS. They
show the limit of the design on this machine at this time. The first process publishes joint states;
the second computes the torques (RNEA) and publishes a joint command. Both latencies count from the
state's stamp, taken just before publication. One ends at the computed torque in the controller. The
other ends at the command's arrival in the bridge: when the middleware has it if the bridge takes
commands itself, otherwise when the callback is called. The first latency is also given from the
state's publication, without its packing, as the nodes count.

Then the nodes run in real time: `fake_hardware`, and `hardware_bridge` on emulated boards behind a
preloaded SPI bus. Each runs with every controller and with `excitation`, and with a client that
sends 20 parameter requests per second to the bridge. Figures are medians of repeats.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np
import rclpy
from bare_loop import BareLoops
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState
from timing.node_run import EMULATED, EXCITATION, REAL, measure, median, why_not
from timing.waiting import wait_until

from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_msgs_py.live_topics import RawReader
from aerarm_msgs_py.topics import JOINT_COMMAND, JOINT_STATES
from aerarm_ros.description.robot import load_robot
from aerarm_ros.model.dynamics import Dynamics
from aerarm_ros.realtime.periodic_loop import PeriodicLoop, TimingStatistics
from aerarm_ros.realtime.scheduling import (
    freeze_garbage_collector,
    keep_cpus_awake,
    lock_memory,
    set_fifo,
)
from aerarm_ros.ros.process.node_process import ros_environment
from aerarm_ros.ros.requests.arm_client import ArmClientError

PERIOD = 1e-3
CONTROLLERS = (
    'computed_torque',
    'gravity_compensation',
    'kinematic_control',
    'impedance_control',
    EXCITATION,
)
ASKED = 'computed_torque'  # also measured in parallel with a client of parameters
NODE_LINE = '{:16}{:29}{:>11}{:>12}{:>10}{:>12}{:>7}{:>9}{:>9}'
NODE_HEADINGS = (
    *('bridge', 'who answers', 'to torque', 'to command', 'answered', 'missed'),
    *('cycle', 'bridge', 'answer'),
)
SILENCE = 1.0  # [s] without a state after which a controller ends
NAMES = ['joint1', 'joint2', 'joint3', 'joint4']
NANOSECONDS = 1_000_000_000


class CpuMeter:
    """Processor load of this process from the first call of `tick` to the last, per core."""

    def __init__(self) -> None:
        self._first: tuple[float, float] | None = None

    def tick(self) -> None:
        """Record the time; call once per cycle."""
        self._last = (time.process_time(), time.monotonic())
        self._first = self._first or self._last

    @property
    def share(self) -> float:
        """Return processor time divided by elapsed time."""
        used, passed = np.subtract(self._last, self._first or self._last)
        return float(used / passed) if passed else 0.0


def raw_bridge(node: Node, cycles: int) -> dict[str, float]:
    """Publish packed states at absolute deadlines, and take the newest command."""
    publisher = node.create_publisher(JOINT_STATES.type, JOINT_STATES.name, JOINT_STATES.qos)
    commands = RawReader(node, JOINT_COMMAND)
    cdr, loop, meter = JointStateCdr(NAMES), PeriodicLoop(PERIOD), CpuMeter()
    state, latency = np.full(4, 0.1), TimingStatistics()

    def cycle(now_ns: int, index: int) -> None:
        message = commands.take_newest()
        command = cdr.unpack(message[0]) if message else None
        if command is not None:
            latency.add(message[1]['received_timestamp'] - command.stamp_ns)
        publisher.publish(cdr.pack(time.time_ns(), state, state, state))
        meter.tick()
        if loop.cycles >= cycles:
            loop.stop()

    wait_until(lambda: publisher.get_subscription_count() and commands.publishers())
    loop.run(cycle)
    figures = {'cpu': meter.share, 'answered': latency.count / loop.cycles}
    return {**figures, 'lateness': loop.lateness.summary().p50, **latency_of(latency)}


def raw_controller(node: Node, cycles: int) -> dict[str, float]:
    """Wait only for the state, and respond with a packed command."""
    publisher = node.create_publisher(JOINT_COMMAND.type, JOINT_COMMAND.name, JOINT_COMMAND.qos)
    states = RawReader(node, JOINT_STATES)
    cdr, meter, latency = JointStateCdr(NAMES), CpuMeter(), TimingStatistics()
    since_publication = TimingStatistics()
    dynamics = Dynamics(load_robot())
    wait_until(lambda: states.wait(0.1))
    while states.wait(SILENCE):
        message = states.take_newest()
        sample = cdr.unpack(message[0]) if message else None
        if sample is None:
            continue
        effort = dynamics.inverse(sample.position, sample.velocity, np.zeros(4))
        now_ns = time.time_ns()
        latency.add(now_ns - sample.stamp_ns)
        since_publication.add(now_ns - message[1]['source_timestamp'])
        publisher.publish(cdr.pack(sample.stamp_ns, effort=effort))
        meter.tick()
    published = {f'published_{k}': v for k, v in latency_of(since_publication).items()}
    return {'cpu': meter.share, **latency_of(latency), **published}


def plain_bridge(node: Node, cycles: int) -> dict[str, float]:
    """Publish message objects from a timer, and receive commands in a callback."""
    publisher = node.create_publisher(JOINT_STATES.type, JOINT_STATES.name, JOINT_STATES.qos)
    meter, sent, latency = CpuMeter(), 0, TimingStatistics()

    def on_command(message: JointState) -> None:
        latency.add(time.time_ns() - stamp_of(message))

    def on_timer() -> None:
        nonlocal sent
        sent += 1
        message = JointState(name=NAMES, position=[0.1] * 4, velocity=[0.1] * 4, effort=[0.1] * 4)
        stamp = message.header.stamp
        stamp.sec, stamp.nanosec = divmod(time.time_ns(), NANOSECONDS)
        publisher.publish(message)
        meter.tick()

    commands = node.create_subscription(
        JointState, JOINT_COMMAND.name, on_command, JOINT_COMMAND.qos
    )
    wait_until(lambda: publisher.get_subscription_count() and commands.get_publisher_count())
    node.create_timer(PERIOD, on_timer)
    spin(node, lambda: sent < cycles)
    return {'cpu': meter.share, 'answered': latency.count / sent, **latency_of(latency)}


def plain_controller(node: Node, cycles: int) -> dict[str, float]:
    """Respond to message objects in a callback."""
    publisher = node.create_publisher(JOINT_COMMAND.type, JOINT_COMMAND.name, JOINT_COMMAND.qos)
    meter, latency = CpuMeter(), TimingStatistics()
    dynamics = Dynamics(load_robot())
    heard = time.monotonic() + 20.0

    def on_state(state: JointState) -> None:
        nonlocal heard
        q, dq = np.array(state.position), np.array(state.velocity)
        effort = dynamics.inverse(q, dq, np.zeros(4))
        latency.add(time.time_ns() - stamp_of(state))
        command = JointState(name=NAMES, effort=effort.tolist())
        command.header.stamp = state.header.stamp
        publisher.publish(command)
        meter.tick()
        heard = time.monotonic()

    node.create_subscription(JointState, JOINT_STATES.name, on_state, JOINT_STATES.qos)
    spin(node, lambda: time.monotonic() < heard + SILENCE)
    return {'cpu': meter.share, **latency_of(latency)}


ROLES = {'raw bytes': (raw_bridge, raw_controller), 'plain rclpy': (plain_bridge, plain_controller)}


def spin(node: Node, going_on: Callable[[], bool]) -> None:
    """Spin like `rclpy.spin` while a condition is true."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while going_on():
        executor.spin_once(timeout_sec=SILENCE)


def stamp_of(message: JointState) -> int:
    return int(message.header.stamp.sec * NANOSECONDS + message.header.stamp.nanosec)


def latency_of(statistics: TimingStatistics) -> dict[str, float]:
    summary = statistics.summary()
    return {'p50': summary.p50, 'p99': summary.p99, 'p999': summary.p999}


def run_role(pair: str, part: int, cycles: int) -> None:
    """Run one process of a pair, and print its figures."""
    rclpy.init(args=[])
    node = rclpy.create_node(f'part_{part}')
    requests = (keep_cpus_awake(), lock_memory(), freeze_garbage_collector())
    for warning in (set_fifo(80 - 10 * part), *requests):
        if warning:
            print(warning, file=sys.stderr)
    print(json.dumps(ROLES[pair][part](node, cycles)))


def run_pair(pair: str, cycles: int) -> tuple[dict[str, float], dict[str, float]]:
    """Run both processes of a pair; return the figures of bridge and controller."""
    isolation = {
        'ROS_DOMAIN_ID': str(1 + os.getpid() % 100),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
    }
    command = [sys.executable, __file__, '--cycles', str(cycles), '--pair', pair, '--part']
    processes = [
        subprocess.Popen(
            [*command, str(part)], env=ros_environment(isolation), stdout=subprocess.PIPE, text=True
        )
        for part in (0, 1)
    ]
    outputs = [process.communicate()[0] for process in processes]
    if any(process.returncode for process in processes):
        raise SystemExit(f'latency: a process of the pair "{pair}" failed')
    bridge, controller = (json.loads(output) for output in outputs)
    return bridge, controller


def median_pair(pair: str, cycles: int, repeats: int) -> tuple[dict[str, float], ...]:
    """Return the medians of several runs of a pair."""
    runs = [run_pair(pair, cycles) for _ in range(repeats)]
    return tuple(
        {name: float(np.median([run[part][name] for run in runs])) for name in runs[0][part]}
        for part in (0, 1)
    )


def report(pairs: dict[str, tuple[dict[str, float], ...]]) -> None:
    rows = [
        (f'state to {end}, {name}', 'us', 1e6, [pair[part][name] for pair in pairs.values()])
        for part, end in ((1, 'torque'), (0, 'command'))
        for name in ('p50', 'p99', 'p999')
    ]
    rows += [
        (label, '%', 100.0, [pair[part][name] for pair in pairs.values()])
        for label, part, name in (
            ('CPU of the process that sends states', 0, 'cpu'),
            ('CPU of the process that answers', 1, 'cpu'),
            ('cycles with a command', 0, 'answered'),
        )
    ]
    print(f'{"":38}' + ''.join(f'{name:>13}' for name in pairs) + f'{"ratio":>8}')
    for label, unit, scale, values in rows:
        cells = ''.join(f'{scale * value:13.1f}' for value in values)
        print(f'{label + " [" + unit + "]":38}{cells}{values[0] / values[1]:8.2f}')


def report_nodes(seconds: float, repeats: int) -> None:
    """Run bridges with their controllers, and print a line for each pair."""
    print(f'\nNodes: medians of {repeats} runs of {seconds:g} s; [us] p50/p99, [%]')
    print(NODE_LINE.format(*NODE_HEADINGS))
    cases = [(bridge, name, False) for bridge in (EMULATED, REAL) for name in CONTROLLERS]
    for bridge, name, ask in [*cases, (EMULATED, ASKED, True), (REAL, ASKED, True)]:
        if why_not(bridge):
            print(f'{bridge}: {why_not(bridge)}')
            continue
        try:
            runs = [measure(bridge, name, seconds, ask) for _ in range(repeats)]
        except ArmClientError as error:  # the machine is too slow for a real arm at present
            print(f'{bridge:16}{name:29} {error}', flush=True)
            continue
        f = median(runs)
        spread = f'{min(r.missed for r in runs):.2f}-{max(r.missed for r in runs):.2f}'
        label = f'{name}, client' if ask else name
        torque, command = (f'{p50:.0f}/{p99:.0f}' for p50, p99 in (f[:2], f[2:4]))
        loads = (f'{f.cycle:.0f}', f'{f.bridge:.1f}', f'{f.controller:.1f}')
        cells = (bridge, label, torque, command, f'{f.answered:.2f}', spread, *loads)
        print(NODE_LINE.format(*cells), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seconds', type=float, default=10.0, help='duration of each run [s]')
    parser.add_argument('--repeats', type=int, default=3, help='number of runs per pair')
    parser.add_argument('--cycles', type=int, help=argparse.SUPPRESS)
    parser.add_argument('--pair', choices=ROLES, help=argparse.SUPPRESS)
    parser.add_argument('--part', type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.pair:
        run_role(options.pair, options.part, options.cycles)
        return
    cycles = round(options.seconds / PERIOD)
    bare = BareLoops(options.seconds)
    quiet = '\n'.join(bare.lines())
    pairs = {pair: median_pair(pair, cycles, options.repeats) for pair in ROLES}
    report(pairs)
    lateness = pairs['raw bytes'][0]['lateness']
    published = [1e6 * pairs['raw bytes'][1][f'published_{name}'] for name in ('p50', 'p99')]
    print(
        'From its publication, as nodes count, a state of raw bytes became a torque in '
        f'{published[0]:.0f} us\n'
        f'(median), {published[1]:.0f} us (p99).\n'
        f'The wake-up latency of a sleeping thread is {1e6 * lateness:.0f} us (median); in '
        'either pair a state wakes two threads.\n'
        'Goals: latency p50 at most half, CPU of the process that sends states at most a '
        'quarter. All\n'
        'processes have SCHED_FIFO if the system permits it.'
    )
    print(quiet)
    report_nodes(options.seconds, options.repeats)


if __name__ == '__main__':
    main()
