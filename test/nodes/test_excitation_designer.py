"""The designer as a program: files, messages, stops."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from aerarm_ros.excitation.trajectory_file import TrajectoryFile
from aerarm_ros.nodes.excitation_designer import main

SMALL = ['--harmonics', '2', '--starts', '1', '--workers', '1', '--objective', 'condition']


def test_writes_trajectory_preview_and_validation(tmp_path: Path, capsys) -> None:
    out, page = tmp_path / 'best.yaml', tmp_path / 'best.html'
    assert main([*SMALL, '--out', str(out), '--preview', str(page), '--validation']) == 0
    best = TrajectoryFile.load(out)
    assert best.made_with['scaled_condition_number'] > 1.0
    assert best.made_with['periods'] == 2
    assert {'torque', 'self clearance', 'ground clearance'} <= set(best.made_with['margins'])
    assert page.stat().st_size > 1_000_000
    slow, fast = (
        TrajectoryFile.load(tmp_path / f'best_validation_{name}.yaml') for name in ('slow', 'fast')
    )
    assert (slow.trajectory.f0, fast.trajectory.f0) == (0.05, 0.2)
    printed = capsys.readouterr().out
    assert 'start 0' in printed
    assert 'motor current' in printed
    assert not list(tmp_path.glob('*.tmp'))


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (['--fundamental', '0.07'], 'no multiple of the period'),
        (['--fundamental', '-1'], 'must be positive'),
        (['--harmonics', '200'], 'frequency of highest harmonic'),
        (['--bias', '0', '-0.4', '0', '0'], 'binds in'),
        (['--bias', '0', '0'], 'bias has 2 values'),
        (['--urdf', 'missing.urdf'], 'missing.urdf'),
        (['--out', '/nowhere/best.yaml'], '/nowhere/best.yaml cannot be written'),
        (['--starts', '0'], 'at least one start'),
    ],
)
def test_bad_input_is_one_line(tmp_path: Path, capsys, arguments, message) -> None:
    assert main([*SMALL, '--out', str(tmp_path / 'best.yaml'), *arguments]) == 1
    error = capsys.readouterr().err
    assert message in error
    assert error.count('\n') == 1


def test_a_stop_keeps_the_best_so_far(tmp_path: Path) -> None:
    out = tmp_path / 'best.yaml'
    command = [sys.executable, '-m', 'aerarm_ros.nodes.excitation_designer', '--out', str(out)]
    process = subprocess.Popen(
        [*command, '--starts', '1000', '--time-limit', '600'], stdout=subprocess.PIPE, text=True
    )
    try:
        deadline = time.monotonic() + 60.0
        while not out.exists():
            assert time.monotonic() < deadline
            assert process.poll() is None
            time.sleep(0.05)
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        printed, _ = process.communicate(timeout=30.0)
    finally:
        process.kill()
    assert process.returncode == 0
    assert 'stopped; the best so far is kept' in printed
    assert TrajectoryFile.load(out).joint_names == ('joint1', 'joint2', 'joint3', 'joint4')
