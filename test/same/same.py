"""Compare a run of this code with a stored record: `make same`.

A refactoring must not change what the suite computes. This script runs the emulated arm, the
attacks on the bridge, the identifier and the other programs on fixed inputs, and compares the
results with `record.json`:

- `lockstep`: every byte of joint_states, motor_states and joint_command while the arm homes,
  enables, plays an excitation and runs each controller, and of a drone that flies with its arm;
- `attacks`: the figures of each attack, the true motion of the arm, and every byte on the wire;
- `figures`: designer, planner, motor bench, payload estimator and identifier.

Motion and frames must be equal byte for byte, attack figures to the last digit, all other figures
to 1e-9 relative. Exit status 0 if all items are the same, 1 if one differs, 2 on a wrong argument.

A record is good for one machine with one set of packages: physics engine, linear algebra and the C
library round differently elsewhere. To check a change, write the record on the commit before it
(`make same RECORD=1`), then compare after it, on the same machine and environment. The record
names the versions that it was made with; the script first reports which of them differ here.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
RECORD = HERE / 'record.json'
PACKAGES = ('numpy', 'scipy', 'pin', 'mujoco', 'clarabel')
TOLERANCE = 1e-9  # relative, of figures
DATASETS = 'figures/datasets'
# One process per part, the longest ones first.
PARTS = {
    'attacks': ('same_attacks.py', 'attacks'),
    'zeros': ('same_attacks.py', 'zeros'),
    'excitation': ('same_lockstep.py', 'excitation'),
    'flight': ('same_lockstep.py', 'flight'),
    'motor_bench': ('same_lockstep.py', 'motor_bench'),
    'planner': ('same_lockstep.py', 'planner'),
    'computed_torque': ('same_lockstep.py', 'computed_torque'),
    'gravity_compensation': ('same_lockstep.py', 'gravity_compensation'),
    'kinematic_control': ('same_lockstep.py', 'kinematic_control'),
    'impedance_control': ('same_lockstep.py', 'impedance_control'),
    'designer': ('same_figures.py', 'designer'),
    'datasets': ('same_figures.py', 'datasets'),
}
PATIENCE = 1800.0  # [s] for one part
Items = dict[str, object]


def machine() -> dict[str, str]:
    """Return the properties of the machine on which the results depend."""
    found = {'python': platform.python_version(), 'machine': platform.machine(), 'cpu': _cpu()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = 'not installed by pip'
    return found


def _cpu() -> str:
    try:
        lines = Path('/proc/cpuinfo').read_text().splitlines()
    except OSError:
        return platform.processor()
    models = [line.split(':')[1].strip() for line in lines if line.startswith('model name')]
    return models[0] if models else platform.processor()


def run_part(name: str, number: int, folder: Path, datasets: str | None) -> Items:
    """Run one part in a separate process; return its items.

    Raises
    ------
    RuntimeError
        If the part fails, with the end of its output.
    """
    script, part = PARTS[name]
    out, work = folder / f'{name}.json', folder / name
    work.mkdir()
    environment = {
        **os.environ,
        # The code next to this script, even if another checkout is installed.
        'PYTHONPATH': os.pathsep.join([str(ROOT), str(ROOT / 'test' / 'hardware')]),
        'PYTHONHASHSEED': '0',
        'OMP_NUM_THREADS': '1',
        'OPENBLAS_NUM_THREADS': '1',
        'ROS_DOMAIN_ID': str(1 + (os.getpid() + number) % 100),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        'ROS_LOG_DIR': str(work / 'ros'),
        'FASTRTPS_DEFAULT_PROFILES_FILE': str(ROOT / 'config' / 'fastdds.xml'),
    }
    command = [sys.executable, str(HERE / script), part, '--out', str(out), '--work', str(work)]
    if datasets is not None and name == 'datasets':
        command += ['--datasets', datasets]
    begun = time.monotonic()
    done = subprocess.run(
        command,
        cwd=ROOT,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=PATIENCE,
    )
    if done.returncode or not out.exists():
        raise RuntimeError(f'exit status {done.returncode}:\n{done.stdout[-3000:]}')
    print(f'  {name} took {time.monotonic() - begun:.0f} s', flush=True)
    items: Items = json.loads(out.read_text())
    return items


def run_parts(names: list[str], datasets: str | None, jobs: int) -> tuple[Items, dict[str, str]]:
    """Run parts, some at a time; return their items, and the failures by part."""
    items: Items = {}
    failures: dict[str, str] = {}
    with tempfile.TemporaryDirectory(prefix='same_') as folder, ThreadPoolExecutor(jobs) as pool:
        futures = {
            name: pool.submit(run_part, name, number, Path(folder), datasets)
            for number, name in enumerate(names)
        }
        for name, future in futures.items():
            try:
                items.update(future.result())
            except (RuntimeError, subprocess.TimeoutExpired, ValueError) as error:
                failures[name] = str(error)
    return items, failures


def first_difference(old: object, new: object, tolerance: float, where: str = '') -> str:
    """Return place and kind of the first difference of two results, or an empty text.

    Parameters
    ----------
    old, new
        JSON values: of the record, and of this run.
    tolerance
        Relative tolerance of numbers; 0 for equal numbers.
    where
        Place of the values.
    """
    if isinstance(old, dict) and isinstance(new, dict):
        for key in [*old, *(key for key in new if key not in old)]:
            place = f'{where}/{key}' if where else str(key)
            if key not in old or key not in new:
                return f'{place}: only in {"the record" if key in old else "this run"}'
            if found := first_difference(old[key], new[key], tolerance, place):
                return found
        return ''
    if isinstance(old, list) and isinstance(new, list):
        for index, pair in enumerate(zip(old, new, strict=False)):
            if found := first_difference(*pair, tolerance, f'{where}[{index}]'):
                return found
        return '' if len(old) == len(new) else f'{where}: {len(old)} values, now {len(new)}'
    return '' if _is_same(old, new, tolerance) else f'{where}: {old!r}, now {new!r}'


def _is_same(old: object, new: object, tolerance: float) -> bool:
    if old == new:
        return True
    numbers = (int, float)
    if not isinstance(old, numbers) or not isinstance(new, numbers):
        return False
    if isinstance(old, bool) or isinstance(new, bool):
        return False
    both_nan = old != old and new != new
    return both_nan or abs(old - new) <= tolerance * max(abs(old), abs(new))


def compare(old: Items, new: Items, expected: list[str]) -> int:
    """Print one line per item; return the number of differences.

    Parameters
    ----------
    old, new
        Items of the record, and of this run.
    expected
        Items of the record that this run must have.
    """
    missing = [name for name in expected if name not in new]
    for name in missing:
        print(f'different  {name}: only in the record')
    different = len(missing)
    for name in new:
        if name not in old:
            found = 'not in the record: write it with --record'
        else:
            tolerance = TOLERANCE if name.startswith('figures/') else 0.0
            found = first_difference(old[name], new[name], tolerance)
        different += bool(found)
        print(f'{"different" if found else "same":10} {name}{": " + found if found else ""}')
    return different


def read_record(path: Path) -> tuple[dict[str, str], Items]:
    """Return machine and items of a record; exits if it cannot be read."""
    try:
        record = json.loads(path.read_text())
        return record['machine'], record['items']
    except (OSError, ValueError, KeyError, TypeError) as error:
        sys.exit(f'same: {path} is no record ({error}): write one with --record on the old commit')


def report_machine(old: dict[str, str]) -> None:
    """Print the differences between the machine of a record and this one."""
    new = machine()
    changed = [
        f'{key}: {old.get(key, "unknown")}, here {new.get(key, "unknown")}'
        for key in {**old, **new}
        if old.get(key) != new.get(key)
    ]
    if changed:
        print('The record was made on another machine or with other packages:')
        print(''.join(f'  {line}\n' for line in changed), end='')
        print('Differences below may come from that: write a record here on the old commit.')
    else:
        print(f'The record was made with these versions: {", ".join(new.values())}')


def parse_arguments() -> argparse.Namespace:
    """Return the checked command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument('--record', action='store_true', help='write the record')
    parser.add_argument(
        '--file', type=Path, default=RECORD, help='the record (default: %(default)s)'
    )
    parser.add_argument(
        '--only',
        nargs='+',
        choices=PARTS,
        default=list(PARTS),
        metavar='PART',
        help=', '.join(PARTS),
    )
    parser.add_argument(
        '--datasets',
        default=os.environ.get('AERARM_DATASETS') or None,
        metavar='DIR',
        help='folder of measured bags (default: environment variable AERARM_DATASETS)',
    )
    parser.add_argument('--jobs', type=int, default=2, help='parts at a time (default: 2)')
    options = parser.parse_args()
    if options.jobs < 1:
        parser.error('argument --jobs: must be at least 1')
    if options.datasets is not None and not Path(options.datasets).is_dir():
        parser.error(f'argument --datasets: {options.datasets} is no folder: give that of the bags')
    return options


