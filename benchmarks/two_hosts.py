"""Measure drone and ground as two hosts with a radio between them, and print a table.

The hosts are Linux namespaces, so this needs root. The bridge and ground_link run with SCHED_FIFO.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import numpy as np
from radio.two_hosts import DRONE, TwoHosts, missing_rights, stop
from run import machine

from aerarm_msgs_py.bags.bag_reader import topics
from aerarm_ros.description.arm_config import load_arm_config

HERE = Path(__file__).parent
PORT, RELAY_PORT = 7447, 7500
DOMAIN = {'ROS_DOMAIN_ID': '64'}
PATIENCE = 60.0  # [s] for anything to start


class Speaker:
    """A process that takes lines and prints JSON objects, see `stop_presser.py`."""

    def __init__(self, process: subprocess.Popen[str], log: Path) -> None:
        self._process = process
        self._log = log
        self._read = 0
        self._rows: list[dict[str, object]] = []

    def tell(self, line: str) -> None:
        """Send a line."""
        assert self._process.stdin is not None
        self._process.stdin.write(f'{line}\n')
        self._process.stdin.flush()

    def rows(self) -> list[dict[str, object]]:
        """Return what it has printed."""
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
                raise TimeoutError(f'{self._log.name} never printed that: {self.rows()[-3:]}')
            time.sleep(0.005)


@dataclass(frozen=True)
class Loop:
    """What became of the 1 kHz loop within a time.

    Attributes
    ----------
    lost
        Share of the cycles that did not come, on the monotonic clock of this machine.
    longest
        Longest time between two states [s].
    gaps
        Times above 20 ms between two states.
    """

    lost: float
    longest: float
    gaps: int

    @classmethod
    def of(cls, row: dict[str, float], elapsed: float) -> Loop:
        """Return the loop of an account that took `elapsed` [s]."""
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
        Of the ground, as libfaketime reads it: '+30s', or '+30s x1.001' for one that drifts.
    link
        Parameters of the drone's end of ground_link.
    """

    def __init__(self, folder: Path, clock: str = '', **link: object) -> None:
        self.folder = folder
        self._clock = shifted_clock(clock) if clock else {}
        self._common = {'key_file': folder / 'key', 'realtime_priority': 40}
        self._given = {'bags': folder / 'bags', **link}
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
        self._wait_for((folder / 'key').exists)
        self._start_ground_link()
        self.ground = self._speak(ground, 'stop_presser', 'watch')
        for speaker in (self._watch, self.drone, self.ground):
            speaker.wait(lambda row: 'ready' in row)

    def press(self) -> float:
        """Press the e-stop on the ground, and return after how long the arm was damped [s]."""
        self.ground.tell('press')
        begin = self.ground.wait(lambda row: row.get('called') == 'press', self._cleared)
        return self.drone.wait(is_fault, begin) - begin

    def clear(self) -> None:
        """Clear the fault, on the drone."""
        self._cleared = time.monotonic()
        self.drone.tell('clear')
        self.drone.wait(lambda row: row.get('mode') not in (None, 'fault'), self._cleared)
        # The ground receives the mode as well; a button is not pressed before that.
        time.sleep(0.1 + 0.1 * np.random.default_rng().random())

    _cleared = 0.0

    def mark(self) -> dict[str, float]:
        """Return the account of the 1 kHz loop since the last mark, see `loop_watch.py`."""
        begin = time.monotonic()
        self._watch.tell('mark')
        when = self._watch.wait(lambda row: 'states' in row, begin)
        row = next(row for row in self._watch.rows() if row['time'] == when and 'states' in row)
        return {key: float(str(value)) for key, value in row.items()}

    def loop(self, seconds: float) -> Loop:
        """Return what became of the 1 kHz loop within a time [s]."""
        self.mark()
        begin = time.monotonic()
        time.sleep(seconds)
        return Loop.of(self.mark(), time.monotonic() - begin)

    def state(self) -> tuple[np.ndarray, np.ndarray]:
        """Return position [rad] and velocity [rad/s] of the joints, on the drone."""
        begin = time.monotonic()
        self.drone.tell('state')
        when = self.drone.wait(lambda row: 'position' in row, begin)
        row = next(row for row in self.drone.rows() if row['time'] == when)
        return np.array(row['position']), np.array(row['velocity'])

    def arm(self, *words: str, host: str = 'ground') -> subprocess.Popen[str]:
        """Start `arm` on a host; its output is `log('arm', words[0])`."""
        log = self.folder / f'arm_{words[0]}.log'
        # As prompt as what it measures: other work on this machine must not count.
        start = ('chrt', '-f', '20', sys.executable, '-m', 'aerarm_ros.executables', 'arm')
        place = self.hosts.ground if host == 'ground' else self.hosts.drone
        environment = DOMAIN | (self._clock if host == 'ground' else {})
        return self.hosts.start(
            place, *start, *words, environment=environment, log=log, cwd=self.folder
        )

    def start_controller(self) -> None:
        """Start computed_torque on the drone."""
        self._node(self.hosts.drone, 'computed_torque', realtime_priority=45)

    def start_on_ground(self, name: str, *words: str, **parameters: object) -> object:
        """Start an executable on the ground."""
        return self._node(self.hosts.ground, name, **parameters)

    def restart_drone_link(self, **link: object) -> None:
        """Start the drone's end of ground_link again, with other parameters."""
        stop([self._drone_link])
        begin = time.monotonic()
        self._drone_link = self._node(
            self.hosts.drone, 'ground_link', **self._common, **self._given, **link
        )
        self.ground.wait(lambda row: 'back' in row, begin)
        time.sleep(1.0)

    def restart_ground_link(self) -> tuple[float, float]:
        """Start the ground's end again; return how long the process and its search took [s]."""
        stop([self._ground_link])
        time.sleep(0.5)
        begin = time.monotonic()
        self._start_ground_link()
        back = self.ground.wait(lambda row: 'back' in row, begin)
        self._wait_for(lambda: 'the drone is connected' in self.log('ground', 'ground_link'))
        stamps = [
            float(line.split('[')[2].split(']')[0])
            for line in self.log('ground', 'ground_link').splitlines()
            if 'looking for' in line or 'is connected' in line
        ]
        return back - begin, stamps[-1] - stamps[0]

    def traffic(self, act: Callable[[], object]) -> tuple[float, float]:
        """Return the radio's traffic while a function runs, both ways [kbit/s], [packets/s]."""
        hosts = self.hosts
        before = [hosts.traffic(host) for host in (hosts.drone, hosts.ground)]
        begin = time.monotonic()
        act()
        elapsed = time.monotonic() - begin
        after = [hosts.traffic(host) for host in (hosts.drone, hosts.ground)]
        sums = np.sum(np.array(after) - np.array(before), axis=0)
        return 8e-3 * sums[0] / elapsed, sums[1] / elapsed

    def listen_on_ground(self) -> None:
        """Start a recorder on the ground, as a tool that listens to everything."""
        self._node(self.hosts.ground, 'recorder', bag=self.folder / 'bag')
        time.sleep(3.0)

    def log(self, host: str, name: str) -> str:
        """Return what a process has printed."""
        return (self.folder / f'{host}_{name}.log').read_text()

    def __enter__(self) -> Rig:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stack.close()

    def _start_ground_link(self) -> None:
        there = {'role': 'ground', 'drone': DRONE, 'port': RELAY_PORT}
        self._ground_link = self._node(self.hosts.ground, 'ground_link', **self._common, **there)

    def _node(self, host: object, name: str, **parameters: object) -> subprocess.Popen[str]:
        given = [word for key, value in parameters.items() for word in ('-p', f'{key}:={value}')]
        environment = DOMAIN | (self._clock if host is self.hosts.ground else {})
        return self.hosts.node(
            host, name, '--ros-args', *given, environment=environment, folder=self.folder
        )

    def _speak(self, host: object, name: str, *words: str) -> Speaker:
        log = self.folder / f'{host.name}_{name}.log'
        # As prompt as what it measures: other work on this machine must not count.
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
                raise TimeoutError('ground_link did not start')
            time.sleep(0.05)


