"""What maintenance asks for: which drives have changed since the last run of the bench."""

from argparse import Namespace
from copy import deepcopy
from pathlib import Path

import pytest
import yaml

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.files.estimate_comparison import compare_benches
from aerarm_ros.ros.programs.identifier_compare import CompareRun

OLD = {
    'viscous': [0.003, 1e-4],
    'coulomb': [0.10, 2e-3],
    'load_friction': [0.02, 5e-3],
    'rotor_inertia': [1.3e-5, 2e-7],
    'backlash': [0.010, 0.001],
}
# It rubs a little more than can be told, and its gear is worn.
NEW = OLD | {'coulomb': [0.104, 2e-3], 'backlash': [0.021, 0.001], 'torque_constant': [0.02, 1e-4]}


def written(folder: Path, name: str, **joints: dict) -> Path:
    (folder / name).mkdir()
    path = folder / name / 'motor_bench.yaml'
    path.write_text(
        yaml.safe_dump({'joints': {name: deepcopy(entry) for name, entry in joints.items()}})
    )
    return path


@pytest.fixture
def benches(tmp_path: Path) -> tuple[Path, Path]:
    old = written(tmp_path, 'old', joint2=OLD, joint3=OLD)
    return old, written(tmp_path, 'new', joint2=NEW)


def test_a_worn_gear_is_reported(benches: tuple[Path, Path], tmp_path: Path) -> None:
    comparison = compare_benches(*benches)
    assert len(comparison.changes) == len(OLD)
    (clear,) = [change for change in comparison.changes if change.is_clear]
    assert clear.name == 'backlash of joint2'
    assert clear.deviations == pytest.approx(0.011 / (0.001 * 2**0.5))
    out = tmp_path / 'out'
    folders = [path.parent for path in benches]
    options = Namespace(compare=folders, out=out, bag=[], model=None, payload=[])
    told = CompareRun(options).execute()
    assert told.startswith('backlash of joint2: 0.01 -> 0.021 rad (+7.8 standard deviations)')
    assert 'backlash of joint2' in (out / 'comparison.html').read_text()


def test_results_that_cannot_be_compared_raise_an_error(
    benches: tuple[Path, Path], tmp_path: Path
) -> None:
    old, new = benches
    other = written(tmp_path, 'other', joint4=OLD)
    with pytest.raises(IdentificationError, match='with the same joints'):
        compare_benches(new, other)
    with pytest.raises(IdentificationError, match='cannot be compared'):
        compare_benches(old, written(tmp_path, 'odd', joint2={'coulomb': 'much'}))
    with pytest.raises(IdentificationError, match='Coulomb friction of joint2 is not a number'):
        compare_benches(old, written(tmp_path, 'empty', joint2={'coulomb': [float('nan'), 0.0]}))
    other.write_text('a: 1\n')
    with pytest.raises(IdentificationError, match=r'is not a motor_bench\.yaml'):
        compare_benches(old, other)
    options = Namespace(compare=[old, tmp_path / 'x'], out=None, bag=[], model=None, payload=[])
    with pytest.raises(IdentificationError, match='pass two results of the same program'):
        CompareRun(options).execute()
