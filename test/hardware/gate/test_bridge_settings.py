import math
from dataclasses import fields

import pytest

from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings


@pytest.mark.parametrize(
    'wrong',
    [
        {'command_timeout': 0.0},
        {'state_age_max': -1.0},
        {'soft_zone': math.nan},
        {'stamp_age_max': math.inf},
        {'board_timeout': 0.0},
        {'board_timeout': 0.0005},
        {'board_timeout': 0.3},
        {'velocity_factor': 0.9},
        {'effort_factor': 0.5},
        {'velocity_factor': 1e9},
        {'position_tolerance': 100.0},
        {'bad_frames_max': 0},
        {'command_timeout': 60.0},
    ],
)
def test_dangerous_settings_are_refused_by_name(wrong):
    (name,) = wrong
    with pytest.raises(ValueError, match=name):
        BridgeSettings(**wrong)


@pytest.mark.parametrize('setting', fields(BridgeSettings), ids=lambda setting: setting.name)
def test_every_setting_may_be_anything_within_its_bounds(setting):
    name, (low, high) = setting.name, setting.metadata['bounds']
    for allowed in (low, high):
        assert getattr(BridgeSettings(**{name: allowed}), name) == allowed
    for beyond in (low - 0.001 * abs(low), high * 1.001):
        with pytest.raises(ValueError, match=f'{name} is .*: set a value from {low:g} to {high:g}'):
            BridgeSettings(**{name: beyond})
