"""What is told of two results is what differs by more than they are uncertain."""

import json
from argparse import Namespace
from pathlib import Path

import numpy as np
import pytest
import yaml

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.files.estimate_comparison import compare_estimates
from aerarm_ros.identification.files.estimate_file import estimate_yaml
from aerarm_ros.identification.files.identified_robot import equivalent_friction
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
    deviations = np.reshape(parameters['friction_deviations']['torques'], (4, -1))
    parameters['friction']['coulomb'][1] += float(20.0 * deviations[1].max())
    base = parameters['base_parameters']
    base['values'][3] += 2.0 * base['standard_deviations'][3]
    base['values'][4] -= 20.0 * base['standard_deviations'][4]
    for name, content in (('old', text), ('new', yaml.safe_dump(document))):
        (tmp_path / name).mkdir()
        (tmp_path / name / 'estimate.yaml').write_text(content)
    return tmp_path / 'old', tmp_path / 'new'


def test_significant_changes_are_distinguished_from_uncertain_ones(
    result, results: tuple[Path, Path]
) -> None:
    old, new = (folder / 'estimate.yaml' for folder in results)
    comparison = compare_estimates(old, new)
    assert len(comparison.friction) == 12
    names = [name for name in result.used_base.expressions() if not name.startswith(('fv_', 'fs_'))]
    assert [change.name for change in comparison.inertia] == names
    clear = [change for change in comparison.changes if change.is_clear]
    assert [change.name.partition(' at ')[0] for change in clear] == [
        *['friction of joint2'] * 3,
        result.used_base.expressions()[4],
    ]
    assert clear[3].deviations == pytest.approx(-20.0 / np.sqrt(2.0))  # both are uncertain
    assert not any(change.is_clear for change in compare_estimates(old, old).changes)


def test_friction_is_compared_whatever_terms_it_is_made_of(
    results: tuple[Path, Path], tmp_path: Path
) -> None:
    """Dry friction that turns round softly, and grows with the load: the same torque at speed."""
    old = results[0] / 'estimate.yaml'
    document = yaml.safe_load(old.read_text())
    parameters = document['/**']['ros__parameters']
    load = parameters['friction_deviations']['loads'][1]
    assert load > 0.5
    parameters['friction']['coulomb_width'] = [0.02] * 4
    parameters['friction']['load'][1] += 0.02
    parameters['friction']['coulomb'][1] -= 0.02 * load
    parameters['coulomb'] = [9.0] * 4  # what is nearest to it in (2.6) is not looked at
    new = tmp_path / 'new.yaml'
    new.write_text(yaml.safe_dump(document))
    for change in compare_estimates(old, new).friction:
        assert change.new == pytest.approx(change.old, abs=1e-6)
        assert change.std > 0.0
    # In another bag the arm carried more: friction is compared under the same load.
    parameters['friction_deviations']['loads'][1] = 3.0 * load
    new.write_text(yaml.safe_dump(document))
    more = compare_estimates(old, new).friction[3]
    assert more.new - more.old == pytest.approx(0.02 * load, rel=1e-3)


def test_the_command_prints_and_writes_the_comparison(
    results: tuple[Path, Path], tmp_path: Path
) -> None:
    out = tmp_path / 'out'
    options = Namespace(compare=list(results), out=out, bag=[], model=None, payload=[])
    told = CompareRun(options).execute()
    assert 'friction of joint2 at ' in told
    assert '4 of ' in told
    page = (out / 'comparison.html').read_text()
    assert 'new against old' in page
    assert page.count('Plotly.newPlot(') == 2
    changes = json.loads((out / 'summary.json').read_text())['changes']
    assert sum(change['clear'] for change in changes) == 4
    with pytest.raises(IdentificationError, match='remove --bag'):
        CompareRun(Namespace(**{**vars(options), 'bag': [out]}))


def test_results_that_cannot_be_compared_raise_an_error(
    results: tuple[Path, Path], tmp_path: Path
) -> None:
    old, new = (folder / 'estimate.yaml' for folder in results)
    other = tmp_path / 'other.yaml'
    other.write_text(old.read_text().replace('joint4', 'elbow'))
    with pytest.raises(IdentificationError, match='compare two results of one arm'):
        compare_estimates(old, other)
    other.write_text('a: 1\n')
    with pytest.raises(IdentificationError, match=r'is not an estimate\.yaml'):
        compare_estimates(other, new)
    document = yaml.safe_load(old.read_text())
    del document['/**']['ros__parameters']['base_parameters']
    other.write_text(yaml.safe_dump(document))
    with pytest.raises(IdentificationError, match='cannot be compared'):
        compare_estimates(old, other)