def is_fault(row: dict[str, object]) -> bool:
    """Tell whether a row says that the arm is damped by an e-stop."""
    return row.get('mode') == 'fault'


def shifted_clock(offset: str) -> dict[str, str]:
    """Return the environment of a process whose system clock is shifted, by libfaketime.

    A time namespace of Linux shifts no system clock.
    """
    library = next(Path('/usr/lib').glob('*/faketime/libfaketimeMT.so.1'), None)
    if library is None:
        raise OSError('libfaketime is not installed: apt-get install faketime')
    return {
        'LD_PRELOAD': str(library),
        'FAKETIME': offset,
        'FAKETIME_DONT_FAKE_MONOTONIC': '1',
        'DONT_FAKE_MONOTONIC': '1',
    }


def table(*columns: str) -> None:
    """Print the head of a table."""
    print(f'\n| {" | ".join(columns)} |')
    print('|---' * len(columns) + '|', flush=True)


def row(*cells: object) -> None:
    """Print a row of a table."""
    print(f'| {" | ".join(map(str, cells))} |', flush=True)


def measure_radios(rig: Rig, seconds: float) -> None:
    """Print what radios of some rates do to the 1 kHz loop, with and without in turns."""
    rig.listen_on_ground()
    table('radio', 'cycles lost', 'longest period', 'periods above 20 ms', 'traffic', 'packets')
    for rate, name in (
        ('', 'no limit'),
        ('6mbit', '6 Mbit/s'),
        ('', 'no limit'),
        ('2mbit', '2 Mbit/s'),
        ('', 'no limit'),
        ('1mbit', '1 Mbit/s'),
        ('', 'no limit'),
        ('8kbit', '8 kbit/s'),
    ):
        rig.hosts.set_rate(rate)
        result: list[Loop] = []
        kbits, packets = rig.traffic(lambda result=result: result.append(rig.loop(seconds)))
        (loop,) = result
        row(name, f'{loop.lost:.2%}', f'{1e3 * loop.longest:.1f} ms', loop.gaps,
            f'{kbits:.0f} kbit/s', f'{packets:.0f}/s')  # fmt: skip
    rig.hosts.set_rate('')


