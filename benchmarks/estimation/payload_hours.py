"""Rate of false payload changes that `PayloadEstimator` reports.

Arms of 4 to 7 joints work for hours on the physics engine without payload: random excitation, and
moves between random postures with rests. The estimator's model of each arm has the errors of
identified models (links by 1 %, friction by 15 %). Each detected change is a false one. At the end
of each session the arm picks up and puts down a payload; the detection and its delay are measured.
"""

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from importlib.metadata import files
from typing import NamedTuple
from xml.etree import ElementTree

import mujoco
import numpy as np

from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.model.dynamics import Dynamics
from aerarm_ros.motion.polynomial_path import PolynomialPath, rest_to_rest_duration, smooth_step
from aerarm_ros.motion.signals import ArmState
from aerarm_ros.online.payload_estimator import EstimatorSettings, PayloadEstimator
from aerarm_ros.parallel import run_in_order
from aerarm_ros.simulation.arm_plant import SUBSTEP, ArmPlant, PlantParameters, Spread

CYCLE = 1e-3  # [s]
WINDOW = 5  # cycles over which the estimator averages the torque
SESSION = 600.0  # [s] of work of one arm with one model
SEGMENT = 10.0  # [s] of one type of motion
PICK_UP, PUT_DOWN, END = 3.0, 7.0, 10.0  # [s] after the end of the work
MADE = Spread(torque_constant=0.0)
KNOWN = Spread(0.01, 0.005, 0.0005, 0.15, 0.15, 0.02, 0.0)
SPEED, ACCELERATION = 2.0, 8.0  # [rad/s], [rad/s^2] upper bounds of the motions
PURSUIT = 30.0  # [rad/s] bandwidth of the position loop
VELOCITY_LAG = 1.6e-3  # [s] of the boards
CURRENT_NOISE = 0.02  # [A] of the boards
NOISE = 3e-3  # relative to a joint's largest gravity load, if no current is known

# Arms of the package example-robot-data, and the joint that is fixed.
EXAMPLES = {5: ('so101.urdf', 'gripper'), 6: ('z1.urdf', 'jointGripper'), 7: ('xarm7.urdf', '')}

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Arm:
    """Nominal arm, noise of its torques [Nm], its payload, and settings of the estimator."""

    robot: Robot
    drawn: PlantParameters
    noise: Array
    mass: float
    settings: EstimatorSettings

    @classmethod
    def of(cls, joints: int) -> 'Arm':
        """Return the packaged arm, or an example with a given number of joints."""
        if joints == 4:
            robot, config = load_robot(), load_arm_config()
            drawn = PlantParameters.nominal(config, robot)
            noise = CURRENT_NOISE * drawn.motor_torque_constant / config.column('gear.ratio')
            return cls(robot, drawn, noise, 0.2, EstimatorSettings())
        robot = example(*EXAMPLES[joints])
        dynamics, zero = Dynamics(robot), np.zeros(robot.n)
        random = np.random.default_rng(joints)
        postures = random.uniform(*robot.posture_range, (500, robot.n))
        load = np.abs([dynamics.inverse(q, zero, zero) for q in postures]).max(axis=0)
        inertia = np.mean([np.diag(dynamics.inertia_matrix(q)) for q in postures], axis=0)
        friction = 0.03 * load + 0.01 * load.max()
        drawn = PlantParameters(
            robot.joint_names,
            robot.link_names,
            np.array(robot.inertial_parameters),
            0.3 * inertia + 2e-4 * load.max(),
            friction,
            friction,
            np.full(robot.n, 0.03),
            np.ones(robot.n),
            np.ones(robot.n),
        )
        # Prior knowledge; the defaults are those of an arm that carries 6 Nm.
        scale = load.max() / 6.0
        settings = EstimatorSettings(
            payload_mass=0.5 * scale, tare_mass=0.01 * scale, torque_noise=0.02 * scale
        )
        return cls(robot, drawn, NOISE * load + 1e-3 * scale, 0.2 * scale, settings)


def example(name: str, fixed: str) -> Robot:
    """Return an arm of example-robot-data with one joint fixed."""
    (path,) = [file for file in files('example-robot-data') or () if file.name == name]
    root = ElementTree.parse(str(path.locate())).getroot()
    for joint in root.iter('joint'):
        if joint.get('name') == fixed:
            joint.set('type', 'fixed')
    return load_robot(ElementTree.tostring(root, encoding='unicode'))


