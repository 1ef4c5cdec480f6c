"""Moves the arm along an excitation trajectory, one command for every joint state.

Usage: ros2 run aerarm_ros excitation --ros-args -p seed:=1 -p periods:=2
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rclpy
from numpy.typing import NDArray
from std_msgs.msg import String

from aerarm_msgs_py import topics
from aerarm_msgs_py.joint_sample import JointSample
from aerarm_msgs_py.joint_state_cdr import JointStateCdr
from aerarm_msgs_py.joint_state_conversion import decode_joint_state, in_order
from aerarm_msgs_py.raw_reader import RawReader
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.excitation.command_law import CommandLaw, FeedForwardLaw, VelocityLaw
from aerarm_ros.excitation.excitation_config import load_excitation_config
from aerarm_ros.excitation.excitation_error import ExcitationError
from aerarm_ros.excitation.excitation_player import ExcitationPlayer
from aerarm_ros.excitation.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.fourier_trajectory import FourierTrajectory
from aerarm_ros.excitation.random_trajectory import RandomTrajectory
from aerarm_ros.excitation.trajectory_file import TrajectoryFile, describe_margins
from aerarm_ros.nodes.background_executor import BackgroundExecutor
from aerarm_ros.nodes.node_main import run_node
from aerarm_ros.nodes.parameter import Parameter
from aerarm_ros.nodes.parameters import ParameterTable
from aerarm_ros.nodes.progress_line import ProgressLine
from aerarm_ros.nodes.stop_signals import StopSignals
from aerarm_ros.realtime.scheduling import freeze_garbage_collector, lock_memory, set_fifo
from aerarm_ros.realtime.timing_statistics import TimingStatistics

NAME = 'excitation'
VELOCITY, FULL = 'velocity', 'position_velocity_effort'
MOVABLE = ('ready', 'running')
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
        self._states = RawReader(self._node, topics.JOINT_STATES)
        self._mode = ''
        self._recorded: set[str] = set()
        for topic, callback in (
            (topics.ARM_MODE, self._on_mode),
            (topics.RECORDER_STATUS, self._on_recorder_status),
        ):
            self._node.create_subscription(topic.type, topic.name, callback, topic.qos)
        self._stop = False
        self._latency = TimingStatistics()

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
        player = ExcitationPlayer(
            motion,
            self._law(),
            self._names,
            self._parameters.tracking_limit,
            self._parameters.state_timeout,
            self._parameters.stop_time,
        )
        self._prepare_real_time()
        self._play(player)
        self._conclude(player)

    def _get_trajectory(self) -> FourierTrajectory:
        """Load or draw the trajectory, inside the limits, and save it if asked to."""
        values, setup = self._parameters, self._setup
        if values.trajectory:
            trajectory = TrajectoryFile.load(values.trajectory).for_joints(self._names)
            report = setup.checker.check_trajectory(trajectory, setup.config.ramp_time)
            report.require(values.trajectory)
            made_with = {'source': Path(values.trajectory).name}
        else:
            candidates = RandomTrajectory(
                setup.config.bias_of(setup.robot),
                setup.config.bias_spread,
                values.amplitude,
                values.fundamental,
                values.harmonics,
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
        posture, resting = None, False
        while not self._stop:
            missing = self._missing(posture is not None, resting)
            if not missing:
                return posture
            if time.monotonic() > deadline:
                raise ExcitationError(
                    f'waited {self._parameters.wait_timeout:g} s, and {"; ".join(missing)}'
                )
            state = self._next_state(0.1)
            if state is not None:
                posture, resting = state.position, bool(np.abs(state.velocity).max() < RESTING)
        return None

    def _missing(self, has_state: bool, resting: bool) -> list[str]:
        """Return what the motion cannot start without, in words."""
        if self._mode == 'fault':
            raise ExcitationError('arm_mode is fault: see /diagnostics, then call clear_fault')
        wanted = self._parameters.subscribers
        missing = []
        if not has_state:
            missing.append('no joint_states arrived: is the bridge running in this domain?')
        elif not resting:
            missing.append(f'the arm does not rest (below {RESTING} rad/s)')
        if self._mode not in MOVABLE:
            missing.append(f"arm_mode is '{self._mode}': call the bridge's enable service")
        matched = self._commands.get_subscription_count()
        if matched < wanted:
            missing.append(f'joint_command has {matched} of {wanted} subscribers')
        matched = self._node.count_subscribers(topics.JOINT_STATES.name)
        if matched < wanted:
            missing.append(f'joint_states has {matched} of {wanted} subscribers')
        if self._parameters.wait_for_recorder:
            missing += [
                f'{topic.name} is not being recorded: is the recorder running?'
                for topic in (topics.JOINT_STATES, topics.JOINT_COMMAND)
                if self._node.resolve_topic_name(topic.name) not in self._recorded
            ]
        return missing

    def _next_state(self, timeout: float) -> JointSample | None:
        """Return the newest state with its joints in order, None if none came in time [s]."""
        self._states.wait(timeout)
        message = self._states.take_newest()
        if message is None:
            return None
        sample = self._codec.unpack(message[0])
        try:
            if sample is None:
                sample = in_order(*decode_joint_state(message[0]), self._names)
        except ValueError as error:
            raise ExcitationError(f'joint_states: {error}: check what publishes it') from error
        if sample.position is None or sample.velocity is None:
            raise ExcitationError(
                'joint_states lacks position or velocity: check what publishes it'
            )
        return sample

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
                state = self._next_state(timeout)
                if state is None:
                    if time.monotonic() - heard > timeout:
                        raise ExcitationError(
                            f'no joint state for {timeout:g} s in the {player.stage}: did the '
                            'bridge end?'
                        )
                    continue
                heard = time.monotonic()
                if self._stop:
                    player.stop()
                if self._mode not in PLAYABLE:
                    raise ExcitationError(f"arm_mode became '{self._mode}' in the {player.stage}")
                command = player.update(state.stamp_ns, state.position)
                self._commands.publish(self._codec.pack(state.stamp_ns, *command))
                self._latency.add(time.time_ns() - state.stamp_ns)
                if progress.due(state.stamp_ns):
                    progress.show(_progress_text(player))
        finally:
            progress.close()

    def _conclude(self, player: ExcitationPlayer) -> None:
        if player.fault is not None:
            raise ExcitationError(player.fault)
        error = player.largest_error.max()
        latency = self._latency.summary()
        print(
            f'{NAME}: {"stopped" if self._stop else "done"}: {latency.count} states answered, '
            f'{self._states.lost() or 0} lost; answer p50 {latency.p50 * 1e6:.0f} us, p99 '
            f'{latency.p99 * 1e6:.0f} us after the stamp; largest tracking error {error:.3f} rad',
            flush=True,
        )
        self.status = INTERRUPTED if self._stop else 0

    def _on_mode(self, message: String) -> None:
        self._mode = message.data

    def _on_recorder_status(self, message: String) -> None:
        try:
            status = json.loads(message.data)
            recording = status['state'] == 'recording'
            self._recorded = set(status['matched']) if recording else set()
        except (ValueError, KeyError, TypeError) as error:
            self._node.get_logger().warning(f'recorder_status is not understood: {error}')

    def _on_stop(self) -> None:
        self._stop = True


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
