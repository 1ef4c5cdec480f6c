"""Computing time, memory and accuracy of the identifier.

Speed: 20 s at 1 kHz with 4 joints, from an MCAP bag to the estimate, and as a whole process. The
bag contains all topics of the recorder: states, commands, motors, power, diagnostics.
Memory: the same process for recordings of 5 minutes and, with --long, 30 minutes.
Truth: an arm that deviates from its model is identified from one motion and compared on another; a
payload of 0.2 kg is identified as well.
Accuracy: the first 60 % of each measured bag are used for identification, the last 40 % are held
out (identification_peers.py). The measured bags are in the folder given by the variable
AERARM_DATASETS. Other tools are run on the same bags, unless --no-peers is given.
"""

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from aerarm_ros.realtime.scheduling import use_one_thread

use_one_thread()

import numpy as np
import yaml
from rosbags.typesys import Stores, get_typestore

from aerarm_msgs_py.bags.bag import RecordedMessage, RecordedTopic
from aerarm_msgs_py.bags.bag_writer import BagWriter
from aerarm_msgs_py.codecs.cdr import Float64ArrayCdr
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_ros.description.arm_config import ArmConfig, load_arm_config
from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.excitation.trajectory import FourierTrajectory
from aerarm_ros.identification.identify import IdentificationOptions, Stopwatch, identify
from aerarm_ros.identification.payload import identify_payload
from aerarm_ros.identification.recording.recording import JointMapping, Recording
from aerarm_ros.identification.truth import inertial_torque_errors, load_truth
from aerarm_ros.model.dynamics import Dynamics
from aerarm_ros.ros.programs.identifier_bags import IdentifierBags
from aerarm_ros.simulation.arm_plant import PlantParameters

RATE = 1000
PAYLOAD = 0.2  # [kg]
REPEATS = 7
DATASETS = os.environ.get('AERARM_DATASETS')
KIND = 'sensor_msgs/msg/JointState'
TOPICS = {
    '/joint_states': KIND,
    '/joint_command': KIND,
    '/motor_states': KIND,
    '/motor_power': 'std_msgs/msg/Float64MultiArray',
    '/diagnostics': 'diagnostic_msgs/msg/DiagnosticArray',
    '/arm_mode': 'std_msgs/msg/String',
}


def write_bag(
    path: Path, robot: Robot, plant: PlantParameters, seconds: float, seed: int = 1
) -> None:
    """Record a simulated motion with noise and friction."""
    random = np.random.default_rng(seed)
    series = random.uniform(-0.35, 0.35, (2, robot.n, 5))
    t = np.arange(0.0, seconds, 1.0 / RATE)
    q, dq, ddq = FourierTrajectory(0.1, np.array([0.0, np.pi / 2, 0.0, 0.0]), *series).evaluate(t)
    arm = robot.with_inertial_parameters(plant.inertial_parameters)
    dynamics = Dynamics(arm, plant.rotor_inertia)
    links = np.array([dynamics.inverse(*x) for x in zip(q, dq, ddq, strict=True)])
    dry = plant.coulomb + plant.load_friction * np.abs(links)
    tau = links + plant.viscous * dq + dry * np.sign(dq)
    tau += 0.05 * random.standard_normal(tau.shape)
    dq = dq + 0.01 * random.standard_normal(dq.shape)
    with BagWriter(path, [RecordedTopic(name, kind) for name, kind in TOPICS.items()]) as writer:
        for message in messages(robot, t, (q, dq, tau)):
            writer.write(message)


