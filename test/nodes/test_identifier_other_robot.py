"""An arm that is not this package's: a Panda with locked fingers, from URDF and bag alone."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from identifier_process import heavier, identifier, measured, motion, write_bag

from aerarm_ros.description.robot import load_robot
from aerarm_ros.model.dynamics import Dynamics
from aerarm_ros.model.inertia import is_physically_consistent

FINGERS = ('panda_finger_joint1', 'panda_finger_joint2')


def test_other_motions_are_predicted_also_from_the_identified_urdf(
    example_urdf: Callable[[str], Path], tmp_path: Path
) -> None:
    """The joints of the bags have other names, and the bags contain a gripper besides."""
    urdf = example_urdf('panda.urdf')
    robot = load_robot(urdf, locked=FINGERS)
    middle = 0.5 * (robot.position_min + robot.position_max)
    names = (*(f'fer_joint{i}' for i in range(1, 8)), 'gripper')
    for seed, name in ((1, 'identification'), (2, 'validation')):
        stamp, q, dq, ddq = motion(seed, middle, 0.12, 100.0)
        fields = (q, dq, measured(robot, q, dq, ddq))
        write_bag(tmp_path / name, stamp, tuple(np.pad(x, ((0, 0), (0, 1))) for x in fields), names)
    done = identifier(
        *('--bag', tmp_path / 'identification', '--validation', tmp_path / 'validation'),
        *('--urdf', urdf, '--lock', *FINGERS, '--ignore', 'gripper', '--out', tmp_path / 'out'),
        *('--rename', *(f'fer_joint{i}=panda_joint{i}' for i in range(1, 8))),
    )
    assert done.returncode == 0, done.stderr
    solvers = json.loads((tmp_path / 'out' / 'summary.json').read_text())['solvers']
    sdp, cad = (solvers[name]['validation'][0]['filtered'] for name in ('sdp', 'cad'))
    assert solvers['sdp']['physically_consistent']
    assert sdp < 1.0
    assert sdp < 0.1 * cad
    identified = load_robot(tmp_path / 'out' / 'identified.urdf', locked=FINGERS)
    assert identified.joint_names == robot.joint_names
    assert is_physically_consistent(identified.inertial_parameters)
    assert identified.coulomb == pytest.approx(np.full(7, 0.2), rel=0.2)
    # The weight is predicted too, without friction and rotors.
    postures = motion(4, middle, 0.12, 100.0)[1]
    real, found, drawn = (
        np.array([dynamics.gravity(q) for q in postures])
        for dynamics in map(Dynamics, (heavier(robot), identified, robot))
    )
    error, before = (np.linalg.norm(x - real) / np.linalg.norm(real) for x in (found, drawn))
    assert error < 0.01
    assert error < 0.2 * before
