"""Figures of designer, planner, motor bench and identifier on fixed inputs, for `same.py`."""

import argparse
import json
import sys
from importlib.metadata import files
from pathlib import Path

from same_programs import figures, finish

FINGERS = ('panda_finger_joint1', 'panda_finger_joint2')
RENAMED = tuple(f'fer_joint{i}=panda_joint{i}' for i in range(1, 8))
# Directory of the bag, URDF in the package example-robot-data, further arguments of the
# identifier.
DATASETS = (
    ('ur10_excitation', 'ur10_robot.urdf', ()),
    ('panda_excitation', 'panda.urdf', ('--lock', *FINGERS, '--rename', *RENAMED)),
)
SOLVERS = ('--solvers', 'wls', 'entropic')


def designer(work: Path) -> dict[str, object]:
    """Design an excitation from one start, which ends long before the time limit."""
    out = work / 'designed'
    out.mkdir()
    motion = ['--out', str(out / 'trajectory.yaml'), '--duration', '10', '--validation']
    finish('excitation_designer', *motion, '--starts', '1', '--workers', '1', '--time-limit', '500')
    return figures('designer', out)


def datasets(work: Path, folder: Path) -> dict[str, object]:
    """Identify measured robots from the first 60 % of their motion."""
    items: dict[str, object] = {}
    for name, urdf, options in DATASETS:
        bag = folder / name
        if not bag.is_dir():
            raise RuntimeError(f'no {bag}: give the folder that holds {name}')
        out = work / name
        described = ['--urdf', str(example_urdf(urdf)), '--holdout', '0.4', '--out', str(out)]
        finish('identifier', '--bag', str(bag), *described, *SOLVERS, *options)
        items |= figures(f'datasets/{name}', out)
    return items


def example_urdf(name: str) -> Path:
    """Return the path of a URDF of the package example-robot-data."""
    for file in files('example-robot-data') or ():
        if file.name == name and file.parent.name == 'urdf':
            return Path(str(file.locate()))
    raise RuntimeError(f'example-robot-data has no {name}')


def main() -> None:
    """Write the items of one part."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('part', choices=('designer', 'datasets'))
    parser.add_argument('--out', type=Path, required=True)
    parser.add_argument('--work', type=Path, required=True)
    parser.add_argument('--datasets', type=Path)
    options = parser.parse_args()
    try:
        if options.part == 'designer':
            items = designer(options.work)
        else:
            items = datasets(options.work, options.datasets)
    except RuntimeError as error:
        sys.exit(str(error))
    options.out.write_text(json.dumps(items))


if __name__ == '__main__':
    main()
