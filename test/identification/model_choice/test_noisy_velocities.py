"""A seven-joint arm at 1 kHz with noisy, quantised velocities, validated on a faster motion."""

from importlib.metadata import files
from pathlib import Path

import numpy as np
import pytest

from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.identification.conditioning.motion_check import ConditioningOptions
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.identify import IdentificationOptions, Stopwatch, identify
from aerarm_ros.identification.recording.recording import Recording
from aerarm_ros.model.dynamics import Dynamics

POSTURE = np.array([0.0, -0.3, 0.0, -1.8, 0.0, 1.6, 0.8])
# No period fits these harmonics, so that only a low-pass can be used.
HARMONICS = np.array([1.13, 2.29, 3.41, 4.17, 5.37])
FINGERS = ('panda_finger_joint1', 'panda_finger_joint2')


@pytest.fixture(scope='module')
def panda() -> Robot:
    urdf = next(f for f in files('example-robot-data') or () if f.name == 'panda.urdf')
    return load_robot(Path(str(urdf.locate())), locked=FINGERS)


def record(panda: Robot, fundamental: float, seconds: float, seed: int) -> Recording:
    """Record an arm whose links differ from the drawing by up to 15 %."""
    random = np.random.default_rng(seed)
    alpha, beta = random.uniform(-0.35, 0.35, (2, 7, 5)) / np.sqrt(np.arange(1, 6))
    t = np.arange(0.0, seconds, 1e-3)
    omega = 2.0 * np.pi * fundamental * HARMONICS
    s, c = np.sin(np.outer(t, omega)), np.cos(np.outer(t, omega))
    q = POSTURE + s @ alpha.T + c @ beta.T
    dq = (c * omega) @ alpha.T - (s * omega) @ beta.T
    ddq = -(s * omega**2) @ alpha.T - (c * omega**2) @ beta.T
    scale = 1.0 + 0.15 * np.random.default_rng(1).uniform(-1.0, 1.0, (7, 1))
    arm = panda.with_inertial_parameters(panda.inertial_parameters * scale)
    dynamics = Dynamics(arm, np.full(7, 0.2))
    links = np.array([dynamics.inverse(*state) for state in zip(q, dq, ddq, strict=True)])
    tau = links + 0.6 * dq + (0.3 + 0.02 * np.abs(links)) * np.tanh(dq / 0.02)
    noise, steps = np.zeros_like(dq), 0.03 * random.standard_normal(dq.shape)
    for k in range(1, len(noise)):
        noise[k] = 0.95 * noise[k - 1] + steps[k]
    return Recording(
        name=f'seed {seed}',
        joint_names=panda.joint_names,
        time=t,
        q=q + 1e-3 * random.standard_normal(q.shape),
        dq=np.round((dq + noise) / 0.01) * 0.01,
        tau=tau + 0.3 * random.standard_normal(tau.shape),
        dead_effort=np.zeros(7, dtype=bool),
    )


@pytest.mark.parametrize('seed', [1, 3])
def test_the_chosen_cutoff_predicts_faster_motion(panda: Robot, seed: int) -> None:
    """Noise of the velocities sets no band. Ten times a band of 65 Hz predicts 4 times worse."""
    slow, fast = record(panda, 0.05, 25.0, seed), record(panda, 0.2, 15.0, seed + 1)

    def run(cutoff: float | None) -> IdentificationResult:
        conditioning = ConditioningOptions(cutoff=cutoff)
        options = IdentificationOptions(conditioning=conditioning)
        return identify(panda, None, [slow], [fast], options, Stopwatch())

    chosen, by_hand, high = run(None), run(3.0), run(10.0)
    by_band = run(10.0 * chosen.conditioner.band)
    errors = [r.recommended.validation[0] for r in (chosen, by_hand, high, by_band)]
    assert chosen.conditioner.band < 0.5
    assert errors[0].filtered < 1.1 * errors[1].filtered
    assert errors[0].raw < 1.1 * errors[1].raw
    assert errors[0].raw < 0.5 * errors[2].raw
    assert errors[0].raw <= errors[3].raw * (1.0 + 1e-9)