def measure_stops(rig: Rig, presses: int, losses: Sequence[float] = (0.0, 0.05, 0.2)) -> None:
    """Print how long an e-stop of the ground takes."""
    table('loss, one way', 'presses', 'median', 'p99', 'longest')
    rig.relay.tell('delay 0.005')
    for loss in losses:
        rig.relay.tell(f'loss {loss}')
        times = []
        for _ in range(presses):
            times.append(rig.press())
            rig.clear()
        q50, q99 = np.quantile(times, [0.5, 0.99])
        row(f'{loss:.0%}', presses, f'{q50:.3f} s', f'{q99:.3f} s', f'{max(times):.3f} s')
    rig.relay.tell('loss 0')


def measure_fresh_stops(rig: Rig, presses: int) -> None:
    """Print how long a new process `arm e_stop` on the ground takes, from its start."""
    table('loss, one way', '`arm e_stop` started', 'median', 'longest')
    for loss in (0.0, 0.05, 0.2):
        rig.relay.tell(f'loss {loss}')
        times = []
        for _ in range(presses):
            begin = time.monotonic()
            process = rig.arm('e_stop')
            times.append(rig.drone.wait(is_fault, begin) - begin)
            process.wait()
            rig.clear()
        row(f'{loss:.0%}', presses, f'{np.median(times):.2f} s', f'{max(times):.2f} s')
    rig.relay.tell('loss 0')


def measure_cuts(rig: Rig, cuts: Sequence[float]) -> None:
    """Print what a press during a cut does once the connection is back."""
    table('cut', 'pressed by', 'acts after the connection is back', 'shown as not delivered',
          'damped before', 'states are back after')  # fmt: skip
    for cut in cuts:
        for is_fresh in (False, True) if cut > 3.0 else (False,):
            rig.relay.tell('cut 1')
            time.sleep(0.2)
            begin = time.monotonic()
            if is_fresh:
                process = rig.arm('e_stop')
            else:
                rig.ground.tell('press')
            time.sleep(cut)
            early = any(is_fault(r) for r in rig.drone.rows() if r['time'] > begin)
            back = time.monotonic()
            rig.relay.tell('cut 0')
            damped = rig.drone.wait(is_fault, begin)
            states = rig.ground.wait(lambda row: 'back' in row, begin)
            if is_fresh:
                process.wait()
                shown = (rig.folder / 'arm_e_stop.log').read_text()
            else:
                time.sleep(0.3)
                shown = str([r.get('text') for r in rig.ground.rows() if r['time'] > begin])
            row(f'{cut:g} s', 'new `arm e_stop`' if is_fresh else 'a standing node',
                f'{damped - back:.3f} s', 'yes' if 'NOT DELIVERED YET' in shown else 'no',
                'yes' if early else 'no', f'{states - back:.3f} s')  # fmt: skip
            rig.clear()


