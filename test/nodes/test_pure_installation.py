"""`pip install .` into a fresh environment without ROS gives working offline commands."""

import json
import os
import subprocess
import sys
import venv
from importlib.metadata import distribution, distributions
from pathlib import Path

import numpy as np
import pytest
from identifier_process import measured, motion, write_bag
from packaging.requirements import Requirement

from aerarm_ros.description.robot import load_robot
from aerarm_ros.ros.process.process_end import USER_ERROR

ROOT = Path(__file__).parents[2]
ENVIRONMENT = {
    name: value
    for name, value in os.environ.items()
    if not name.startswith(('PYTHON', 'LD_LIBRARY_PATH', 'AMENT_', 'ROS_'))
}

# In one process, because most of the time of a help goes into imports.
HELPS = """
import sys
from aerarm_ros import executables
for name in executables.command_modules():
    sys.argv = [name, '--help']
    try:
        getattr(executables, name)()
    except SystemExit as end:
        assert not end.code
"""


def run(*command: object, status: int = 0) -> str:
    """Return the standard error of a command that ends with a status."""
    done = subprocess.run(
        [*map(str, command)], env=ENVIRONMENT, capture_output=True, text=True, timeout=280.0
    )
    assert done.returncode == status, done.stderr
    return done.stderr


def link(name: str, packages: Path) -> None:
    """Link an installed distribution, and all that it requires, into another environment."""
    found = distribution(name)
    for top in {file.parts[0] for file in found.files or ()} - {'..', '__pycache__'}:
        if not (packages / top).exists():
            (packages / top).symlink_to(found.locate_file(top))
    link_required(found.requires, packages)


def link_required(required: list[str] | None, packages: Path) -> None:
    for requirement in map(Requirement, required or ()):
        is_linked = any(packages.glob(f'{requirement.name.replace("-", "_")}-*'))
        if not is_linked and (not requirement.marker or requirement.marker.evaluate({'extra': ''})):
            link(requirement.name, packages)


@pytest.fixture(scope='module')
def commands(tmp_path_factory: pytest.TempPathFactory, wheel: Path) -> Path:
    """Return the folder of the installed commands.

    The packages that the suite requires are linked, because to download them takes minutes.
    """
    folder = tmp_path_factory.mktemp('pure')
    venv.create(folder / 'env')
    (packages,) = (folder / 'env').glob('lib/python*/site-packages')
    # The pip of this process installs, and only imported modules are compiled.
    pip = (sys.executable, '-m', 'pip', '--python', folder / 'env/bin/python')
    run(*pip, 'install', '--quiet', '--no-compile', '--no-deps', wheel)
    (suite,) = distributions(path=[str(packages)], name='aerarm_ros')
    link_required(suite.requires, packages)
    run(*pip, 'check')
    return folder / 'env/bin'


@pytest.mark.skipif('ROS_DISTRO' in os.environ, reason='the packages of a sourced ROS are used')
def test_a_csv_an_npz_and_a_bag_are_identified(commands: Path, tmp_path: Path) -> None:
    run(commands / 'python', '-c', 'import importlib.util as u; assert not u.find_spec("rclpy")')
    robot = load_robot()
    stamp, q, dq, ddq = motion(1)
    tau = measured(robot, q, dq, ddq)
    names = [f'{kind}{k}' for kind in ('q', 'dq', 'tau') for k in range(1, 5)]
    table = np.column_stack([stamp - stamp[0], q, dq, tau])
    header = ','.join(['time', *names])
    np.savetxt(tmp_path / 'motion.csv', table, delimiter=',', header=header, comments='')
    np.savez(tmp_path / 'motion.npz', time=stamp, q=q, dq=dq, tau=tau)
    bag, out = write_bag(tmp_path / 'bag', stamp, (q, dq, tau)), tmp_path / 'result'
    others = ('--validation', tmp_path / 'motion.csv', tmp_path / 'motion.npz')
    run(commands / 'identifier', '--bag', bag, *others, '--out', out)
    assert (out / 'identified.urdf').is_file()
    solved = json.loads((out / 'summary.json').read_text())['solvers']['sdp']
    errors = [error['filtered'] for error in (*solved['identification'], *solved['validation'])]
    assert max(errors) < 2.0  # [%]
    assert errors == pytest.approx(errors[:1] * 3, rel=0.01)
    assert run(commands / 'python', '-c', HELPS) == ''
    model = out / 'estimate.yaml'
    run(commands / 'payload_estimator', '--bag', bag, '--model', model)
    given = ('--free', bag, '--model', model, '--out', tmp_path / 'thresholds')
    run(commands / 'contact_estimator', *given)
    assert (tmp_path / 'thresholds' / 'residuals.yaml').is_file()
    run(commands / 'arm', 'init', ROOT / 'urdf/aerarm.urdf', '--out', tmp_path)
    assert run(commands / 'arm', 'enable', status=USER_ERROR).count('\n') == 1
