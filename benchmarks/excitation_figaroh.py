"""FIGAROH's excitation trajectories on the same arm, judged by the same figures.

Optional: needs figaroh and cyipopt (which builds against IPOPT: apt install
coinor-libipopt-dev libblas-dev liblapack-dev), for example in an environment of its own with
this checkout on PYTHONPATH. FIGAROH minimises the condition number of the base regressor along
cubic splines through waypoints with IPOPT and finite differences; the ground is not part of
its problem.
"""

import logging
import os
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import numpy as np  # noqa: E402

from aerarm_ros.description.arm_config import load_arm_config  # noqa: E402
from aerarm_ros.description.resources import resource  # noqa: E402
from aerarm_ros.description.robot import load_robot  # noqa: E402
from aerarm_ros.excitation.design_specification import DesignSpecification  # noqa: E402
from aerarm_ros.excitation.excitation_config import load_excitation_config  # noqa: E402
from aerarm_ros.excitation.excitation_setup import ExcitationSetup  # noqa: E402
from aerarm_ros.excitation.joint_reference import JointReference  # noqa: E402
from aerarm_ros.excitation.trajectory_designer import TrajectoryDesigner  # noqa: E402

SEGMENTS = 2  # of four intervals of 2 s each
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
    problem: {soft_lim: 0.05, max_iterations: 60}
    trajectory: {waypoints: 5, frequency: 20, segment_duration: 2.0}
"""


def figaroh_states(seed: int) -> tuple[JointReference, float]:
    """Return the states of FIGAROH's trajectory and the time it took [s]."""
    from figaroh.optimal.base_optimal_trajectory import (
        BaseOptimalTrajectory,
        BaseTrajectoryIPOPTProblem,
    )
    from figaroh.tools.robot import Robot

    class Generator(BaseOptimalTrajectory):
        def create_ipopt_problem(self, *arguments):
            return BaseTrajectoryIPOPTProblem(self, *arguments)

    np.random.seed(seed)  # noqa: NPY002 - FIGAROH draws from the global generator
    urdf = resource('urdf', 'aerarm.urdf')
    robot = Robot(str(urdf), str(urdf.parent))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'arm.yaml'
        path.write_text(CONFIG)
        joints = [f'joint{i}' for i in range(1, 5)]
        generator = Generator(robot, joints, str(path))
    generator.identif_config.update(act_idxv=[0, 1, 2, 3], act_idxq=[0, 1, 2, 3])
    generator.initialize()
    began = time.monotonic()
    result = generator.solve(stack_reps=SEGMENTS)
    seconds = time.monotonic() - began
    return JointReference(*(np.vstack(result[key]) for key in ('P_F', 'V_F', 'A_F'))), seconds


def main() -> int:
    try:
        import cyipopt  # noqa: F401
        import figaroh  # noqa: F401
    except ImportError as error:
        print(f'skipped: {error} (see the head of this file)')
        return 0
    logging.disable(logging.CRITICAL)
    arm, config = load_arm_config(), load_excitation_config()
    robot = load_robot(gravity_in_base=arm.gravity_in_base)
    setup = ExcitationSetup.of_arm(robot, arm, config)
    designer = TrajectoryDesigner(DesignSpecification(setup))
    states, seconds = figaroh_states(seed=0)
    quality = designer.quality(states)
    margin = min(setup.clearance.margin(q) for q in states.position)
    print(
        f'FIGAROH, {len(states.position) / 20.0:.0f} s of motion in {seconds:.1f} s: condition '
        f'(5.2) {quality.condition_number:.1f}, scaled {quality.scaled_condition_number:.1f}, '
        f'deviations e^{quality.log_deviation:.2f} a sample, clearance margin {margin:.3f} m'
    )
    began = time.monotonic()
    ours = min((designer.design(i) for i in range(4)), key=lambda r: r.quality.objective)
    print(
        f'this suite, 4 starts on one core in {time.monotonic() - began:.1f} s: condition (5.2) '
        f'{ours.quality.condition_number:.1f}, scaled {ours.quality.scaled_condition_number:.1f}, '
        f'deviations e^{ours.quality.log_deviation:.2f} a sample, every limit kept'
    )
    return 0


if __name__ == '__main__':
    sys.exit(main())
