"""Test bench of two emulated hosts: bridge, both ends of ground_link, and a lossy relay."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from radio.two_hosts import DRONE, Host, TwoHosts, stop

HERE = Path(__file__).parent
PORT, RELAY_PORT = 7447, 7500
DOMAIN = {'ROS_DOMAIN_ID': '64'}
PATIENCE = 60.0  # [s] for anything to start


class Speaker:
    """Process that reads commands line by line and prints JSON objects, see `stop_presser.py`."""

    def __init__(self, process: subprocess.Popen[str], log: Path) -> None:
        self._process = process
        self._log = log
        self._read = 0
        self._rows: list[dict[str, object]] = []

    def send_line(self, line: str) -> None:
        """Send a command line to the process."""
        assert self._process.stdin is not None
        self._process.stdin.write(f'{line}\n')
        self._process.stdin.flush()

    def rows(self) -> list[dict[str, object]]:
        """Return the JSON objects that the process has printed."""
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
        """Wait for a row that was printed after a time [s] and return its time [s]."""
        deadline = time.monotonic() + PATIENCE
        while True:
            for row in self.rows():
                if float(str(row['time'])) >= since and found(row):
                    return float(str(row['time']))
            if time.monotonic() > deadline or self._process.poll() is not None:
                raise TimeoutError(
                    f'{self._log.name} did not print the expected row; last rows: '
                    f'{self.rows()[-3:]}'
                )
            time.sleep(0.005)


@dataclass(frozen=True)
class Loop:
    """Missed cycles and gaps of the bridge's 1 kHz loop within a time span.

    Attributes
    ----------
    lost
        Fraction of missed cycles, by the monotonic clock of this machine.
    longest
        Longest time between two joint states [s].
    gaps
        Number of times above 20 ms between two joint states.
    """

    lost: float
    longest: float
    gaps: int

    @classmethod
    def of(cls, row: dict[str, float], elapsed: float) -> Loop:
        """Return the loop statistics from a row of `loop_watch.py` about `elapsed` seconds."""
        states = row['states'] + row['unread']
        # Both clocks must agree that states are missing: a state more or less is at either end.
        lost = 1.0 - (states + 1) / (1000.0 * min(row['span'], elapsed))
        return cls(max(0.0, lost), row['longest'], int(row['gaps']))


class Rig:
    """Both hosts with bridge, both ends of ground_link, and a relay that loses datagrams.

    The emulated bridge keeps real time: a cycle that comes too late is missed, as on hardware.

    Parameters
    ----------
    folder
        For logs, key and bags.
    clock
        Of the ground, as libfaketime reads it: '+30s', or '+30s x1.001' for one that drifts. For a
        ground that is behind, '-30s', the drone's clock is ahead.
    link
        Parameters of the drone's end of ground_link.
    """

    def __init__(self, folder: Path, clock: str = '', **link: object) -> None:
        self.folder = folder
        self._shifted_host = 'drone' if clock.startswith('-') else 'ground'
        self._clock = shifted_clock(clock.replace('-', '+')) if clock else {}
        self._common = {'key_file': folder / 'key', 'realtime_priority': 40}
        self._given = {'bags': folder / 'bags', **link}
        self._controller: subprocess.Popen[str] | None = None
        self._stack = ExitStack()
        self.hosts = self._stack.enter_context(TwoHosts())
        try:
            self._start()
        except BaseException:
            self._stack.close()
            raise

    def _start(self) -> None:
        folder, drone, ground = self.folder, self.hosts.drone, self.hosts.ground
        first = {'realtime_priority': 50, 'encoders': 'absolute', 'seed': 3, 'pace': 'real_time'}
        self._node(drone, 'fake_hardware', **first)
        self.relay = self._speak(drone, 'lossy_relay', str(RELAY_PORT), '127.0.0.1', str(PORT))
        self._drone_link = self._node(drone, 'ground_link', **self._common, **self._given)
        self._watch = self._speak(drone, 'loop_watch')
        self.drone = self._speak(drone, 'stop_presser')
        wait_for('the key', (folder / 'key').exists)
        self._start_ground_link()
        self.ground = self._speak(ground, 'stop_presser', 'watch')
        for speaker in (self._watch, self.drone, self.ground):
            speaker.wait(lambda row: 'ready' in row)

    def press(self) -> float:
        """Send an e-stop on the ground; return the time [s] until the arm is damped."""
        self.ground.send_line('press')
        begin = self.ground.wait(lambda row: row.get('called') == 'press', self._cleared)
        return self.drone.wait(is_fault, begin) - begin

    def clear(self) -> None:
        """Clear the fault, on the drone."""
        self._cleared = time.monotonic()
        self.drone.send_line('clear')
        self.drone.wait(lambda row: row.get('mode') not in (None, 'fault'), self._cleared)
        # The ground receives the mode as well; a button is not pressed before that.
        time.sleep(0.1 + 0.1 * np.random.default_rng().random())

    _cleared = 0.0

    def mark(self) -> dict[str, float]:
        """Return the statistics of the 1 kHz loop since the last mark, see `loop_watch.py`."""
        begin = time.monotonic()
        self._watch.send_line('mark')
        when = self._watch.wait(lambda row: 'states' in row, begin)
        row = next(row for row in self._watch.rows() if row['time'] == when and 'states' in row)
        return {key: float(str(value)) for key, value in row.items()}

    def loop(self, seconds: float) -> Loop:
        """Return the statistics of the 1 kHz loop over a time span [s]."""
        self.mark()
        begin = time.monotonic()
        time.sleep(seconds)
        return Loop.of(self.mark(), time.monotonic() - begin)

    def state(self) -> tuple[np.ndarray, np.ndarray]:
        """Return position [rad] and velocity [rad/s] of the joints, on the drone."""
        begin = time.monotonic()
        self.drone.send_line('state')
        when = self.drone.wait(lambda row: 'position' in row, begin)
        row = next(row for row in self.drone.rows() if row['time'] == when)
        return np.array(row['position']), np.array(row['velocity'])

    def arm(self, *words: str, host: str = 'ground') -> subprocess.Popen[str]:
        """Start `arm` on a host; its output is `log('arm', words[0])`."""
        log = self.folder / f'arm_{words[0]}.log'
        # As prompt as what it measures: other work on this machine must not count.
        start = ('chrt', '-f', '20', sys.executable, '-m', 'aerarm_ros.executables', 'arm')
        place = self.hosts.ground if host == 'ground' else self.hosts.drone
        return place.start(
            *start, *words, environment=self._environment(place), log=log, cwd=self.folder
        )

    def start_controller(self, name: str = 'computed_torque') -> None:
        """Start a controller on the drone, and stop the previous controller."""
        if self._controller is not None:
            stop([self._controller])
        self._controller = self._node(self.hosts.drone, name, realtime_priority=45)

    def restart_drone_link(self, **link: object) -> None:
        """Restart ground_link on the drone with other parameters."""
        stop([self._drone_link])
        begin = time.monotonic()
        self._drone_link = self._node(
            self.hosts.drone, 'ground_link', **self._common, **self._given, **link
        )
        self.ground.wait(lambda row: 'back' in row, begin)
        time.sleep(1.0)

    def restart_ground_link(self) -> tuple[float, float]:
        """Restart ground_link on the ground.

        Return the time [s] until the drone is found, from the start of the process and from the
        start of its search.
        """
        stop([self._ground_link])
        time.sleep(0.5)
        begin = time.monotonic()
        self._start_ground_link()
        back = self.ground.wait(lambda row: 'back' in row, begin)
        wait_for_text(self.folder / 'ground_ground_link.log', 'the drone is connected')
        stamps = [
            float(line.split('[')[2].split(']')[0])
            for line in self.log('ground', 'ground_link').splitlines()
            if 'looking for' in line or 'is connected' in line
        ]
        return back - begin, stamps[-1] - stamps[0]

    def traffic(self, act: Callable[[], object]) -> tuple[float, float]:
        """Return the radio traffic [kbit/s], [packets/s] in both directions during a function."""
        hosts = self.hosts
        before = [hosts.traffic(host) for host in (hosts.drone, hosts.ground)]
        begin = time.monotonic()
        act()
        elapsed = time.monotonic() - begin
        after = [hosts.traffic(host) for host in (hosts.drone, hosts.ground)]
        sums = np.sum(np.array(after) - np.array(before), axis=0)
        return 8e-3 * sums[0] / elapsed, sums[1] / elapsed

    def listen_on_ground(self) -> None:
        """Start a recorder on the ground, which subscribes to all topics."""
        self._node(self.hosts.ground, 'recorder', bag=self.folder / 'bag')
        time.sleep(3.0)

    def log(self, host: str, name: str) -> str:
        """Return the output of a process."""
        return (self.folder / f'{host}_{name}.log').read_text()

    def __enter__(self) -> Rig:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def _start_ground_link(self) -> None:
        there = {'role': 'ground', 'drone': DRONE, 'port': RELAY_PORT}
        self._ground_link = self._node(self.hosts.ground, 'ground_link', **self._common, **there)

    def _node(self, host: Host, name: str, **parameters: object) -> subprocess.Popen[str]:
        given = [word for key, value in parameters.items() for word in ('-p', f'{key}:={value}')]
        environment = self._environment(host)
        return host.node(name, '--ros-args', *given, environment=environment, folder=self.folder)

    def _environment(self, host: Host) -> dict[str, str]:
        # Not for the watchers, whose times are compared with this process's.
        return DOMAIN | (self._clock if host.name == self._shifted_host else {})

    def _speak(self, host: Host, name: str, *words: str) -> Speaker:
        log = self.folder / f'{host.name}_{name}.log'
        # As prompt as what it measures: other work on this machine must not count.
        command = ('chrt', '-f', '30', sys.executable, str(HERE / f'{name}.py'), *words)
        process = host.start(*command, environment=DOMAIN, log=log, stdin=subprocess.PIPE)
        return Speaker(process, log)


def is_fault(row: dict[str, object]) -> bool:
    """Return whether a row reports that an e-stop has damped the arm."""
    return row.get('mode') == 'fault'


def shifted_clock(offset: str) -> dict[str, str]:
    """Return the environment of a process whose clocks are shifted, by libfaketime.

    A time namespace of Linux shifts no system clock. With libfaketime 0.9.10 only clocks ahead are
    usable: with a clock behind, every second service call between two plain rclpy nodes takes
    seconds. It must shift the monotonic clock too, because otherwise sleeps fail.
    """
    library = next(Path('/usr/lib').glob('*/faketime/libfaketimeMT.so.1'), None)
    if library is None:
        raise OSError('libfaketime is not installed: apt-get install faketime')
    return {'LD_PRELOAD': str(library), 'FAKETIME': offset}


def wait_for(what: str, condition: Callable[[], object]) -> None:
    """Wait until a condition holds."""
    deadline = time.monotonic() + PATIENCE
    while not condition():
        if time.monotonic() > deadline:
            raise TimeoutError(f'waited in vain for {what}')
        time.sleep(0.02)


def wait_for_text(log: Path, text: str) -> None:
    """Wait until a log file contains a text."""
    wait_for(f'{text!r} in {log.name}', lambda: text in log.read_text())


def run(rig: Rig, *words: str) -> str:
    """Run `arm` on the ground, and return its output."""
    process = rig.arm(*words)
    status = process.wait(PATIENCE)
    text = (rig.folder / f'arm_{words[0]}.log').read_text()
    if status:
        raise RuntimeError(f'arm {" ".join(words)}: {text}')
    return text
