"""What changes while a motion is recorded: friction of gears that get warm, sensors that drift."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.assessment.assessment import BagAssessment
from aerarm_ros.identification.regression.noise import noise_from_residuals
from aerarm_ros.identification.regression.sample_columns import SampleColumns

Array = npt.NDArray[np.float64]

_SLOW = 0.05  # share of a joint's top speed up to which its direction is faded in
_CLEAR = 4.0  # standard deviations
_WORTH_TELLING = 0.05  # of the joint's torque, as root mean square
_SHORTEST = 10.0  # [s] of a motion in which anything can change


@dataclass(frozen=True, eq=False)
class ResidualTrend:
    """How the torque that a model leaves grows from a bag's beginning to its end.

    Attributes
    ----------
    bag : str
    friction, offset : (n,) ndarray
        Torque against the motion, and in one direction [Nm]; 0 where nothing is clear.
    torque : (n,) ndarray
        Size of each joint's torque [Nm].
    """

    bag: str
    friction: Array
    offset: Array
    torque: Array


def residual_trend(bag: SampleColumns, assessed: BagAssessment) -> ResidualTrend:
    """Look for what grows with time in the residuals of a bag.

    Parameters
    ----------
    bag : SampleColumns
    assessed : BagAssessment
        Of an estimate on this bag.
    """
    samples = bag.samples
    n = samples.n
    residuals = samples.tau - assessed.prediction.filtered
    span = float(samples.time[-1] - samples.time[0])
    age = (samples.time - samples.time[0]) / max(span, 1e-9) - 0.5
    size = np.sqrt((samples.tau**2).mean(axis=0))
    grown = np.zeros((2, n))
    for joint in range(n):
        rows = samples.usable[:, joint]
        if span < _SHORTEST or rows.sum() < 50:
            continue
        dq, residual = samples.dq[rows, joint], residuals[rows, joint]
        way = np.tanh(dq / max(_SLOW * float(np.abs(dq).max()), 1e-9))
        columns = np.column_stack([way * age[rows], age[rows], way, np.ones(len(dq))])
        if np.linalg.matrix_rank(columns) < 4:
            continue
        solved, *_ = np.linalg.lstsq(columns, residual, rcond=None)
        left = (residual - columns @ solved)[:, None]
        noise = noise_from_residuals([left], [np.ones_like(left, dtype=bool)], size[[joint]])
        covariance = np.linalg.inv(columns.T @ columns) * noise.std**2 * noise.correlation
        clear = np.abs(solved) > _CLEAR * np.sqrt(np.diag(covariance))
        grown[:, joint] = np.where(clear, solved, 0.0)[:2]
    return ResidualTrend(samples.name, grown[0], grown[1], size)


def trend_warnings(trends: Sequence[ResidualTrend], joints: Sequence[str]) -> list[str]:
    """Return which joints' friction or offset changed enough to matter."""
    warnings = []
    for trend in trends:
        for values, what, why in (
            (trend.friction, 'friction', 'gears that get warm: let them, before recording'),
            (trend.offset, 'torque offset', 'a sensor that drifts: set it to zero again'),
        ):
            told = [
                f'{name} by {value:+.2g} Nm'
                for name, value, torque in zip(joints, values, trend.torque, strict=True)
                if abs(value) > _WORTH_TELLING * torque
            ]
            if told:
                warnings.append(
                    f'{trend.bag}: the {what} changes from its beginning to its end '
                    f'({", ".join(told)}), as with {why}'
                )
    return warnings
