"""Behaviour of a drone with an autopilot's firmware when a component fails during arm motion.

Each failure occurs during slow motion of the arm with full feed-forward, in a separate flight. The
output is the largest distance of the drone from its set point before and after the failure, and the
reports of the firmware. `PX4=<folder of a build>` or `ARDUPILOT=<folder of ArduPilot>` selects the
firmware.
"""

import argparse
import re
import signal
import sys
from collections.abc import Callable

import numpy as np
from firmware import BEST, HOW, flying, parse
from flying.arm_model import ArmModel
from flying.arm_swing import ArmSwing
from flying.flight_bench import FlightBench
from flying.flight_case import load_drone
from flying.flight_record import LOST
from flying.node_bench import FAILURES as ERRORS
from flying.node_bench import reason, ros_node
from rclpy.node import Node

DRONE = 'hexarotor'
_WHEN, _LENGTH, _RAMP = 3.0, 10.0, 1.0  # [s]
_AT_TOOL = [0.1, 0.0, 0.0]  # [m]
# Messages of PX4 or ArduCopter on a rejected set point or a failsafe.
_TOLD = re.compile(r'invalid|unsupported|not supported|[Ff]ailsafe|denied|rejected')


def _kill(*names: str) -> Callable[[FlightBench], None]:
    def act(bench: FlightBench) -> None:
        for name in names:
            bench.processes[name].stop(signal.SIGKILL)

    return act


FAILURES: dict[str, Callable[[FlightBench], None]] = {
    'nothing': lambda bench: None,
    'feed-forward stops': lambda bench: bench.switch({'feed_posture': False, 'feed_motion': False}),
    'base_reaction killed': _kill('base_reaction'),
    'computed_torque is killed, so the arm is damped and sinks': _kill('computed_torque'),
    'both killed': _kill('base_reaction', 'computed_torque'),
    '0.2 kg picked up': lambda bench: bench.change_world('payload', [0.2, *_AT_TOOL]),
    '0.5 kg picked up': lambda bench: bench.change_world('payload', [0.5, *_AT_TOOL]),
}


def fail(node: Node, options: argparse.Namespace, name: str) -> str:
    """Return a line with the results of one failure."""
    with flying(node, load_drone(DRONE), BEST, ArmModel.true(), options) as (bench, log):
        motion = ArmSwing('slow', _LENGTH, _RAMP)
        begin, now, is_done = bench.begin(motion), -np.inf, False
        while now < begin + motion.duration and bench.listener.farthest < LOST:
            now, _ = bench.listener.next()
            if not is_done and now > begin + _WHEN:
                FAILURES[name](bench)
                is_done = True
        record = bench.listener.record().shifted(begin)
        told = [line for line in log.read_text().splitlines() if _TOLD.search(line)]
    away = 1e3 * np.linalg.norm(record.places, axis=1)
    before = (record.times > 0.0) & (record.times < _WHEN)
    after = record.times >= _WHEN
    end = record.times > record.times[-1] - 1.0
    return (
        f'{name:52} {away[before].max():6.1f} {away[after].max():6.1f} {away[end].max():6.1f}  '
        f'{"lost" if record.is_lost else ""} {"; ".join(told)}'
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--failures', nargs='*', default=list(FAILURES), choices=list(FAILURES))
    options = parse(parser)
    if options.autopilot == 'betaflight':
        parser.error('failures are defined for px4 and ardupilot only: select one with --autopilot')
    if options.program is None:
        print(HOW[options.autopilot])
        return 1
    print(f'{"distance [mm]":52} before  after    end  reports')
    with ros_node() as node:
        for name in options.failures:
            try:
                print(fail(node, options, name), flush=True)
            except ERRORS as error:
                print(f'{name}: {reason(error)}', flush=True)
    return 0


if __name__ == '__main__':
    sys.exit(main())
