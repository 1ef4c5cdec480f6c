import math

import pytest

from aerarm_ros.hardware.bridge_settings import BridgeSettings


def test_the_defaults_are_allowed():
    BridgeSettings()


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
    ],
)
def test_dangerous_settings_are_refused_by_name(wrong):
    (name,) = wrong
    with pytest.raises(ValueError, match=name):
        BridgeSettings(**wrong)
