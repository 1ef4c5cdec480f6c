"""Runs of the emulated arm in lockstep for `same.py`, compared byte by byte."""

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path

import rclpy
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import PointStamped, PoseStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from same_programs import ROOT, executable, figures, finish, parameters
from same_relay import COMMANDS, LATCHED, NEWEST, PATIENCE, RELIABLE, SETTLED, STATES, Relay, Step
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

NAMES = ['joint1', 'joint2', 'joint3', 'joint4']
BENCH: dict[str, object] = {
    'joints': ['joint4'],
    'speeds': [0.8, 1.6],
    'span': 1.2,
    'runs': 1,
    'wait_timeout': 60.0,
    'state_timeout': 10.0,
    'tracking_limit': 1.0,
}
LOAD = [0.2, 0.08, 0.01, -0.02]  # [kg], [m]
EXCITATION: dict[str, object] = {
    'seed': 4,
    'fundamental': 0.25,
    'harmonics': 3,
    'amplitude': 0.3,
    'periods': 1,
    'wait_timeout': 60.0,
    'state_timeout': 10.0,
}
_RELAYED = (
    *('--ros-args', '-r', f'joint_states:={STATES}'),
    *('-r', f'joint_command:={COMMANDS}', '--'),
)


def arm(work: Path, **hardware: object) -> AbstractContextManager[subprocess.Popen[bytes]]:
    """Run the emulated arm."""
    given = {'seed': 3, 'pace': 'lockstep', 'encoders': 'absolute', 'answer_timeout': 600.0}
    return executable(work, 'fake_hardware', **{**given, **hardware})


def controller(
    work: Path, name: str, **law: object
) -> AbstractContextManager[subprocess.Popen[bytes]]:
    """Run a controller behind the relay."""
    return executable(work, name, *_RELAYED, **{'state_timeout': 10.0, **law})


# Actions of the arm.


def to(*points: tuple[float, list[float]]) -> JointTrajectory:
    """Return a trajectory through joint angles [rad] at times [s], to start at once."""
    message = JointTrajectory(joint_names=NAMES)
    for seconds, q in points:
        whole, part = divmod(seconds, 1.0)
        after = Duration(sec=int(whole), nanosec=round(part * 1e9))
        message.points.append(JointTrajectoryPoint(positions=q, time_from_start=after))
    return message


def pose(x: float, y: float, z: float) -> PoseStamped:
    """Return a place of the tool [m]."""
    message = PoseStamped()
    message.header.frame_id = 'base_link'
    message.pose.position.x, message.pose.position.y, message.pose.position.z = x, y, z
    message.pose.orientation.w = 1.0
    return message


def computed_torque(relay: Relay) -> tuple[list[Step], float]:
    """Follow a trajectory, stop along its path, follow another, and replace it."""
    send = relay.publisher(JointTrajectory, 'joint_trajectory')
    first = to((1.0, [0.3, 1.2, -0.2, 0.3]), (2.0, [-0.2, 1.8, 0.3, -0.4]))
    second = to((1.5, [0.4, 1.3, 0.2, 0.2]))
    third = to((1.2, [0.0, 1.6, -0.3, 0.4]), (2.2, [0.1, 1.5, 0.0, 0.0]))
    steps: list[Step] = [
        (0.1, lambda: send(first)),
        (1.3, lambda: send(JointTrajectory())),
        (2.2, lambda: send(second)),
        (2.9, lambda: send(third)),
    ]
    return steps, 5.5


def gravity_compensation(relay: Relay) -> tuple[list[Step], float]:
    """Move to a set point, then along a trajectory."""
    go = relay.publisher(JointState, 'set_point')
    send = relay.publisher(JointTrajectory, 'joint_trajectory')
    goal = JointState(name=NAMES, position=[0.2, 1.3, -0.1, 0.2])
    way = to((1.0, [0.0, 1.6, 0.1, -0.2]))
    return [(0.1, lambda: go(goal)), (1.6, lambda: send(way))], 3.0


def cartesian(relay: Relay) -> tuple[list[Step], float]:
    """Move the tool to two places."""
    send = relay.publisher(PoseStamped, 'tool_trajectory')
    one, other = pose(0.1, 0.25, 0.85), pose(-0.1, 0.2, 0.75)
    return [(0.1, lambda: send(one)), (1.5, lambda: send(other))], 3.0