class Plant(ArmPlant):
    """Simulated arm whose load-dependent friction is updated once per cycle."""

    def cycle(self, effort: Array) -> None:
        """Advance by one cycle with torques (n,) [Nm]."""
        self._effort[:] = self._applied[:] = effort
        mujoco.mj_step(self._model, self._data, nstep=round(CYCLE / SUBSTEP))
        self._set_friction()


class Work:
    """Random motions of an arm: position, speed and acceleration (n,) of each cycle."""

    def __init__(self, robot: Robot, random: np.random.Generator) -> None:
        low, high = robot.posture_range
        self._middle = 0.5 * (low + high)
        self._reach = np.minimum(0.4 * (high - low), 1.5)
        self._random = random
        self.start = self._middle.copy()

    def play(self) -> Iterator[tuple[Array, Array, Array]]:
        """Yield motions that alternate between waves about a posture and moves."""
        q = self.start
        while True:
            for target in self._middle + self._reach * self._random.uniform(-0.5, 0.5, (1, len(q))):
                yield from self._move(q, target)
                q = target
            yield from self._waves(q)
            for target in self._middle + self._reach * self._random.uniform(-1, 1, (4, len(q))):
                yield from self._move(q, target)
                q = target
                yield from [(q, 0.0 * q, 0.0 * q)] * int(self._random.uniform(0.0, 1500.0))

    def _move(self, start: Array, end: Array) -> Iterator[tuple[Array, Array, Array]]:
        """Yield the samples of a quintic motion from rest to rest."""
        pace = self._random.uniform(0.2, 1.0)
        seconds = rest_to_rest_duration(end - start, SPEED, ACCELERATION, 0.0) / pace
        path = PolynomialPath.rest_to_rest(start, end, seconds)
        yield from zip(*path.evaluate(np.arange(CYCLE, seconds, CYCLE)), strict=True)

    def _waves(self, centre: Array) -> Iterator[tuple[Array, Array, Array]]:
        """Yield the samples of a motion of five waves per joint, with smooth start and end."""
        n, random = len(centre), self._random
        rate = 2.0 * np.pi * random.uniform(0.1, 1.0, (5, n))
        size = random.uniform(0.2, 1.0, (5, n)) * 0.5 * self._reach
        size /= np.maximum(1.0, (size.sum(axis=0) / (0.5 * self._reach)))
        size *= np.minimum(1.0, SPEED / (size * rate).sum(axis=0))
        size *= np.minimum(1.0, ACCELERATION / (size * rate**2).sum(axis=0))
        phase = random.uniform(0.0, 2.0 * np.pi, (5, n))
        t = np.arange(CYCLE, SEGMENT, CYCLE)[:, np.newaxis, np.newaxis]
        q = (size * np.sin(rate * t + phase)).sum(axis=1)
        dq = (size * rate * np.cos(rate * t + phase)).sum(axis=1)
        ddq = -(size * rate**2 * np.sin(rate * t + phase)).sum(axis=1)
        t = t[:, 0]
        w, slope, _, ddw = smooth_step(np.minimum(t, SEGMENT - t))
        dw = np.where(t < 0.5 * SEGMENT, slope, -slope)
        yield from zip(
            centre + w * q, dw * q + w * dq, ddw * q + 2.0 * dw * dq + w * ddq, strict=True
        )


class Job(NamedTuple):
    """Session to run: number of joints, seed, duration of work [s], and a setting."""

    joints: int
    seed: int
    seconds: float
    model_error: float


class Session(NamedTuple):
    """Times of false changes [s], detection delays of true changes [s], and mass error.

    The delay of a missed change is NaN.
    """

    joints: int
    seed: int
    wrong: list[float]
    problem: str
    pick_up: float
    put_down: float
    mass_error: float


