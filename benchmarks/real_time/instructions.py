"""Instructions and memory traffic per cycle, which are independent of the machine's speed.

Each part of the work runs under valgrind's cachegrind twice, with different numbers of cycles; the
difference is the cost per cycle without start-up. The caches are those of a Raspberry Pi 4
(Cortex-A72): 48 KiB for instructions, 32 KiB for data, and a shared second level of 1 MiB. The
conversion to time is an assumption, see docs/reference/raspberry_pi_budget.md.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

from counting.work import PIECES, answering

HERE = Path(__file__).parent
CACHES = ('--cache-sim=yes', '--I1=49152,3,64', '--D1=32768,2,64', '--LL=1048576,16,64')
LINE = 64  # bytes
FEW, MANY = 500, 2000
CLOCK = 1.5e9  # [Hz] of a Raspberry Pi 4
PER_CYCLE = (1.2, 0.6)  # instructions of an interpreter per cycle of an A72, best and worst
RATE = 1000.0  # [Hz]


class Counts(NamedTuple):
    """Instructions, data references and bytes from memory."""

    instructions: float
    references: float
    traffic: float

    @staticmethod
    def of(piece: str, cycles: int) -> 'Counts':
        """Run a part for a number of cycles under cachegrind, and return its counts."""
        command = ['valgrind', '--tool=cachegrind', '--cachegrind-out-file=/dev/null', *CACHES]
        command += [sys.executable, '-m', 'counting.work', piece, str(cycles)]
        run = subprocess.run(command, cwd=HERE, capture_output=True, text=True)
        if run.returncode:
            raise SystemExit(f'{piece} failed under valgrind:\n{run.stderr[-2000:]}')

        def found(name: str) -> float:
            match = re.search(rf'{name}:\s+([\d,]+)', run.stderr)
            assert match, run.stderr
            return float(match[1].replace(',', ''))

        misses = found('LL misses')
        return Counts(found('I *refs'), found('D *refs'), LINE * misses)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        '--pieces', nargs='*', choices=PIECES, help='parts of the suite to count (default: all)'
    )
    options = parser.parse_args()
    if not shutil.which('valgrind'):
        print('valgrind is not installed, so nothing is counted: apt install valgrind')
        return
    os.environ['ROS_DOMAIN_ID'] = str(1 + os.getpid() % 100)
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    print(f'{"a cycle of":18}{"instructions":>14}{"data refs":>12}{"KiB/cycle":>11}  A72 core, %')
    for piece in options.pieces or [name for name in PIECES if name != answering.__name__]:
        few, many = (Counts.of(piece, cycles) for cycles in (FEW, MANY))
        cycle = Counts(*((m - f) / (MANY - FEW) for m, f in zip(many, few, strict=True)))
        shares = [100.0 * RATE * cycle.instructions / (CLOCK * ipc) for ipc in PER_CYCLE]
        print(
            f'{piece:18}{cycle.instructions:14.0f}{cycle.references:12.0f}'
            f'{cycle.traffic / 1024.0:11.1f}  {shares[0]:.0f} to {shares[1]:.0f}',
            flush=True,
        )


if __name__ == '__main__':
    main()
