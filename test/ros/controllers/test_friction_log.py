"""Friction is kept from one run to the next."""

from pathlib import Path

import numpy as np
import pytest

from aerarm_ros.identification.payload import Payload
from aerarm_ros.online.friction_trend import read_trend
from aerarm_ros.online.information_filter import SPECK, ball
from aerarm_ros.online.payload_estimator import OnlineEstimate
from aerarm_ros.ros.controllers.friction_log import FrictionLog
from aerarm_ros.ros.programs.payload_replay import show_trend

NAMES = ('joint1', 'joint2')
PERIOD = 0.08


def estimate(time: float, coulomb: float) -> OnlineEstimate:
    friction = np.array([[0.01, 0.01], [coulomb, 0.1], [0.02, 0.02]])
    payload = Payload('link2', ball(SPECK, np.zeros(3), 0.1), np.eye(10))
    return OnlineEstimate(
        time, payload, False, 0.0, np.ones(10), friction, np.full((3, 2), 1e-3), np.ones(2)
    )


def use(path: Path, day: int, coulomb: float) -> FrictionLog:
    """Let the log follow 25 s of an arm, on some day."""
    log = FrictionLog(path, NAMES, 10.0, lambda: 1.8e9 + 86400.0 * day)
    for time in np.arange(0.0, 25.0, PERIOD):
        log.offer(estimate(float(time), coulomb))
    log.write()
    return log


def test_a_week_of_use_is_seen(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / 'friction.csv'
    for day in range(7):
        log = use(path, day, 0.2 + 0.01 * day)
    log.finish()  # half an interval is too little
    assert len(read_trend(path).records) == 14
    told = log.describe()
    assert told['friction records'] == 14
    assert str(told['friction changed since the first record']).startswith(
        'Coulomb [Nm] of joint1 0.2 -> 0.26 ('
    )
    assert show_trend('payload_estimator', ['--trend', str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    (marked,) = (line for line in lines if line.startswith('* Coulomb'))
    assert marked.split()[5:7] == ['0.2000', '0.2600']
    assert (
        lines[-1] == '* marks a change by more than three standard deviations (1 of 6 coefficients)'
    )


def test_a_silence_is_no_learning(tmp_path: Path) -> None:
    path = tmp_path / 'friction.csv'
    log = FrictionLog(path, NAMES, 10.0)
    for time in np.arange(0.0, 100.0, 5.0):
        log.offer(estimate(float(time), 0.2))
    log.finish()
    assert not path.exists()


def test_a_deleted_folder_is_reported_and_recovered(tmp_path: Path) -> None:
    folder = tmp_path / 'stick'
    folder.mkdir()
    log = FrictionLog(folder / 'friction.csv', NAMES, 1.0)
    folder.rmdir()
    for time in np.arange(0.0, 1.5, PERIOD):
        log.offer(estimate(float(time), 0.2))
    log.write()
    assert 'cannot be written' in log.problem
    folder.mkdir()
    log.write()
    assert not log.problem
    assert len(read_trend(folder / 'friction.csv').records) == 1


def test_an_unusable_friction_file_is_rejected_at_the_start(tmp_path: Path) -> None:
    with pytest.raises(OSError, match='friction_file cannot be written'):
        FrictionLog(tmp_path / 'none' / 'friction.csv', NAMES, 1.0)
    (tmp_path / 'notes.txt').write_text('mine\n')
    with pytest.raises(ValueError, match='is not a friction history'):
        FrictionLog(tmp_path / 'notes.txt', NAMES, 1.0)
    assert (tmp_path / 'notes.txt').read_text() == 'mine\n'


def test_no_trend_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert show_trend('payload_estimator', ['--trend', str(tmp_path / 'none')]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
