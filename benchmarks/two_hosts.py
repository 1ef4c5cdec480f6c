"""Measure drone and ground as two hosts connected by a radio link, and print a table.

The hosts are Linux namespaces, which require root. The bridge and ground_link run with SCHED_FIFO.
"""

import argparse
import json
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType

import numpy as np
from radio.two_hosts import DRONE, TwoHosts, missing_rights
from run import machine

HERE = Path(__file__).parent
PORT, RELAY_PORT = 7447, 7500
DOMAIN = {'ROS_DOMAIN_ID': '64'}
PATIENCE = 60.0  # [s] for a process to start


class Speaker:
    """Process that reads commands and prints JSON objects, see `stop_presser.py`."""

    def __init__(self, process: subprocess.Popen[str], log: Path) -> None:
        self._process = process
        self._log = log
        self._read = 0
        self._rows: list[dict[str, object]] = []

    def tell(self, line: str) -> None:
        """Send a line to the process."""
        assert self._process.stdin is not None
        self._process.stdin.write(f'{line}\n')
        self._process.stdin.flush()

    def rows(self) -> list[dict[str, object]]:
        """Return the printed rows."""
        with self._log.open() as stream:
            stream.seek(self._read)
            for line in iter(stream.readline, ''):
                if not line.endswith('\n'):
                    break
                self._read += len(line.encode())
                if line.startswith('{'):
                    self._rows.append(json.loads(line))
        return self._rows

    def wait(self, found: Callable[[dict[str, object]], object], since: float = 0.0) -> float:
        """Wait for a matching row printed after a time [s]; return its time [s]."""
        deadline = time.monotonic() + PATIENCE
        while True:
            for row in self.rows():
                if float(str(row['time'])) >= since and found(row):
                    return float(str(row['time']))
            if time.monotonic() > deadline:
                raise TimeoutError(f'{self._log.name} has no such line: {self.rows()[-3:]}')
            time.sleep(0.005)


class Rig:
    """Both hosts with bridge, both ends of ground_link, and a relay that drops datagrams."""

    def __init__(self, folder: Path, **link: object) -> None:
        self.folder = folder
        self._stack = ExitStack()
        self.hosts = self._stack.enter_context(TwoHosts())
        drone, ground = self.hosts.drone, self.hosts.ground
        first = {'realtime_priority': 50, 'encoders': 'absolute', 'seed': 3}
        self._node(drone, 'fake_hardware', **first)
        self.relay = self._speak(drone, 'lossy_relay', str(RELAY_PORT), '127.0.0.1', str(PORT))
        common = {'key_file': folder / 'key', 'realtime_priority': 40}
        self._node(drone, 'ground_link', **common, **link)
        self._watch = self._speak(drone, 'loop_watch', '3600')
        self.drone = self._speak(drone, 'stop_presser')
        self._wait_for(lambda: self._loop_rows() and (folder / 'key').exists())
        there = {'role': 'ground', 'drone': DRONE, 'port': RELAY_PORT}
        self._node(ground, 'ground_link', **common, **there)
        self.ground = self._speak(ground, 'stop_presser')
        for presser in (self.drone, self.ground):
            presser.wait(lambda row: 'ready' in row)

    def press(self) -> float:
        """Press the e-stop on the ground; return the time until the arm was damped [s]."""
        self.ground.tell('press')
        begin = self.ground.wait(lambda row: row.get('called') == 'press', self._cleared)
        return self.drone.wait(lambda row: row.get('mode') == 'fault', begin) - begin

    def clear(self) -> None:
        """Clear the fault on the drone."""
        self._cleared = time.monotonic()
        self.drone.tell('clear')
        self.drone.wait(lambda row: row.get('mode') not in (None, 'fault'), self._cleared)
        # Wait until the ground receives the mode as well, before the button is pressed.
        time.sleep(0.1 + 0.1 * np.random.default_rng().random())

    _cleared = 0.0

    def loop(self, seconds: float) -> tuple[float, float]:
        """Return the fraction of lost bridge cycles, and the longest period [ms]."""
        first = self._loop_rows()[-1]
        time.sleep(seconds)
        rows = [row for row in self._loop_rows() if row['time'] > first['time']]
        if not rows:
            return 1.0, math.inf
        span = 1000.0 * (rows[-1]['time'] - first['time'])
        lost = 1.0 - (rows[-1]['cycles'] - first['cycles']) / span
        return max(0.0, lost), max(row['longest [ms]'] for row in rows)

    def state(self) -> tuple[np.ndarray, np.ndarray]:
        """Return joint positions [rad] and velocities [rad/s], measured on the drone."""
        begin = time.monotonic()
        self.drone.tell('state')
        when = self.drone.wait(lambda row: 'position' in row, begin)
        row = next(row for row in self.drone.rows() if row['time'] == when)
        return np.array(row['position']), np.array(row['velocity'])

    def arm(self, *words: str) -> subprocess.Popen[str]:
        """Start the executable `arm` on the ground."""
        log = self.folder / f'arm_{words[0]}.log'
        command = (sys.executable, '-m', 'aerarm_ros.executables', 'arm', *words)
        return self.hosts.start(self.hosts.ground, *command, environment=DOMAIN, log=log)

    def start_controller(self) -> None:
        """Start computed_torque on the drone."""
        self._node(self.hosts.drone, 'computed_torque', realtime_priority=45)

    def traffic(self, act: Callable[[], object]) -> tuple[float, float]:
        """Return the radio's traffic during a call, in both directions [kbit/s], [packets/s]."""
        hosts = self.hosts
        before = [hosts.traffic(host) for host in (hosts.drone, hosts.ground)]
        begin = time.monotonic()
        act()
        elapsed = time.monotonic() - begin
        after = [hosts.traffic(host) for host in (hosts.drone, hosts.ground)]
        sums = np.sum(np.array(after) - np.array(before), axis=0)
        return 8e-3 * sums[0] / elapsed, sums[1] / elapsed

    def listen_on_ground(self) -> None:
        """Start a recorder on the ground, as an example of a tool that subscribes to all topics."""
        self._node(self.hosts.ground, 'recorder', bag=self.folder / 'bag')
        time.sleep(4.0)

    def log(self, host: str, name: str) -> str:
        """Return the output of a process."""
        return (self.folder / f'{host}_{name}.log').read_text()

    def __enter__(self) -> 'Rig':
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stack.close()

    def _loop_rows(self) -> list[dict[str, float]]:
        return [{key: float(str(row[key])) for key in row} for row in self._watch.rows()]

    def _node(self, host: object, name: str, **parameters: object) -> None:
        given = [word for key, value in parameters.items() for word in ('-p', f'{key}:={value}')]
        self.hosts.node(host, name, '--ros-args', *given, environment=DOMAIN, folder=self.folder)

    def _speak(self, host: object, name: str, *words: str) -> Speaker:
        log = self.folder / f'{host.name}_{name}.log'
        # High priority, so that other work on this machine does not affect the measurement.
        command = ('chrt', '-f', '30', sys.executable, str(HERE / 'radio' / f'{name}.py'), *words)
        process = self.hosts.start(
            host, *command, environment=DOMAIN, log=log, stdin=subprocess.PIPE
        )
        return Speaker(process, log)

    @staticmethod
    def _wait_for(condition: Callable[[], object]) -> None:
        deadline = time.monotonic() + PATIENCE
        while not condition():
            if time.monotonic() > deadline:
                raise TimeoutError('the bridge did not start')
            time.sleep(0.05)


