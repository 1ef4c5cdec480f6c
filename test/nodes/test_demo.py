"""The demo as a user runs it, with one period a motion instead of two."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from aerarm_ros.description.robot import load_robot
from aerarm_ros.model.inertia import is_physically_consistent

DEMO = (sys.executable, '-m', 'aerarm_ros.nodes.demo')


@pytest.fixture(scope='module')
def demo(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    out = tmp_path_factory.mktemp('demo') / 'out'
    command = [*DEMO, '--out', str(out), '--periods', '1']
    run = subprocess.run(command, capture_output=True, text=True, timeout=240)
    logs = {path.name: path.read_text()[-800:] for path in (out / 'logs').iterdir()}
    assert run.returncode == 0, (run.stdout[-1500:], run.stderr, logs)
    return run.stdout, out


def test_identified_model_beats_the_drawing_and_is_physical(demo: tuple[str, Path]) -> None:
    solvers = json.loads((demo[1] / 'result' / 'summary.json').read_text())['solvers']
    cad, identified = (solvers[name]['validation'][0]['filtered'] for name in ('cad', 'sdp'))
    assert identified < 0.25 * cad
    assert identified < 1.3 * solvers['ols']['validation'][0]['filtered']
    assert solvers['sdp']['physically_consistent']
    assert solvers['sdp']['min_pseudo_inertia_eigenvalue'] > 0


def test_results_are_whole(demo: tuple[str, Path]) -> None:
    result = demo[1] / 'result'
    robot = load_robot(result / 'identified.urdf')
    assert all(is_physically_consistent(link) for link in robot.inertial_parameters)
    summary = json.loads((result / 'summary.json').read_text())
    assert summary['regressor']['thesis']['columns'] == 48
    assert summary['regressor']['thesis']['rank'] == 30
    assert {'cad', 'ols', 'sdp'} <= set(summary['solvers'])
    assert 'true parameters' in (result / 'report.html').read_text()


def test_says_what_was_missed_and_lost_and_where_the_report_is(demo: tuple[str, Path]) -> None:
    text, out = demo
    assert re.search(r'^Bridge +\d+ cycles, \d+ missed', text, re.MULTILINE)
    assert len(re.findall(r'^Recorder .* \d+ messages, \d+ lost', text, re.MULTILINE)) == 2
    assert str(out / 'result' / 'report.html') in text


def test_leaves_nothing_running(demo: tuple[str, Path]) -> None:
    _, out = demo
    for process in Path('/proc').glob('[0-9]*/cmdline'):
        try:
            command = process.read_bytes()
        except OSError:
            continue  # it has just ended
        assert str(out).encode() not in command, command


def test_refuses_a_folder_that_is_in_use(tmp_path: Path) -> None:
    (tmp_path / 'mine').write_text('keep')
    run = subprocess.run(
        [*DEMO, '--out', str(tmp_path)], capture_output=True, text=True, timeout=60
    )
    assert run.returncode == 2
    assert '--out' in run.stderr
    assert [path.name for path in tmp_path.iterdir()] == ['mine']
