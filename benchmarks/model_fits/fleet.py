"""Identification of a fleet: 200 bags of ten arms, with one worker killed during the run.

Usage: python benchmarks/model_fits/fleet.py [--folder output/fleet] [--bags 200] [--workers 2]

The benchmark writes bags of simulated arms with realistic deviations (rigid links, rotors,
friction, noise). The friction of joint 2 of arm3 grows from month to month, and the last link of
arm7 carries 60 g. Then it runs `identifier --each`, kills one worker after a third of the rows, and
prints time, memory and the findings of the page.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pinocchio as pin

from aerarm_msgs_py.bags.bag import RecordedMessage, RecordedTopic
from aerarm_msgs_py.bags.bag_writer import BagWriter
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.excitation.trajectory import FourierTrajectory

_ARMS = 10
_RATE, _SECONDS, _F0, _HARMONICS = 100.0, 20.0, 0.1, 5
_MONTH = 30 * 86400
_FIRST = 1_767_225_600  # 2026-01-01
_DRIFT, _LOADED = 3, 7
_POINT = np.array([1.0, 0.08, 0, 0, 0, 0, 0.0064, 0, 0, 0.0064])  # a mass 80 mm along link 4


def main() -> int:
    """Create missing bags, and identify from all bags."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--folder', type=Path, default=Path('output/fleet'))
    parser.add_argument('--bags', type=int, default=200)
    parser.add_argument('--workers', type=int, default=2)
    options = parser.parse_args()
    robot = load_robot()
    bags = options.folder / 'bags'
    for number in range(options.bags):
        month, arm = divmod(number, _ARMS)
        path = bags / f'arm{arm}' / f'month{month:02d}'
        if not path.exists():
            write_bag(path, robot, arm, month)
    return identify(bags, options.folder / 'result', options.bags, options.workers)


def write_bag(path: Path, robot: Robot, arm: int, month: int) -> None:
    """Write the joint states of one arm's excitation in one month."""
    built, recorded = np.random.default_rng(arm), np.random.default_rng([arm, month])
    inertial = np.array(robot.inertial_parameters) * built.normal(1.05, 0.02, (robot.n, 1))
    if arm == _LOADED:
        inertial[-1] += 0.06 * _POINT
    coulomb = np.array(robot.coulomb) * built.normal(1.0, 0.03, robot.n)
    if arm == _DRIFT:
        coulomb[1] *= 1.0 + 0.03 * month
    rotor = 0.012 * built.normal(1.0, 0.02, robot.n)
    t = np.arange(0.0, _SECONDS, 1.0 / _RATE)
    series = recorded.uniform(-0.35, 0.35, (2, robot.n, _HARMONICS))
    q, dq, ddq = FourierTrajectory(_F0, np.array([0.0, np.pi / 2, 0.0, 0.0]), *series).evaluate(t)
    model = robot.with_inertial_parameters(inertial).model
    data = model.createData()
    tau = np.array([pin.rnea(model, data, *row) for row in zip(q, dq, ddq, strict=True)])
    tau += rotor * ddq + robot.viscous * dq + coulomb * np.sign(dq)
    tau += 0.03 * recorded.standard_normal(tau.shape)
    q = q + 2e-5 * recorded.standard_normal(q.shape)
    dq = dq + 0.005 * recorded.standard_normal(dq.shape)
    path.parent.mkdir(parents=True, exist_ok=True)
    codec = JointStateCdr(robot.joint_names)
    topic = RecordedTopic('/joint_states', 'sensor_msgs/msg/JointState')
    with BagWriter(path, [topic]) as writer:
        for number, row in enumerate(zip(t, q, dq, tau, strict=True), 1):
            stamp = round((_FIRST + _MONTH * month + row[0]) * 1e9)
            payload = bytes(codec.pack(stamp, *row[1:]))
            writer.write(RecordedMessage(0, payload, stamp, stamp, number))


def identify(bags: Path, out: Path, count: int, workers: int) -> int:
    """Run the identifier, kill one worker, and print the result."""
    command = [sys.executable, '-m', 'aerarm_ros.executables', 'identifier', '--each', str(bags)]
    command += ['--workers', str(workers), '--holdout', '0.3', '--out', str(out)]
    begin, killed, most = time.monotonic(), 0, 0.0
    with subprocess.Popen(command) as process:
        while process.poll() is None:
            time.sleep(0.5)
            children = _children(process.pid)
            most = max([most, *(_memory(child) for child in children)])
            if not killed and _rows(out) >= count // 3 and children:
                killed = children[-1]
                os.kill(killed, signal.SIGKILL)
    seconds = time.monotonic() - begin
    entries = [json.loads(line)['row'] for line in (out / 'rows.jsonl').read_text().splitlines()]
    good = [row for row in entries if row['status'] == 'ok']
    errors = [row['validation_sdp_filtered'] for row in good]
    print(f'{len(good)} of {count} bags identified, {len(entries)} rows, {seconds:.0f} s')
    print(f'worker {killed} was killed; largest memory of a process {most:.0f} MB')
    print(f'validation error: median {np.median(errors):.2f} %, largest {max(errors):.2f} %')
    return process.returncode


def _rows(out: Path) -> int:
    path = out / 'rows.jsonl'
    return path.read_text().count('\n') if path.is_file() else 0


def _children(parent: int) -> list[int]:
    """Return the worker processes of a process."""
    found = []
    for folder in Path('/proc').glob('[0-9]*'):
        try:
            own = (folder / 'stat').read_text().rpartition(')')[2].split()[1]
            is_worker = b'spawn_main' in (folder / 'cmdline').read_bytes()
        except OSError:
            continue
        if int(own) == parent and is_worker:
            found.append(int(folder.name))
    return sorted(found)


def _memory(process: int) -> float:
    """Return the resident memory of a process [MB], 0 if it has ended."""
    try:
        lines = Path(f'/proc/{process}/status').read_text().splitlines()
    except OSError:
        return 0.0
    return next((float(line.split()[1]) / 1e3 for line in lines if line.startswith('VmHWM')), 0.0)


if __name__ == '__main__':
    sys.exit(main())
