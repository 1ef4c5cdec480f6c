"""What the user says of a motion is checked at once."""

import pytest

from aerarm_ros.identification.conditioning.motion_check import ConditioningOptions
from aerarm_ros.identification.errors import IdentificationError


@pytest.mark.parametrize(
    ('options', 'text'),
    [
        ({'cutoff': -1.0}, 'cutoff = -1.0 must be a positive frequency'),
        ({'fundamental': float('nan')}, 'fundamental'),
        ({'harmonics': 0}, 'at least 1'),
        ({'filter': 'none'}, "filter 'none': choose auto, harmonics, butterworth"),
    ],
)
def test_nonsense_is_refused(options: dict, text: str) -> None:
    with pytest.raises(IdentificationError, match=text):
        ConditioningOptions(**options)
