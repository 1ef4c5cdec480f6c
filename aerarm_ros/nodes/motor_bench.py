"""Measure friction, inertia, torque constant, resistance and backlash of each drive.

Section 4.4 of the thesis describes the method.

Usage: ros2 run aerarm_ros motor_bench --ros-args -p joints:="[joint4]" -p out:=DIRECTORY
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import fields
from datetime import datetime
from pathlib import Path

import numpy as np
import rclpy
from numpy.typing import NDArray

from aerarm_msgs_py import topics
from aerarm_msgs_py.storage.read_limits import BagError
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.config_reader import config_path
from aerarm_ros.excitation.bench_motion import BenchMotion, BenchPlan, bench_checker
from aerarm_ros.excitation.feasibility import StopLimits
from aerarm_ros.excitation.player import ExcitationPlayer, VelocityLaw
from aerarm_ros.excitation.settings import ExcitationError
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.files.result_directory import MARKER, ResultDirectory
from aerarm_ros.identification.motor_bench.motor_bench import KnownMass, MotorBench, MotorResult
from aerarm_ros.identification.motor_bench.motor_report import (
    bench_html,
    bench_table,
    bench_yaml,
    config_yaml,
    load_earlier,
)
from aerarm_ros.motion.signals import ArmState
from aerarm_ros.ros.executors import BackgroundExecutor
from aerarm_ros.ros.parameters.parameter import Parameter
from aerarm_ros.ros.parameters.parameter_table import ParameterTable
from aerarm_ros.ros.parameters.shared_parameters import (
    ARM_FILES,
    REAL_TIME_PARAMETERS,
    SURROUNDINGS,
    load_arm,
    load_setup,
    prepare_thread,
)
from aerarm_ros.ros.playback.bench_recording import BenchRecording, MotorReadings
from aerarm_ros.ros.playback.motion_playback import MotionPlayback
from aerarm_ros.ros.process.node_main import run_node
from aerarm_ros.ros.process.process_end import INTERRUPTED, StopSignals
from aerarm_ros.ros.requests.arm_client import AT_END_PARAMETERS, ArmAtEnd

NAME = 'motor_bench'
_PLAN = BenchPlan()

PARAMETERS = ParameterTable(
    Parameter('joints', [], 'joints to measure, one after the other; all joints if empty'),
    Parameter('mounted', True,
        'true if the drives are mounted in the arm; false for bare motors without gravity load'),
    Parameter('posture', [],
        'joint positions about which the joints move, in joint order; the present posture if empty',
        'rad', -6.3, 6.3, element=float),
    Parameter('speeds', list(_PLAN.speeds),
        'speeds at which each joint moves steadily in both directions, to measure friction',
              'rad/s', 1e-3, 50.0),
    Parameter('span', _PLAN.span, 'width of the range in which a joint moves, centred at its '
                                  'position in the posture',
              'rad', 0.01, 6.28),
    Parameter('acceleration_share', _PLAN.acceleration_share,
        'fraction of acceleration_max that ramps and acceleration runs use', '', 0.01, 1.0),
    Parameter('runs', _PLAN.runs,
        'number of acceleration runs per joint; each run moves the joint back and forth',
        '', 0, 100),
    Parameter('swings', _PLAN.swings,
        'number of sine waves per joint about the posture, to measure the gear backlash; 0 for '
        'no measurement',
        '', 0, 1000),
    Parameter('amplitude', _PLAN.amplitude,
        'amplitude of the sine waves whose number swings sets', 'rad', 0.01, 3.0),
    Parameter('known_mass', 0.0,
        'known mass on the arm or on the lever, to measure the torque constants; 0 for no mass',
        'kg', 0.0, 100.0),
    Parameter('known_mass_position', [0.0, 0.0, 0.0],
        'centre of the known mass in the frame of the last joint, for mounted motors', 'm',
        -5.0, 5.0),
    Parameter('lever', 0.0,
        'distance of the known mass from the horizontal motor shaft, for bare motors', 'm',
        0.0, 5.0),
    Parameter('without_mass', '', 'file motor_bench.yaml of an earlier run without the known '
        'mass, for mounted motors'),
    Parameter('link_uncertainty', 0.2,
        'relative standard deviation assumed for the link inertias in the URDF', '', 0.0, 2.0),
    Parameter('resistance_uncertainty', 0.1, (
        'relative standard deviation assumed for the resistance that a board reports, if the board '
        'does not measure voltage'
    ), '', 0.0, 2.0),
    Parameter('out', '', 'folder for the results; motor_bench_DATE_TIME if empty'),
    Parameter('position_gain', 1.0,
        'gain K of the commanded velocity dq_d + K (q_d - q)', '1/s', 0.0, 20.0),
    Parameter('tracking_limit', 0.3,
        'position error |q_d - q| at which the node stops the arm', 'rad', 1e-3, 3.0),
    Parameter('state_timeout', 0.2,
        'time without joint_states after which the node aborts the motion', 's', 0.005, 10.0),
    Parameter('wait_timeout', 20.0, 'time limit until the arm is ready', 's', 0.1, 3600.0),
    *AT_END_PARAMETERS,
    *REAL_TIME_PARAMETERS,
    *ARM_FILES,
    *SURROUNDINGS,
)  # fmt: skip


class MotorBenchNode:
    """Node that moves one joint at a time, measures the drives, and writes the results to files.

    Attributes
    ----------
    status
        Exit status after `run`.

    Raises
    ------
    ValueError
        If a parameter or a file cannot be used.
    """

    def __init__(self) -> None:
        self.status = 1
        self._node = rclpy.create_node(NAME)
        self._values = values = PARAMETERS.declare(self._node)
        self._source = config_path(values.config or None, 'aerarm.yaml')
        arm, self._robot = load_arm(values)
        # Error messages and results use the joint names of the files, without tf_prefix.
        self._config = load_arm_config(values.config or None)
        names = self._config.joint_names
        self._setup = load_setup(values, arm, self._robot)
        joints = [self._robot.own_name(name) for name in values.joints]
        unknown = [name for name in joints if name not in names]
        if unknown:
            raise ExcitationError(
                f'unknown joint {", ".join(unknown)}: choose from {", ".join(names)}'
            )
        self._joints = [names.index(name) for name in joints or names]
        plan = {item.name: getattr(values, item.name) for item in fields(BenchPlan)}
        self._plan = BenchPlan(**plan | {'speeds': tuple(values.speeds)})
        if values.swings and not values.mounted:
            raise ExcitationError(
                'a bare motor has no link, which the measurement of the gear backlash needs: set '
                'swings to 0'
            )
        if len(values.posture) not in (0, len(names)):
            raise ExcitationError(
                f'the parameter posture has {len(values.posture)} values: set {len(names)} values, '
                'one per joint, or none'
            )
        self._known = self._known_mass()
        earlier = values.without_mass
        self._earlier = load_earlier(Path(earlier)) if earlier else None
        self._names = arm.joint_names
        self._playback = MotionPlayback(self._node, self._names)
        self._readings = MotorReadings(self._node, self._names)
        self._arm_at_end = ArmAtEnd(self._node, values)

    def run(self) -> None:
        """Measure the drives, and set the attribute `status` to the exit status."""
        out = Path(self._values.out or f'{NAME}_{datetime.now():%Y%m%d_%H%M%S}')
        with StopSignals(self._playback.ask_stop), BackgroundExecutor(self._node):
            try:
                with ResultDirectory(out, 'the parameter out') as directory:
                    self._measure(directory)
                self.status = 0
                print(f'{NAME}: {directory.target / "report.html"}', flush=True)
            except KeyboardInterrupt:
                self.status = INTERRUPTED
                print(f'{NAME}: stopped, so it wrote no files', file=sys.stderr, flush=True)
            except (ExcitationError, IdentificationError, BagError) as error:
                print(f'{NAME}: {error}', file=sys.stderr, flush=True)

    def close(self) -> None:
        """Destroy the node."""
        self._playback.destroy()
        self._readings.destroy()
        self._node.destroy_node()

    def _measure(self, directory: ResultDirectory) -> None:
        start = self._playback.wait_for_arm(self._values.wait_timeout)
        if start is None:
            raise KeyboardInterrupt
        posture = np.array(self._values.posture) if self._values.posture else start
        bench = MotorBench(
            self._config,
            self._robot if self._values.mounted else None,
            posture,
            self._known,
            self._earlier,
            self._values.link_uncertainty,
            self._values.resistance_uncertainty,
        )
        motion = BenchMotion(self._plan, self._setup.limits, start, posture, self._joints)
        motion.require_feasible(bench_checker(self._setup, self._values.mounted))
        recording = self._record(motion, directory)
        runs = recording.runs(motion.measurements)
        readings = self._readings
        results = [
            bench.evaluate(joint, runs[joint], readings.supply(joint)) for joint in self._joints
        ]
        self._write(directory, results, posture, bench.warnings)

    def _known_mass(self) -> KnownMass | None:
        values = self._values
        if values.known_mass == 0.0:
            return None
        if len(values.known_mass_position) != 3:
            raise ExcitationError(
                f'the parameter known_mass_position has {len(values.known_mass_position)} values: '
                'set x, y and z [m]'
            )
        return KnownMass(values.known_mass, tuple(values.known_mass_position), values.lever)

    def _record(self, motion: BenchMotion, directory: ResultDirectory) -> BenchRecording:
        values, names, limits = self._values, self._names, self._setup.limits
        player = ExcitationPlayer(
            motion.sequence,
            VelocityLaw(values.position_gain, limits.velocity),
            self._setup.stops if values.mounted else StopLimits(limits, None),
            values.tracking_limit,
            values.state_timeout,
        )
        prepare_thread(values, self._node.get_logger())
        resolve = self._node.resolve_topic_name
        topic_names = resolve(topics.JOINT_STATES.name), resolve(topics.JOINT_COMMAND.name)
        recording = BenchRecording(directory.path('bag'), names, topic_names)

        def listen(stamp_ns: int, state: ArmState, command: bytes) -> None:
            recording.add(stamp_ns, player.path_time, state, command)
            self._readings.take()

        try:
            self._playback.play(player, values.state_timeout, listen)
        finally:
            recording.close()
        self._arm_at_end.leave()
        if self._playback.stop_asked:
            raise KeyboardInterrupt
        return recording

    def _write(
        self,
        directory: ResultDirectory,
        results: Sequence[MotorResult],
        posture: NDArray[np.float64],
        warnings: Sequence[str],
    ) -> None:
        mounted = self._values.mounted
        for text in warnings:
            print(f'{NAME}: {text}', file=sys.stderr, flush=True)
        directory.write('motor_bench.yaml', bench_yaml(results, posture, mounted, warnings))
        directory.write('config.yaml', config_yaml(self._source, self._config, results))
        directory.write('report.html', bench_html(results, mounted, warnings))
        directory.write_json(MARKER, {'joints': [result.joint for result in results]})
        print(bench_table(results), flush=True)


def main(args: Sequence[str] | None = None) -> int:
    """Run the node; return exit status 0 if all drives were measured and the results written."""
    return run_node(NAME, MotorBenchNode, args, PARAMETERS, __doc__)
