"""Identified URDF of an emulated arm's excitation, in virtual time."""

from pathlib import Path

import numpy as np

from aerarm_ros.description.arm_config import ArmConfig, load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.excitation.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.player import ExcitationPlayer, VelocityLaw
from aerarm_ros.excitation.settings import load_excitation_config
from aerarm_ros.excitation.trajectory import FourierTrajectory
from aerarm_ros.hardware.bridge_cycle import BridgeCycle
from aerarm_ros.hardware.emulation.emulated_motor import AlignmentTiming
from aerarm_ros.hardware.emulation.emulation import make_emulated_transport
from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings
from aerarm_ros.hardware.gate.command_intake import OfferedCommand
from aerarm_ros.identification.identify import IdentificationOptions, Stopwatch, identify
from aerarm_ros.identification.recording.recording import Recording
from aerarm_ros.ros.library.identification import IdentifiedArm
from aerarm_ros.simulation.arm_plant import PlantParameters

CYCLE = 1e-3
QUICK = AlignmentTiming(forward=0.25, reverse=0.25, hold=0.1)


def identified_urdf_file(truth: PlantParameters, seed: int, folder: Path) -> Path:
    """Excite an arm made of `truth`, identify it and return the path of its identified.urdf.

    Parameters
    ----------
    truth
        True parameters of the arm.
    seed
        Seed of the excitation and of the boards' noise.
    folder
        Folder for the identifier's files.
    """
    config = load_arm_config()
    robot = load_robot(joint_names=config.joint_names)
    setup = ExcitationSetup.of_arm(robot, config, load_excitation_config())
    trajectory, _ = setup.random_trajectory(0.35, 0.1, 5).draw_feasible(
        seed, setup.checker, setup.config.ramp_time
    )
    recording = excited('excitation', setup, config, trajectory, seed, truth)
    result = identify(robot, config, [recording], [], IdentificationOptions(), Stopwatch())
    return IdentifiedArm(result, {}).save(folder) / 'identified.urdf'


def excited(
    name: str,
    setup: ExcitationSetup,
    config: ArmConfig,
    trajectory: FourierTrajectory,
    seed: int,
    truth: PlantParameters | None = None,
    periods: int = 1,
) -> Recording:
    """Return the recording of an emulated arm that plays a trajectory in virtual time."""
    config, robot = config.with_encoders('absolute'), setup.robot
    transport = make_emulated_transport(config, robot, seed, parameters=truth, alignment=QUICK)
    bridge = BridgeCycle(config, transport, BridgeSettings(stall_time=60.0), robot=robot)
    transport.open()
    now = 0.0
    while bridge.mode != 'ready':
        bridge.update(now)
        if bridge.mode == 'idle':
            bridge.enable()
        now += CYCLE
    motion = setup.planner.plan(trajectory, periods, bridge.q.copy(), go_back=False)
    player = ExcitationPlayer(motion, VelocityLaw(1.0), setup.stops)
    rows = []
    while not player.done:
        rows.append((now, bridge.q.copy(), bridge.dq.copy(), bridge.tau.copy()))
        command = player.update(round(now * 1e9), rows[-1][1])
        now += CYCLE
        bridge.command(OfferedCommand(config.joint_names, *command, CYCLE, name), now)
        bridge.update(now)
        if bridge.mode != 'running' or player.fault:
            raise RuntimeError(f'{name}: the arm is {bridge.mode}: {bridge.faults} {player.fault}')
    stamp, q, dq, tau = map(np.array, zip(*rows, strict=True))
    names = tuple(config.joint_names)
    return Recording(name, names, stamp - stamp[0], q, dq, tau, np.zeros(len(names), dtype=bool))
