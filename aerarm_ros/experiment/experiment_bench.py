"""Simulations of controllers on the emulated arm, without ROS and not tied to real time.

All code between control law and physics engine equals that of the real arm: the bridge's cycle with
its frames, the boards' control laws, quantized encoders and filtered velocities. ROS is omitted, so
that every run is reproducible.
"""

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.base_motion import ImuSample
from aerarm_ros.control.base.base_motion_estimator import FULL, NONE, BaseMotionEstimator
from aerarm_ros.control.base.feedback_check import OscillationWatch
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.checks import JointLimits
from aerarm_ros.control.compensation import FrictionCompensation, MomentumObserver
from aerarm_ros.control.control_loop import ControlLoop
from aerarm_ros.control.laws.computed_torque import BoardComputedTorque, ComputedTorque
from aerarm_ros.control.laws.gravity_compensation import GravityCompensation
from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.resources import write_whole
from aerarm_ros.description.robot import Robot
from aerarm_ros.excitation.trajectory import RampedExcitation
from aerarm_ros.hardware.bridge_cycle import BridgeCycle
from aerarm_ros.hardware.emulation.emulation import make_emulated_transport, mount_on_base
from aerarm_ros.hardware.gate.command_intake import OfferedCommand
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.motion.signals import ArmState, Array, JointReference
from aerarm_ros.pages.html_text import origin, page, paragraph, section, table, text_table
from aerarm_ros.parallel import run_in_order
from aerarm_ros.simulation.arm_plant import PlantParameters
from aerarm_ros.simulation.base_profile import BASE_PROFILES, MOVING, STILL, TILTED
from aerarm_ros.simulation.flying_plant import MovingBasePlant

GRAVITY, HOST, BOARDS = 'gravity compensation', 'computed torque, host', 'computed torque, boards'
CAD, TRUE = 'CAD', 'true'


@dataclass(frozen=True)
class ExperimentCase:
    """Settings of one run.

    Attributes
    ----------
    law
        Control law: `GRAVITY`, `HOST` or `BOARDS`.
    parameters
        Model parameters of the controller: `CAD` for nominal parameters, `TRUE` for those of the
        simulated arm.
    observer
        Whether the momentum observer compensates disturbances.
    base
        Motion of the drone: `STILL`, `TILTED` or `MOVING`.
    aware
        Whether the controller compensates the motion of the drone, measured by the IMU.
    """

    law: str
    parameters: str
    observer: bool = False
    base: str = STILL
    aware: bool = False

    @property
    def name(self) -> str:
        """Text for tables: control law, observer, model parameters, motion of the drone."""
        observer = ' + observer' if self.observer else ''
        imu = '' if self.base == STILL else ', IMU' if self.aware else ', no IMU'
        return f'{self.law}{observer}; {self.parameters}; {self.base}{imu}'


def all_cases() -> list[ExperimentCase]:
    """Return all cases of the experiment of thesis 5.4."""
    still = [
        ExperimentCase(law, parameters, observer)
        for law in (GRAVITY, HOST, BOARDS)
        for parameters in (CAD, TRUE)
        for observer in (False, True)
    ]
    host, cad = ExperimentCase(HOST, TRUE), ExperimentCase(HOST, CAD)
    compared = [host, ExperimentCase(BOARDS, TRUE), cad, replace(cad, observer=True)]
    moved = [
        replace(case, base=base, aware=aware)
        for base in (TILTED, MOVING)
        for case in compared
        for aware in (False, True)
    ]
    return [*still, *moved]


CYCLE = 1e-3
SETTLE = 1.0  # [s] at rest before and after the motion
_IMU_PERIOD = 4  # cycles between two recorded rows: 250 Hz
_START_LIMIT = 20.0  # [s] longest time in which the motors must align and the arm must hold


class MotionSource:
    """Source of controller references that follow an excitation motion."""

    def __init__(self, motion: RampedExcitation) -> None:
        self._motion = motion
        self.begin = np.inf

    def take_over(self, q: Array) -> None:
        """Do nothing: the arm is already at the start of the motion."""

    def update(self, q: Array, now: float, dt: float) -> JointReference:
        """Return the reference at `now` [s], at rest before and after the motion."""
        time = min(max(now - self.begin, 0.0), self._motion.duration)
        return JointReference(*self._motion.evaluate(time))


