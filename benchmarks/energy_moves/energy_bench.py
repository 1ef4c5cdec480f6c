"""Test bench that plays motions with nodes in lockstep and measures their energies."""

import json
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from flying.arm_model import ArmModel
from flying.node_bench import PATIENCE, NodeBench
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from tracking import ArmStates
from trajectory_msgs.msg import JointTrajectory

from aerarm_msgs_py import topics
from aerarm_msgs_py.bags.bag_reader import read_contents
from aerarm_ros.control.checks import JointLimits
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.energy.energy_model import BalanceMeter, EnergyModel, HoldingLoss
from aerarm_ros.motion.polynomial_path import PolynomialPath
from aerarm_ros.motion.signals import ArmState
from aerarm_ros.planner.motion_plan import QUINTIC, PlanError
from aerarm_ros.planner.motion_planner import MotionPlanner
from aerarm_ros.ros.controllers.trajectory_input import read_trajectory
from aerarm_ros.ros.executors import spin_until
from aerarm_ros.ros.requests.arm_client import ArmClient, ArmClientError
from aerarm_ros.ros.requests.motion_request import trajectory_message
from aerarm_ros.ros.requests.parameter_request import ParameterRequest

PLANNED, TRAPEZOID = 'planned', 'trapezoid'
SHAPES = (PLANNED, QUINTIC, TRAPEZOID)


@dataclass(frozen=True, eq=False)
class Move:
    """Move from rest to rest between postures (n,) [rad] in a duration [s]."""

    start: np.ndarray
    goal: np.ndarray
    duration: float

    @property
    def back(self) -> 'Move':
        """Move in the opposite direction."""
        return Move(self.goal, self.start, self.duration)

    def path(self, shape: str) -> PolynomialPath:
        """Return the path of the move as a quintic or a trapezoid."""
        make = trapezoid if shape == TRAPEZOID else PolynomialPath.rest_to_rest
        return make(self.start, self.goal, self.duration)


def trapezoid(start: np.ndarray, end: np.ndarray, duration: float) -> PolynomialPath:
    """Return a rest-to-rest path between postures (n,) with trapezoidal velocity.

    Acceleration in the first and deceleration in the last third of the time are constant.
    """
    shares = np.zeros((3, 6))  # coefficients of 1, x, x^2 in each third
    shares[:, :3] = [[0.0, 0.0, 0.25], [0.25, 0.5, 0.0], [0.75, 0.5, -0.25]]
    coefficients = shares[:, :, np.newaxis] * (end - start)
    coefficients[:, 0] += start
    return PolynomialPath(tuple(duration / 3.0 * np.arange(4.0)), coefficients)


def draw_moves(planner: MotionPlanner, seed: int, durations: list[float]) -> Iterator[Move]:
    """Yield random moves, uniform over the joint ranges and between two durations [s].

    Only moves that are feasible as quintics in both directions are yielded, for comparison.
    """
    random = np.random.default_rng(seed)
    low, high = planner.limits.position_min, planner.limits.position_max
    while True:
        start, goal = random.uniform(low, high, (2, len(low)))
        duration = float(random.uniform(*durations))
        quintic = planner.with_settings(objective=QUINTIC, duration=duration)
        try:
            quintic.plan(start, goal)
            quintic.plan(goal, start)
        except PlanError:
            continue
        yield Move(start, goal, duration)


LEAD = 1.0  # [s] from a message to its motion
SETTLE = 0.2  # [s] after a motion that belong to it
ASTRAY = 50.0  # [mrad] error above which the arm does not follow its path

# Settings that docs/how-to/energy.md recommends for `computed_torque`; no observer is needed.
LAW = {
    'friction_width': 0.004,
    'command_delay': 1.5e-3,
    'velocity_lag': 1.59e-3,
    'observer_gain': 0.0,
}

Stamp = tuple[int, int]  # [s], [ns]


@dataclass(frozen=True)
class Played:
    """Name and start time [s] of a motion that was played."""

    pair: int
    shape: str
    begin: float
    path: PolynomialPath


@dataclass(frozen=True)
class Taken:
    """Predicted and measured energy of a motion [J], and its RMS and maximum errors [mrad]."""

    pair: int
    shape: str
    duration: float
    predicted: float
    measured: float
    rms: float
    largest: float