def measure_watchdog(rig: Rig, cuts: Sequence[tuple[str, float]]) -> None:
    """Print what a cut does to an arm that moves."""
    rig.start_controller()
    run(rig, 'enable', '--wait', 'running')
    table('ground_lost', 'cut', 'speed at the cut', 'speed at its end', 'moved during the cut',
          'to home', 'mode', 'states are back after', 'log')  # fmt: skip
    before = ''
    for action, cut in cuts:
        if action != before:
            before = action
            rig.restart_drone_link(ground_lost=action, ground_timeout=1.0)
        run(rig, 'go', '0.5', '1.2', '0.3', '0.3', '--tolerance', '0.05')
        rig.ground.tell('sweep')
        deadline = time.monotonic() + PATIENCE
        while abs(rig.state()[1][0]) < 0.2:
            if time.monotonic() > deadline:
                raise TimeoutError('the arm does not move')
        begin, speed = rig.state()
        cut_at = time.monotonic()
        rig.relay.tell('cut 1')
        time.sleep(cut)
        end, last = rig.state()
        back = time.monotonic()
        rig.relay.tell('cut 0')
        states = rig.ground.wait(lambda row: 'back' in row, cut_at)
        time.sleep(0.5)
        modes = [r['mode'] for r in rig.drone.rows() if 'mode' in r and r['time'] > cut_at]
        said = [
            line for line in rig.log('ground', 'ground_link').splitlines() if 'back after' in line
        ]
        row(action, f'{cut:g} s', f'{abs(speed[0]):.2f} rad/s', f'{np.abs(last).max():.2f} rad/s',
            f'{begin[0] - end[0]:.2f} rad', f'{np.abs(end - HOME).max():.2f} rad',
            ' '.join(map(str, modes)) or 'running', f'{states - back:.2f} s',
            said[-1].split(': ')[-1] if said else 'none')  # fmt: skip


def measure_discovery(rig: Rig, starts: int) -> None:
    """Print how long a new ground needs to find its drone."""
    table('loss, one way', 'starts', 'found after, median', 'longest', 'with its start, longest')
    for loss in (0.0, 0.05, 0.2):
        rig.relay.tell(f'loss {loss}')
        times = np.array([rig.restart_ground_link() for _ in range(starts)])
        row(f'{loss:.0%}', starts, f'{np.median(times[:, 1]):.3f} s', f'{times[:, 1].max():.3f} s',
            f'{times[:, 0].max():.2f} s')  # fmt: skip
    rig.relay.tell('loss 0')


def measure_listeners(rig: Rig, starts: int) -> None:
    """Print what new local listeners do to the loop, at a radio that is nearly out of range."""
    rig.hosts.set_rate('8kbit')
    table('new local listeners', 'cycles lost', 'longest period', 'periods above 20 ms',
          'has states after, median', 'longest')  # fmt: skip
    command = (sys.executable, str(HERE / 'radio' / 'new_listener.py'))
    rig.mark()
    begin, times = time.monotonic(), []
    for _ in range(starts):
        done = rig.hosts.drone.start(*command, environment=DOMAIN, stdout=subprocess.PIPE)
        times.append(json.loads(done.communicate()[0])['states'] or math.inf)
    loop = Loop.of(rig.mark(), time.monotonic() - begin)
    row(starts, f'{loop.lost:.2%}', f'{1e3 * loop.longest:.1f} ms', loop.gaps,
        f'{np.median(times):.2f} s', f'{max(times):.2f} s')  # fmt: skip
    rig.hosts.set_rate('')


