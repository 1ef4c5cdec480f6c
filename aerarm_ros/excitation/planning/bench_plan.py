"""What a motor bench is to measure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aerarm_ros.excitation.settings.excitation_error import ExcitationError


@dataclass(frozen=True)
class BenchPlan:
    """What the motor bench does.

    Parameters
    ----------
    speeds : joint speeds of the velocity steps [rad/s], positive.
    span : way of a joint, half of it to either side of the posture [rad].
    velocity_share, acceleration_share : share of the limits that acceleration runs reach; the
        ramps of velocity steps use the same acceleration.
    runs : acceleration runs of a joint, each forth and back; 0 for none.
    swings : sine waves of a joint about the posture, for its gear's play; 0 for none.
    amplitude : of the swings [rad]; they are as fast as the shares let them be.

    Raises
    ------
    ExcitationError
        If a number makes no sense.
    """

    speeds: tuple[float, ...] = (0.2, 0.4, 0.8, 1.2, 1.6, 2.0)
    span: float = 1.6
    velocity_share: float = 0.6
    acceleration_share: float = 0.5
    runs: int = 3
    swings: int = 0
    amplitude: float = 0.25

    def __post_init__(self) -> None:
        if len(set(self.speeds)) < 2 or min(self.speeds) <= 0.0:
            raise ExcitationError(
                f'speeds {list(self.speeds)}: two or more different positive ones tell viscous '
                'from Coulomb friction (4.13)'
            )
        if not 0.0 < self.span < 2.0 * np.pi:
            raise ExcitationError(f'span {self.span:g} must lie between 0 and 2 pi rad')
        if self.swings and not 0.0 < self.amplitude <= 0.5 * self.span:
            raise ExcitationError(
                f'swings of {self.amplitude:g} rad must be above 0 and within half of the span of '
                f'{self.span:g} rad'
            )
