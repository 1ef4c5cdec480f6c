"""Moves the arm along an excitation trajectory, one command for every joint state.

Usage: ros2 run aerarm_ros excitation --ros-args -p seed:=1 -p periods:=2
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rclpy
from numpy.typing import NDArray

from aerarm_msgs_py import topics
from aerarm_msgs_py.joint_state_cdr import JointStateCdr
from aerarm_ros.control.arm_state import ArmState
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.excitation.command_law import CommandLaw, FeedForwardLaw, VelocityLaw
from aerarm_ros.excitation.excitation_config import load_excitation_config
from aerarm_ros.excitation.excitation_error import ExcitationError
from aerarm_ros.excitation.excitation_player import ExcitationPlayer
from aerarm_ros.excitation.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.fourier_trajectory import FourierTrajectory
from aerarm_ros.excitation.trajectory_file import TrajectoryFile, describe_margins
from aerarm_ros.nodes.background_executor import BackgroundExecutor
from aerarm_ros.nodes.node_main import run_node
from aerarm_ros.nodes.parameter import Parameter
from aerarm_ros.nodes.parameters import ParameterTable
from aerarm_ros.nodes.progress_line import ProgressLine
from aerarm_ros.nodes.start_conditions import MOVABLE, StartConditions
from aerarm_ros.nodes.state_diagnostics import StateDiagnostics
from aerarm_ros.nodes.state_stream import StateStream
from aerarm_ros.nodes.stop_signals import StopSignals
from aerarm_ros.realtime.scheduling import freeze_garbage_collector, lock_memory, set_fifo

NAME = 'excitation'
VELOCITY, FULL = 'velocity', 'position_velocity_effort'
# A pause of this process damps the arm; the next command is followed again. What the pause
# did to the motion is judged by the tracking error.
PLAYABLE = (*MOVABLE, 'damping')
# A joint slower than this counts as resting [rad/s]; the velocity filter's noise stays below.
RESTING = 0.1
INTERRUPTED = 130

PARAMETERS = ParameterTable(
    Parameter('trajectory', '', 'YAML file to play; without one a random trajectory is drawn'),
    Parameter('seed', 1, 'seed of the random trajectory', minimum=0),
    Parameter('fundamental', 0.1, 'f0 of the random trajectory', 'Hz', 0.001, 10.0),
    Parameter('harmonics', 5, 'N of the random trajectory', '', 1, 50),
    Parameter('amplitude', 0.35, 'largest random coefficient', 'rad', 0.001, 3.0),
    Parameter('periods', 2, 'whole periods to play at full speed', '', 1, 10000),
    Parameter('save', '', 'YAML file to write the trajectory to before it is played'),
    Parameter('mode', VELOCITY, 'what is commanded', choices=(VELOCITY, FULL)),
    Parameter('position_gain', 1.0, 'K of dq_d + K (q_d - q) in velocity mode', '1/s', 0.0, 20.0),
    Parameter('tracking_limit', 0.3, '|q_d - q| at which the arm is stopped', 'rad', 1e-3, 3.0),
    Parameter('stop_time', 0.5, 'duration of a smooth stop', 's', 0.05, 10.0),
    Parameter('return_to_start', True, 'go back to the posture found at the start'),
    Parameter('state_timeout', 0.2, 'longest wait for the next joint state', 's', 0.005, 10.0),
    Parameter('wait_timeout', 20.0, 'longest wait for arm and subscribers', 's', 0.1, 3600.0),
    Parameter('subscribers', 1, 'subscribers of joint_command, and of joint_states, to wait for '
              '(2: bridge and recorder; this node and recorder)', '', 1, 100),
    Parameter('wait_for_recorder', False, 'wait until recorder_status says that joint_states and '
              'joint_command are being recorded'),
    Parameter('realtime_priority', 0, 'SCHED_FIFO priority of the loop; 0 leaves it to the '
              'ordinary scheduler', '', 0, 98),
    Parameter('lock_memory', False, 'keep all memory of the process in RAM'),
    Parameter('urdf', '', 'URDF of the arm; the packaged one if empty'),
    Parameter('config', '', 'YAML file of the drive train; the packaged arm if empty'),
    Parameter('excitation_config', '', 'YAML file of surroundings and usable shares of the limits; '
              'the packaged one if empty'),
)  # fmt: skip


class ExcitationNode:
    """Waits for the arm, plans from where it is, plays, and says how it went.

    Attributes
    ----------
    status : exit status after `run`.

    Raises
    ------
    ValueError
        If a parameter, a file or the trajectory cannot be used.
    """

    def __init__(self) -> None:
        self.status = 1
        self._node = rclpy.create_node(NAME)
        self._parameters = PARAMETERS.declare(self._node)
        arm = load_arm_config(self._parameters.config or None)
        robot = load_robot(
            self._parameters.urdf or None,
            gravity_in_base=arm.gravity_in_base,
            joint_names=arm.joint_names,
        )
        config = load_excitation_config(self._parameters.excitation_config or None)
        self._names = arm.joint_names
        self._setup = ExcitationSetup.of_arm(robot, arm, config)
        self._trajectory = self._get_trajectory()
        self._codec = JointStateCdr(self._names)
        command = topics.JOINT_COMMAND
        self._commands = self._node.create_publisher(command.type, command.name, command.qos)
        self._conditions = StartConditions(
            self._node,
            self._commands,
            self._parameters.subscribers,
            self._parameters.wait_for_recorder,
        )
        self._diagnostics = StateDiagnostics(self._node, lambda: '', self._diagnostic_values)
        self._states = StateStream(self._node, self._names, self._diagnostics.add_rejection)
        self._diagnostics.watch(self._states)
        self._player: ExcitationPlayer | None = None
        self._stop = False

    def run(self) -> None:
        """Play the trajectory; `status` says how it ended."""
        with BackgroundExecutor(self._node), StopSignals(self._on_stop):
            try:
                self._run()
            except ExcitationError as error:
                print(f'{NAME}: {error}', file=sys.stderr, flush=True)

    def close(self) -> None:
        """Destroy the node."""
        self._states.destroy()
        self._node.destroy_node()

    def _run(self) -> None:
        start = self._wait_for_arm()
        if start is None:
            self.status = INTERRUPTED
            return
        motion = self._setup.planner.plan(
            self._trajectory,
            self._parameters.periods,
            start,
            go_back=self._parameters.return_to_start,
        )
        self._player = ExcitationPlayer(
            motion,
            self._law(),
            self._names,
            self._parameters.tracking_limit,
            self._parameters.state_timeout,
            self._parameters.stop_time,
        )
        self._prepare_real_time()
        self._play(self._player)
        self._conclude(self._player)

    def _get_trajectory(self) -> FourierTrajectory:
        """Load or draw the trajectory, inside the limits, and save it if asked to."""
        values, setup = self._parameters, self._setup
        if values.trajectory:
            trajectory = TrajectoryFile.load(values.trajectory).for_joints(self._names)
            report = setup.checker.check_trajectory(trajectory, setup.config.ramp_time)
            report.require(values.trajectory)
            made_with = {'source': Path(values.trajectory).name}
        else:
            candidates = setup.random_trajectory(
                values.amplitude, values.fundamental, values.harmonics
            )
            trajectory, report = candidates.draw_feasible(
                values.seed, setup.checker, setup.config.ramp_time
            )
            made_with = {'seed': values.seed, 'amplitude': values.amplitude}
        if values.save:
            made_with['margins'] = describe_margins(report)
            TrajectoryFile(trajectory, self._names, made_with).save(values.save)
        return trajectory

    def _law(self) -> CommandLaw:
        if self._parameters.mode == FULL:
            return FeedForwardLaw(self._setup.effort_model)
        return VelocityLaw(self._parameters.position_gain)

    def _wait_for_arm(self) -> NDArray[np.float64] | None:
        """Return the posture [rad] once everything is there; None if asked to stop."""
        deadline = time.monotonic() + self._parameters.wait_timeout
        state: ArmState | None = None
        while not self._stop:
            missing = [*_missing_rest(state), *self._conditions.missing()]
            if not missing and state is not None:
                return state.q
            if time.monotonic() > deadline:
                raise ExcitationError(
                    f'waited {self._parameters.wait_timeout:g} s, and '
                    f'{"; ".join([*missing, self._diagnostics.last_rejection]).rstrip("; ")}'
                )
            self._states.wait(0.1)
            newest = self._states.newest_state()
            state = state if newest is None else newest[1]
        return None

    def _prepare_real_time(self) -> None:
        values = self._parameters
        warnings = [
            freeze_garbage_collector(),
            lock_memory() if values.lock_memory else None,
            set_fifo(values.realtime_priority) if values.realtime_priority else None,
        ]
        for warning in filter(None, warnings):
            print(f'{NAME}: {warning}', file=sys.stderr, flush=True)

    def _play(self, player: ExcitationPlayer) -> None:
        """Answer every state until the motion has ended or was broken off."""
        progress = ProgressLine(NAME)
        timeout = self._parameters.state_timeout
        heard = time.monotonic()
        try:
            while not player.done:
                self._states.wait(timeout)
                newest = self._states.newest_state()
                if newest is None:
                    self._check_silence(heard, timeout, player.stage)
                    continue
                heard = time.monotonic()
                if self._stop:
                    player.stop()
                if self._conditions.mode not in PLAYABLE:
                    raise ExcitationError(
                        f"arm_mode became '{self._conditions.mode}' in the {player.stage}"
                    )
                stamp_ns, state = newest
                command = player.update(stamp_ns, state.q)
                self._commands.publish(self._codec.pack(stamp_ns, *command))
                self._diagnostics.latency.add(time.time_ns() - stamp_ns)
                if progress.due(stamp_ns):
                    progress.show(_progress_text(player))
        finally:
            progress.close()

    def _check_silence(self, heard: float, timeout: float, stage: str) -> None:
        """Raise if the last joint state came too long ago."""
        if time.monotonic() - heard > timeout:
            why = self._diagnostics.last_rejection or 'did the bridge end?'
            raise ExcitationError(f'no joint state for {timeout:g} s in the {stage}: {why}')

    def _conclude(self, player: ExcitationPlayer) -> None:
        if player.fault is not None:
            raise ExcitationError(player.fault)
        print(
            f'{NAME}: {"stopped" if self._stop else "done"}: {self._diagnostics.account()}; '
            f'largest tracking error {player.largest_error.max():.3f} rad',
            flush=True,
        )
        self.status = INTERRUPTED if self._stop else 0

    def _diagnostic_values(self) -> dict[str, object]:
        player = self._player
        if player is None:
            return {'stage': 'waiting'}
        return {
            'stage': player.stage,
            'played [%]': round(100.0 * player.progress, 1),
            'largest tracking error [rad]': round(float(player.largest_error.max()), 4),
        }

    def _on_stop(self) -> None:
        self._stop = True


def _missing_rest(state: ArmState | None) -> list[str]:
    if state is None:
        return ['no joint_states arrived: is the bridge running in this domain?']
    if np.abs(state.dq).max() >= RESTING:
        return [f'the arm does not rest (below {RESTING} rad/s)']
    return []


def _progress_text(player: ExcitationPlayer) -> str:
    return (
        f'{player.path_time:5.1f} of {player.motion.duration:.1f} s  {player.stage:<10} '
        f'largest error {player.largest_error.max():.3f} rad'
    )


def main(args: Sequence[str] | None = None) -> int:
    """Run the node; the exit status is 0 only if the whole trajectory was played."""
    return run_node(NAME, ExcitationNode, args)


if __name__ == '__main__':
    sys.exit(main())
