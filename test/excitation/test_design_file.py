"""Round trips, and errors that name file and key."""

from pathlib import Path

import numpy as np
import pytest

from aerarm_ros.excitation.design_file import TrajectoryFile
from aerarm_ros.excitation.settings import ExcitationError
from aerarm_ros.excitation.trajectory import FourierTrajectory

NAMES = ('joint1', 'joint2', 'joint3', 'joint4')


@pytest.fixture
def path(tmp_path: Path, trajectory: FourierTrajectory) -> Path:
    path = tmp_path / 'trajectory.yaml'
    TrajectoryFile(trajectory, NAMES, {'seed': 3}, 3).save(path)
    return path


def test_round_trip_is_exact(path: Path, trajectory: FourierTrajectory) -> None:
    loaded = TrajectoryFile.load(path)
    assert loaded.joint_names == NAMES
    assert loaded.made_with == {'seed': 3}
    assert loaded.periods == 3
    assert loaded.trajectory.f0 == trajectory.f0
    for field in ('q0', 'alpha', 'beta'):
        np.testing.assert_array_equal(getattr(loaded.trajectory, field), getattr(trajectory, field))


def test_rows_follow_the_names(path: Path, trajectory: FourierTrajectory) -> None:
    swapped = TrajectoryFile.load(path).for_joints(NAMES[::-1])
    np.testing.assert_array_equal(swapped.alpha, trajectory.alpha[::-1])
    with pytest.raises(ExcitationError, match='the arm has a, b'):
        TrajectoryFile.load(path).for_joints(('a', 'b'))


@pytest.mark.parametrize(
    ('old', 'new', 'message'),
    [
        ('fourier_trajectory/1', 'fourier_trajectory/9', 'format is'),
        ('fundamental_frequency: 0.1', 'fundamental_frequency: -0.1', 'must be positive'),
        ('fundamental_frequency: 0.1\n', '', 'lacks the key fundamental_frequency'),
        ('periods: 3', 'periods: 0', 'periods'),
        ('periods: 3', 'periods: 1.5', 'periods'),
        ('bias:', 'bais:', 'bais'),
        ('cosine: [', 'cosine: [0.1, ', 'one value per harmonic'),
        ('sine: [', 'sine: [.nan, ', 'finite|harmonic'),
        ('joints:', 'joints: [', 'not valid YAML'),
    ],
)
def test_the_error_names_the_invalid_entry(path: Path, old: str, new: str, message: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(ExcitationError, match=message) as caught:
        TrajectoryFile.load(path)
    assert str(caught.value).startswith(str(path))
    assert '\n' not in str(caught.value)


def test_missing_file_and_unwritable_folder(tmp_path: Path, trajectory: FourierTrajectory) -> None:
    with pytest.raises(ExcitationError, match='No such file'):
        TrajectoryFile.load(tmp_path / 'none.yaml')
    with pytest.raises(ExcitationError, match='cannot be written'):
        TrajectoryFile(trajectory, NAMES).save(tmp_path / 'no_folder' / 'x.yaml')
