"""Bad input yields one line with advice, and writes no files."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from identifier_process import identifier, motion, write_bag

from aerarm_ros.description.robot import Robot


def check_refusal(done: subprocess.CompletedProcess, words: str, out: Path) -> None:
    """One line on standard error, exit status not zero, nothing written."""
    assert done.returncode == 2
    lines = done.stderr.strip().splitlines()
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith('identifier: ')
    assert words in lines[0]
    assert not out.exists()
    assert not list(out.parent.glob('.*'))


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['--bag', 'none'], 'none'),
        (['--bag', '{text}'], 'rosbag2 folders, and .mcap, .db3, .csv, .npz and ROS 1 .bag files'),
        (['--bag', '{repeated}'], 'names joint joint3 more than once'),
        (['--bag', '{bag}', '--topic', '/states'], '/states'),
        (['--bag', '{bag}', '--urdf', '{massless}'], 'has no mass'),
        (['--bag', '{bag}', '--urdf', '{text}'], 'README.md'),
        (['--bag', '{bag}', '--config', 'none.yaml'], 'none.yaml'),
        (['--bag', '{bag}', '--holdout', '1.5'], '--holdout'),
        (['--bag', '{bag}', '--effort-gain', 'joint1=x'], '--effort-gain'),
        (['--bag', '{bag}', '--effort-gain', 'elbow=2'], 'unknown joint elbow: the URDF has'),
        (['--bag', '{bag}', '--rename', 'joint1'], '--rename'),
        (['--bag', '{bag}', '--lock', 'joint4'], 'joint4 is locked (--lock) but moves by'),
        (['--bag', '{bag}', '--friction', 'none'], '--friction'),
        ([], '--bag'),
    ],
)
def test_faulty_input_is_refused(
    arguments: list[str], words: str, bags: Path, tmp_path: Path, robot: Robot
) -> None:
    massless, text, repeated = (
        tmp_path / name for name in ('massless.urdf', 'README.md', 'repeated')
    )
    start = robot.urdf_text.index('<inertial>', robot.urdf_text.index('<link name="link3">'))
    end = robot.urdf_text.index('</inertial>', start) + len('</inertial>')
    massless.write_text(robot.urdf_text[:start] + robot.urdf_text[end:])
    text.write_text('# aerarm_ros\n')
    if '{repeated}' in arguments:
        stamp, *fields = motion(1)
        write_bag(repeated, stamp, tuple(fields), ('joint1', 'joint2', 'joint3', 'joint3'))
    places = {'massless': massless, 'text': text, 'repeated': repeated}
    out = tmp_path / 'results' / 'out'
    out.parent.mkdir()
    filled = [argument.format(bag=bags / 'identification', **places) for argument in arguments]
    check_refusal(identifier(*filled, '--out', out), words, out)


def test_places_that_cannot_be_written(bags: Path, tmp_path: Path) -> None:
    file = tmp_path / 'file'
    file.write_text('')
    for out in (file / 'out', Path('/proc/none/out')):
        done = identifier('--bag', bags / 'identification', '--out', out)
        assert done.returncode == 2
        assert len(done.stderr.strip().splitlines()) == 1
        assert '--out' in done.stderr
    assert file.read_text() == ''


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_interrupted_runs_leave_nothing(bags: Path, tmp_path: Path, number: signal.Signals) -> None:
    command = [sys.executable, '-m', 'aerarm_ros.executables', 'identifier']
    # Many bags, so that the process is busy when the signal comes.
    many = [str(bags / 'identification')] * 200
    command += ['--bag', *many, '--out', str(tmp_path / 'r' / 'out')]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 60.0
    while not (tmp_path / 'r').exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(number)
    _, errors = process.communicate(timeout=60.0)
    assert process.returncode == 130
    assert errors.strip() == 'identifier: interrupted, no files were written'
    assert not list(tmp_path.iterdir())
