"""An arm that is not this package's: a Panda with locked fingers, from URDF and bag alone."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from identifier_process import identifier, write_bag
from other_bodies import other_bodies

from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.model.inertia import is_physically_consistent

FINGERS = ('panda_finger_joint1', 'panda_finger_joint2')
RATE = 100.0
F0, HARMONICS, PERIODS = 0.1, 5, 2


@pytest.fixture(scope='module')
def urdf(example_urdf: Callable[[str], Path]) -> Path:
    return example_urdf('panda.urdf')


@pytest.fixture(scope='module')
def robot(urdf: Path) -> Robot:
    return load_robot(urdf, locked=FINGERS)


def real_arm(robot: Robot) -> pin.Model:
    """The arm as built: every link's matter is denser, shifted and stretched a little."""
    random = np.random.default_rng(3)
    bodies = other_bodies(robot.inertial_parameters, random, stretch=0.05, density=0.15)
    return robot.with_inertial_parameters(bodies).model


def states(robot: Robot, seed: int) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
    """Return stamps, and noisy position, velocity and effort."""
    random = np.random.default_rng(seed)
    alpha, beta = random.uniform(-0.12, 0.12, (2, robot.n, HARMONICS))
    omega = 2.0 * np.pi * F0 * np.arange(1, HARMONICS + 1)
    t = np.arange(0.0, PERIODS / F0, 1.0 / RATE)
    s, c = np.sin(np.outer(t, omega)), np.cos(np.outer(t, omega))
    q = 0.5 * (robot.position_min + robot.position_max) + s @ alpha.T + c @ beta.T
    dq = (c * omega) @ alpha.T - (s * omega) @ beta.T
    ddq = -(s * omega**2) @ alpha.T - (c * omega**2) @ beta.T
    model = real_arm(robot)
    data = model.createData()
    links = np.array([pin.rnea(model, data, *x) for x in zip(q, dq, ddq, strict=True)])
    rotors = 0.1 * ddq
    friction = 0.4 * dq + 0.3 * np.sign(dq)
    noise = [size * random.standard_normal(q.shape) for size in (2e-5, 2e-3, 0.05)]
    fields = (q + noise[0], dq + noise[1], links + rotors + friction + noise[2])
    return 1.7e9 + t, fields


@pytest.fixture
def result(robot: Robot, urdf: Path, tmp_path: Path) -> Path:
    """Result folder of a run on bags whose joints have other names, and fingers besides."""
    folder = tmp_path
    names = (*(f'fer_joint{i}' for i in range(1, 8)), 'gripper')
    for seed, name in ((1, 'identification'), (2, 'validation')):
        stamp, fields = states(robot, seed)
        padded = tuple(np.pad(field, ((0, 0), (0, 1))) for field in fields)
        write_bag(folder / name, stamp, padded, names)
    done = identifier(
        *('--bag', folder / 'identification', '--validation', folder / 'validation'),
        *('--urdf', urdf, '--lock', *FINGERS, '--ignore', 'gripper', '--out', folder / 'out'),
        *('--rename', *(f'fer_joint{i}=panda_joint{i}' for i in range(1, 8))),
    )
    assert done.returncode == 0, done.stderr
    return folder / 'out'


def test_other_motions_are_predicted_also_from_the_identified_urdf(
    result: Path, robot: Robot
) -> None:
    """The second prediction is without friction and rotors."""
    solvers = json.loads((result / 'summary.json').read_text())['solvers']
    sdp, cad = (solvers[name]['validation'][0]['filtered'] for name in ('sdp', 'cad'))
    assert solvers['sdp']['physically_consistent']
    assert sdp < 1.0
    assert sdp < 0.1 * cad
    identified = load_robot(result / 'identified.urdf', locked=FINGERS)
    assert identified.joint_names == robot.joint_names
    assert is_physically_consistent(identified.inertial_parameters)
    _, (q, dq, _) = states(robot, 4)
    still = np.zeros_like(dq)
    real, found, drawn = (
        np.array(
            [pin.rnea(model, model.createData(), *x) for x in zip(q, still, still, strict=True)]
        )
        for model in (real_arm(robot), identified.model, robot.model)
    )
    error, before = (np.linalg.norm(x - real) / np.linalg.norm(real) for x in (found, drawn))
    assert error < 0.01
    assert error < 0.2 * before
    assert identified.coulomb == pytest.approx(np.full(7, 0.3), rel=0.2)
