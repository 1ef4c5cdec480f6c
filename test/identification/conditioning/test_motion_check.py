"""Options that contradict the motion are named."""

from collections.abc import Callable

import pytest

from aerarm_ros.identification.conditioning.conditioning import Conditioner
from aerarm_ros.identification.conditioning.motion_check import (
    ConditioningOptions,
    harmonics_warnings,
)
from aerarm_ros.identification.errors import IdentificationError


@pytest.fixture(scope='module')
def recording(make_arm: Callable):
    return make_arm(rate=100.0).recording(1)


def warnings(recording, **options: object) -> str:
    return ' '.join(Conditioner([recording], ConditioningOptions(**options)).warnings)


def test_options_that_match_the_motion_cause_no_warning(recording) -> None:
    assert warnings(recording) == ''
    assert warnings(recording, fundamental=0.1, harmonics=5) == ''
    # Two periods together are periodic too.
    assert warnings(recording, fundamental=0.05) == ''


def test_another_period_than_the_given_one(recording) -> None:
    text = warnings(recording, fundamental=0.13)
    assert 'repeats every 10 s (0.1 Hz)' in text


def test_a_wrong_fundamental_is_named_where_nothing_is_left_or_it_is_needed(recording) -> None:
    for options in ({'fundamental': 7.0}, {'fundamental': 0.13, 'filter': 'harmonics'}):
        with pytest.raises(IdentificationError, match='repeats every 10 s'):
            warnings(recording, **options)
    once = recording.part(0.0, 0.6, '')
    with pytest.raises(
        IdentificationError, match=r'7 Hz, but the motion of .* does not repeat .* 0.142'
    ):
        warnings(once, fundamental=7.0, filter='harmonics')


def test_less_than_one_period(recording) -> None:
    text = warnings(recording.part(0.3, 0.6, ''), fundamental=0.05)
    assert 'less than one period of 20 s' in text
    assert 'only 7.' in text
    assert 'record at least one whole period' in text


def test_fewer_harmonics_than_the_motion_has(recording) -> None:
    assert '5 harmonics, up to 0.5 Hz' in warnings(recording, harmonics=3)
    assert harmonics_warnings(7, 5, 0.1, 100.0) == []


def test_harmonics_need_whole_periods(recording) -> None:
    part = recording.part(0.0, 0.6, '')
    assert 'so --harmonics is ignored' in warnings(part, harmonics=5)
    with pytest.raises(IdentificationError, match='no whole period of --fundamental 0.01 Hz'):
        warnings(part, filter='harmonics', fundamental=0.01)
    with pytest.raises(IdentificationError, match='--filter harmonics needs whole periods'):
        warnings(part, filter='harmonics')


def test_harmonics_stay_below_the_nyquist_frequency(recording) -> None:
    with pytest.raises(IdentificationError, match='60 Hz, beyond the Nyquist frequency 50 Hz'):
        warnings(recording, harmonics=600)
