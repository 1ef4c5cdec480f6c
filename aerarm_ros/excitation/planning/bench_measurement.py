"""The stretches of a motor bench's motion that are evaluated."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from aerarm_ros.motion.float_array import FloatArray


@dataclass(frozen=True)
class BenchMeasurement:
    """A stretch of the motion that is evaluated.

    Attributes
    ----------
    joint : int
        The one that moves.
    speed : float or None
        Commanded velocity [rad/s], signed; None in an acceleration run and in swings.
    start, end : float
        Time along the motion [s].
    swings : bool
        Whether the joint swings about the posture, for the gear's play.
    """

    joint: int
    speed: float | None
    start: float
    end: float
    swings: bool = False


def split(
    measurements: Sequence[BenchMeasurement], path_time: FloatArray
) -> Iterator[tuple[BenchMeasurement, slice]]:
    """Yield each measurement with its rows among samples at rising `path_time` (M,) [s]."""
    for measurement in measurements:
        first, last = np.searchsorted(path_time, (measurement.start, measurement.end))
        yield measurement, slice(int(first), int(last))
