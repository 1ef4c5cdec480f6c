"""An excitation of the emulated arm, recorded into a bag."""

from pathlib import Path

import numpy as np
from emulated_arm import EmulatedArm

from aerarm_msgs_py.bags.bag import RecordedMessage, RecordedTopic
from aerarm_msgs_py.bags.bag_writer import BagWriter
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.excitation.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.settings import load_excitation_config
from aerarm_ros.simulation.arm_plant import PlantParameters


def record_excitation(path: Path, truth: PlantParameters, seed: int, periods: int = 2) -> None:
    """Play a random trajectory on an arm with the parameters `truth`; record joint_states."""
    config = load_arm_config()
    robot = load_robot(joint_names=config.joint_names)
    setup = ExcitationSetup.of_arm(robot, config, load_excitation_config())
    trajectory, _ = setup.random_trajectory(0.35, 0.1, 5).draw_feasible(
        seed, setup.checker, setup.config.ramp_time
    )
    arm = EmulatedArm(config, robot, truth, np.array(config.rest_position), seed)
    motion = setup.planner.plan(trajectory, periods, arm.posture, go_back=False)
    codec = JointStateCdr(config.joint_names)
    topic = RecordedTopic('/joint_states', 'sensor_msgs/msg/JointState')
    with BagWriter(path, [topic]) as writer:
        for number, state in enumerate(arm.play(motion), 1):
            payload = bytes(codec.pack(state.stamp_ns, state.q, state.dq, state.tau))
            writer.write(RecordedMessage(0, payload, state.stamp_ns, state.stamp_ns, number))
