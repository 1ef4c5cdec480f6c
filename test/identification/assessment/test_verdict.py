"""Limits are kept or not, and a file of limits is read with care."""

from dataclasses import replace
from pathlib import Path

import pytest

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.identification_result import (
    LIMITS,
    IdentificationResult,
    judge,
    read_limits,
)


def test_each_limit_is_compared_with_the_result(result: IdentificationResult) -> None:
    error = result.recommended.validation[0].filtered
    checks = judge(result, {'filtered': 1.1 * error, 'inconsistent': 0.0, 'tilt': 0.5})
    assert [check.text.startswith('passed') for check in checks] == [True] * 3
    checks = judge(result, {'filtered': 0.9 * error, 'inconsistent': 0.0})
    assert [check.passed for check in checks] == [False, True]
    assert checks[0].text == f'FAILED  filtered: {error:.4g}, at most {0.9 * error:.4g}'


def test_every_limit_has_a_value_that_it_passes_and_one_it_fails(
    result: IdentificationResult,
) -> None:
    for name, value_of in LIMITS.items():
        value = value_of(result)
        assert judge(result, {name: value})[0].passed
        assert not judge(result, {name: value - 1e-9})[0].passed


def test_without_validation_identification_counts(result: IdentificationResult) -> None:
    recommended = replace(result.recommended, validation=[])
    alone = replace(result, solutions={**result.solutions, 'sdp': recommended})
    assert LIMITS['raw'](alone) == recommended.identification[0].raw


def test_a_file_of_limits(tmp_path: Path) -> None:
    path = tmp_path / 'limits.yaml'
    path.write_text('filtered: 2\njoint_raw: 30.5\n')
    assert read_limits(path) == {'filtered': 2.0, 'joint_raw': 30.5}
    for text, words in (
        ('', 'no limits: limits are filtered'),
        ('[1, 2]', 'no limits'),
        ('filterd: 2', 'no limit filterd: limits are'),
        ('raw: much', 'raw = much must be a non-negative number'),
        ('raw: true', 'raw = True must be a non-negative number'),
        ('raw: -1', 'raw = -1 must be a non-negative number'),
        ('raw: [', 'limits.yaml: '),
    ):
        path.write_text(text)
        with pytest.raises(IdentificationError, match=words):
            read_limits(path)
    with pytest.raises(IdentificationError, match='check the path'):
        read_limits(tmp_path / 'none.yaml')
