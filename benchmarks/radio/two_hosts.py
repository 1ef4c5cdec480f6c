"""Two hosts connected by a radio link, emulated by Linux namespaces on one machine.

Each host has a separate network, IPC, shared memory and host name, so Fast DDS treats them as two
computers. A pair of virtual interfaces connects them. `tc tbf` limits the rate like a slow radio. A
relay process (`lossy_relay.py`) delays and drops datagrams, because many kernels lack `sch_netem`.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

DRONE, GROUND = '10.77.0.1', '10.77.0.2'
"""Addresses of the two hosts on the radio."""
RADIO = 'radio'
"""Name of the radio link's interface on both hosts."""

_TOOLS = ('unshare', 'nsenter', 'ip', 'tc', 'chrt')
_SET_UP = (
    'mount -t tmpfs tmpfs /dev/shm && hostname {name} && ip link set lo up && echo ready && '
    'exec sleep infinity'
)


def missing_rights() -> str:
    """Return the reason why this machine cannot emulate two hosts; '' if it can."""
    absent = [tool for tool in _TOOLS if shutil.which(tool) is None]
    if absent:
        return f'{", ".join(absent)} is not installed: install util-linux and iproute2'
    probe = 'mount -t tmpfs tmpfs /dev/shm && ip link add name probe type veth peer name other'
    tried = subprocess.run(
        ['unshare', '-n', '-i', '-u', '-m', 'sh', '-c', probe], capture_output=True, text=True
    )
    if tried.returncode:
        return f'namespaces are not permitted ({tried.stderr.strip()}): run as root'
    return ''


class Host:
    """Emulated host: a process that keeps its namespaces, with commands to run in them.

    Parameters
    ----------
    name
        Host name.
    address
        IP address on the radio link.
    """

    def __init__(self, name: str, address: str) -> None:
        self.name = name
        self.address = address
        self._processes: list[subprocess.Popen[str]] = []
        command = ['unshare', '-n', '-i', '-u', '-m', 'sh', '-c', _SET_UP.format(name=name)]
        self._keeper = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self._keeper.stdout is not None
        if self._keeper.stdout.readline().strip() != 'ready':
            raise OSError(f'host {name} did not start: run as root')

    @property
    def pid(self) -> int:
        """Process id of the keeper, which identifies the namespaces."""
        return self._keeper.pid

    def command(self, *words: str, cwd: Path | None = None) -> list[str]:
        """Return the command line that runs a command on this host, in a folder."""
        enter = ('nsenter', '-t', str(self.pid), '-n', '-i', '-u', '-m', '--')
        return [*enter, 'env', '-C', str(cwd or Path.cwd()), *words]

    def run(self, *words: str) -> str:
        """Run a command on this host and return its output; raises CalledProcessError."""
        done = subprocess.run(self.command(*words), check=True, capture_output=True, text=True)
        return done.stdout

    def start(
        self,
        *words: str,
        environment: Mapping[str, str],
        log: Path | None = None,
        cwd: Path | None = None,
        stdin: int = subprocess.DEVNULL,
        stdout: int | None = None,
    ) -> subprocess.Popen[str]:
        """Start a command on this host until `close`; its output goes to `log` if given."""
        stream = None if log is None else log.open('w')
        process = subprocess.Popen(
            self.command(*words, cwd=cwd),
            env={**os.environ, **environment},
            text=True,
            stdin=stdin,
            stdout=stream or stdout,
            stderr=None if stream is None else subprocess.STDOUT,
        )
        self._processes.append(process)
        return process

    def node(
        self, name: str, *words: str, environment: Mapping[str, str], folder: Path
    ) -> subprocess.Popen[str]:
        """Start an executable of the package; its output goes to FOLDER/HOST_NAME.log."""
        command = (sys.executable, '-m', 'aerarm_ros.executables', name, *words)
        log = folder / f'{self.name}_{name}.log'
        return self.start(*command, environment=environment, log=log)

    def close(self) -> None:
        """End all started processes; the namespaces end with their last process."""
        stop(self._processes)
        self._keeper.kill()
        self._keeper.wait()


class TwoHosts:
    """Hosts of drone and ground, connected by a radio link of full speed until `set_rate`.

    Attributes
    ----------
    drone, ground
        The two hosts.
    """

    def __init__(self) -> None:
        self.drone, self.ground = Host('drone', DRONE), Host('ground', GROUND)
        ends = [f'{side}{os.getpid()}' for side in 'dg']
        _ip('link', 'add', ends[0], 'type', 'veth', 'peer', 'name', ends[1])
        for host, end in zip((self.drone, self.ground), ends, strict=True):
            _ip('link', 'set', end, 'netns', str(host.pid))
            host.run('ip', 'link', 'set', end, 'name', RADIO)
            host.run('ip', 'address', 'add', f'{host.address}/24', 'dev', RADIO)
            host.run('ip', 'link', 'set', RADIO, 'up')
            host.run('ip', 'route', 'add', 'default', 'dev', RADIO)  # for multicast

    def set_rate(self, rate: str) -> None:
        """Limit the radio in both directions, e.g. '2mbit' or '8kbit'; '' removes the limit."""
        for host in (self.drone, self.ground):
            if rate:
                limit = ('rate', rate, 'burst', '4kb', 'limit', '1mb')
                host.run('tc', 'qdisc', 'replace', 'dev', RADIO, 'root', 'tbf', *limit)
            else:
                host.run('tc', 'qdisc', 'replace', 'dev', RADIO, 'root', 'pfifo', 'limit', '1000')

    def traffic(self, host: Host) -> tuple[int, int]:
        """Return the number of bytes and packets that a host has sent over the radio."""
        table = Path(f'/proc/{host.pid}/net/dev').read_text().splitlines()
        fields = next(line.split() for line in table if line.strip().startswith(f'{RADIO}:'))
        return int(fields[9]), int(fields[10])

    def close(self) -> None:
        """End both hosts."""
        for host in (self.ground, self.drone):
            host.close()

    def __enter__(self) -> TwoHosts:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def stop(processes: Sequence[subprocess.Popen[str]], timeout: float = 20.0) -> None:
    """Terminate processes, the last first, and kill those still running after `timeout` [s]."""
    for process in reversed(processes):
        if process.poll() is None:
            process.terminate()
    deadline = time.monotonic() + timeout
    for process in processes:
        try:
            process.wait(max(0.1, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _ip(*words: str) -> None:
    subprocess.run(('ip', *words), check=True)
