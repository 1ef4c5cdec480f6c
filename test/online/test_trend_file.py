import errno
import os
from pathlib import Path

import numpy as np
import pytest

from aerarm_ros.online.friction_trend import (
    FrictionRecord,
    FrictionTrend,
    TrendFileError,
    read_trend,
    write_trend,
)

NAMES = ('joint1', 'joint2')


def trend(count: int = 3) -> FrictionTrend:
    random = np.random.default_rng(0)
    records = [
        FrictionRecord(1.8e9 + 600.0 * k, *random.uniform(0.01, 1.0, size=(2, 3, 2)))
        for k in range(count)
    ]
    return FrictionTrend(NAMES, records)


def test_a_written_trend_is_read_back(tmp_path: Path) -> None:
    path, written = tmp_path / 'friction.csv', trend()
    assert read_trend(path, NAMES).records == ()
    write_trend(path, written)
    for told, given in zip(read_trend(path, NAMES).records, written.records, strict=True):
        assert told.time == given.time
        assert told.friction == pytest.approx(given.friction, rel=1e-5)
        assert told.std == pytest.approx(given.std, rel=1e-5)
    assert read_trend(path).joint_names == NAMES
    assert [file.name for file in tmp_path.iterdir()] == ['friction.csv']


def test_a_full_disk_keeps_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / 'friction.csv'
    write_trend(path, trend(2))
    before = path.read_bytes()

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, 'No space left on device')

    monkeypatch.setattr(os, 'fsync', full)
    with pytest.raises(OSError, match='No space'):
        write_trend(path, trend(3))
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ['friction.csv']


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('', 'not a friction history'),
        ('date,viscous joint1\n', 'not a friction history'),
        ('\0\xff\n', 'not a friction history'),
        ('{whole}2027-01-01T00:00:00,1,2\n', 'line 5 of .* is not a friction record'),
        ('{whole}yesterday{numbers}\n', 'line 5 of .* is not a friction record'),
        ('{whole}2027-01-01T00:00:00{numbers},1\n', 'line 5 of .* is not a friction record'),
        ('{whole}2027-01-01T00:00:00{nans}\n', 'line 5 of .* is not a friction record'),
        ('{whole}2027-01-01T00:00:00{zeros}\n', 'line 5 of .* is not a friction record'),
        ('{large}', 'too large'),
    ],
)
def test_anything_else_is_refused_in_a_line(text: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / 'friction.csv'
    write_trend(path, trend())
    parts = {'whole': path.read_text(), 'numbers': ',1' * 12, 'nans': ',nan' * 12,
             'zeros': ',0' * 12, 'large': 'x' * 2_000_000}  # fmt: skip
    path.write_text(text.format(**parts))
    with pytest.raises(TrendFileError, match=words) as refused:
        read_trend(path, NAMES)
    assert '\n' not in str(refused.value)


def test_another_arms_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / 'friction.csv'
    write_trend(path, trend())
    with pytest.raises(TrendFileError, match='belongs to joints joint1, joint2, not to a, b'):
        read_trend(path, ('a', 'b'))
