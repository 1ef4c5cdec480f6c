"""Send two stop signals to a node; as a program, a campaign of such ends at random times.

python test/nodes/asked_twice.py --tries 1000
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from aerarm_ros.description.resources import resource
from aerarm_ros.ros.process.node_process import ros_environment

# As installed commands do.
COMMAND = 'import sys; from aerarm_ros.executables import {0}; sys.exit({0}())'
# A delayed host stretches the gap between signals; this setting still counts them as one.
_DEAF = 'import aerarm_ros.ros.process.process_end as s; s._SAME = 3600.0; '
PATIENCE = 120.0  # [s]
LONGEST_START = 4.0  # [s] after which a node works on an idle machine
LONGEST_GAP = 0.5  # [s]

# Nodes that run until stopped, with their required arguments.
SERVING: Mapping[str, Sequence[str]] = {
    'fake_hardware': (),
    'hardware_bridge': ('-p', 'autostart:=false'),
    'computed_torque': (),
    'gravity_compensation': (),
    'impedance_control': (),
    'kinematic_control': (),
    'world_control': (),
    'base_reaction': (),
    'motion_planner': (),
    'payload_estimator': (),
    'flight_control': ('-p', f'drone_file:={resource("config", "drone.yaml")}'),
    'recorder': ('-p', 'bag:={folder}/bag'),
    'tool_path': (),
    'view': ('-p', 'port:={port}'),
}


@dataclass(frozen=True)
class Ended:
    """End of a node: exit status, standard error, and the signals sent."""

    node: str
    status: int
    said: str
    first: float
    gap: float

    @property
    def is_clean(self) -> bool:
        return self.status == 0 and 'Traceback' not in self.said and 'rror' not in self.said


def ask_twice(
    node: str,
    arguments: Sequence[str],
    first: float,
    gap: float,
    number: signal.Signals = signal.SIGINT,
    environment: Mapping[str, str] | None = None,
) -> Ended:
    """Start a node; send a signal `first` [s] after it can be stopped, and one `gap` [s] later."""
    command = [sys.executable, '-c', _DEAF + COMMAND.format(node), '--ros-args', *arguments]
    with subprocess.Popen(
        command,
        env=ros_environment(environment),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        deadline = time.monotonic() + PATIENCE
        while not catches(process.pid, signal.SIGHUP) and time.monotonic() < deadline:
            time.sleep(0.001)
        time.sleep(first)
        for pause in (gap, 0.0):
            process.send_signal(number)
            time.sleep(pause)
        try:
            _, said = process.communicate(timeout=PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
            _, said = process.communicate()
    return Ended(node, process.returncode, said, first, gap)


def catches(pid: int, number: signal.Signals) -> bool:
    """Return whether a process has its own handler for a signal."""
    for line in Path(f'/proc/{pid}/status').read_text().splitlines():
        if line.startswith('SigCgt:'):
            return bool(int(line.split()[1], 16) & 1 << number - 1)
    return False


def _try(index: int, folder: Path, seed: int) -> Ended:
    chance = random.Random(f'{seed} {index}')
    node = list(SERVING)[index % len(SERVING)]
    given = [part.format(folder=folder / str(index), port=9000 + index) for part in SERVING[node]]
    (folder / str(index)).mkdir(parents=True)
    # Half of them at work, half at any time of the start.
    first = LONGEST_START if chance.random() < 0.5 else chance.uniform(0.0, LONGEST_START)
    number = chance.choice([signal.SIGINT, signal.SIGINT, signal.SIGTERM])
    domain = {'ROS_DOMAIN_ID': str(1 + index % 100)}
    return ask_twice(node, given, first, chance.uniform(0.0, LONGEST_GAP), number, domain)


def main() -> int:
    """Stop nodes of every kind, and print those that ended wrongly."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--tries', type=int, default=1000)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--at-once', type=int, default=max(2, os.cpu_count() or 1))
    parser.add_argument('--out', type=Path, required=True, help='new folder, for bags')
    options = parser.parse_args()
    # A shell's background job ignores SIGINT, nohup SIGHUP, and started processes inherit this.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, lambda *_: None)
    bad = 0
    with ThreadPoolExecutor(options.at_once) as pool:
        tries = range(options.tries)
        ends = pool.map(lambda index: _try(index, options.out, options.seed), tries)
        for done, ended in enumerate(ends, 1):
            if not ended.is_clean:
                bad += 1
                print(f'{ended}\n{ended.said}', flush=True)
            if done % 50 == 0:
                print(f'{done} of {options.tries}: {bad} ended badly', flush=True)
    print(f'{options.tries} tries, {bad} ended badly')
    return 1 if bad else 0


if __name__ == '__main__':
    sys.exit(main())
