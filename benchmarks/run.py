"""Run all benchmarks of this folder and its groups, and print a description of the machine."""

import argparse
import os
import platform
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent
GROUPS = ('.', 'real_time', 'model_fits', 'estimation')
BESIDE_PEERS = ('excitation', 'identification')


def machine() -> str:
    """Return one line that describes the machine on which the benchmarks run."""
    model = next(
        (
            line.split(':')[1].strip()
            for line in Path('/proc/cpuinfo').read_text().splitlines()
            if line.startswith(('model name', 'Model'))
        ),
        platform.machine(),
    )
    load = os.getloadavg()[0]
    system = f'Linux {platform.release()}, Python {platform.python_version()}'
    return f'{model}, {os.cpu_count()} cores, {system}, load {load:.1f}'


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        '--no-peers',
        action='store_true',
        help=f'run {" and ".join(BESIDE_PEERS)} without the comparison with other tools',
    )
    options = parser.parse_args()
    print(f'Machine: {machine()}')
    failed = 0
    scripts = [script for group in GROUPS for script in sorted((HERE / group).glob('*.py'))]
    for script in scripts:
        # The corresponding benchmark runs the comparisons with other tools.
        if script.name == Path(__file__).name or script.stem.endswith('_peers'):
            continue
        print(f'\n== {script.stem} ==', flush=True)
        given = ['--no-peers'] if options.no_peers and script.stem in BESIDE_PEERS else []
        failed += subprocess.run([sys.executable, str(script), *given]).returncode != 0
    return 1 if failed else 0


if __name__ == '__main__':
    sys.exit(main())
