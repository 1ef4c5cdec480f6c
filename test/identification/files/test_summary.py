"""summary.json has the keys that were promised."""

import json

import pytest

from aerarm_ros.identification.files.summary import summarise
from aerarm_ros.identification.identification_result import IdentificationResult


def test_keys_and_values(result: IdentificationResult) -> None:
    summary = summarise(result, {'a': 1.0, 'b': 0.5})
    json.dumps(summary, allow_nan=False)
    assert summary['samples'] == 10_000
    assert summary['seconds'] == {'a': 1.0, 'b': 0.5, 'total': 1.5}
    thesis, used = (summary['regressor'][name] for name in ('thesis', 'used'))
    assert (thesis['columns'], thesis['rank']) == (48, 30)
    assert (used['columns'], used['rank']) == (52, 32)
    assert 20.0 < thesis['condition_number'] < 150.0
    assert set(summary['solvers']) == {'cad', 'cad_friction', 'ols', 'wls', 'sdp'}
    for solver in summary['solvers'].values():
        for role, bag in (('identification', 'bag1'), ('validation', 'bag2')):
            (entry,) = solver[role]
            assert entry['bag'] == bag
            assert entry['filtered'] > 0.0
            assert entry['filtered'] < entry['filtered_measured'] < entry['raw']
            assert len(entry['per_joint_filtered']) == 4
        assert isinstance(solver['physically_consistent'], bool)
        assert isinstance(solver['min_pseudo_inertia_eigenvalue'], float)
    assert summary['gravity']['tilt'] == 0.0
    assert summary['gravity']['stated'] == summary['gravity']['used']
    assert {trial['cutoff'] for trial in summary['conditioning']['trials']} > {5.0}
    assert summary['solvers']['sdp']['physically_consistent']
    assert summary['solvers']['sdp']['validation'][0]['filtered'] == pytest.approx(
        result.recommended.validation[0].filtered
    )
