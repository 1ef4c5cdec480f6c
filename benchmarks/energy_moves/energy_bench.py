"""Bridge, controller, planner and recorder as processes in lockstep, and what motions took."""

import json
import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from energy_moves.move import PLANNED, Move
from flying.arm_model import ArmModel
from rclpy.node import Node
from sensor_msgs.msg import JointState
from tracking import ArmStates
from trajectory_msgs.msg import JointTrajectory

from aerarm_msgs_py import topics
from aerarm_msgs_py.bags.bag_contents import read_contents
from aerarm_ros.control.checks.joint_limits import JointLimits
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.energy.balance_meter import BalanceMeter
from aerarm_ros.energy.energy_model import EnergyModel
from aerarm_ros.energy.holding_loss import HoldingLoss
from aerarm_ros.motion.arm_state import ArmState
from aerarm_ros.motion.polynomial_path import PolynomialPath
from aerarm_ros.ros.controllers.trajectory_input import read_trajectory
from aerarm_ros.ros.controllers.trajectory_output import trajectory_message
from aerarm_ros.ros.executors.spinning import spin_until
from aerarm_ros.ros.process.node_process import NodeProcess
from aerarm_ros.ros.requests.arm_client import ArmClient, ArmClientError
from aerarm_ros.ros.requests.parameter_request import set_parameter

LEAD = 1.0  # [s] from a message to its motion
SETTLE = 0.2  # [s] after a motion that count to it
PATIENCE = 600.0  # [s] of the host, which may be busy


@dataclass(frozen=True)
class Played:
    """One motion that was played: as told, and its begin [s]."""

    pair: int
    shape: str
    begin: float
    path: PolynomialPath


@dataclass(frozen=True)
class Taken:
    """What a motion took: as predicted, as measured [J], and its errors RMS and largest [mrad]."""

    pair: int
    shape: str
    duration: float
    predicted: float
    measured: float
    rms: float
    largest: float


class EnergyBench:
    """An emulated arm that plays motions, recorded."""

    def __init__(
        self, stack: ExitStack, node: Node, folder: Path, arm: ArmModel, model: EnergyModel
    ) -> None:
        self._node, self._folder, self._model = node, folder, model
        self._config = load_arm_config()
        self.played: list[Played] = []
        self.refused: list[str] = []
        self._told: list[dict] = []
        self._sent: list[JointTrajectory] = []
        self._bridge = self._start(stack, 'fake_hardware', {'seed': arm.seed, 'pace': 'lockstep'})
        law = {**arm.law, 'observer_gain': 0.0, 'friction_width': 0.004}
        self._start(stack, 'computed_torque', law)
        self._planner = self._start(stack, 'motion_planner', {**arm.law, 'lead': LEAD})
        self._recorder = stack.enter_context(
            NodeProcess(
                'recorder',
                (),
                {'bag': folder / 'bag', 'topics': '[joint_states]'},
                log=folder / 'recorder.log',
            )
        )
        self._client = ArmClient(node)
        self._trajectories = self._publisher(topics.JOINT_TRAJECTORY)
        self._goals = self._publisher(topics.JOINT_GOAL)
        self._listen(topics.PLAN_STATUS, lambda m: self._told.append(json.loads(m.data)))
        self._listen(topics.JOINT_TRAJECTORY, self._sent.append)
        self._states = ArmStates(node, self._config.joint_names)
        self._client.wait_for_mode(['idle'], PATIENCE)
        ready = [self._trajectories, self._goals]
        self._until(lambda: all(p.get_subscription_count() for p in ready), 'nodes')
        self._until(lambda: 'publishers found' in self._recorder.tail(), 'the recorder')
        self._client.call('enable')
        self._client.wait_for_mode(['running'], PATIENCE)

    def go(self, path: PolynomialPath) -> None:
        """Play a motion that nobody measures."""
        self._play(path)

    def play(self, pair: int, shape: str, move: Move) -> None:
        """Play a move."""
        if shape != PLANNED:
            self.played.append(Played(pair, shape, *self._play(move.path(shape))))
            return
        self._set_duration(move.duration)
        told, before = len(self._told), len(self._sent)
        names = list(self._config.joint_names)
        self._goals.publish(JointState(name=names, position=move.goal.tolist()))
        self._until(lambda: len(self._told) > told, 'a plan')
        if not self._told[-1]['accepted']:
            self.refused.append(self._told[-1]['text'])
            self._play(move.path('quintic'))
            return
        self._until(lambda: len(self._sent) > before, 'a trajectory')
        limits = JointLimits.from_config(self._config)
        sent = self._sent[-1].header.stamp
        begin = sent.sec + 1e-9 * sent.nanosec  # this process may be late, the arm is not
        trajectory, _ = read_trajectory(limits, self._sent[-1], begin)
        path = trajectory.path(move.start, 'quintic')
        self._wait_for(begin + path.duration)
        self.played.append(Played(pair, shape, begin, path))

    def results(self) -> list[Taken]:
        """Return what was taken, from the bag, which ends here."""
        self._recorder.stop()
        states = read_contents(self._folder / 'bag', 'joint_states').joint_states['/joint_states']
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
                raise SystemExit(f'energy: only {meter.total.seconds:.2f} s of a motion recorded')
            moving = rows[states.stamp[rows] <= end]
            off = 1e3 * (q[moving] - one.path.evaluate(states.stamp[moving] - one.begin).q)
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

    def _play(self, path: PolynomialPath) -> tuple[float, PolynomialPath]:
        begin = self._now() + LEAD
        names = self._config.joint_names
        self._trajectories.publish(trajectory_message(path, names, round(begin * 1e9)))
        self._wait_for(begin + path.duration)
        return round(begin * 1e9) * 1e-9, path

    def _wait_for(self, end: float) -> None:
        while self._now() < end + SETTLE + 0.05:
            time.sleep(0.05)  # to look at every state would take a share of a core
        try:
            self._client.wait_for_mode(['running'], 20.0)
        except ArmClientError as error:
            raise SystemExit(f'energy: {error}\n{self._bridge.tail(5)}') from error

    def _now(self) -> float:
        return self._states.next().stamp_ns * 1e-9

    def _set_duration(self, seconds: float) -> None:
        set_parameter(self._node, 'motion_planner', 'duration', str(seconds), PATIENCE)

    def _publisher(self, topic: topics.Topic):
        return self._node.create_publisher(topic.type, topic.name, topic.qos)

    def _listen(self, topic: topics.Topic, act) -> None:
        self._node.create_subscription(topic.type, topic.name, act, topic.qos)

    def _until(self, condition, what: str) -> None:
        deadline = time.monotonic() + PATIENCE
        while not spin_until(self._node, condition, 1.0):
            if self._planner.returncode is not None or time.monotonic() > deadline:
                raise SystemExit(f'energy: waited for {what}: {self._planner.tail(3)}')

    def _start(self, stack: ExitStack, name: str, values: dict) -> NodeProcess:
        log = self._folder / f'{name}.log'
        return stack.enter_context(NodeProcess(name, (), values, log=log))
