"""The designer's command line: periods, and arms with and without a drive train."""

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from aerarm_ros.excitation.settings import ExcitationError
from aerarm_ros.ros.programs.design_run import excitation_setup, whole_periods


def options(**changes) -> argparse.Namespace:
    nothing = {
        'urdf': None, 'config': None, 'excitation_config': None, 'bias': None, 'locked': [],
        'package_directory': [], 'acceleration_limit': None,
    }  # fmt: skip
    return argparse.Namespace(**{**nothing, **changes})


def test_whole_periods() -> None:
    assert whole_periods(20.0, 0.1) == 2
    # 0.3 has no exact binary fraction, and 10 / 3 s no exact decimal one.
    assert whole_periods(10.0, 0.3) == 3


@pytest.mark.parametrize(
    ('duration', 'fundamental', 'message'),
    [(25.0, 0.1, 'pass 20 s or 30 s'), (4.0, 0.1, 'pass 10 s$')],
)
def test_parts_of_periods_are_refused(duration: float, fundamental: float, message: str) -> None:
    with pytest.raises(ExcitationError, match=message):
        whole_periods(duration, fundamental)


def test_another_arm_by_its_urdf(example_urdf: Callable[[str], Path]) -> None:
    urdf = example_urdf('ur10_robot.urdf')
    setup = excitation_setup(options(urdf=urdf, acceleration_limit=[3.0]))
    np.testing.assert_array_equal(setup.limits.acceleration, np.full(6, 3.0))
    assert np.isinf(setup.limits.current).all()