class EnergyBench(NodeBench):
    """Emulated arm that plays and records motions."""

    def __init__(
        self, stack: ExitStack, node: Node, folder: Path, arm: ArmModel, model: EnergyModel
    ) -> None:
        super().__init__(stack, node, folder)
        self._model = model
        self._config = load_arm_config()
        self.played: list[Played] = []
        self.refused: list[str] = []
        # Keyed by stamp: that of the goal and that of the trajectory. This process also receives
        # its own messages, possibly with delay.
        self._told: dict[Stamp, dict] = {}
        self._sent: dict[Stamp, JointTrajectory] = {}
        world = {'seed': arm.seed, 'pace': 'lockstep', 'encoders': 'absolute'}
        self._bridge = self.start('fake_hardware', world)
        self.start('computed_torque', {**arm.law, **LAW})
        self.start('motion_planner', {**arm.law, 'lead': LEAD})
        recorded = {'bag': folder / 'bag', 'topics': '[joint_states]'}
        self._recorder = self.start('recorder', recorded)
        self._client = ArmClient(node)
        self._trajectories = self.publisher_of(topics.JOINT_TRAJECTORY)
        self._goals = self.publisher_of(topics.JOINT_GOAL)
        self.listen(topics.PLAN_STATUS, self._on_status)
        self.listen(topics.JOINT_TRAJECTORY, self._on_trajectory)
        self._states = ArmStates(node, self._config.joint_names)
        self._client.wait_for_mode(['idle'], PATIENCE)
        ready = [self._trajectories, self._goals]
        self.wait('a node', lambda: all(p.get_subscription_count() for p in ready))
        self.wait('the recorder', lambda: 'publishers found' in self._recorder.tail())
        self._client.call('enable', PATIENCE)
        self._client.wait_for_mode(['running'], PATIENCE)

    def play(self, pair: int, shape: str, move: Move) -> None:
        """Play a move and record it."""
        if shape != PLANNED:
            self.played.append(Played(pair, shape, *self.go(move.path(shape))))
            return
        planned = self._planned(move)
        if planned is None:
            self.go(move.path('quintic'))
        else:
            self.played.append(Played(pair, shape, *planned))

    def results(self) -> list[Taken]:
        """Close the bag and return its energies."""
        self._recorder.stop()
        states = read_contents(self.folder / 'bag', 'joint_states').joint_states['/joint_states']
        order = [states.names.index(name) for name in self._config.joint_names]
        q, dq, tau = (
            values[:, order] for values in (states.position, states.velocity, states.effort)
        )
        loss = HoldingLoss(self._model)
        results = []
        for one in self.played:
            end = one.begin + one.path.duration
            rows = np.flatnonzero((states.stamp >= one.begin) & (states.stamp <= end + SETTLE))
            meter = BalanceMeter(self._model)
            for k in rows:
                meter.add(states.stamp[k], ArmState(q[k], dq[k], tau[k]))
            if abs(meter.total.seconds - one.path.duration - SETTLE) > 0.03:
                raise SystemExit(
                    f'energy: only {meter.total.seconds:.2f} s of a motion were recorded: check '
                    'the load of this computer'
                )
            moving = rows[states.stamp[rows] <= end]
            off = 1e3 * (q[moving] - one.path.evaluate(states.stamp[moving] - one.begin).q)
            if np.abs(off).max() > ASTRAY:
                off_by = (
                    f'{np.abs(off).max():.0f} mrad off its path, because the plan arrived too late'
                )
                self.refused.append(f'{one.shape} of move {one.pair}: {off_by}')
                continue
            balance = self._model.balance(one.path)
            held = SETTLE * loss.watts(one.path.evaluate(one.path.duration).q)
            results.append(
                Taken(
                    one.pair,
                    one.shape,
                    one.path.duration,
                    float(balance.motors.sum()) + held,
                    float(meter.total.motors.sum()),
                    float(np.sqrt((off**2).mean())),
                    float(np.abs(off).max()),
                )
            )
        return results

    def _planned(self, move: Move) -> tuple[float, PolynomialPath] | None:
        """Play the planner's motion for a move, if any; return its start [s] and path."""
        request = ParameterRequest(self.node, 'motion_planner', PATIENCE)
        request.set('duration', str(move.duration))
        goal = JointState(name=list(self._config.joint_names), position=move.goal.tolist())
        goal.header.stamp.sec, goal.header.stamp.nanosec = divmod(self._now_ns(), 10**9)
        asked = _stamp(goal)
        self._goals.publish(goal)
        self.wait('a plan', lambda: asked in self._told)
        told = self._told.pop(asked)
        if not told['accepted']:
            self.refused.append(told['text'])
            return None
        stamp: Stamp = tuple(told['trajectory'])
        self.wait('a trajectory', lambda: stamp in self._sent)
        limits = JointLimits.from_config(self._config)
        begin = stamp[0] + 1e-9 * stamp[1]  # this process may be late, but the arm is not
        trajectory, _ = read_trajectory(limits, self._sent.pop(stamp), begin)
        path = trajectory.path(move.start)
        if abs(path.duration - move.duration) > 1e-6:
            raise SystemExit(
                f'energy: the planner answered with {path.duration:.3f} s instead of '
                f'{move.duration:.3f} s'
            )
        self._wait_for(begin + path.duration)
        return begin, path

    def go(self, path: PolynomialPath) -> tuple[float, PolynomialPath]:
        """Play a motion; return its begin [s] and the motion."""
        begin_ns = self._now_ns() + round(LEAD * 1e9)
        names = self._config.joint_names
        self._trajectories.publish(trajectory_message(path, names, begin_ns))
        self._wait_for(1e-9 * begin_ns + path.duration)
        return 1e-9 * begin_ns, path

    def _wait_for(self, end: float) -> None:
        while 1e-9 * self._now_ns() < end + SETTLE + 0.05:
            # Receiving every state would load a core.
            spin_until(self.node, lambda: self._client.mode != 'running', 0.05)
            try:
                self._client.wait_for_mode(['running'], 20.0)
            except ArmClientError as error:
                raise SystemExit(f'energy: {error}\n{self._bridge.tail(5)}') from error

    def _now_ns(self) -> int:
        return self._states.next().stamp_ns

    def _on_status(self, message: String) -> None:
        told = json.loads(message.data)
        self._told[tuple(told['asked'])] = told

    def _on_trajectory(self, message: JointTrajectory) -> None:
        self._sent[_stamp(message)] = message


def _stamp(message: JointState | JointTrajectory) -> Stamp:
    stamp = message.header.stamp
    return stamp.sec, stamp.nanosec
