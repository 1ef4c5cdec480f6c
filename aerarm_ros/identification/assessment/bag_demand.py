"""Whether a bag asks of the model what the identification motion has shown."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.regression.model_fit import ModelFit
from aerarm_ros.identification.regression.regression_bank import RegressionBank
from aerarm_ros.identification.regression.sample_columns import SampleColumns

Array = npt.NDArray[np.float64]

# Share of the identified range by which a motion may leave it: filters alone cause a little.
_TOLERATED = 0.1
_HARDLY_MOVED = 10.0  # times that range: a share says nothing then
# The model is asked beyond its data if its uncertainty grows by this factor and matters.
_GROWTH = 3.0
_QUANTITIES = (('q', 'position'), ('dq', 'velocity'), ('ddq', 'acceleration'))


@dataclass(frozen=True, eq=False)
class BagDemand:
    """What one bag demands of the model.

    Attributes
    ----------
    bag : str
    beyond : (3, n) ndarray
        How far position, velocity and acceleration leave the range of the identification
        motion, as a share of that range; 0 inside.
    uncertainty : (n,) ndarray
        Standard deviation of the predicted torque because of the parameters' [Nm], root mean
        square along the motion: the leverage of the samples, in torque.
    """

    bag: str
    beyond: Array
    uncertainty: Array


def bag_demand(fit: ModelFit, bags: Sequence[SampleColumns], judged: SampleColumns) -> BagDemand:
    """Compare a bag with those identified from.

    Parameters
    ----------
    fit : ModelFit
        Made from `bags`.
    bags : sequence of SampleColumns
        To identify from.
    judged : SampleColumns
    """
    beyond = []
    for quantity, _ in _QUANTITIES:
        known = np.vstack([getattr(bag.samples, quantity)[bag.samples.kept] for bag in bags])
        asked = getattr(judged.samples, quantity)[judged.samples.kept]
        low, high = known.min(axis=0), known.max(axis=0)
        over = np.maximum(asked.max(axis=0) - high, low - asked.min(axis=0))
        beyond.append(np.maximum(over, 0.0) / np.maximum(high - low, 1e-9))
    terms = [term for _, term in fit.model.joint_columns]
    regression = RegressionBank([judged], terms, fit.inertial).regression(fit.model)
    variance = [
        np.einsum('ij,jk,ik', f[:, :-1], fit.covariance, f[:, :-1]) for f in regression.factors
    ]
    mean = np.array(variance) / np.maximum(regression.rows, 1)
    return BagDemand(judged.samples.name, np.array(beyond), np.sqrt(mean))


def extrapolation_warnings(
    fit: ModelFit, identification: Sequence[BagDemand], validation: Sequence[BagDemand]
) -> list[str]:
    """Return where validation bags ask for more than the identification bags have shown.

    Parameters
    ----------
    fit : ModelFit
    identification, validation : sequence of BagDemand
    """
    names = fit.model.joint_names
    known = np.max([demand.uncertainty for demand in identification], axis=0)
    warnings = []
    for demand in validation:
        for (_, word), beyond in zip(_QUANTITIES, demand.beyond, strict=True):
            joints = [
                f'{name} by {100.0 * share:.0f} %'
                if share < _HARDLY_MOVED
                else f'{name}, which hardly moved there'
                for name, share in zip(names, beyond, strict=True)
                if share > _TOLERATED
            ]
            if joints:
                warnings.append(
                    f'{demand.bag}: {word} leaves the range of the identification motion '
                    f'({", ".join(joints)}): its errors are those of extrapolation'
                )
        grown = (demand.uncertainty > _GROWTH * known) & (demand.uncertainty > fit.noise.std)
        if grown.any():
            joints = [name for name, bad in zip(names, grown, strict=True) if bad]
            warnings.append(
                f'{demand.bag}: needs parameters that the identification motion hardly excites '
                f'(torque of {", ".join(joints)}): identify from a motion that is more like it'
            )
    return warnings
