"""A simulated arm with known parameters, independent of the plant behind the boards."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pytest
from identified import identified
from other_bodies import other_bodies

from aerarm_ros.description.arm_config import ArmConfig, load_arm_config
from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.identification.conditioning.conditioning import Conditioner
from aerarm_ros.identification.conditioning.motion_check import ConditioningOptions
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.joint_model import ArmParameters
from aerarm_ros.identification.recording.recording import (
    JointMapping,
    Recording,
    recording_from_states,
)
from aerarm_ros.identification.recording.table_file import TableStates
from aerarm_ros.identification.regression import SampleColumns
from aerarm_ros.model.dynamics import Dynamics
from aerarm_ros.model.regressor import Regressor


@dataclass
class SimulatedArm:
    """Create recordings of an arm that differs from its URDF.

    The motion is whole periods of a Fourier series between smooth run-in and run-out, with rest at
    both ends. The torque is inverse dynamics plus rotor inertia and friction.
    """

    robot: Robot
    inertial: np.ndarray
    rotor: np.ndarray
    viscous: np.ndarray
    coulomb: np.ndarray
    load: np.ndarray
    rate: float = 500.0
    centre: np.ndarray = field(default_factory=lambda: np.array([0.0, np.pi / 2, 0.0, 0.0]))

    def motion(
        self, seed: int, periods: int = 2, f0: float = 0.1, harmonics: int = 5, still: float = 1.0
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return t, q, dq, ddq; the periods begin at `still` + 2 s."""
        ramp = 2.0
        random = np.random.default_rng(seed)
        shape = (self.robot.n, harmonics)
        alpha, beta = random.uniform(-0.35, 0.35, (2, *shape)) * np.minimum(0.1 / f0, 1.0)
        t = np.arange(0.0, periods / f0 + 2 * ramp + 2 * still, 1.0 / self.rate)
        phase, speed, gain = _phase(t - still, ramp, periods / f0)
        omega = 2 * np.pi * f0 * np.arange(1, harmonics + 1)
        angle = np.multiply.outer(phase, omega)
        s, c = np.sin(angle), np.cos(angle)
        q = self.centre + s @ alpha.T + c @ beta.T
        first = (c * omega) @ alpha.T - (s * omega) @ beta.T
        second = -(s * omega**2) @ alpha.T - (c * omega**2) @ beta.T
        return t, q, first * speed[:, None], second * speed[:, None] ** 2 + first * gain[:, None]

    def torque(self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        dynamics = Dynamics(self.robot.with_inertial_parameters(self.inertial))
        links = np.array([dynamics.inverse(*x) for x in zip(q, dq, ddq, strict=True)])
        dry = self.coulomb + self.load * np.abs(links)
        return links + self.rotor * ddq + self.viscous * dq + dry * np.sign(dq)

    def states(self, seed: int, noise: float = 0.0, **motion: float) -> TableStates:
        t, q, dq, ddq = self.motion(seed, **motion)
        tau = self.torque(q, dq, ddq)
        random = np.random.default_rng(1000 + seed)
        dq = dq + noise * 0.01 * random.standard_normal(q.shape)
        q = q + noise * 2e-5 * random.standard_normal(q.shape)
        tau = tau + noise * 0.05 * random.standard_normal(q.shape)
        return TableStates(self.robot.joint_names, 1000.0 + t, q, dq, tau)

    def recording(self, seed: int, noise: float = 0.0, **motion: float) -> Recording:
        states = self.states(seed, noise, **motion)
        return recording_from_states(f'bag{seed}', states, self.robot.joint_names, JointMapping({}))


def _phase(t: np.ndarray, ramp: float, length: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return path time, its rate (0 to 1 and back) and the rate's derivative."""

    def step(x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        x = np.clip(x, 0.0, 1.0)
        return x**3 - x**4 / 2, 3 * x**2 - 2 * x**3, 6 * x - 6 * x**2

    up, down = step(t / ramp), step((t - ramp - length) / ramp)
    x_down = np.clip((t - ramp - length) / ramp, 0.0, 1.0)
    phase = ramp * up[0] + np.clip(t - ramp, 0.0, length) + ramp * (x_down - down[0])
    return phase, up[1] - down[1], (up[2] - down[2]) / ramp


@pytest.fixture(scope='session')
def robot() -> Robot:
    return load_robot()


@pytest.fixture(scope='session')
def config() -> ArmConfig:
    return load_arm_config()


@pytest.fixture(scope='session')
def make_arm(robot: Robot, config: ArmConfig) -> Callable[..., SimulatedArm]:
    """Return a function that creates arms, with optional kinds of friction."""

    def make(load: float = 0.0, friction: float = 1.0, **other: float) -> SimulatedArm:
        random = np.random.default_rng(5)
        return SimulatedArm(
            robot,
            other_bodies(robot.inertial_parameters, random, stretch=0.1, density=0.2),
            config.column('reflected_inertia') * random.uniform(0.8, 1.2, robot.n),
            friction * config.column('viscous') * random.uniform(0.8, 1.2, robot.n),
            friction * config.column('coulomb') * random.uniform(0.8, 1.2, robot.n),
            np.full(robot.n, load),
            **other,
        )

    return make


@pytest.fixture(scope='session')
def arm(make_arm: Callable[..., SimulatedArm]) -> SimulatedArm:
    """An arm with viscous and Coulomb friction."""
    return make_arm()


@pytest.fixture(scope='session')
def result(arm: SimulatedArm) -> IdentificationResult:
    """An identification from noisy data, validated on another motion."""
    return identified(arm.recording(1, noise=1.0), arm.recording(2, noise=1.0))


@pytest.fixture(scope='session')
def columns_of(robot: Robot) -> Callable[..., SampleColumns]:
    """Return a function that records an arm, and returns the columns of its regressor."""

    def make(
        arm: SimulatedArm, periods: int = 2, noise: float = 0.0, **options: float
    ) -> SampleColumns:
        recording = arm.recording(1, noise, periods=periods)
        conditioner = Conditioner([recording], ConditioningOptions(**options))
        samples = conditioner.condition(recording, conditioner.candidates()[0])
        return SampleColumns(samples, Regressor(robot))

    return make


@pytest.fixture(scope='session')
def cad(robot: Robot) -> ArmParameters:
    """Parameters of the URDF, without rotors."""
    return ArmParameters.stated(robot, None)