def messages(
    robot: Robot, t: np.ndarray, values: tuple[np.ndarray, ...]
) -> Iterator[RecordedMessage]:
    """Yield the messages that the recorder stores at 1 kHz, and diagnostics."""
    q, dq, tau = values
    joints, motors = JointStateCdr(robot.joint_names), JointStateCdr(robot.joint_names)
    power = Float64ArrayCdr(robot.n)
    diagnostics = diagnostics_payload()
    for k, nanoseconds in enumerate((t * 1e9).astype(np.int64).tolist()):
        stamp = 10**18 + nanoseconds
        payloads = (
            joints.pack(stamp, q[k], dq[k], tau[k]),
            joints.pack(stamp, None, dq[k], None),
            motors.pack(stamp, 9.0 * q[k], 9.0 * dq[k], tau[k] / 9.0),
            power.pack(tau[k] * dq[k]),
        )
        for topic, payload in enumerate(payloads):
            yield RecordedMessage(topic, payload, stamp + topic, stamp, k + 1)
        if k % 500 == 0:
            yield RecordedMessage(4, diagnostics, stamp + 9, stamp, k // 500 + 1)
        if k == 0:
            yield RecordedMessage(5, b'\0\1\0\0\x08\0\0\0running\0', stamp, stamp, 1)


def diagnostics_payload() -> bytes:
    """Return a DiagnosticArray of the size of the bridge's."""
    store = get_typestore(Stores.ROS2_JAZZY)
    types = store.types
    pair, status = (types[f'diagnostic_msgs/msg/{x}'] for x in ('KeyValue', 'DiagnosticStatus'))
    stamp = types['builtin_interfaces/msg/Time'](0, 0)
    values = [pair(f'quantity {i} [us]', '1000') for i in range(50)]
    arm = status(0, 'bridge: timing', '999.5 Hz', 'arm', [pair('missed cycles', '0'), *values])
    array = types['diagnostic_msgs/msg/DiagnosticArray']
    message = array(types['std_msgs/msg/Header'](stamp, ''), [arm])
    return bytes(store.serialize_cdr(message, array.__msgtype__))


def read(path: Path, robot: Robot) -> Recording:
    bags = IdentifierBags('/joint_states', robot.joint_names, JointMapping({}))
    return bags.read(path, path.name).recording


def bag_to_estimate(path: Path, robot: Robot, config: ArmConfig) -> tuple[float, float]:
    """Return wall and processor time [s] from the file to the estimates."""
    wall, cpu = time.perf_counter(), time.process_time()
    recording = read(path, robot)
    identify(robot, config, [recording], [], IdentificationOptions(), Stopwatch())
    return time.perf_counter() - wall, time.process_time() - cpu


def process(*arguments: object) -> tuple[float, float, float]:
    """Run the identifier; return wall and processor time [s] and peak memory [MB]."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    begin = time.perf_counter()
    command = [sys.executable, '-m', 'aerarm_ros.executables', 'identifier', *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True)
    wall = time.perf_counter() - begin
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise SystemExit(done.stderr)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return wall, cpu, after.ru_maxrss / 1024.0


def speed(folder: Path) -> None:
    robot, config = load_robot(), load_arm_config()
    bag = folder / 'bag'
    write_bag(bag, robot, PlantParameters.nominal(config, robot), 20.0)
    inside = [bag_to_estimate(bag, robot, config) for _ in range(REPEATS)]
    whole = [process('--bag', bag, '--out', folder / 'out') for _ in range(REPEATS)]
    print('20 s at 1 kHz, 4 joints          wall   processor  (medians of', REPEATS, 'runs)')
    for name, runs, goal in (('MCAP to estimate', inside, 0.3), ('whole process', whole, 1.5)):
        wall, cpu = (statistics.median(run[k] for run in runs) for k in (0, 1))
        print(f'{name:28s} {wall:7.3f} s {cpu:7.3f} s   goal {goal} s')
    print(f'{"peak memory":28s} {max(run[2] for run in whole):7.0f} MB            goal 300 MB')


def memory(folder: Path, minutes: Sequence[float]) -> None:
    print('\nLonger recordings                wall   processor   peak memory')
    robot = load_robot()
    for length in minutes:
        bag = folder / f'bag_{length}'
        write_bag(bag, robot, PlantParameters.nominal(load_arm_config(), robot), 60.0 * length)
        wall, cpu, peak = process('--bag', bag, '--out', folder / 'out')
        print(f'{length:3.0f} min at 1 kHz{"":14s} {wall:7.1f} s {cpu:7.1f} s {peak:10.0f} MB')


def truth(folder: Path) -> None:
    """Print the deviation of an identified arm from the truth, and of its payload."""
    robot, config = load_robot(), load_arm_config()
    plant = PlantParameters.nominal(config, robot).perturbed(3)
    carrying = plant.carrying(PAYLOAD, (0.1, 0.01, -0.02), 0.03)
    recordings = []
    for seed, made in ((1, plant), (2, plant), (3, carrying)):
        write_bag(folder / f'truth_{seed}', robot, made, 20.0, seed)
        recordings.append(read(folder / f'truth_{seed}', robot))
    first, second, loaded = recordings
    result = identify(robot, config, [first], [second], IdentificationOptions(), Stopwatch())
    estimate = result.recommended.estimate
    file = folder / 'truth.yaml'
    # Torques are written directly, without currents of deviating motors.
    document = plant.as_dict() | {'measured_per_true_torque': [1.0] * robot.n}
    file.write_text(yaml.safe_dump(document))
    (error,) = inertial_torque_errors(
        load_truth(file, estimate.model), [estimate], result.validation
    )
    payload = identify_payload(result, [loaded])
    deviation = 100.0 * abs(payload.mass / PAYLOAD - 1.0)
    consistent = 'yes' if estimate.physically_consistent else 'no'
    print('\nSimulated arm, 20 s at 1 kHz, validated on another motion')
    print(f'{"consistent, rank (goal 30)":28s} {consistent}, {result.thesis_base.rank}')
    print(f'{"inertial torque error":28s} {error.total:7.2f} %   goal 1 %')
    weighed = f'{payload.mass:7.4f} kg, off by {deviation:.1f} %'
    print(f'{f"payload of {PAYLOAD} kg":28s} {weighed}   goal 2 %')


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        '--long', action='store_true', help='also measure the memory for half an hour of motion'
    )
    parser.add_argument('--no-peers', action='store_true', help='do not compare with other tools')
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        speed(Path(folder))
        memory(Path(folder), (5, 30) if options.long else (5,))
        truth(Path(folder))
    # Local import, because the module uses this file's bags.
    from identification_peers import PEERS, compare_all

    compare_all(() if options.no_peers else PEERS)


if __name__ == '__main__':
    main()