def measure_recording(rig: Rig, seconds: float) -> None:
    """Print how a bag that is recorded on the drone comes to the ground."""
    table('radio', 'loss, one way', 'recorded', 'bag', 'lost', 'fetched in', 'rate', 'cut of 3 s',
          'e-stop meanwhile')  # fmt: skip
    for number, (rate, name, loss) in enumerate(
        (('', 'no limit', 0.0), ('1mbit', '1 Mbit/s', 0.0), ('1mbit', '1 Mbit/s', 0.2))
    ):
        rig.hosts.set_rate(rate)
        rig.relay.tell(f'loss {loss}')
        process = rig.arm('record', f'bag{number}')
        log = rig.folder / 'arm_record.log'
        wait_for_text(log, 'Ctrl-C ends it')
        time.sleep(seconds)
        process.send_signal(signal.SIGINT)
        wait_for_text(log, 'fetching')
        begin = time.monotonic()
        bag = rig.folder / f'bag{number}'
        while not any(bag.glob('*.part')) or sum(p.stat().st_size for p in bag.iterdir()) < 20_000:
            time.sleep(0.01)
        rig.relay.tell('cut 1')
        time.sleep(3.0)
        rig.relay.tell('cut 0')
        time.sleep(0.5)
        stopped = rig.press()
        rig.clear()
        status = process.wait(PATIENCE)
        took = time.monotonic() - begin - 3.0
        size = sum(path.stat().st_size for path in bag.iterdir())
        same = all(
            path.read_bytes() == (rig.folder / 'bags' / bag.name / path.name).read_bytes()
            for path in bag.iterdir()
        )
        found = topics(bag)['/joint_states']
        row(name, f'{loss:.0%}', f'{found.messages} joint_states', f'{1e-6 * size:.2f} MB',
            found.lost, f'{took:.1f} s', f'{8e-6 * size / took:.2f} Mbit/s',
            'resumed, same bytes' if same and not status else f'FAILED, {status}',
            f'{stopped:.3f} s')  # fmt: skip
    rig.relay.tell('loss 0')
    rig.hosts.set_rate('')


def measure_page(rig: Rig, seconds: float) -> None:
    """Print how long the page on the ground takes to load, and how often it changes."""
    rig.start_on_ground('view', port=8097)
    wait_for_text(rig.folder / 'ground_view.log', 'in a browser')
    rig.start_controller()
    run(rig, 'enable', '--wait', 'running')
    table('radio', 'loss, one way', 'stop button after', 'states after', 'the page says',
          'poses', 'curves')  # fmt: skip
    script = str(HERE / 'radio' / 'page_watch.py')
    for rate, name, loss in (('', 'no limit', 0.0), ('1mbit', '1 Mbit/s', 0.2)):
        rig.hosts.set_rate(rate)
        rig.relay.tell(f'loss {loss}')
        run(rig, 'go', '0.5', '1.2', '0.3', '0.3', '--tolerance', '0.05')
        rig.ground.tell('sweep')
        command = ('chrt', '-f', '10', sys.executable, script, 'http://127.0.0.1:8097')
        done = rig.hosts.ground.start(
            *command, str(seconds), environment=DOMAIN, stdout=subprocess.PIPE
        )
        found = json.loads(done.communicate()[0])
        row(name, f'{loss:.0%}', f'{found["button"]:.1f} s', f'{found["states"]:.1f} s',
            found['says'], f'{found["poses"]:.0f}/s', f'{found["curves"]:.0f}/s')  # fmt: skip
    rig.relay.tell('loss 0')
    rig.hosts.set_rate('')


def measure_controller(rig: Rig) -> None:
    """Print what becomes of a controller on the ground, as it is and with an open network."""
    table('a controller on the ground', 'result')
    rig.start_on_ground('computed_torque')
    log = rig.folder / 'ground_ground_link.log'
    wait_for_text(log, 'cannot command the arm')
    line = next(line for line in log.read_text().splitlines() if 'cannot command' in line)
    row('as it is', f'rejected: {line.split("]: ")[1]}')
    with tempfile.TemporaryDirectory() as name, TwoHosts() as hosts:
        folder = Path(name)
        environment = {'ROS_DOMAIN_ID': '65', 'AERARM_NETWORK': 'open',
                       'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET'}  # fmt: skip
        given = ('--ros-args', '-p', 'realtime_priority:=50', '-p', 'encoders:=absolute')
        hosts.node(hosts.drone, 'fake_hardware', *given, environment=environment, folder=folder)
        hosts.node(hosts.ground, 'computed_torque', *given[:3], environment=environment,
                   folder=folder)  # fmt: skip
        enabled = hosts.node(hosts.drone, 'arm', 'enable', '--wait', 'running',
                             environment=environment, folder=folder)  # fmt: skip
        enabled.wait(PATIENCE)
        text = (folder / 'drone_arm.log').read_text().strip().splitlines()
        row('`AERARM_NETWORK=open` on both hosts', '; '.join(text))


