"""FIGAROH's trajectory generator on one arm; run by excitation_peers.py.

The generator minimizes the condition number of the base regressor along cubic splines through
waypoints, with IPOPT and finite differences, within the URDF's limits of position, velocity and
torque. The ground is not included. Usage: excitation_figaroh.py ARM.urdf SEED STATES.npz
"""

import json
import logging
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from figaroh.optimal.base_optimal_trajectory import (
    BaseOptimalTrajectory,
    BaseTrajectoryIPOPTProblem,
)
from figaroh.tools.robot import Robot

JOINTS = ['joint1', 'joint2', 'joint3', 'joint4']
SEGMENTS = 2
SEGMENT_DURATION = 8.0  # [s] for five waypoints, 2 s apart
CONFIG = """
schema_version: "2.0"
robot:
  name: aerarm
  properties:
    joints:
      active_joints: [joint1, joint2, joint3, joint4]
      joint_limits: {position: [], velocity: [], acceleration: [], torque: []}
    mechanics:
      friction_coefficients: {viscous: [0, 0, 0, 0], static: [0, 0, 0, 0]}
      actuator_inertias: [0, 0, 0, 0]
      joint_offsets: [0, 0, 0, 0]
      reduction_ratios: [1, 1, 1, 1]
    coupling: {has_coupled_wrist: false}
tasks:
  identification:
    type: identification
    enabled: true
    problem:
      use_joint_torques: true
      model_components: {friction: true, actuator_inertia: false, joint_offset: false}
    signal_processing: {sampling_frequency: 100.0, cutoff_frequency: 10.0}
  optimal_trajectory:
    type: optimal_trajectory
    enabled: true
    # Its default of 200 iterations takes minutes, and ended infeasible with seed 0.
    problem: {soft_lim: 0.05, max_iterations: 60, segment_attempts: 5}
    trajectory: {waypoints: 5, frequency: 20, segment_duration: 2.0}
"""


class Generator(BaseOptimalTrajectory):
    """FIGAROH's generator with a problem adapted to the robot, as in its examples."""

    def create_ipopt_problem(self, *arguments) -> BaseTrajectoryIPOPTProblem:
        """Return the problem for IPOPT."""
        return BaseTrajectoryIPOPTProblem(self, *arguments)


def make_generator(urdf: Path) -> Generator:
    robot = Robot(str(urdf), str(urdf.parent))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'arm.yaml'
        path.write_text(CONFIG)
        generator = Generator(robot, JOINTS, str(path))
    generator.identif_config.update(act_idxv=[0, 1, 2, 3], act_idxq=[0, 1, 2, 3])
    generator.initialize()
    return generator


def main() -> None:
    logging.disable(logging.CRITICAL)
    urdf, seed, out = sys.argv[1:]
    np.random.seed(int(seed))  # noqa: NPY002 - FIGAROH draws from the global generator
    generator = make_generator(Path(urdf))
    began = time.monotonic()
    result = generator.solve(stack_reps=SEGMENTS)
    seconds = time.monotonic() - began
    segments = len(result['P_F'])
    if segments < SEGMENTS:
        sys.exit(f'IPOPT found no feasible trajectory for segment {segments + 1} of {SEGMENTS}')
    names = {'q': 'P_F', 'dq': 'V_F', 'ddq': 'A_F'}
    np.savez(out, **{name: np.vstack(result[key]) for name, key in names.items()})
    print(json.dumps({'seconds': seconds, 'duration': SEGMENTS * SEGMENT_DURATION}))


if __name__ == '__main__':
    main()