def commanded(
    work: Path, name: str, plan: Callable[[Relay], tuple[list[Step], float]]
) -> dict[str, object]:
    """Enable the arm and let a controller command it."""
    with ExitStack() as stack:
        relay = Relay()
        stack.enter_context(arm(work))
        relay.wait_until_standing('idle')
        begin = relay.stamp
        relay.call('enable')
        relay.wait_until_standing('ready')
        stack.enter_context(controller(work, name))
        steps, end = plan(relay)
        relay.settle()
        _, last = relay.run(steps, end)
        return relay.items(name, begin, last)


def excitation(work: Path) -> dict[str, object]:
    """Home an arm with unknown zeros, play an excitation, and identify the recording.

    A second arm carries a payload, which `identifier` and `payload_estimator` estimate.
    """
    bare, loaded = work / 'bare', work / 'loaded'
    items = played(bare, 'unhomed', 'home', 'homing', 'excitation', encoders='incremental')
    items |= played(loaded, 'idle', 'enable', 'enabling', 'excitation with payload', payload=LOAD)
    model = ['--bag', str(bare / 'bag'), '--out', str(work / 'model')]
    finish('identifier', *model, '--payload', str(loaded / 'bag'))
    estimate = ['--model', str(work / 'model' / 'estimate.yaml'), '--out', str(work / 'payload')]
    finish('payload_estimator', '--bag', str(bare / 'bag'), str(loaded / 'bag'), *estimate)
    return items | figures('identifier', work / 'model') | figures('payload', work / 'payload')


def played(
    work: Path, mode: str, service: str, first: str, second: str, **hardware: object
) -> dict[str, object]:
    """Make the arm ready, and play and record an excitation; return the items of both."""
    work.mkdir()
    lines = (ROOT / 'config' / 'excitation.yaml').read_text().splitlines()
    quick = ['ramp_time: 0.8' if line.startswith('ramp_time:') else line for line in lines]
    config = work / 'excitation.yaml'
    config.write_text('\n'.join(quick) + '\n')
    with ExitStack() as stack:
        relay = Relay()
        stack.enter_context(arm(work, **hardware))
        relay.wait_until_standing(mode)
        begin = relay.stamp
        relay.call(service)
        relay.wait_until_standing('ready')
        ready = relay.stamp
        topics = ['joint_states', 'joint_command']
        stack.enter_context(executable(work, 'recorder', bag=str(work / 'bag'), topics=topics))
        relay.wait_for_recorder(topics)
        relay.passes_on = True
        motion = {**EXCITATION, 'excitation_config': str(config)}
        player = stack.enter_context(executable(work, 'excitation', *_RELAYED, **motion))
        relay.pass_on_until(lambda: player.poll() is not None)
        if player.returncode:
            raise RuntimeError(f'excitation: exit status {player.returncode}')
        last = max(relay.kept[COMMANDS].messages)
        items = relay.items(first, begin, ready) | relay.items(second, ready, last)
        relay.destroy()
    return items


def flight(work: Path) -> dict[str, object]:
    """Fly a drone to another place while its arm follows a trajectory."""
    drone = {'drone_file': 'config/drone.yaml'}
    with ExitStack() as stack:
        relay = Relay({'odometry': Odometry, 'rotor_command': JointState})
        stack.enter_context(arm(work, **drone))
        relay.wait_until_standing('idle')
        stack.enter_context(executable(work, 'flight_control', **drone))
        go = relay.publisher(PoseStamped, 'flight_set_point')
        relay.wait(lambda: bool(relay.kept['rotor_command'].messages), 'a rotor command')
        relay.call('enable')
        relay.wait_until_standing('ready')
        begin = relay.stamp
        stack.enter_context(controller(work, 'computed_torque', **drone))
        send = relay.publisher(JointTrajectory, 'joint_trajectory')
        relay.settle()
        way = to((1.0, [0.3, 1.2, -0.2, 0.3]), (2.0, [0.0, 1.57, 0.2, -0.2]))
        there = pose(0.3, -0.2, 0.1)
        there.header.frame_id = 'odom'
        steps: list[Step] = [(2.0, lambda: send(way)), (3.0, lambda: go(there))]
        _, last = relay.run(steps, 6.0)
        return relay.items('flight', begin, last)


def motor_bench(work: Path) -> dict[str, object]:
    """Measure one drive of the emulated arm."""
    out = work / 'bench'
    given = {**BENCH, 'out': str(out)}
    with ExitStack() as stack:
        relay = Relay()
        stack.enter_context(arm(work))
        relay.wait_until_standing('idle')
        relay.call('enable')
        relay.wait_until_standing('ready')
        relay.destroy()
        finish('motor_bench', *parameters(given))
    return figures('motor_bench', out)


