import numpy as np
import pytest

from aerarm_ros.hardware.emulation.emulated_motor import RAD_PER_COUNT, EmulatedEncoder

SUBSTEP = 0.25e-3


def turned(encoder, speed, duration, start=0.0, **options):
    """Turn an encoder at a speed [rad/s] and return positions and velocities."""
    angles = start + speed * SUBSTEP * np.arange(1, round(duration / SUBSTEP) + 1)
    readings = []
    for angle in angles:
        encoder.sample(angle, **options)
        readings.append((encoder.position, encoder.velocity))
    return angles, *np.array(readings).T


def test_steps_are_a_4096th_of_a_turn_and_never_off_by_more_than_one():
    angles, positions, _ = turned(EmulatedEncoder(SUBSTEP), 1.0, 0.5)
    assert pytest.approx(2 * np.pi / 4096) == RAD_PER_COUNT
    counts = positions / RAD_PER_COUNT
    assert counts == pytest.approx(np.round(counts), abs=1e-9)
    assert np.all((angles - positions >= -1e-12) & (angles - positions < RAD_PER_COUNT))


def test_velocity_is_the_speed_after_a_low_pass_of_100_hz():
    speed = 200.0
    _, _, velocity = turned(EmulatedEncoder(SUBSTEP), speed, 0.05)
    time = SUBSTEP * np.arange(len(velocity))  # the first sample has no speed yet
    rise = speed * (1 - np.exp(-2 * np.pi * 100 * time))
    assert velocity == pytest.approx(rise, abs=0.05 * speed)
    assert velocity[-100:].mean() == pytest.approx(speed, rel=0.01)


def test_the_first_sample_has_no_speed():
    encoder = EmulatedEncoder(SUBSTEP)
    encoder.sample(50.0)
    assert encoder.velocity == 0.0
    assert encoder.position == pytest.approx(50.0, abs=RAD_PER_COUNT)


def test_zero_shifts_the_count():
    encoder = EmulatedEncoder(SUBSTEP, zero=3.0)
    encoder.sample(3.0)
    assert encoder.position == pytest.approx(0.0, abs=RAD_PER_COUNT)


def test_index_comes_once_a_turn():
    encoder = EmulatedEncoder(SUBSTEP)
    turned(encoder, 100.0, 0.02, start=1.0)
    assert not encoder.index_detected
    toggles = []
    for angle in np.linspace(3.0, 6 * np.pi + 3.0, 2000):
        encoder.sample(angle)
        toggles.append(encoder.index_toggle)
    assert encoder.index_detected
    assert np.count_nonzero(np.diff(toggles)) == 3


@pytest.mark.parametrize('speed', [50.0, -50.0])
def test_compensation_puts_zero_at_the_index(speed):
    encoder = EmulatedEncoder(SUBSTEP, zero=0.7)
    start = 4 * np.pi - np.sign(speed) * 0.5
    angles, positions, velocity = turned(encoder, speed, 0.05, start, compensate_index=True)
    assert positions[-1] == pytest.approx(angles[-1] - 4 * np.pi, abs=RAD_PER_COUNT)
    assert np.abs(velocity).max() < 1.2 * abs(speed)


def test_stuck_and_jumping():
    encoder = EmulatedEncoder(SUBSTEP)
    turned(encoder, 10.0, 0.1)
    before = encoder.position
    encoder.stuck = True
    _, positions, velocity = turned(encoder, 10.0, 0.1, start=1.0)
    assert np.all(positions == before)
    assert abs(velocity[-1]) < 1e-6
    encoder.jump(1.0)
    encoder.sample(2.0)
    assert encoder.position == pytest.approx(before + 1.0, abs=RAD_PER_COUNT)
