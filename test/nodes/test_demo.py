"""The demo as a user runs it, with one period per motion instead of two."""

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from own_domain import own_domain

from aerarm_ros.description.robot import load_robot
from aerarm_ros.model.inertia import is_physically_consistent
from aerarm_ros.nodes.demo import INCOMPLETE
from aerarm_ros.ros.programs.demo_run import DemoError, account_lines

DEMO = (sys.executable, '-m', 'aerarm_ros.executables', 'demo')


def run_demo(folder: Path) -> None:
    """Run the demo into `folder/out`, and store its output."""
    out = folder / 'out'
    command = [*DEMO, '--out', str(out), '--periods', '1', '--pace', 'lockstep']
    run = subprocess.run(
        command, env=marked_environment(out), capture_output=True, text=True, timeout=240
    )
    logs = {path.name: path.read_text()[-800:] for path in (out / 'logs').iterdir()}
    assert run.returncode == 0, (run.stdout[-1500:], run.stderr, logs)
    (folder / 'printed').write_text(run.stdout)


def test_the_demo_writes_a_consistent_model_that_is_better_than_cad(
    made_once: Callable[[str, Callable[[Path], None]], Path],
) -> None:
    folder = made_once('demo', run_demo)
    text, out = (folder / 'printed').read_text(), folder / 'out'
    summary = json.loads((out / 'result' / 'summary.json').read_text())
    cad, identified, ols = (
        summary['solvers'][name]['validation'][0]['filtered'] for name in ('cad', 'sdp', 'ols')
    )
    assert identified < min(0.25 * cad, 1.3 * ols)
    assert summary['solvers']['sdp']['physically_consistent']
    robot = load_robot(out / 'result' / 'identified.urdf')
    assert all(is_physically_consistent(link) for link in robot.inertial_parameters)
    thesis = summary['regressor']['thesis']
    assert (thesis['columns'], thesis['rank']) == (48, 30)
    # The validation motion stays in the range of the designed motion.
    for words in ('extrapolation', 'hardly excites'):
        assert words not in ' '.join(summary['warnings']) + text
    assert 'true parameters' in (out / 'result' / 'report.html').read_text()
    assert processes_of(out) == []
    assert not (out / INCOMPLETE).exists()
    # The last lines state missed cycles, lost messages and the report.
    account = r'^Bridge +\d+ cycles, the simulation ran at [\d.]+ % of real time'
    assert re.search(account, text, re.MULTILINE)
    assert len(re.findall(r'^Recorder .* \d+ messages, \d+ lost', text, re.MULTILINE)) == 2
    assert text.count(str(out / 'result' / 'report.html')) == 1
    progress = re.findall(r'^excitation: .* of .* s  (\w+)', text, re.MULTILINE)
    assert progress == 2 * ['approach', 'excitation', 'return']


@pytest.mark.parametrize(
    ('slip', 'lost', 'said'),
    [
        (', 11.68 s behind real time: this computer is too slow for a real arm', 0, 'NOTE '),
        ('', 7, 'WARNING   7 messages are missing from the bags: '),
    ],
)
def test_warnings_contain_a_remedy(tmp_path: Path, slip: str, lost: int, said: str) -> None:
    bridge, recorder = tmp_path / 'bridge', tmp_path / 'recorder'
    bridge.write_text(f'idle\n999 cycles, the simulation ran at 81.6 % of real time{slip}\n')
    recorder.write_text(f'/joint_states: 900 messages, 5 lost\nbag: 2000 messages, {lost} lost\n')
    *_, warning = account_lines(bridge, {'identification': recorder})
    assert warning.startswith(said)
    assert 'real-time priority (docs/how-to/raspberry_pi.md, "Real time")' in warning
    bridge.write_text('Killed\n')
    with pytest.raises(DemoError, match='no line of .*bridge matches'):
        account_lines(bridge, {})


@pytest.mark.parametrize('sent', [signal.SIGINT, signal.SIGKILL])
def test_ended_early_it_leaves_no_process_and_a_marked_folder(
    ros_domain: dict[str, str], tmp_path: Path, sent: signal.Signals
) -> None:
    out, log = tmp_path / 'out', tmp_path / 'log'
    with (
        log.open('w') as stream,
        # Ctrl-C of a terminal goes to all processes of the group.
        subprocess.Popen(
            [*DEMO, '--out', str(out)],
            env=marked_environment(out),
            stdout=stream,
            stderr=stream,
            start_new_session=True,
        ) as process,
    ):
        wait_for(lambda: 's  approach' in log.read_text())
        assert len(processes_of(out)) == 4  # with bridge, recorder and excitation
        os.killpg(process.pid, sent)
        assert process.wait(60.0) == (-signal.SIGKILL if sent is signal.SIGKILL else 130)
    wait_for(lambda: processes_of(out) == [])
    assert (out / INCOMPLETE).exists()
    assert 'Traceback' not in log.read_text() + (out / 'logs' / 'fake_hardware.log').read_text()
    if sent is not signal.SIGKILL:
        assert log.read_text().splitlines()[-1] == (
            f'demo: interrupted, all nodes were stopped; the results in {out} are incomplete'
        )


def marked_environment(out: Path) -> dict[str, str]:
    """Return an environment that identifies the processes of a demo."""
    return {**os.environ, **own_domain(), 'DEMO_UNDER_TEST': str(out)}


def processes_of(out: Path) -> list[str]:
    """Return the command lines of a demo and its children."""
    mark = f'DEMO_UNDER_TEST={out}'.encode()
    commands = []
    for process in Path('/proc').glob('[0-9]*'):
        with contextlib.suppress(OSError):  # it may have just ended
            if mark in (process / 'environ').read_bytes().split(b'\0'):
                commands.append((process / 'cmdline').read_text().replace('\0', ' '))
    return commands


def wait_for(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def test_refuses_a_folder_that_is_in_use(tmp_path: Path) -> None:
    (tmp_path / 'mine').write_text('keep')
    run = subprocess.run(
        [*DEMO, '--out', str(tmp_path)], capture_output=True, text=True, timeout=60
    )
    assert run.returncode == 2
    assert '--out' in run.stderr
    assert [path.name for path in tmp_path.iterdir()] == ['mine']