@dataclass(frozen=True, eq=False)
class ExperimentRun:
    """Recorded data of one simulated run, with one row per control cycle.

    Attributes
    ----------
    time : (M,) ndarray
        Time since the start of the motion [s].
    q, qd : (M, n) ndarray
        True and desired joint positions [rad].
    effort : (M, n) ndarray
        Drive torques [Nm].
    at_full_speed : (M,) ndarray of bool
        Whether the periodic part of the motion is active, after the run-in.
    """

    case: ExperimentCase
    time: Array
    q: Array
    qd: Array
    effort: Array
    at_full_speed: npt.NDArray[np.bool_]


class ExperimentBench:
    """Simulation of an arm that follows a motion; its true parameters deviate from the CAD model.

    Parameters
    ----------
    config, robot
        Nominal configuration and robot model (CAD).
    truth
        True parameters of the plant.
    motion
        Motion that the arm should follow.
    """

    def __init__(
        self, config: ArmConfig, robot: Robot, truth: PlantParameters, motion: RampedExcitation
    ) -> None:
        self._config = config.with_encoders('absolute')
        self._robot = robot
        self._truth = truth
        self._motion = motion
        self._limits = JointLimits.from_config(config)

    def run(self, case: ExperimentCase) -> ExperimentRun:
        """Simulate a case from rest to rest; raises RuntimeError if the bridge stops the arm."""
        start = self._motion.evaluate(0.0).q
        transport = make_emulated_transport(
            self._config, self._robot, None, position=start, parameters=self._truth
        )
        if case.base != STILL:
            mount_on_base(transport, self._robot, BASE_PROFILES[case.base])
        plant = transport.plant
        bridge = BridgeCycle(self._config, transport, robot=self._robot)
        transport.open()
        now = self._enable(bridge)
        source, estimator = MotionSource(self._motion), self._estimator(case)
        loop = self._loop(case, source, estimator)
        source.begin = now + SETTLE
        if isinstance(plant, MovingBasePlant):
            plant.start()
        rows = []
        for cycle in range(round((self._motion.duration + 2.0 * SETTLE) / CYCLE)):
            if case.aware and cycle % _IMU_PERIOD == 0 and isinstance(plant, MovingBasePlant):
                estimator.offer(ImuSample(now, *plant.imu), now)
            state = ArmState(bridge.q.copy(), bridge.dq.copy(), bridge.tau.copy())
            command = loop.update(state, now)
            now += CYCLE
            if command is not None:
                # The controller's answer to the state of this cycle acts in the next cycle, as
                # with ROS topics.
                bridge.command(
                    OfferedCommand(self._config.joint_names, *command, CYCLE, 'experiment'), now
                )
            bridge.update(now)
            desired = source.update(state.q, now, CYCLE).q
            rows.append(np.concatenate([[now - source.begin], plant.position, desired, bridge.tau]))
        if bridge.mode != 'running':
            raise RuntimeError(f'{case.name}: the arm was stopped ({"; ".join(bridge.faults)})')
        table = np.array(rows)
        time = table[:, 0]
        ramp = self._motion.ramp_time
        full_speed = (time >= ramp) & (time <= self._motion.duration - ramp)
        q, desired_q, effort = np.split(table[:, 1:], 3, axis=1)
        return ExperimentRun(case, time, q, desired_q, effort, full_speed)

    def _enable(self, bridge: BridgeCycle) -> float:
        """Align the motors and hold the arm at rest; return the simulated time after that [s]."""
        now = 0.0
        ready_at = np.inf
        while now < ready_at + SETTLE:
            bridge.update(now)
            if bridge.mode == 'idle':
                bridge.enable()
            elif bridge.mode == 'ready' and np.isinf(ready_at):
                ready_at = now
            now += CYCLE
            if np.isinf(ready_at) and now > _START_LIMIT:
                raise RuntimeError(f'the arm is {bridge.mode}: {"; ".join(bridge.faults)}')
        return now

    def _estimator(self, case: ExperimentCase) -> BaseMotionEstimator:
        watch = OscillationWatch(self._limits.effort_max)
        mode = FULL if case.aware else NONE
        return BaseMotionEstimator(self._config.gravity_in_base, mode, watch=watch)

    def _loop(
        self, case: ExperimentCase, source: MotionSource, estimator: BaseMotionEstimator
    ) -> ControlLoop[JointReference]:
        robot, truth = self._robot, self._truth
        if case.parameters == CAD:
            inertia = self._config.column('reflected_inertia')
            viscous, coulomb = robot.viscous, robot.coulomb
            load_share = robot.load_friction
        else:
            robot = robot.with_inertial_parameters(truth.inertial_parameters)
            inertia, viscous, coulomb = truth.rotor_inertia, truth.viscous, truth.coulomb
            load_share = truth.load_friction
        dynamics = MovingBaseDynamics(robot, inertia)
        friction = FrictionCompensation(viscous, coulomb, load_share=load_share)
        law: Any
        if case.law == GRAVITY:
            law = GravityCompensation(dynamics, [60, 60, 40, 40], [5, 5, 1, 1], friction)
        elif case.law == HOST:
            law = ComputedTorque(dynamics, 400.0, 40.0, friction=friction)
        else:
            law = BoardComputedTorque(dynamics, friction=friction)
        observer = MomentumObserver(dynamics, 30.0, friction) if case.observer else None
        limit = 0.5 * self._limits.effort_max
        return ControlLoop(self._limits, source, law, observer, estimator, limit)


