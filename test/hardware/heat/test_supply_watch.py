import pytest

from aerarm_ros.description.arm_config import PowerStageConfig
from aerarm_ros.hardware.boards.board_monitor import SupplyWatch

STAGE = PowerStageConfig(voltage_min=18.0, voltage_max=30.0)


def watched(*voltages: float, cycles: int = 20) -> SupplyWatch:
    watch = SupplyWatch('board0', STAGE)
    for voltage in voltages:
        for _ in range(cycles):
            watch.update(voltage, 1e-3)
    return watch


@pytest.mark.parametrize('voltage', [19.0, 24.0, 28.4])
def test_a_voltage_within_its_limits_is_not_spoken_of(voltage):
    watch = watched(voltage)
    assert (watch.warning(), watch.stop()) == ('', '')


@pytest.mark.parametrize(('voltage', 'limit'), [(18.5, 'minimum of 18'), (29.0, 'maximum of 30')])
def test_a_voltage_near_its_limits_is_warned_of(voltage, limit):
    watch = watched(voltage, 24.0)
    assert f'board0 had {voltage:.1f} V, near its {limit}' in watch.warning()
    assert not watch.stop()
    assert not watched(voltage, 24.0, cycles=6000).warning()


@pytest.mark.parametrize(('voltage', 'advice'), [(15.0, 'charge'), (35.0, 'braking resistor')])
def test_a_voltage_beyond_its_limits_stops(voltage, advice):
    assert advice in watched(24.0, voltage).stop()


@pytest.mark.parametrize('voltage', [15.0, 35.0])
def test_a_short_peak_stops_nothing(voltage):
    watch = watched(24.0)
    for _ in range(30):
        for reading in [voltage] * 9 + [24.0]:
            watch.update(reading, 1e-3)
            assert not watch.stop()


def test_at_its_limits_and_before_the_first_reading_nothing_is_said():
    watch = watched()
    assert (watch.voltage, watch.warning(), watch.stop()) == (0.0, '', '')
    for voltage in (STAGE.voltage_min, STAGE.voltage_max):
        assert not watched(voltage).stop()
    for voltage in (1.05 * STAGE.voltage_min, 0.95 * STAGE.voltage_max):
        assert not watched(voltage).warning()
