"""Move the arm along an excitation trajectory, to identify the dynamics of the arm.

Usage: ros2 run aerarm_ros excitation --ros-args -p seed:=1 -p periods:=2
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import rclpy

from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.excitation.design_file import TrajectoryFile, describe_margins
from aerarm_ros.excitation.player import CommandLaw, ExcitationPlayer, FeedForwardLaw, VelocityLaw
from aerarm_ros.excitation.settings import ExcitationError
from aerarm_ros.excitation.trajectory import FourierTrajectory
from aerarm_ros.motion.signals import Array, JointMotion, JointReference
from aerarm_ros.ros.controllers.controller_parameters import ROTOR_PARAMETERS, ControlledArm
from aerarm_ros.ros.controllers.state_node import PlanTopic
from aerarm_ros.ros.executors import BackgroundExecutor
from aerarm_ros.ros.parameters.parameter import Parameter
from aerarm_ros.ros.parameters.parameter_table import ParameterTable
from aerarm_ros.ros.parameters.shared_parameters import (
    ARM_FILES,
    DRONE_FILE,
    REAL_TIME_PARAMETERS,
    SURROUNDINGS,
    load_setup,
    prepare_thread,
)
from aerarm_ros.ros.playback.motion_playback import MotionPlayback
from aerarm_ros.ros.process.node_main import run_node
from aerarm_ros.ros.process.process_end import INTERRUPTED, StopSignals, print_error
from aerarm_ros.ros.requests.arm_client import AT_END_PARAMETERS, ArmAtEnd
from aerarm_ros.ros.states.state_diagnostics import StateDiagnostics

NAME = 'excitation'
VELOCITY, FULL = 'velocity', 'position_velocity_effort'
DEFAULT_PERIODS = 2

PARAMETERS = ParameterTable(
    Parameter('trajectory', '', 'YAML file of the trajectory; a random trajectory if empty'),
    Parameter('seed', 1, 'seed of the random trajectory', '', 0, 10**9),
    Parameter('fundamental', 0.1,
        'fundamental frequency f0 of the random trajectory', 'Hz', 0.001, 10.0),
    Parameter('harmonics', 5, 'number of harmonics N of the random trajectory', '', 1, 50),
    Parameter('amplitude', 0.35,
        'largest Fourier coefficient of the random trajectory', 'rad', 0.001, 3.0),
    Parameter('periods', 0,
        'number of whole periods at full speed; 0 for the number in the trajectory file, or 2 if '
        'the file contains no number', '', 0, 10000),
    Parameter('save', '',
        'YAML file to which the node writes the trajectory before the motion; no file if empty'),
    Parameter('mode', VELOCITY,
        'commanded quantities: joint velocity only, or position, velocity and effort',
        choices=(VELOCITY, FULL)),
    Parameter('position_gain', 1.0,
        'feedback gain K in the mode velocity, in which the node commands dq_d + K (q_d - q)',
        '1/s',
        0.0, 20.0),
    Parameter('tracking_limit', 0.3,
        'position error |q_d - q| at which the node stops the arm', 'rad', 1e-3, 3.0),
    Parameter('damped_share_max', 0.01, (
        'fraction of the motion during which the bridge may damp the arm because of late '
        'commands; if exceeded, the exit status is 1'
    ), '', 0.0, 1.0),
    Parameter('return_to_start', True, 'whether the arm returns to its initial posture at the '
                                       'end'),
    Parameter('state_timeout', 0.2,
        'time without joint_states after which the node aborts the motion', 's', 0.005, 10.0),
    Parameter('wait_timeout', 20.0,
        'longest wait until the arm is ready', 's', 0.1, 3600.0),
    Parameter('wait_for_recorder', False,
        'whether the motion starts only when the recorder records joint_states and '
        'joint_command'),
    *AT_END_PARAMETERS,
    *REAL_TIME_PARAMETERS,
    *ARM_FILES,
    DRONE_FILE,
    *ROTOR_PARAMETERS,
    *SURROUNDINGS,
)  # fmt: skip


class ExcitationNode:
    """Node that waits until the arm is ready, then plans and plays the excitation motion.

    Attributes
    ----------
    status
        Exit status after `run`.

    Raises
    ------
    ValueError
        If a parameter, a file or the trajectory cannot be used.
    """

    def __init__(self) -> None:
        self.status = 1
        self._node = rclpy.create_node(NAME)
        self._parameters = PARAMETERS.declare(self._node)
        controlled = ControlledArm.from_parameters(self._parameters)
        arm, robot = controlled.config, controlled.robot
        self._governor = controlled.governor(self._parameters)
        self._names = arm.joint_names
        self._own_names = tuple(map(robot.own_name, self._names))  # names in the file
        self._setup = load_setup(self._parameters, arm, robot)
        self._periods = self._parameters.periods or DEFAULT_PERIODS
        self._slowed = 'no'
        self._trajectory = self._get_trajectory()
        self._playback = MotionPlayback(
            self._node,
            self._names,
            self._parameters.wait_for_recorder,
            lambda reason: self._diagnostics.add_rejection(reason),
        )
        states = self._playback.states
        self._diagnostics = StateDiagnostics(
            self._node, states, lambda: '', self._diagnostic_values, arm.name
        )
        self._arm_at_end = ArmAtEnd(self._node, self._parameters)
        self._player: ExcitationPlayer | None = None
        self._plan = PlanTopic(self._node, self._names, lambda: states.stamp_ns, self._ahead)

    def run(self) -> None:
        """Play the trajectory, and set the attribute `status` to the exit status."""
        with StopSignals(self._playback.ask_stop), BackgroundExecutor(self._node):
            try:
                self._run()
            except ExcitationError as error:
                print(f'{NAME}: {error}', file=sys.stderr, flush=True)

    def close(self) -> None:
        """Destroy the node."""
        self._playback.destroy()
        self._plan.destroy()
        self._node.destroy_node()

    def _run(self) -> None:
        start = self._playback.wait_for_arm(self._parameters.wait_timeout)
        if start is None:
            self.status = INTERRUPTED
            print_error(NAME, 'interrupted before the motion started')
            return
        motion = self._setup.planner.plan(
            self._trajectory,
            self._periods,
            start,
            go_back=self._parameters.return_to_start,
            slowdown=self._slowdown,
        )
        self._player = ExcitationPlayer(
            motion,
            self._law(),
            self._setup.stops,
            self._parameters.tracking_limit,
            self._parameters.state_timeout,
        )
        prepare_thread(self._parameters, self._node.get_logger())
        self._playback.play(self._player, self._parameters.state_timeout, self._measure)
        self._arm_at_end.leave()
        self._conclude()

    def _get_trajectory(self) -> FourierTrajectory:
        """Load a trajectory or draw a feasible random one; write it to the file `save`."""
        values, setup = self._parameters, self._setup
        if values.trajectory:
            file = TrajectoryFile.load(values.trajectory)
            trajectory = file.for_joints(self._own_names)
            self._periods = values.periods or file.periods or DEFAULT_PERIODS
            report = setup.checker.check_trajectory(trajectory, setup.config.ramp_time)
            report.require(values.trajectory)
            made_with: dict[str, Any] = {'source': Path(values.trajectory).name}
        else:
            candidates = setup.random_trajectory(
                values.amplitude, values.fundamental, values.harmonics
            )
            trajectory, report = candidates.draw_feasible(
                values.seed, setup.checker, setup.config.ramp_time
            )
            made_with = {'seed': values.seed, 'amplitude': values.amplitude}
        trajectory = self._within_rotors(trajectory)
        if values.save:
            if self._slowed != 'no':
                report = setup.checker.check_trajectory(trajectory, setup.config.ramp_time)
            made_with['margins'] = describe_margins(report)
            TrajectoryFile(trajectory, self._own_names, made_with, self._periods).save(values.save)
        return trajectory

    def _within_rotors(self, trajectory: FourierTrajectory) -> FourierTrajectory:
        """Return the trajectory, slowed down if the drone's rotors could not balance it."""
        slowed = self._setup.planner.slowed(trajectory, self._periods, self._slowdown)
        factor = slowed.period / trajectory.period
        if factor > 1.0:
            self._slowed = f'{factor:.2f} times'
            print(
                f"{NAME}: the motion is slower than designed, to stay within the drone's rotor "
                'limits (parameters rotor_share and heading_max): a period takes '
                f'{slowed.period:.1f} s instead of {trajectory.period:.1f} s ({factor:.2f} times '
                'as long)',
                flush=True,
            )
        return slowed

    def _slowdown(self, motion: JointMotion) -> float:
        try:
            return 1.0 if self._governor is None else self._governor.slowdown(motion)
        except RejectedInputError as error:
            raise ExcitationError(str(error)) from None

    def _law(self) -> CommandLaw:
        if self._parameters.mode == FULL:
            return FeedForwardLaw(self._setup.effort_model)
        return VelocityLaw(self._parameters.position_gain, self._setup.limits.velocity)

    def _measure(self, *_: object) -> None:
        self._diagnostics.latency.add(self._playback.latency_ns)
        self._plan.update()

    def _ahead(self, times: Array) -> JointReference | None:
        return None if self._player is None else self._player.ahead(times)

    def _conclude(self) -> None:
        assert self._player is not None
        stopped, damping = self._playback.stop_asked, self._playback.damping
        largest = self._player.largest_error.max()
        account = [self._diagnostics.account(), f'the largest tracking error was {largest:.3f} rad']
        account += filter(None, [damping.text])
        print(f'{NAME}: {"stopped" if stopped else "done"}: {"; ".join(account)}', flush=True)
        self.status = INTERRUPTED if stopped else 0
        allowed = self._parameters.damped_share_max
        if not stopped and damping.share > allowed:
            self.status = 1
            raise ExcitationError(
                f'the bridge damped the arm for {damping.share:.1%} of the motion (allowed: '
                f'{allowed:.1%}), because commands arrived too late, so the motion deviates from '
                'the plan. End other processes, set the parameter realtime_priority, or increase '
                'the parameter damped_share_max'
            )

    def _diagnostic_values(self) -> dict[str, object]:
        player = self._player
        if player is None:
            return {'stage': 'waiting'}
        return {
            'stage': player.stage,
            'played [%]': round(100.0 * player.progress, 1),
            'slowed down for the rotors of the drone': self._slowed,
            'largest tracking error [rad]': round(float(player.largest_error.max()), 4),
        }


def main(args: Sequence[str] | None = None) -> int:
    """Run the node; return exit status 0 if the arm followed the whole trajectory."""
    return run_node(NAME, ExcitationNode, args, PARAMETERS, __doc__)
