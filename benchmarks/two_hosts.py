"""Measure the connection of drone and ground computer over an emulated radio link.

The hosts are Linux namespaces, which require root. The bridge and ground_link run with SCHED_FIFO.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from radio.rig import DOMAIN, HERE, PATIENCE, Loop, Rig, is_fault, run, wait_for_text
from radio.two_hosts import TwoHosts, missing_rights
from run import machine

from aerarm_msgs_py.bags.bag_reader import read_joint_states
from aerarm_msgs_py.sequence_gaps import lost_messages
from aerarm_ros.description.arm_config import load_arm_config


def table(*columns: str) -> None:
    """Print the head of a table."""
    print(f'\n| {" | ".join(columns)} |')
    print('|---' * len(columns) + '|', flush=True)


def row(*cells: object) -> None:
    """Print a row of a table."""
    print(f'| {" | ".join(map(str, cells))} |', flush=True)


def losses(rig: Rig) -> Iterator[float]:
    """Set the packet losses per direction one after the other, and none at the end."""
    for loss in (0.0, 0.05, 0.2):
        rig.relay.send_line(f'loss {loss}')
        yield loss
    rig.relay.send_line('loss 0')


def radios(rig: Rig, *radios: tuple[str, float]) -> Iterator[tuple[str, str]]:
    """Set rate and packet loss of one radio after the other, and no limits at the end.

    Yield the text of the rate and of the loss.
    """
    for rate, loss in radios:
        rig.hosts.set_rate(rate)
        rig.relay.send_line(f'loss {loss}')
        name = rate.replace('mbit', ' Mbit/s').replace('kbit', ' kbit/s')
        yield name or 'no limit', f'{loss:.0%}'
    rig.hosts.set_rate('')
    rig.relay.send_line('loss 0')


def press(rig: Rig, presses: int) -> list[float]:
    """Return the times [s] from e-stops on the ground until the arm is damped."""
    times = []
    for _ in range(presses):
        times.append(rig.press())
        rig.clear()
    return times


def move(rig: Rig) -> None:
    """Move the arm to a posture from which it can sweep."""
    run(rig, 'go', '0.5', '1.2', '0.3', '0.3', '--tolerance', '0.05')
    rig.ground.send_line('sweep')


def measure_radios(rig: Rig, options: argparse.Namespace) -> None:
    """Print missed cycles of the 1 kHz loop with radios of several rates and without limit."""
    rig.listen_on_ground()
    table('rate of the radio', 'missed cycles of the bridge', 'longest period of the bridge',
          'periods above 20 ms', 'traffic', 'packets')  # fmt: skip
    rates = [rate for limit in ('6mbit', '2mbit', '1mbit', '8kbit') for rate in ('', limit)]
    for name, _ in radios(rig, *((rate, 0.0) for rate in rates)):
        result: list[Loop] = []
        kbits, packets = rig.traffic(lambda result=result: result.append(rig.loop(options.seconds)))
        (loop,) = result
        row(name, f'{loop.lost:.2%}', f'{1e3 * loop.longest:.1f} ms', loop.gaps,
            f'{kbits:.0f} kbit/s', f'{packets:.0f}/s')  # fmt: skip


def measure_stops(rig: Rig, options: argparse.Namespace) -> None:
    """Print the time from an e-stop on the ground until the arm is damped."""
    table('packet loss per direction', 'e-stops', 'time until damped, median', 'p99', 'longest')
    rig.relay.send_line('delay 0.005')
    for loss in losses(rig):
        times = press(rig, options.presses)
        q50, q99 = np.quantile(times, [0.5, 0.99])
        row(f'{loss:.0%}', len(times), f'{q50:.3f} s', f'{q99:.3f} s', f'{max(times):.3f} s')


def measure_fresh_stops(rig: Rig, options: argparse.Namespace) -> None:
    """Print the time from the start of `arm e_stop` on the ground until the arm is damped."""
    table('packet loss per direction', '`arm e_stop` started', 'time until damped, median',
          'longest')  # fmt: skip
    for loss in losses(rig):
        times = []
        for _ in range(options.starts):
            begin = time.monotonic()
            process = rig.arm('e_stop')
            times.append(rig.drone.wait(is_fault, begin) - begin)
            process.wait()
            rig.clear()
        row(f'{loss:.0%}', len(times), f'{np.median(times):.2f} s', f'{max(times):.2f} s')


def measure_cuts(rig: Rig, options: argparse.Namespace) -> None:
    """Print when an e-stop during a cut takes effect after the connection is back."""
    table('cut of the connection', 'e-stop sent by', 'arm damped after the cut by',
          'shown as not delivered', 'arm damped during the cut',
          'joint states return after the cut by')  # fmt: skip
    for cut in options.cuts:
        for is_fresh in (False, True) if cut > 3.0 else (False,):
            rig.relay.send_line('cut 1')
            time.sleep(0.2)
            begin = time.monotonic()
            if is_fresh:
                process = rig.arm('e_stop')
            else:
                rig.ground.send_line('press')
            time.sleep(cut)
            early = any(is_fault(r) for r in rig.drone.rows() if r['time'] > begin)
            back = time.monotonic()
            rig.relay.send_line('cut 0')
            damped = rig.drone.wait(is_fault, begin)
            states = rig.ground.wait(lambda row: 'back' in row, begin)
            if is_fresh:
                process.wait()
                shown = (rig.folder / 'arm_e_stop.log').read_text()
            else:
                time.sleep(0.3)
                shown = str([r.get('text') for r in rig.ground.rows() if r['time'] > begin])
            row(f'{cut:g} s', 'new `arm e_stop`' if is_fresh else 'running node',
                f'{damped - back:.3f} s', 'yes' if 'NOT DELIVERED YET' in shown else 'no',
                'yes' if early else 'no', f'{states - back:.3f} s')  # fmt: skip
            rig.clear()


def measure_watchdog(rig: Rig, options: argparse.Namespace) -> None:
    """Print how a moving arm reacts to a cut of the connection."""
    table('controller', 'ground_lost', 'cut of the connection', 'joint speed at its start',
          'joint speed at its end', 'motion of joint 1 during the cut',
          'distance to the home configuration', 'modes of the arm',
          'joint states return after the cut by', 'log')  # fmt: skip
    actions = [('continue', 5.0), *(('stop', cut) for cut in options.cuts), ('home', 5.0)]
    cuts = [('computed_torque', *action) for action in actions]
    before = controlled_by = ''
    for controller, action, cut in [*cuts, ('gravity_compensation', 'home', 5.0)]:
        if controller != controlled_by:
            controlled_by = controller
            rig.start_controller(controller)
            run(rig, 'enable', '--wait', 'running')
        if action != before:
            before = action
            rig.restart_drone_link(ground_lost=action, ground_timeout=1.0)
        move(rig)
        deadline = time.monotonic() + PATIENCE
        while abs(rig.state()[1][0]) < 0.2:
            if time.monotonic() > deadline:
                raise TimeoutError('the arm does not move')
        begin, speed = rig.state()
        cut_at = time.monotonic()
        rig.relay.send_line('cut 1')
        time.sleep(cut)
        end, last = rig.state()
        back = time.monotonic()
        rig.relay.send_line('cut 0')
        states = rig.ground.wait(lambda row: 'back' in row, cut_at)
        time.sleep(0.5)
        modes = [r['mode'] for r in rig.drone.rows() if 'mode' in r and r['time'] > cut_at]
        said = [
            line for line in rig.log('ground', 'ground_link').splitlines() if 'back after' in line
        ]
        row(controller, action, f'{cut:g} s', f'{abs(speed[0]):.2f} rad/s',
            f'{np.abs(last).max():.2f} rad/s', f'{begin[0] - end[0]:.2f} rad',
            f'{np.abs(end - HOME).max():.2f} rad', ' '.join(map(str, modes)) or 'running',
            f'{states - back:.2f} s',
            said[-1].split(': ')[-1] if said else 'none')  # fmt: skip


def measure_discovery(rig: Rig, options: argparse.Namespace) -> None:
    """Print how long a restarted ground computer needs to find its drone."""
    table('packet loss per direction', 'starts', 'drone found after, median', 'longest',
          'longest, including the start of the process')  # fmt: skip
    for loss in losses(rig):
        times = np.array([rig.restart_ground_link() for _ in range(options.starts)])
        row(f'{loss:.0%}', len(times), f'{np.median(times[:, 1]):.3f} s',
            f'{times[:, 1].max():.3f} s', f'{times[:, 0].max():.2f} s')  # fmt: skip


def measure_listeners(rig: Rig, options: argparse.Namespace) -> None:
    """Print missed cycles while local subscribers start, with a radio nearly out of range."""
    rig.hosts.set_rate('8kbit')
    table('new local subscribers', 'missed cycles of the bridge', 'longest period of the bridge',
          'periods above 20 ms', 'first joint states after, median', 'longest')  # fmt: skip
    command = (sys.executable, str(HERE / 'new_listener.py'), str(options.listeners))
    rig.mark()
    begin = time.monotonic()
    done = rig.hosts.drone.start(*command, environment=DOMAIN, stdout=subprocess.PIPE)
    times = json.loads(done.communicate()[0])
    loop = Loop.of(rig.mark(), time.monotonic() - begin)
    row(len(times), f'{loop.lost:.2%}', f'{1e3 * loop.longest:.1f} ms', loop.gaps,
        f'{np.median(times):.2f} s', f'{max(times):.2f} s')  # fmt: skip
    rig.hosts.set_rate('')


def measure_recording(rig: Rig, options: argparse.Namespace) -> None:
    """Print how long the ground needs to fetch a bag that was recorded on the drone."""
    table('rate of the radio', 'packet loss per direction', 'recorded messages', 'size of the bag',
          'lost messages', 'fetched in', 'data rate', 'after a cut of 3 s',
          'time of an e-stop during the fetch')  # fmt: skip
    for number, (name, loss) in enumerate(radios(rig, ('', 0.0), ('1mbit', 0.0), ('1mbit', 0.2))):
        process = rig.arm('record', f'bag{number}')
        log = rig.folder / 'arm_record.log'
        wait_for_text(log, 'Ctrl-C ends the recording')
        time.sleep(options.seconds)
        process.send_signal(signal.SIGINT)
        wait_for_text(log, 'fetching')
        begin = time.monotonic()
        bag = rig.folder / f'bag{number}'
        while not any(bag.glob('*.part')) or sum(p.stat().st_size for p in bag.iterdir()) < 20_000:
            time.sleep(0.01)
        rig.relay.send_line('cut 1')
        time.sleep(3.0)
        rig.relay.send_line('cut 0')
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
        states = read_joint_states(bag)
        lost = lost_messages(states.sequence.tolist())
        row(name, loss, f'{len(states)} joint_states', f'{1e-6 * size:.2f} MB',
            lost, f'{took:.1f} s', f'{8e-6 * size / took:.2f} Mbit/s',
            'resumed, same bytes' if same and not status else f'FAILED, {status}',
            f'{stopped:.3f} s')  # fmt: skip


def measure_page(rig: Rig, options: argparse.Namespace) -> None:
    """Print how long the browser page on the ground takes to load, and how often it is updated."""
    # As prompt as the browser: other work on this machine must not count.
    start = ('chrt', '-f', '15', sys.executable, '-m', 'aerarm_ros.executables', 'view')
    log = rig.folder / 'ground_view.log'
    given = ('--ros-args', '-p', 'port:=8097')
    rig.hosts.ground.start(*start, *given, environment=DOMAIN, log=log)
    wait_for_text(log, 'in a browser')
    rig.start_controller()
    run(rig, 'enable', '--wait', 'running')
    table('rate of the radio', 'packet loss per direction', 'stop button shown after',
          'joint states shown after', 'text on the page', 'updates of the pose',
          'updates of the curves')  # fmt: skip
    script = str(HERE / 'page_watch.py')
    for name, loss in radios(rig, ('', 0.0), ('1mbit', 0.2)):
        move(rig)
        command = ('chrt', '-f', '10', sys.executable, script, 'http://127.0.0.1:8097')
        done = rig.hosts.ground.start(
            *command, str(options.seconds), environment=DOMAIN, stdout=subprocess.PIPE
        )
        found = json.loads(done.communicate()[0])
        row(name, loss, f'{found["button"]:.1f} s', f'{found["states"]:.1f} s',
            found['says'], f'{found["poses"]:.0f}/s', f'{found["curves"]:.0f}/s')  # fmt: skip


def measure_controller(_: Rig, __: argparse.Namespace) -> None:
    """Print whether a controller on the ground can command the arm over an open network."""
    table('network of a controller on the ground', 'result')
    with tempfile.TemporaryDirectory() as name, TwoHosts() as hosts:
        folder = Path(name)
        environment = {'ROS_DOMAIN_ID': '65', 'AERARM_NETWORK': 'open',
                       'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET'}  # fmt: skip
        given = ('--ros-args', '-p', 'realtime_priority:=50', '-p', 'encoders:=absolute')
        hosts.drone.node('fake_hardware', *given, environment=environment, folder=folder)
        hosts.ground.node('computed_torque', *given[:3], environment=environment,
                   folder=folder)  # fmt: skip
        wait_for_text(folder / 'drone_fake_hardware.log', 'idle')
        enabled = hosts.drone.node('arm', 'enable', '--wait', 'running',
                             environment=environment, folder=folder)  # fmt: skip
        enabled.wait(PATIENCE)
        text = (folder / 'drone_arm.log').read_text().strip().splitlines()
        row('`AERARM_NETWORK=open` on both hosts', '; '.join(text))


def measure_clocks(presses: int) -> None:
    """Print results with a wrong clock of the ground computer."""
    table("ground's clock", 'e-stops at 5 % packet loss', 'time until damped, median', 'longest',
          'clock offset on /diagnostics', 'distance from the goal',
          'largest latency on /diagnostics')  # fmt: skip
    for clock in ('', '+30s', '-30s', '+30s x1.001'):
        with tempfile.TemporaryDirectory() as folder, Rig(Path(folder), clock) as rig:
            rig.relay.send_line('delay 0.005')
            rig.relay.send_line('loss 0.05')
            times = press(rig, presses)
            rig.start_controller()
            run(rig, 'enable', '--wait', 'running')
            run(rig, 'go', '0.3', '1.2', '0.3', '0.3', '--tolerance', '0.05')
            error = np.abs(rig.state()[0] - [0.3, 1.2, 0.3, 0.3]).max()
            begin = time.monotonic()
            rig.ground.send_line('diagnostics')
            when = rig.ground.wait(lambda row: 'offset' in row, begin)
            found = next(r for r in rig.ground.rows() if r['time'] == when)
            row(clock or "equal to the drone's", presses, f'{np.median(times):.3f} s',
                f'{max(times):.3f} s', f'{found["offset"]:+.1f} ms', f'{error:.3f} rad',
                f'{found["latency"]} us')  # fmt: skip


HOME = np.array(load_arm_config(None).rest_position)
"""Home configuration of the packaged arm [rad]."""


PARTS = {
    'stops': measure_stops,
    'fresh': measure_fresh_stops,
    'cuts': measure_cuts,
    'discovery': measure_discovery,
    'listeners': measure_listeners,
    'radios': measure_radios,
    'watchdog': measure_watchdog,
    'page': measure_page,
    'controller': measure_controller,
    'recording': measure_recording,
}
CLOCKS = 'clocks'
"""Part that starts its own hosts."""


def missing_programs(parts: Sequence[str]) -> str:
    """Return which Debian packages the parts need and this machine lacks, '' if none."""
    needs = (('page', 'chromium'), (CLOCKS, 'faketime'))
    absent = [name for part, name in needs if part in parts and shutil.which(name) is None]
    names = ', '.join(absent)
    return f'{names} is not installed: apt-get install {" ".join(absent)}' if absent else ''


def main() -> int:
    """Measure and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add('--presses', type=int, default=100, help='number of e-stops per loss rate (default: 100)')
    add('--starts', type=int, default=10, help='process starts per loss rate (default: 10)')
    add('--listeners', type=int, default=200, help='new local subscribers (default: 200)')
    add('--seconds', type=float, default=8.0, help='duration per radio [s] (default: 8)')
    add('--cuts', type=float, nargs='+', default=[0.5, 5.0, 60.0],
        help='durations of the cuts [s] (default: 0.5 5 60)')  # fmt: skip
    names = [*PARTS, CLOCKS]
    add('--only', nargs='+', choices=names, default=names, help='parts to measure (default: all)')
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # ends what was started
    problem = missing_rights() or missing_programs(options.only)
    if problem:
        print(f'two_hosts: {problem}', file=sys.stderr)
        return 1
    load = ' '.join(f'{load:.1f}' for load in os.getloadavg())
    print(f'{machine()}\n\nload {load}', flush=True)
    with tempfile.TemporaryDirectory() as folder, Rig(Path(folder)) as rig:
        for name, measure in PARTS.items():
            if name in options.only:
                measure(rig, options)
    if CLOCKS in options.only:
        measure_clocks(max(5, options.presses // 5))
    return 0


if __name__ == '__main__':
    sys.exit(main())
