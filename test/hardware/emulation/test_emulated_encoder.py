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
