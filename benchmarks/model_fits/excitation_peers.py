"""Trajectory of FIGAROH's generator for the packaged arm, evaluated like those of this suite.

It runs in a separate virtual environment, see peers/peer.py. pip builds cyipopt there, which
requires IPOPT on the machine; without IPOPT a line names the packages to install.
"""

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import numpy as np
from peers.peer import Peer

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.resources import resource
from aerarm_ros.description.robot import load_robot
from aerarm_ros.excitation.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.settings import load_excitation_config
from aerarm_ros.excitation.trajectory_designer import (
    DesignSpecification,
    Quality,
    TrajectoryDesigner,
)
from aerarm_ros.motion.signals import JointReference

FIGAROH = Peer(
    'FIGAROH',
    ('figaroh', 'cyipopt'),
    ('figaroh', 'cyipopt'),
    'excitation_figaroh.py',
    library='ipopt',
    library_package='coinor-libipopt-dev',
)
SEED = 0
STARTS = 4


def judge_figaroh(designer: TrajectoryDesigner, random: Quality) -> None:
    """Print the quality of FIGAROH's trajectory, and its use of the arm's limits."""
    setup = designer.specification.setup
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'states.npz'
        found = FIGAROH.run(resource('urdf', 'aerarm.urdf'), SEED, path)
        if 'skipped' in found:
            print(f'FIGAROH left out: {found["skipped"]}')
            return
        with np.load(path) as arrays:
            states = JointReference(*(arrays[name] for name in JointReference._fields))
    print(
        f'FIGAROH, {found["duration"]:.0f} s of motion in {found["seconds"]:.1f} s on one core: '
        f'{figures(designer.quality(states), random)}, {demands(setup, states)}'
    )


def demands(setup: ExcitationSetup, states: JointReference) -> str:
    """Return the largest fraction of each limit used by a motion, and its clearance."""
    limits, effort = setup.limits, setup.effort_model.effort(*states)
    shares = {
        'velocity': states.dq / limits.velocity,
        'acceleration': states.ddq / limits.acceleration,
        'torque': effort / limits.effort,
        'current': setup.effort_model.current(effort) / limits.current,
    }
    text = ', '.join(f'{100 * np.abs(share).max():.0f} % of {k}' for k, share in shares.items())
    margin = min(setup.clearance.margin(q) for q in states.q)
    return f'{text}, {margin:+.3f} m beyond the required clearances'


def figures(quality: Quality, random: Quality) -> str:
    return (
        f'condition (5.2) {quality.condition_number:.1f}, '
        f'scaled {quality.scaled_condition_number:.1f}, '
        f'{quality.compared_with(random, "a random trajectory")} with as many samples'
    )


def main() -> int:
    arm, config = load_arm_config(), load_excitation_config()
    robot = load_robot(gravity_in_base=arm.gravity_in_base)
    setup = ExcitationSetup.of_arm(robot, arm, config)
    designer = TrajectoryDesigner(DesignSpecification(setup))
    random = designer.initial(0).quality
    judge_figaroh(designer, random)
    began = time.monotonic()
    results = [designer.design(start) for start in range(STARTS)]
    seconds = time.monotonic() - began
    best = min(results, key=lambda result: result.quality.objective)
    states = designer.states(best.trajectory)
    print(
        f'this suite, {best.trajectory.period:.0f} s of motion, {STARTS} starts in {seconds:.1f} s '
        f'on one core: {figures(best.quality, random)}, {demands(setup, states)}'
    )
    return 0


if __name__ == '__main__':
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    sys.exit(main())