def measure_radios(rig: Rig, seconds: float) -> None:
    """Print the effect of radios of several rates on the 1 kHz loop, alternating with none."""
    print('\n| radio | cycles lost | longest period | traffic | packets |')
    print('|---|---|---|---|---|')
    for rate, name in (
        ('', 'no limit'),
        ('6mbit', '6 Mbit/s'),
        ('', 'no limit'),
        ('1mbit', '1 Mbit/s'),
        ('', 'no limit'),
        ('8kbit', '8 kbit/s'),
    ):
        rig.hosts.set_rate(rate)
        result: list[tuple[float, float]] = []
        kbits, packets = rig.traffic(lambda result=result: result.append(rig.loop(seconds)))
        lost, longest = result[0]
        print(f'| {name} | {lost:.2%} | {longest:.1f} ms | {kbits:.0f} kbit/s | {packets:.0f}/s |')
    rig.hosts.set_rate('')


def measure_stops(rig: Rig, presses: int) -> None:
    """Print the delay of an e-stop from the ground."""
    print('\n| loss, one way | presses | median | p99 | longest |')
    print('|---|---|---|---|---|')
    rig.relay.tell('delay 0.005')
    for loss in (0.0, 0.05, 0.2):
        rig.relay.tell(f'loss {loss}')
        times = []
        for _ in range(presses):
            times.append(rig.press())
            rig.clear()
        q50, q99 = np.quantile(times, [0.5, 0.99])
        print(f'| {loss:.0%} | {presses} | {q50:.3f} s | {q99:.3f} s | {max(times):.3f} s |')
    rig.relay.tell('loss 0')


def measure_cuts(rig: Rig, cuts: Sequence[float]) -> None:
    """Print the effect of an e-stop pressed during a cut, once the connection is back."""
    print('\n| cut | press acts after the connection is back | arm damped before |')
    print('|---|---|---|')
    for cut in cuts:
        rig.relay.tell('cut 1')
        time.sleep(0.2)
        begin = time.monotonic()
        rig.ground.tell('press')
        time.sleep(cut)
        early = any(r.get('mode') == 'fault' for r in rig.drone.rows() if r['time'] > begin)
        back = time.monotonic()
        rig.relay.tell('cut 0')
        damped = rig.drone.wait(lambda row: row.get('mode') == 'fault', begin)
        print(f'| {cut:g} s | {damped - back:.3f} s | {"yes" if early else "no"} |')
        rig.clear()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--presses', type=int, default=100, help='e-stops per loss (default: 100)')
    parser.add_argument('--seconds', type=float, default=8.0, help='per radio (default: 8)')
    parser.add_argument(
        '--cuts', type=float, nargs='+', default=[0.5, 5.0, 60.0], help='[s] (default: 0.5 5 60)'
    )
    options = parser.parse_args()
    problem = missing_rights()
    if problem:
        print(f'two_hosts: {problem}', file=sys.stderr)
        return 1
    print(machine(), flush=True)
    with tempfile.TemporaryDirectory() as folder, Rig(Path(folder)) as rig:
        measure_stops(rig, options.presses)
        measure_cuts(rig, options.cuts)
        rig.listen_on_ground()
        measure_radios(rig, options.seconds)
    return 0


if __name__ == '__main__':
    sys.exit(main())
