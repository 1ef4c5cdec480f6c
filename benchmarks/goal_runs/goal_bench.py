"""Goals of FollowJointTrajectory for a packaged controller on the emulated bridge, in virtual time.

All code between control law and physics engine equals that of the real arm: the bridge's cycle, the
boards' frames, quantized encoders and filtered speeds. The loop is created from the node's
parameter table, so changed defaults take effect.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from aerarm_ros.control.references.joint_trajectory import JointTrajectory
from aerarm_ros.control.references.trajectory_goals import GoalResult, TrajectoryGoals
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.hardware.bridge_cycle import BridgeCycle
from aerarm_ros.hardware.emulation.emulated_motor import AlignmentTiming
from aerarm_ros.hardware.emulation.emulated_transport import EmulatedTransport
from aerarm_ros.hardware.emulation.emulation import make_emulated_transport
from aerarm_ros.hardware.gate.command_intake import OfferedCommand
from aerarm_ros.motion.polynomial_path import rest_to_rest_duration
from aerarm_ros.motion.signals import ArmState
from aerarm_ros.nodes.controllers.computed_torque import ComputedTorqueNode
from aerarm_ros.nodes.controllers.gravity_compensation import GravityCompensationNode
from aerarm_ros.ros.controllers.controller_parameters import ControlledArm
from aerarm_ros.ros.controllers.trajectory_input import TrajectoryController
from aerarm_ros.ros.emulation.emulation_parameters import PAYLOAD_RADIUS
from aerarm_ros.simulation.arm_plant import PlantParameters
from aerarm_ros.simulation.backlash_plant import BacklashPlant

CYCLE = 1e-3
SETTLED = 5e-3  # [rad] distance from the goal
STOPPED = 0.01  # [rad/s] joint_trajectory_controller's stopped_velocity_tolerance
REVERSAL = 2e-4  # [rad] smallest reversal of a joint that counts, about four encoder counts
# Servers of the action by name, with parameters that differ from the defaults.
CONTROLLERS: Mapping[str, tuple[type[TrajectoryController], Mapping[str, Any]]] = {
    'computed_torque': (ComputedTorqueNode, {}),
    'computed_torque, boards': (ComputedTorqueNode, {'feedback': 'boards'}),
    'gravity_compensation': (GravityCompensationNode, {}),
}
_QUICK = AlignmentTiming(forward=0.25, reverse=0.25, hold=0.1)


def arm_truth(seed: int) -> PlantParameters:
    """Return the true parameters of an arm with a seed, as `fake_hardware` draws them."""
    return PlantParameters.nominal(load_arm_config(), load_robot()).perturbed(seed)


@dataclass(frozen=True)
class ReachedGoal:
    """Result of one goal.

    Attributes
    ----------
    result : GoalResult
        Result of the action.
    settling : float
        Time from the trajectory's end until every true joint stays within `SETTLED` and below
        `STOPPED` [s]; infinite if never.
    tracking : float
        RMS error of the true joints during the motion [rad].
    peak : float
        Largest error during the motion [rad].
    """

    result: GoalResult
    settling: float
    tracking: float
    peak: float


@dataclass(frozen=True)
class Rest:
    """Behaviour of an arm at rest at a goal.

    Attributes
    ----------
    error : float
        Largest joint error at the end [rad].
    travel : float
        Largest peak-to-peak motion of a true joint in the second half [rad].
    reversals : int
        Largest number of reversals of a true joint by more than `REVERSAL` during the whole rest.
    ripple : float
        Largest standard deviation of a joint's torque about its 0.1 s mean, second half [Nm].
    """

    error: float
    travel: float
    reversals: int
    ripple: float


class GoalBench:
    """Arm that deviates from its model, a controller with the nominal model, and goals.

    Parameters
    ----------
    controller
        Key of `CONTROLLERS`.
    seed
        Seed of the arm's deviations, of the boards' noise and of the goals.
    delay
        Cycles between a state and the cycle in which its command acts; 1 over topics.
    payload
        Undeclared payload of the last link at tool0 [kg].
    backlash
        Backlash of every gear [rad].
    stiction
        Excess of friction at rest over friction in motion, as a fraction of the Coulomb friction
        (Stribeck). The emulated arm has none by default.
    parameters
        Controller parameters that replace the defaults.
    """

    def __init__(
        self,
        controller: str,
        seed: int,
        *,
        delay: int = 1,
        payload: float = 0.0,
        backlash: float = 0.0,
        stiction: float = 0.0,
        **parameters: Any,
    ) -> None:
        kind, fixed = CONTROLLERS[controller]
        node = kind.__new__(kind)  # without its ROS node
        defaults = {p.name: p.default for p in kind.parameters}
        node.values = SimpleNamespace(**{**defaults, **fixed, **parameters})
        arm = node.arm = ControlledArm.from_parameters(node.values)
        node.base = arm.base(node.values)
        self.loop = node.make_loop()
        self.follower = node.follower
        self.goals = TrajectoryGoals(self.follower, lambda *ended: self._ended.append(ended))
        self.names = arm.config.joint_names
        self._random = np.random.default_rng(seed)
        config, robot = load_arm_config().with_encoders('absolute'), load_robot()
        truth = arm_truth(seed).carrying(payload, config.rated_payload[1:], PAYLOAD_RADIUS)
        if backlash:
            truth = replace(truth, backlash=np.full(config.n, backlash))
        truth = replace(truth, stribeck=stiction, stribeck_velocity=0.02)
        self.transport: EmulatedTransport = make_emulated_transport(
            config, robot, seed, parameters=truth, alignment=_QUICK
        )
        self.bridge = BridgeCycle(config, self.transport, robot=robot)
        self._answers: deque[Any] = deque([None] * (delay - 1))
        self.now = 0.0
        self._bring_up()

    @property
    def joints(self) -> np.ndarray:
        """True joint angles (n,) [rad] on the link side of the gears."""
        plant = self.transport.plant
        return plant.link_position if isinstance(plant, BacklashPlant) else plant.position

    def draw_goal(self, largest: float) -> np.ndarray:
        """Return a posture within the limits, with a largest joint distance of `largest` [rad]."""
        limits, here = self.follower.limits, self.follower.reference.q
        for _ in range(10_000):
            step = self._random.uniform(-1.0, 1.0, limits.n)
            goal = here + step * largest / np.abs(step).max()
            if (goal > limits.position_min + 0.05).all() and (
                goal < limits.position_max - 0.05
            ).all():
                return goal
        raise ValueError(f'no posture {largest:g} rad away from {here.round(2)}')

    def go(self, goal: np.ndarray, effort: float = 0.5, rest: float = 0.6) -> ReachedGoal:
        """Send a goal as one point from rest to rest; return the result.

        Parameters
        ----------
        goal
            Goal posture (n,) [rad].
        effort
            Upper bound of peak speed and acceleration, relative to the limits.
        rest
            Shortest observation time after the trajectory's end [s].
        """
        limits, way = self.follower.limits, goal - self.follower.reference.q
        duration = rest_to_rest_duration(
            way, effort * limits.velocity_max, effort * limits.acceleration_max, 0.1
        )
        trajectory = JointTrajectory(limits, self.names, [duration], [goal])
        self.goals.start('goal', trajectory, self.now)
        begin, errors, away = self.now, [], []
        ended = self._ended = []
        while not ended or self.now < begin + duration + rest:
            self.cycle()
            errors.append(self.follower.reference.q - self.joints)
            speed = np.abs(self.transport.plant.velocity).max()
            away.append(np.abs(self.joints - goal).max() > SETTLED or speed > STOPPED)
            self.goals.update()
        count = round(duration / CYCLE)
        moving = np.array(errors[:count])
        outside = np.flatnonzero(away)
        last = outside[-1] + 1 if outside.size else 0
        settling = np.inf if last >= len(away) else max(0.0, (last - count) * CYCLE)
        tracking, peak = float(np.sqrt((moving**2).mean())), float(np.abs(moving).max())
        return ReachedGoal(ended[0][1], settling, tracking, peak)

    def rest(self, seconds: float) -> Rest:
        """Hold the last goal and observe the arm for a time [s]."""
        joints, torques = [], []
        for _ in range(round(seconds / CYCLE)):
            self.cycle()
            joints.append(self.joints)
            torques.append(self.bridge.tau.copy())
        q, tau = np.array(joints), np.array(torques)
        half = len(q) // 2
        smooth = np.apply_along_axis(lambda x: np.convolve(x, np.full(100, 0.01), 'valid'), 0, tau)
        about = tau[50 : 50 + len(smooth)] - smooth
        return Rest(
            error=float(np.abs(self.follower.reference.q - q[-1]).max()),
            travel=float(np.ptp(q[half:], axis=0).max()),
            reversals=max(_reversals(column) for column in q.T),
            ripple=float(about[half:].std(axis=0).max()),
        )

    def cycle(self) -> None:
        """Run one cycle: the controller responds to the state, the bridge executes the command."""
        bridge = self.bridge
        state = ArmState(bridge.q.copy(), bridge.dq.copy(), bridge.tau.copy())
        command = self.loop.update(state, self.now)
        self.loop.observe()
        self.now += CYCLE
        self._answers.append(command)
        due = self._answers.popleft()
        if due is not None:
            age = CYCLE * (1 + len(self._answers))
            bridge.command(OfferedCommand(self.names, *due, age, 'bench'), self.now)
        bridge.update(self.now)
        if bridge.mode not in ('ready', 'running'):
            raise RuntimeError(f'the arm was stopped: {bridge.mode}, {"; ".join(bridge.faults)}')

    def _bring_up(self) -> None:
        self.transport.open()
        while self.bridge.mode != 'ready' or self.transport.plant.support > 0.0:
            self.bridge.update(self.now)
            if self.bridge.mode == 'idle':
                self.bridge.enable()
            self.now += CYCLE
            if self.now > 10.0:
                raise RuntimeError(
                    f'the arm is {self.bridge.mode}: {"; ".join(self.bridge.faults)}'
                )
        for _ in range(200):
            self.cycle()


def _reversals(q: np.ndarray) -> int:
    """Return the number of reversals of a signal by more than `REVERSAL`."""
    count, direction, extreme = 0, 0, q[0]
    for value in q.tolist():
        if direction * (value - extreme) > 0.0:
            extreme = value
        elif abs(value - extreme) > REVERSAL:
            count += direction != 0
            direction, extreme = (1 if value > extreme else -1), value
    return count
