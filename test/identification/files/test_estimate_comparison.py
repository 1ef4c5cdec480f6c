"""What is told of two results is what differs by more than they are uncertain."""

import json
from argparse import Namespace
from pathlib import Path

import numpy as np
import pytest
import yaml

from aerarm_ros.identification.files.equivalent_friction import equivalent_friction
from aerarm_ros.identification.files.estimate_comparison import compare_estimates
from aerarm_ros.identification.files.estimate_file import estimate_yaml
from aerarm_ros.identification.recording.identification_error import IdentificationError
from aerarm_ros.ros.programs.identifier_compare import CompareRun


@pytest.fixture(scope='module')
def text(result) -> str:
    estimate = result.recommended.estimate
    return estimate_yaml(result, estimate, *equivalent_friction(estimate, result.identification))


@pytest.fixture
def results(text: str, tmp_path: Path) -> tuple[Path, Path]:
    """Two result folders: in the second joint 2 rubs more, and a link is heavier by too little."""
    document = yaml.safe_load(text)
    parameters = document['/**']['ros__parameters']
    parameters['coulomb'][1] += 10.0 * parameters['standard_deviation']['coulomb'][1]
    base = parameters['base_parameters']
    base['values'][3] += 2.0 * base['standard_deviations'][3]
    base['values'][4] -= 20.0 * base['standard_deviations'][4]
    for name, content in (('old', text), ('new', yaml.safe_dump(document))):
        (tmp_path / name).mkdir()
        (tmp_path / name / 'estimate.yaml').write_text(content)
    return tmp_path / 'old', tmp_path / 'new'


def test_clear_changes_are_told_from_uncertain_ones(result, results: tuple[Path, Path]) -> None:
    old, new = (folder / 'estimate.yaml' for folder in results)
    comparison = compare_estimates(old, new)
    assert len(comparison.friction) == 8
    names = [name for name in result.used_base.expressions() if not name.startswith(('fv_', 'fs_'))]
    assert [change.name for change in comparison.inertia] == names
    clear = [change for change in comparison.changes if change.is_clear]
    changed = ['coulomb friction of joint2', result.used_base.expressions()[4]]
    assert [change.name for change in clear] == changed
    # Both are uncertain.
    assert clear[0].deviations == pytest.approx(10.0 / np.sqrt(2.0))
    assert not any(change.is_clear for change in compare_estimates(old, old).changes)


def test_the_command_tells_writes_and_shows_it(results: tuple[Path, Path], tmp_path: Path) -> None:
    out = tmp_path / 'out'
    options = Namespace(compare=list(results), out=out, bag=[], model=None, payload=[])
    told = CompareRun(options).execute()
    assert 'coulomb friction of joint2: ' in told
    assert '2 of ' in told
    page = (out / 'comparison.html').read_text()
    assert 'new against old' in page
    assert page.count('Plotly.newPlot(') == 2
    changes = json.loads((out / 'summary.json').read_text())['changes']
    assert sum(change['clear'] for change in changes) == 2
    with pytest.raises(IdentificationError, match='give no bags'):
        CompareRun(Namespace(**{**vars(options), 'bag': [out]}))


def test_what_cannot_be_compared_is_said(results: tuple[Path, Path], tmp_path: Path) -> None:
    old, new = (folder / 'estimate.yaml' for folder in results)
    other = tmp_path / 'other.yaml'
    other.write_text(old.read_text().replace('joint4', 'elbow'))
    with pytest.raises(IdentificationError, match='compare two results of one arm'):
        compare_estimates(old, other)
    other.write_text('a: 1\n')
    with pytest.raises(IdentificationError, match=r'is no estimate\.yaml'):
        compare_estimates(other, new)
    document = yaml.safe_load(old.read_text())
    del document['/**']['ros__parameters']['base_parameters']
    other.write_text(yaml.safe_dump(document))
    with pytest.raises(IdentificationError, match='cannot be compared'):
        compare_estimates(old, other)
