"""`pip install .` into a fresh environment without ROS gives working offline commands."""

import json
import os
import shutil
import subprocess
import sys
import venv
from pathlib import Path

import numpy as np
import pytest
from identifier_process import measured, motion, write_bag

from aerarm_ros.description.robot import load_robot
from aerarm_ros.ros.process.process_end import USER_ERROR

ROOT = Path(__file__).parents[2]
SOURCES = ('aerarm_ros', 'aerarm_msgs_py', 'config', 'launch', 'resource', 'urdf')
FILES = ('setup.py', 'setup.cfg', 'pyproject.toml', 'package.xml', 'README.md', 'LICENSE')
ENVIRONMENT = {
    name: value
    for name, value in os.environ.items()
    if not name.startswith(('PYTHON', 'LD_LIBRARY_PATH', 'AMENT_', 'ROS_'))
}


def run(*command: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*map(str, command)], env=ENVIRONMENT, capture_output=True, text=True, timeout=280.0
    )


@pytest.fixture(scope='module')
def commands(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the installed commands."""
    folder = tmp_path_factory.mktemp('pure')
    source = folder / 'source'  # a copy, because setuptools writes beside setup.py
    for name in SOURCES:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns('*.pyc'))
    for name in FILES:
        if (ROOT / name).is_file():
            shutil.copy(ROOT / name, source / name)
    reach = (sys.executable, '-m', 'pip', 'download', '--no-deps', '--dest', folder, 'argcomplete')
    if run(*reach).returncode:
        pytest.skip('no package index can be reached: check the network')
    # The pip of this process installs, and only imported modules are compiled.
    venv.create(folder / 'env')
    pip = (sys.executable, '-m', 'pip', '--python', folder / 'env/bin/python')
    done = run(*pip, 'install', '--quiet', '--no-compile', source)
    assert done.returncode == 0, done.stderr
    return folder / 'env/bin'


@pytest.mark.skipif('ROS_DISTRO' in os.environ, reason='the packages of a sourced ROS are used')
def test_a_csv_an_npz_and_a_bag_are_identified(commands: Path, tmp_path: Path) -> None:
    assert run(commands / 'python', '-c', 'import rclpy').returncode == 1
    robot = load_robot()
    stamp, q, dq, ddq = motion(1)
    tau = measured(robot, q, dq, ddq)
    names = [f'{kind}{k}' for kind in ('q', 'dq', 'tau') for k in range(1, 5)]
    table = np.column_stack([stamp - stamp[0], q, dq, tau])
    header = ','.join(['time', *names])
    np.savetxt(tmp_path / 'motion.csv', table, delimiter=',', header=header, comments='')
    np.savez(tmp_path / 'motion.npz', time=stamp, q=q, dq=dq, tau=tau)
    write_bag(tmp_path / 'bag', stamp, (q, dq, tau))
    errors = []
    for name in ('motion.csv', 'motion.npz', 'bag'):
        out = tmp_path / f'result_{name}'
        given = ('--bag', tmp_path / name, '--holdout', '0.3')
        done = run(commands / 'identifier', *given, '--out', out)
        assert done.returncode == 0, done.stderr
        assert (out / 'identified.urdf').is_file()
        summary = json.loads((out / 'summary.json').read_text())
        (error,) = summary['solvers']['sdp']['validation']
        errors.append(error['filtered'])
    assert max(errors) < 2.0  # [%]
    assert errors == pytest.approx(errors[:1] * 3, rel=0.01)
    for command in ('excitation_designer', 'calibrator', 'arm'):
        done = run(commands / command, '--help')
        assert (done.returncode, done.stderr) == (0, ''), command
    model = tmp_path / 'result_bag' / 'estimate.yaml'
    done = run(commands / 'payload_estimator', '--bag', tmp_path / 'bag', '--model', model)
    assert done.returncode == 0, done.stderr
    given = ('--free', tmp_path / 'bag', '--model', model, '--out', tmp_path / 'thresholds')
    done = run(commands / 'contact_estimator', *given)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / 'thresholds' / 'residuals.yaml').is_file()
    done = run(commands / 'arm', 'init', ROOT / 'urdf/aerarm.urdf', '--out', tmp_path)
    assert done.returncode == 0, done.stderr
    done = run(commands / 'arm', 'enable')
    assert (done.returncode, done.stderr.count('\n')) == (USER_ERROR, 1)
