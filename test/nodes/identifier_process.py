"""Runs of the identifier as a process, and bags for it written by another library."""

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from forked_executable import run
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from aerarm_ros.description.robot import Robot
from aerarm_ros.excitation.trajectory import FourierTrajectory
from aerarm_ros.model.dynamics import Dynamics
from aerarm_ros.model.inertia import from_pseudo_inertia, pseudo_inertia

RATE = 200.0
JOINTS = ('joint1', 'joint2', 'joint3', 'joint4')
STORE = get_typestore(Stores.ROS2_JAZZY)


def write_bag(
    path: Path,
    stamp: np.ndarray,
    fields: tuple[np.ndarray, ...],
    names: tuple[str, ...] = JOINTS,
    topic: str = '/joint_states',
    desired: np.ndarray | None = None,
) -> Path:
    """Write a bag with a library that the identifier does not use."""
    state, header, when = (
        STORE.types[name]
        for name in (
            'sensor_msgs/msg/JointState',
            'std_msgs/msg/Header',
            'builtin_interfaces/msg/Time',
        )
    )
    nothing = np.zeros(0)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        states = writer.add_connection(topic, state.__msgtype__, typestore=STORE)
        commands = writer.add_connection('/joint_command', state.__msgtype__, typestore=STORE)
        for k, t in enumerate(stamp):
            nanoseconds = round(t * 1e9)
            time_of = when(nanoseconds // 10**9, nanoseconds % 10**9)
            message = state(header(time_of, ''), list(names), *(field[k] for field in fields))
            data = STORE.serialize_cdr(message, state.__msgtype__)
            # Reception is regular even if stamps are not.
            writer.write(states, 10**12 + round(1e9 * k / RATE), data)
            if desired is not None:
                command = state(header(time_of, ''), list(names), nothing, desired[k], nothing)
                data = STORE.serialize_cdr(command, state.__msgtype__)
                writer.write(commands, 10**12 + round(1e9 * k / RATE), data)
    return path


def motion(
    seed: int,
    centre: Sequence[float] = (0.0, np.pi / 2, 0.0, 0.0),
    size: float = 0.35,
    rate: float = RATE,
) -> tuple[np.ndarray, ...]:
    """Return stamps, and q, dq, ddq over two periods of 10 s."""
    random = np.random.default_rng(seed)
    alpha, beta = random.uniform(-size, size, (2, len(centre), 5))
    t = np.arange(0.0, 20.0, 1.0 / rate)
    return 1.7e9 + t, *FourierTrajectory(0.1, np.array(centre), alpha, beta).evaluate(t)


def heavier(robot: Robot) -> Robot:
    """Return an arm whose links are denser than in its URDF, and shifted."""
    shift = np.eye(4)
    shift[:3, 3] = 0.008
    matter = 1.2 * shift @ pseudo_inertia(robot.inertial_parameters) @ shift.T
    return robot.with_inertial_parameters(from_pseudo_inertia(matter))


def measured(robot: Robot, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
    """Return torques of an arm that is heavier than its URDF and has rotors and friction."""
    dynamics = Dynamics(heavier(robot), 0.015)
    links = np.array([dynamics.inverse(*x) for x in zip(q, dq, ddq, strict=True)])
    noise = 0.03 * np.random.default_rng(0).standard_normal(q.shape)
    return links + 0.01 * dq + 0.2 * np.sign(dq) + noise


def identifier(*arguments: object) -> subprocess.CompletedProcess[str]:
    return run('identifier', *arguments)


def fresh_identifier(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run the identifier in a new interpreter with other hash values."""
    command = [sys.executable, '-m', 'aerarm_ros.executables', 'identifier', *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120)


def write_bags(folder: Path, robot: Robot) -> None:
    """Write an identification and a validation bag into a directory."""
    for seed, name in ((1, 'identification'), (2, 'validation')):
        stamp, q, dq, ddq = motion(seed)
        write_bag(folder / name, stamp, (q, dq, measured(robot, q, dq, ddq)), desired=dq)