def write_record(path: Path, items: Items, is_whole: bool) -> None:
    """Write the items; items of parts that did not run are copied from the old record."""
    kept: Items = {}
    if path.exists():
        kept = read_record(path)[1]
    if is_whole:
        kept = {name: item for name, item in kept.items() if name.startswith(DATASETS)}
    lines = [f'{json.dumps(name)}: {json.dumps(item)}' for name, item in {**kept, **items}.items()]
    text = ',\n'.join(lines)  # one line per item
    path.write_text(f'{{"machine": {json.dumps(machine())},\n"items": {{\n{text}\n}}}}\n')
    print(f'{path}: {len(items)} items written')


def main() -> int:
    """Run the parts, and compare them or write the record."""
    options = parse_arguments()
    old: Items = {}
    if not options.record:
        made_with, old = read_record(options.file)
        report_machine(made_with)
    names = list(dict.fromkeys(options.only))
    if options.datasets is None and 'datasets' in names:
        names.remove('datasets')
        print(
            "datasets skipped: set AERARM_DATASETS, or DATASETS=DIR for make, to the bags' folder"
        )
    begun = time.monotonic()
    items, failures = run_parts(names, options.datasets, options.jobs)
    for name, failure in failures.items():
        print(f'failed     {name}: {failure}')
    if options.record:
        if failures:
            print('No record written')
            return 1
        write_record(options.file, items, set(names) >= set(PARTS) - {'datasets'})
        return 0
    # A part that did not run, or failed, has no expected items.
    is_whole = set(names) >= set(PARTS) - {'datasets'} and not failures
    expected = [name for name in old if 'datasets' in names or not name.startswith(DATASETS)]
    different = compare(old, items, expected if is_whole else []) + len(failures)
    took = time.monotonic() - begun
    print(f'{len(items)} items in {took:.0f} s, {different} different')
    return 1 if different else 0


if __name__ == '__main__':
    sys.exit(main())
