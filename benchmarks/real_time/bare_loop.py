"""Timing accuracy of the machine, measured by a periodic loop without work and by cyclictest.

Benchmarks that measure time use this module; it can also be run alone. The loop only sleeps until
its next deadline, with the priority of a bridge. cyclictest (package rt-tests) is a standard
latency test of the operating system; it runs if it is installed.
"""

import argparse
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

from aerarm_ros.realtime.periodic_loop import PeriodicLoop
from aerarm_ros.realtime.scheduling import freeze_garbage_collector, set_fifo

PERIOD = 1e-3
PRIORITY = 80


def run_loop(seconds: float) -> dict[str, float]:
    """Return figures of a bare loop: missed cycles [%], lateness p50, p99.9, max [us]."""
    set_fifo(PRIORITY)
    freeze_garbage_collector()
    loop = PeriodicLoop(PERIOD)
    cycles = round(seconds / PERIOD)

    def cycle(now_ns: int, index: int) -> None:
        if index >= cycles:
            loop.stop()

    loop.run(cycle)
    late = loop.lateness.summary()
    return {
        'missed': 100.0 * loop.missed / (loop.cycles + loop.missed),
        'p50': 1e6 * late.p50,
        'p99.9': 1e6 * late.p999,
        'max': 1e6 * late.maximum,
    }


class BareLoops:
    """Run the bare loop, and cyclictest if installed, in processes parallel to a measurement.

    Parameters
    ----------
    seconds
        Duration [s].
    """

    def __init__(self, seconds: float) -> None:
        command = [sys.executable, str(Path(__file__)), '--seconds', str(seconds), '--json']
        self._loop = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        self._cyclic = None
        if shutil.which('cyclictest'):
            options = ['-q', '-i', '1000', '-p', str(PRIORITY), '-D', f'{max(1, round(seconds))}s']
            self._cyclic = subprocess.Popen(
                ['cyclictest', *options], stdout=subprocess.PIPE, text=True
            )

    def lines(self) -> list[str]:
        """Wait for the processes to end; return one line for each."""
        figures = json.loads(self._loop.communicate()[0])
        lines = [
            f'{"bare loop beside it":38}{figures["missed"]:8.2f} % missed, wake-up latency '
            f'{figures["p50"]:.0f} us (median), {figures["p99.9"]:.0f} us (p99.9), '
            f'{figures["max"]:.0f} us (largest)'
        ]
        if self._cyclic is not None:
            text = self._cyclic.communicate()[0]
            found = re.search(r'Avg:\s*(\d+)\s+Max:\s*(\d+)', text)
            said = f'{found[1]} us late on average, {found[2]} us at most' if found else text
            lines.append(f'{"cyclictest beside it":38}{said:>8}')
        return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seconds', type=float, default=10.0, help='duration of the run [s]')
    parser.add_argument('--json', action='store_true', help='run only the bare loop and print JSON')
    options = parser.parse_args()
    if options.json:
        print(json.dumps(run_loop(options.seconds)))
    else:
        print(*BareLoops(options.seconds).lines(), sep='\n')


if __name__ == '__main__':
    main()
