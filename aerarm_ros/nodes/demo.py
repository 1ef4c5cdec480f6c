"""The whole path in one command: move the emulated arm, record, identify, validate.

Starts the suite's nodes as separate processes, as a user would with `ros2 run`,
and ends with a table of torque errors and the path of a report.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from subprocess import TimeoutExpired

import rclpy
from rclpy.signals import SignalHandlerOptions

from aerarm_ros.ros.process.discovery_profile import use_packaged_profile
from aerarm_ros.ros.process.node_process import NodeProcess
from aerarm_ros.ros.programs.demo_account import DemoAccount
from aerarm_ros.ros.requests.arm_client import ArmClient, ArmClientError

# Stands in the folder until everything in it is whole.
INCOMPLETE = 'INCOMPLETE'
# [s] A slow or busy machine takes long to load its libraries, and for the arm's time to pass.
_START_TIME = 120
_PATIENCE = 300.0


class DemoError(RuntimeError):
    """A step of the demo failed; the message says which and where its log is."""


@dataclass(frozen=True)
class Motion:
    """One recorded run of the arm."""

    name: str
    seed: int
    bag: Path


def main(arguments: list[str] | None = None) -> int:
    """Run the demo; return 0 when the identified model is written."""
    options = _parse(arguments)
    _isolate_from_other_ros_graphs()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    out: Path = options.out
    try:
        if out.is_dir() and any(out.iterdir()):
            raise FileExistsError('it is not empty')
        (out / 'logs').mkdir(parents=True)
        marker = out / INCOMPLETE
        marker.write_text('The demo is still running, or ended before its result was whole.\n')
    except OSError as error:
        reason = error.strerror or error
        print(f'demo: {out} cannot be used ({reason}): name another with --out', file=sys.stderr)
        return 2
    started = time.monotonic()
    motions = [
        Motion('identification', options.seed, out / 'identification_bag'),
        Motion('validation', options.seed + 1, out / 'validation_bag'),
    ]
    try:
        account = _move_and_record(motions, out, options)
        _identify(motions, out)
    except (DemoError, ArmClientError) as error:
        print(f'demo: {error}\ndemo: {out} is incomplete', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(f'\ndemo: interrupted, every node was stopped; {out} is incomplete', file=sys.stderr)
        return 130
    marker.unlink()
    print(*account.lines(), f'Time      {time.monotonic() - started:.0f} s', sep='\n')
    return 0


def _parse(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog='demo', description=__doc__.splitlines()[0])
    parser.add_argument(
        '--out',
        type=Path,
        default=Path('output') / datetime.now().strftime('demo_%Y%m%d_%H%M%S'),
        help='folder for bags, logs and the result (default: %(default)s)',
    )
    parser.add_argument('--seed', type=int, default=1, help='seed of the trajectories')
    parser.add_argument('--arm-seed', type=int, default=7, help="seed of the arm's true parameters")
    parser.add_argument(
        '--periods',
        type=_at_least_one,
        default=2,
        help='periods of 10 s in each trajectory (default: 2)',
    )
    parser.add_argument(
        '--priority', type=int, default=80, help='SCHED_FIFO priority of the bridge, 0 for none'
    )
    return parser.parse_args(arguments)


def _at_least_one(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f'{value} is below 1')
    return value


def _isolate_from_other_ros_graphs() -> None:
    """Keep the emulated arm off a network where a real one may be listening."""
    os.environ.setdefault('ROS_DOMAIN_ID', str(random.randint(1, 100)))
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    for name in ('ROS_STATIC_PEERS', 'ROS_DISCOVERY_SERVER'):
        os.environ.pop(name, None)  # they reach beyond this host all the same


def _move_and_record(motions: list[Motion], out: Path, options: argparse.Namespace) -> DemoAccount:
    """Drive the emulated arm through the motions; return what its nodes say of it."""
    logs = out / 'logs'
    hardware = NodeProcess(
        'fake_hardware',
        parameters={
            'seed': options.arm_seed,
            'truth_file': out / 'truth.yaml',
            'realtime_priority': options.priority,
        },
        log=logs / 'fake_hardware.log',
    )
    with hardware, _arm_client() as client:
        print('Arm       emulated boards are starting', flush=True)
        _wait_for_bridge(hardware, client)
        client.call('enable')
        client.wait_for_mode(['ready'], _PATIENCE)
        for motion in motions:
            _run_motion(motion, logs, options)
            client.call('enable')  # hold the arm, which is only damped once its commands end
    if hardware.returncode != 0:
        raise DemoError(f'fake_hardware ended with {hardware.returncode}:\n{hardware.tail()}')
    try:
        return DemoAccount.read(
            logs / 'fake_hardware.log', {m.name: _recorder_log(logs, m) for m in motions}
        )
    except ValueError as error:
        raise DemoError(str(error)) from None


def _wait_for_bridge(hardware: NodeProcess, client: ArmClient) -> None:
    for _ in range(_START_TIME):
        try:
            return client.wait_for_mode(['idle'], timeout=1.0)
        except ArmClientError:
            if hardware.returncode is not None:
                raise DemoError(
                    f'fake_hardware ended with {hardware.returncode}:\n{hardware.tail()}'
                ) from None
    raise DemoError(f'fake_hardware is not ready after {_START_TIME} s: see {hardware.log}')


@contextmanager
def _arm_client() -> Iterator[ArmClient]:
    use_packaged_profile()
    # Ctrl-C and SIGTERM end the demo as KeyboardInterrupt, with the context still valid.
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('demo')
    try:
        yield ArmClient(node, ['fake_hardware'])
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def _run_motion(motion: Motion, logs: Path, options: argparse.Namespace) -> None:
    with ExitStack() as stack:
        recorder = stack.enter_context(
            NodeProcess(
                'recorder',
                parameters={'bag': motion.bag},
                log=_recorder_log(logs, motion),
            )
        )
        print(f'Motion    {motion.name} (seed {motion.seed})', flush=True)
        excitation = stack.enter_context(
            NodeProcess(
                'excitation',
                parameters={
                    'seed': motion.seed,
                    'periods': options.periods,
                    'subscribers': 2,
                    'wait_for_recorder': True,
                    'wait_timeout': _PATIENCE,
                    'realtime_priority': max(0, options.priority - 1),
                },
            )
        )
        _wait(excitation, _PATIENCE * (2 + options.periods))
        if recorder.returncode is not None:
            raise DemoError(f'recorder ended early:\n{recorder.tail()}')
    if recorder.returncode != 0:
        raise DemoError(f'recorder ended with {recorder.returncode}:\n{recorder.tail()}')


def _identify(motions: list[Motion], out: Path) -> None:
    identification, validation = motions
    arguments = ['--bag', str(identification.bag), '--validation', str(validation.bag)]
    arguments += ['--truth', str(out / 'truth.yaml'), '--out', str(out / 'result')]
    with NodeProcess('identifier', arguments) as identifier:
        _wait(identifier, 2 * _PATIENCE)
    # The promise of the demo, checked and not only printed.
    solvers = json.loads((out / 'result' / 'summary.json').read_text())['solvers']
    if not solvers['sdp']['physically_consistent']:
        raise DemoError('the identified model is not physically consistent: see the report')
    cad, identified = (solvers[name]['validation'][0]['filtered'] for name in ('cad', 'sdp'))
    if identified > 0.5 * cad:
        raise DemoError(f'the identified model ({identified:.1f} %) does not beat CAD clearly')


def _wait(process: NodeProcess, timeout: float) -> None:
    """Wait for a good end of a process; raise DemoError if there is none within `timeout` [s]."""
    try:
        status = process.wait(timeout)
    except TimeoutExpired:
        raise DemoError(f'{process.name} did not end within {timeout:g} s') from None
    if status != 0:
        raise DemoError(f'{process.name} ended with {status}')


def _recorder_log(logs: Path, motion: Motion) -> Path:
    return logs / f'recorder_{motion.name}.log'


if __name__ == '__main__':
    sys.exit(main())