def record(arm: Arm, truth: PlantParameters, seed: int, seconds: float) -> Array:
    """Return position, speed and mean torque of each window (k, 3 n), including END."""
    random = np.random.default_rng(seed)
    work = Work(arm.robot, random)
    plant = Plant(arm.robot, truth, work.start)
    loaded = truth.carrying(arm.mass, (0.06, 0.01, -0.02), 0.03)
    model = Dynamics(
        arm.robot.with_inertial_parameters(truth.inertial_parameters), truth.rotor_inertia
    )
    stiffness = PURSUIT**2 * np.diag(model.inertia_matrix(work.start))
    damping = 2.0 * stiffness / PURSUIT
    n, speed, share = arm.robot.n, np.zeros(arm.robot.n), -np.expm1(-CYCLE / VELOCITY_LAG)
    noise = arm.noise * random.standard_normal((8192, n))
    rows, mean = [], np.zeros(n)
    for number, (q, dq, ddq) in enumerate(work.play()):
        now = number * CYCLE - seconds
        if abs(now - PICK_UP) < 0.5 * CYCLE:
            plant.grasp(loaded)
        elif abs(now - PUT_DOWN) < 0.5 * CYCLE:
            plant.grasp(truth)
        elif now > END:
            break
        friction = truth.viscous * dq + truth.coulomb * np.tanh(dq / 0.02)
        tau = model.inverse(q, dq, ddq) + friction
        tau += stiffness * (q - plant.position) + damping * (dq - plant.velocity)
        plant.cycle(tau)
        speed += share * (plant.velocity - speed)
        mean += (tau + noise[number % 8192]) / WINDOW
        if number % WINDOW == WINDOW - 1:
            rows.append(np.concatenate([plant.position, speed, mean]))
            mean = np.zeros(n)
    return np.array(rows)


def session(job: Job) -> Session:
    """Simulate one arm, and estimate its payload with one model."""
    joints, seed, seconds, model_error = job
    arm = Arm.of(joints)
    truth = arm.drawn.perturbed(seed, MADE)
    known = truth.perturbed(10_000 + seed, KNOWN)
    robot = arm.robot.with_inertial_parameters(known.inertial_parameters)
    learner = PayloadEstimator(
        MovingBaseDynamics(robot, known.rotor_inertia),
        known.viscous,
        known.coulomb,
        known.load_friction,
        replace(arm.settings, model_error=model_error),
    )
    wrong: list[float] = []
    problem, found, put, mass, changes = '', np.nan, np.nan, np.nan, 0
    for number, row in enumerate(record(arm, truth, seed, seconds)):
        since = number * WINDOW * CYCLE - seconds
        told = learner.update(ArmState(*np.split(row, 3)), number * WINDOW * CYCLE)
        problem = problem or learner.problem
        if since < PICK_UP:
            wrong += [round(since + seconds, 2)] * (learner.changes - changes)
            changes = learner.changes
        elif told is not None and since < PUT_DOWN and told.carries:
            found = since - PICK_UP if np.isnan(found) else found
            mass = told.payload.mass / arm.mass - 1.0
        elif told is not None and since > PUT_DOWN and not told.carries and np.isnan(put):
            put = since - PUT_DOWN
    return Session(joints, seed, wrong, problem, found, put, mass)


def main() -> int:
    """Run the sessions and print the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        '--hours', type=float, default=0.5, help='simulated hours per number of joints'
    )
    parser.add_argument('--joints', type=int, nargs='+', default=[4, 5, 6, 7], choices=[4, 5, 6, 7])
    parser.add_argument('--seconds', type=float, default=SESSION, help='duration of a session [s]')
    parser.add_argument('--jobs', type=int, default=1, help='number of processes')
    parser.add_argument(
        '--model-error', type=float, default=EstimatorSettings().model_error, help='model_error'
    )
    options = parser.parse_args()
    runs = max(round(3600.0 * options.hours / options.seconds), 1)
    jobs = [
        (Job(n, seed, options.seconds, options.model_error),)
        for seed in range(runs)
        for n in options.joints
    ]
    results = []
    for result in run_in_order(session, jobs, options.jobs):
        results.append(result)
        print(*result, flush=True)
    report(results, options.seconds)
    return 0


def report(results: list[Session], seconds: float) -> None:
    """Print one row per number of joints."""
    for joints in sorted({result.joints for result in results}):
        rows = [result for result in results if result.joints == joints]
        wrong = sum(len(row.wrong) for row in rows)
        hours = len(rows) * seconds / 3600.0
        delays = np.array([(row.pick_up, row.put_down) for row in rows])
        errors = np.array([row.mass_error for row in rows])
        print(
            f'{joints} joints: {wrong} false changes in {hours:.2f} h, '
            f'{sum(bool(row.problem) for row in rows)} problems; found after '
            f'{np.nanmedian(delays[:, 0]):.2f} s ({np.nanmax(delays[:, 0]):.2f} s), put down '
            f'{np.nanmedian(delays[:, 1]):.2f} s ({np.nanmax(delays[:, 1]):.2f} s), missed '
            f'{np.isnan(delays).sum()}; mass off by {100 * np.nanmedian(np.abs(errors)):.1f} % '
            f'({100 * np.nanmax(np.abs(errors)):.1f} %)'
        )


if __name__ == '__main__':
    sys.exit(main())