def wait_for_text(log: Path, text: str) -> None:
    """Wait until a process has printed a text."""
    deadline = time.monotonic() + PATIENCE
    while text not in log.read_text():
        if time.monotonic() > deadline:
            raise TimeoutError(f'{log.name} lacks {text!r}: {log.read_text()}')
        time.sleep(0.02)


def measure_clocks(presses: int) -> None:
    """Print what depends on the two hosts' clocks."""
    table("ground's clock", 'e-stops at 5 % loss', 'median', 'longest', 'offset on /diagnostics',
          'goal reached', 'worst latency on /diagnostics')  # fmt: skip
    for clock in ('', '+30s', '-30s', '+30s x1.001'):
        with tempfile.TemporaryDirectory() as folder, Rig(Path(folder), clock) as rig:
            rig.relay.tell('delay 0.005')
            rig.relay.tell('loss 0.05')
            times = []
            for _ in range(presses):
                times.append(rig.press())
                rig.clear()
            rig.start_controller()
            run(rig, 'enable', '--wait', 'running')
            run(rig, 'go', '0.3', '1.2', '0.3', '0.3', '--tolerance', '0.05')
            error = np.abs(rig.state()[0] - [0.3, 1.2, 0.3, 0.3]).max()
            begin = time.monotonic()
            rig.ground.tell('diagnostics')
            when = rig.ground.wait(lambda row: 'offset' in row, begin)
            found = next(r for r in rig.ground.rows() if r['time'] == when)
            row(clock or 'as the drone\'s', presses, f'{np.median(times):.3f} s',
                f'{max(times):.3f} s', f'{found["offset"]} ms', f'{error:.3f} rad away',
                f'{found["latency"]} us')  # fmt: skip


HOME = np.array(load_arm_config(None).rest_position)
"""Home configuration of the packaged arm [rad]."""


def run(rig: Rig, *words: str) -> str:
    """Run `arm` on the ground, and return what it printed."""
    process = rig.arm(*words)
    status = process.wait(PATIENCE)
    text = (rig.folder / f'arm_{words[0]}.log').read_text()
    if status:
        raise RuntimeError(f'arm {" ".join(words)}: {text}')
    return text


PARTS = (
    'stops',
    'fresh',
    'cuts',
    'discovery',
    'listeners',
    'radios',
    'watchdog',
    'page',
    'controller',
    'recording',
    'clocks',
)


def main() -> int:
    """Measure and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add('--presses', type=int, default=100, help='e-stops per loss (default: 100)')
    add('--starts', type=int, default=10, help='starts of a process per loss (default: 10)')
    add('--listeners', type=int, default=200, help='new local listeners (default: 200)')
    add('--seconds', type=float, default=8.0, help='per radio (default: 8)')
    add('--cuts', type=float, nargs='+', default=[0.5, 5.0, 60.0], help='[s] (default: 0.5 5 60)')
    add('--only', nargs='+', choices=PARTS, default=PARTS, help='parts to measure (default: all)')
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # ends what was started
    problem = missing_rights()
    if problem:
        print(f'two_hosts: {problem}', file=sys.stderr)
        return 1
    load = ' '.join(f'{load:.1f}' for load in os.getloadavg())
    print(f'{machine()}\n\nload {load}', flush=True)
    stops = [('continue', 5.0), *(('stop', cut) for cut in options.cuts), ('home', 5.0)]
    parts = {
        'stops': lambda rig: measure_stops(rig, options.presses),
        'fresh': lambda rig: measure_fresh_stops(rig, options.starts),
        'cuts': lambda rig: measure_cuts(rig, options.cuts),
        'discovery': lambda rig: measure_discovery(rig, options.starts),
        'listeners': lambda rig: measure_listeners(rig, options.listeners),
        'radios': lambda rig: measure_radios(rig, options.seconds),
        'watchdog': lambda rig: measure_watchdog(rig, stops),
        'page': lambda rig: measure_page(rig, options.seconds),
        'controller': measure_controller,
        'recording': lambda rig: measure_recording(rig, options.seconds),
    }
    with tempfile.TemporaryDirectory() as folder, Rig(Path(folder)) as rig:
        for name in parts:
            if name in options.only:
                parts[name](rig)
    if 'clocks' in options.only:
        measure_clocks(max(5, options.presses // 5))
    return 0


if __name__ == '__main__':
    sys.exit(main())