def run_all(
    bench: ExperimentBench, cases: Sequence[ExperimentCase], workers: int
) -> Generator[ExperimentRun, None, None]:
    """Yield the runs in the order of the cases; the results do not depend on `workers`.

    Leaving the iteration early ends the workers.

    Parameters
    ----------
    workers
        Number of processes; one means this process.

    Raises
    ------
    RuntimeError
        If the bridge stops the arm.
    """
    if workers == 1:
        yield from map(bench.run, cases)
        return
    yield from run_in_order(bench.run, [(case,) for case in cases], workers)


HEADINGS = (
    'control law; parameters of its model; motion of the drone',
    'joints RMS [mrad]',
    'joints max [mrad]',
    'joints final [mrad]',
    'tool RMS [mm]',
    'tool max [mm]',
    'tool final [mm]',
    'RMS relative to a still drone: joint, tool',
)
_TOOL_RMS = HEADINGS.index('tool RMS [mm]')


class ExperimentReport:
    """Report of the tracking errors of all runs.

    Parameters
    ----------
    robot
        Robot model for the tool's path.
    """

    def __init__(self, robot: Robot) -> None:
        self._kinematics = Kinematics(robot)
        self._runs: list[ExperimentRun] = []
        self._rows: list[tuple[str, ...]] = []
        self._still: dict[ExperimentCase, Array] = {}

    def add(self, run: ExperimentRun) -> tuple[str, ...]:
        """Add a run to the report, and return its row of the table of tracking errors."""
        joints = 1e3 * np.abs(run.qd - run.q)
        tool = 1e3 * np.linalg.norm(self._path(run.qd) - self._path(run.q), axis=1)
        final = joints[-1].max(), tool[-1]
        joints, tool = joints[run.at_full_speed], tool[run.at_full_speed]
        rms, tool_rms = np.sqrt((joints**2).mean(axis=0)), np.sqrt((tool**2).mean())
        row = (
            run.case.name,
            ' '.join(f'{value:.2f}' for value in rms),
            *(f'{x:.2f}' for x in (joints.max(), final[0], tool_rms, tool.max(), final[1])),
            self._over_still(run.case, np.array([rms.max(), tool_rms])),
        )
        self._runs.append(run)
        self._rows.append(row)
        return row

    def text(self) -> str:
        """Return the table of tracking errors as text for a terminal."""
        return text_table([HEADINGS, *self._rows])

    def write(self, path: Path, note: str) -> None:
        """Write the HTML page, which opens offline."""
        body: list[str] = [paragraph(note, 'lead')]
        for base in dict.fromkeys(run.case.base for run in self._runs):
            rows = [
                _numbers(row)
                for run, row in zip(self._runs, self._rows, strict=True)
                if run.case.base == base
            ]
            best = min(range(len(rows)), key=lambda k: float(rows[k][_TOOL_RMS]))
            body.append(section(f'Errors, drone {base}', table(HEADINGS, rows, [best])))
        text = page('Dynamic controllers', '', body, origin())
        write_whole(path, text)

    def _over_still(self, case: ExperimentCase, rms: Array) -> str:
        """Return, as text, the RMS errors divided by those of the same case on a still base.

        The two ratios are those of the worst joint and of the tool. '' for a case with a still
        base, or if that case has not run on a still base.
        """
        if case.base == STILL:
            self._still[case] = rms
            return ''
        still = self._still.get(replace(case, base=STILL, aware=False))
        return '' if still is None else ' '.join(f'{ratio:.2f}' for ratio in rms / still)

    def _path(self, q: Sequence[Array] | Array) -> Array:
        return np.array([self._kinematics.position(row) for row in q])


def _numbers(row: Sequence[str]) -> list[str | float]:
    """Return a table row whose numeric texts are converted to numbers, for the page."""
    return [float(x) if x.replace('.', '', 1).isdigit() else x for x in row]
