"""Send two stop signals to a node."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from aerarm_ros.ros.process.node_process import ros_environment

# As installed commands do.
COMMAND = 'import sys; from aerarm_ros.executables import {0}; sys.exit({0}())'
# A delayed host stretches the gap between signals; this setting still counts them as one.
_DEAF = 'import aerarm_ros.ros.process.process_end as s; s._SAME = 3600.0; '
PATIENCE = 120.0  # [s]
LONGEST_GAP = 0.5  # [s]


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
