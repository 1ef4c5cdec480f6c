"""Published accuracy on measured bags of real robots, which are not part of the checkout."""

import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from identifier_process import identifier

from aerarm_ros.description.robot import load_robot

DATASETS = os.environ.get('AERARM_DATASETS')
FINGERS = ['panda_finger_joint1', 'panda_finger_joint2']
RENAMED = [f'fer_joint{i}=panda_joint{i}' for i in range(1, 8)]


@pytest.mark.skipif(not DATASETS, reason='set AERARM_DATASETS to the folder of measured bags')
@pytest.mark.parametrize(
    ('folder', 'urdf', 'locked', 'options', 'published'),
    [
        ('ur10_excitation', 'ur10_robot.urdf', [], [], 3.7),
        ('panda_excitation', 'panda.urdf', FINGERS, ['--rename', *RENAMED], 1.5),
    ],
)
def test_measured_robots_are_predicted_as_published(
    folder: str,
    urdf: str,
    locked: list[str],
    options: list[str],
    published: float,
    tmp_path: Path,
    example_urdf: Callable[[str], Path],
) -> None:
    """First 60 % of a real robot's motion to identify, last 40 % held out, as in the README."""
    bag, path, out = Path(str(DATASETS), folder), example_urdf(urdf), tmp_path / 'out'
    if not bag.is_dir():
        pytest.skip(f'no {bag}: set AERARM_DATASETS to the folder with {folder}')
    locks = ['--lock', *locked] if locked else []
    done = identifier(
        '--bag', bag, '--urdf', path, '--holdout', '0.4', '--out', out, *locks, *options
    )
    assert done.returncode == 0, done.stderr
    sdp = json.loads((out / 'summary.json').read_text())['solvers']['sdp']
    assert sdp['validation'][0]['filtered'] == pytest.approx(published, abs=0.05)
    assert sdp['min_pseudo_inertia_eigenvalue'] >= 0.0
    cad, identified = (load_robot(p, locked=locked) for p in (path, out / 'identified.urdf'))
    ratio = identified.inertial_parameters[:, 0] / cad.inertial_parameters[:, 0]
    assert np.all((ratio > 0.49) & (ratio < 2.01))
