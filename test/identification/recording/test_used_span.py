"""Idle, aligning and sinking arms are left out."""

import numpy as np
import pytest

from aerarm_ros.identification.recording.recording import (
    UsedSpan,
    commanded_span,
    moving_span,
    running_span,
)

TIME = 100.0 + 0.01 * np.arange(2000)


def positions(*motions: tuple[int, int, float]) -> np.ndarray:
    """Two joints that move between rows, by a size, and rest (with noise) otherwise."""
    q = np.full((2000, 2), 0.3)
    for first, last, size in motions:
        phase = np.linspace(0.0, 2.0 * np.pi, last - first)
        q[first:last, 1] += size * np.sin(phase) ** 2
        q[last:, 1] += 1e-6
    return q + 2e-5 * np.random.default_rng(0).standard_normal(q.shape)


def test_the_liveliest_run_is_used() -> None:
    q = positions((300, 500, 0.1), (900, 1500, 1.0), (1600, 1900, 2.0))
    modes = [
        *((TIME[200], 'running'), (TIME[600], 'ready'), (TIME[800], 'running')),
        (TIME[1550], 'damping'),
    ]
    # The mode in force when recording began is the first one announced.
    assert running_span(TIME, q, modes) == (
        slice(800, 1550),
        'arm_mode running, the longest of 2 motions',
    )
    assert running_span(TIME, q, modes[2:]) == (slice(0, 1550), 'arm_mode running')
    assert running_span(TIME, q, modes[:1]) == (slice(0, 2000), 'arm_mode running')


def test_an_arm_that_never_ran_has_no_run() -> None:
    q = positions((300, 500, 0.1))
    assert running_span(TIME, q, []) is None
    assert running_span(TIME, q, [(TIME[0], 'idle'), (TIME[900], 'damping')]) is None
    still = np.zeros((2000, 2))
    assert running_span(TIME, still, [(TIME[0], 'running')]) is None


def test_commands_tell_when_the_arm_followed() -> None:
    q = positions((300, 500, 0.1), (900, 1500, 1.0))
    commands = np.concatenate([TIME[250:550], TIME[850:1600]])
    span = commanded_span(TIME, q, commands)
    assert span == (slice(850, 1600), 'joint_command, the longest of 2 motions')
    assert commanded_span(TIME, q, commands[:1]) is None
    assert commanded_span(TIME, q, TIME[-1] + 1.0 + 0.01 * np.arange(50)) is None


def test_rest_before_and_after_a_motion_is_left_out() -> None:
    part, reason = moving_span(TIME, positions((600, 1400, 1.0)))
    assert reason == 'motion'
    # Half a second of it stays as the filters' past.
    assert part.start == pytest.approx(600 - 50, abs=15)
    assert part.stop == pytest.approx(1400 + 50, abs=15)
    assert moving_span(TIME, positions((0, 2000, 1.0))) == (slice(0, 2000), 'whole bag')
    assert moving_span(TIME, np.zeros((2000, 2))) == (slice(0, 2000), 'whole bag')


def test_missing_positions_are_no_motion() -> None:
    q = positions((600, 1400, 1.0))
    q[:100] = np.nan
    q[50:80, 0] = np.inf
    part, _ = moving_span(TIME, q)
    assert part.start == pytest.approx(550, abs=15)
    assert moving_span(TIME, np.full((2000, 2), np.nan)) == (slice(0, 2000), 'whole bag')


def test_the_span_in_words() -> None:
    assert UsedSpan(1.04, 23.0, 30.0, 'motion').text == '1.0 .. 23.0 s of 30.0 s (motion)'
