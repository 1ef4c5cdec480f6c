"""Read many mutants of bags and count the outcomes: `make fuzz`."""

import argparse
import json
import shutil
import sys
import tempfile
import time
import warnings
from collections import Counter
from pathlib import Path

import numpy as np
from bag_originals import OriginalBag, originals
from mutant_trial import ALTERED, FORGED, PROMISED, SHORTER, TrialResult, rows_of, tried
from mutation import mutant

OUTCOMES = (*PROMISED, ALTERED, FORGED, SHORTER)
LONGEST, LARGEST = 2.0, 300.0
"""What a mutant may take [s], [MB]."""


def judged(result: TrialResult, bag: OriginalBag, forged: bool) -> str:
    """Return the error in a result, or an empty text."""
    allowed = [*PROMISED]
    allowed += [] if bag.checked else [ALTERED]
    allowed += [] if bag.finished else [SHORTER]
    allowed += [FORGED] if forged else []
    if result.outcome not in allowed:
        return result.outcome
    if result.time > LONGEST:
        return f'took {result.time:.1f} s'
    return f'took {result.memory:.0f} MB' if result.memory > LARGEST else ''


def run(count: int, seed: int, first: int, folder: Path) -> dict[str, object]:
    """Read mutants and return counts of outcomes by bag, failures, and the worst figures."""
    bags = originals(folder)
    sound = []
    for bag in bags:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')
            sound.append(rows_of(_written(folder / 'sound', bag.files)))
    counts: dict[str, Counter[str]] = {bag.name: Counter() for bag in bags}
    worst_time = worst_memory = (0.0, '')
    failures = []
    for k in range(first, first + count):
        rng = np.random.default_rng([seed, k])
        index = int(rng.integers(len(bags)))
        bag = bags[index]
        files, done = mutant(bags, index, rng)
        forged = 'bomb' in done or 'spliced' in done and not bag.checked
        result = tried(
            _written(folder / 'mutant', files), sound[index], bag.checked, forged, bag.finished
        )
        what = f'{k}: {bag.name}, {done}'
        counts[bag.name][result.outcome if result.outcome in OUTCOMES else 'failed'] += 1
        worst_time = max(worst_time, (result.time, what))
        worst_memory = max(worst_memory, (result.memory, what))
        if wrong := judged(result, bag, forged):
            failures.append(f'{what}: {wrong}')
    return {
        'counts': counts,
        'failures': failures,
        'worst time': worst_time,
        'worst memory': worst_memory,
    }


def _written(folder: Path, files: dict[str, bytes]) -> Path:
    """Write a bag's files into an empty directory, and return it, or the single file of ROS 1."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for name, content in files.items():
        (folder / name).write_bytes(content)
    return next(folder.glob('*.bag'), folder)


def main() -> int:
    """Print the outcomes of all mutants; return 1 if one of them failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--count', type=int, default=20_000, help='mutants')
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--first', type=int, default=0, help='number of the first mutant')
    parser.add_argument('--json', type=Path, help='file for the result')
    options = parser.parse_args()
    begin = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        found = run(options.count, options.seed, options.first, Path(folder))
    if options.json:
        options.json.write_text(json.dumps(found))
    _print(found, time.monotonic() - begin)
    return 1 if found['failures'] else 0


def _print(found: dict, duration: float) -> None:  # type: ignore[type-arg]
    columns = [*OUTCOMES, 'failed']
    print(f'{"":30}', *(f'{name:>8}' for name in columns))
    total: Counter[str] = Counter()
    for name, counts in found['counts'].items():
        total += counts
        print(f'{name:30}', *(f'{counts[column]:8}' for column in columns))
    print(f'{"all":30}', *(f'{total[column]:8}' for column in columns))
    print(*found['failures'], sep='\n')
    print(f'longest   {found["worst time"][0]:.2f} s ({found["worst time"][1]})')
    print(f'largest   {found["worst memory"][0]:.0f} MB ({found["worst memory"][1]})')
    print(f'{total.total()} mutants in {duration:.0f} s')


if __name__ == '__main__':
    sys.exit(main())
