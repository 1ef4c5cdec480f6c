"""Accuracy on measured bags of real robots, which are not part of the checkout."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from aerarm_ros.description.robot import load_robot

DATASETS = os.environ.get('AERARM_DATASETS')


@pytest.mark.skipif(
    DATASETS is None, reason='measured bags: set AERARM_DATASETS to the folder that holds them'
)
@pytest.mark.parametrize(
    ('folder', 'urdf', 'options', 'limit'),
    [
        ('ur10_excitation', 'ur10_robot.urdf', [], 5.0),
        (
            'panda_excitation',
            'panda.urdf',
            ['--lock', 'panda_finger_joint1', 'panda_finger_joint2', '--rename']
            + [f'fer_joint{i}=panda_joint{i}' for i in range(1, 8)],
            2.0,
        ),
    ],
)
def test_measured_robots_are_predicted_well(
    folder: str,
    urdf: str,
    options: list[str],
    limit: float,
    tmp_path: Path,
    example_urdf: Callable[[str], Path],
) -> None:
    """First 60 % of a real robot's motion to identify, last 40 % held out."""
    bag = Path(str(DATASETS), folder)
    if not bag.is_dir():
        pytest.skip(f'no {bag}: set AERARM_DATASETS to the folder with {folder}')
    path = example_urdf(urdf)
    out = tmp_path / 'out'
    command = [sys.executable, '-m', 'aerarm_ros.executables', 'identifier']
    command += ['--bag', bag, '--urdf', path, '--holdout', '0.4', '--out', out, *options]
    subprocess.run(command, check=True, timeout=60)
    sdp = json.loads((out / 'summary.json').read_text())['solvers']['sdp']
    assert sdp['validation'][0]['filtered'] <= limit
    assert sdp['min_pseudo_inertia_eigenvalue'] >= 0.0
    locked = options[1:3] if options else []
    cad, identified = (load_robot(p, locked=locked) for p in (path, out / 'identified.urdf'))
    ratio = identified.inertial_parameters[:, 0] / cad.inertial_parameters[:, 0]
    assert np.all((ratio > 0.49) & (ratio < 2.01))