def planner(work: Path) -> dict[str, object]:
    """Plan motions to joint angles and to a place of the tool, for each objective."""
    items: dict[str, object] = {}
    for objective in ('energy', 'time'):
        with executable(work, 'motion_planner', objective=objective, frame='tool0', lead=0.5):
            desk = PlannerDesk()
            goal = JointState(name=NAMES, position=[-0.6, 2.2, 0.5, -0.2])
            items[f'figures/planner/{objective}/joint_goal'] = desk.ask('joint_goal', goal)
            place = PointStamped()
            place.point.x, place.point.y, place.point.z = 0.3, 0.35, 0.65
            items[f'figures/planner/{objective}/tool_goal'] = desk.ask('tool_goal', place)
            desk.node.destroy_node()
    return items


class PlannerDesk:
    """Publishes states of an arm at rest, and goals; receives plans."""

    def __init__(self) -> None:
        self.node: Node = rclpy.create_node('same')
        self._plans: list[JointTrajectory] = []
        self._told: list[dict[str, object]] = []
        self._stamp = 0
        self._states = self.node.create_publisher(JointState, 'joint_states', NEWEST)
        self._goals = {
            'joint_goal': self.node.create_publisher(JointState, 'joint_goal', RELIABLE),
            'tool_goal': self.node.create_publisher(PointStamped, 'tool_goal', RELIABLE),
        }
        self.node.create_subscription(
            JointTrajectory, 'joint_trajectory', self._plans.append, RELIABLE
        )
        self.node.create_subscription(
            String, 'plan_status', lambda m: self._told.append(json.loads(m.data)), LATCHED
        )
        publishers = [self._states, *self._goals.values()]
        self._wait(lambda: all(p.get_subscription_count() for p in publishers), 'the planner')
        settled = time.monotonic() + SETTLED
        self._wait(lambda: time.monotonic() > settled, 'states')

    def _wait(self, condition: Callable[[], bool], what: str) -> None:
        deadline = time.monotonic() + PATIENCE
        while not condition():
            self._stamp += 10_000_000
            state = JointState(name=NAMES, position=[0.2, 1.0, 0.0, 0.3])
            state.velocity, state.effort = [0.0] * 4, [0.0] * 4
            state.header.stamp.sec, state.header.stamp.nanosec = divmod(self._stamp, 10**9)
            self._states.publish(state)
            rclpy.spin_once(self.node, timeout_sec=0.02)
            if time.monotonic() > deadline:
                raise TimeoutError(f'waited {PATIENCE:g} s for {what}: {self._told}')

    def ask(self, topic: str, goal: object) -> dict[str, object]:
        """Return the planner's report on a goal, and its trajectory."""
        told, plans = len(self._told), len(self._plans)
        self._goals[topic].publish(goal)
        self._wait(lambda: len(self._told) > told, 'an answer')
        status = self._told[-1]
        if not status['accepted']:
            raise RuntimeError(f'motion_planner: {status["text"]}')
        self._wait(lambda: len(self._plans) > plans, 'a trajectory')
        points = [
            [
                point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec,
                *(list(values) for values in (point.positions, point.velocities)),
            ]
            for point in self._plans[-1].points
        ]
        figures = {key: status[key] for key in ('seconds', 'joules', 'goal')}
        return {**figures, 'points': len(points), 'every tenth': points[::10]}


PARTS: dict[str, Callable[[Path], dict[str, object]]] = {
    'excitation': excitation,
    'flight': flight,
    'motor_bench': motor_bench,
    'planner': planner,
    'computed_torque': lambda work: commanded(work, 'computed_torque', computed_torque),
    'gravity_compensation': lambda work: commanded(
        work, 'gravity_compensation', gravity_compensation
    ),
    'kinematic_control': lambda work: commanded(work, 'kinematic_control', cartesian),
    'impedance_control': lambda work: commanded(work, 'impedance_control', cartesian),
}


def main() -> None:
    """Write the items of one part."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('part', choices=PARTS)
    parser.add_argument('--out', type=Path, required=True)
    parser.add_argument('--work', type=Path, required=True)
    options = parser.parse_args()
    rclpy.init(args=[])
    try:
        items = PARTS[options.part](options.work)
    except (TimeoutError, RuntimeError) as error:
        logs = [path.read_text(errors='replace')[-1500:] for path in options.work.rglob('*.log')]
        sys.exit(f'{error}\n' + '\n'.join(logs))
    options.out.write_text(json.dumps(items))
    sys.stdout.flush()
    os._exit(0)  # The nodes need no cleanup.


if __name__ == '__main__':
    main()
