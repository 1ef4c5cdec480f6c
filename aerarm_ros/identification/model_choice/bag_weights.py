"""How much each bag is to count: by what a simple model leaves of its torque."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.model_choice.simple_fit import SimpleFit
from aerarm_ros.identification.parameters.arm_parameters import ArmParameters
from aerarm_ros.identification.regression.sample_columns import SampleColumns

Array = npt.NDArray[np.float64]

_MOST = 10.0  # times that one bag counts more, or less, than all together
_ROUNDS = 2  # a noisy bag spoils the first fit, by which the others are judged


def weighted_bags(bags: Sequence[SampleColumns], cad: ArmParameters) -> list[SampleColumns]:
    """Return the bags with weights, one over the noise of each joint in each bag.

    Relative to that of all bags together; a single bag keeps weights of one. Noise is what is left
    of the torque in parts that the fit has not seen.

    Parameters
    ----------
    bags : sequence of SampleColumns
        To identify from.
    cad : ArmParameters
    """
    weighted = list(bags)
    if len(bags) < 2:
        return weighted
    for _ in range(_ROUNDS):
        residuals = SimpleFit(weighted, cad).residuals()
        squares = np.array([np.nansum(own**2, axis=0) for own in residuals])
        counts = np.array([np.isfinite(own).sum(axis=0) for own in residuals])
        noise = np.sqrt(squares / np.maximum(counts, 1))
        together = np.sqrt(squares.sum(axis=0) / np.maximum(counts.sum(axis=0), 1))
        known = (noise > 0.0) & (counts > 0)
        weights = np.where(known, together / np.where(known, noise, 1.0), 1.0)
        weighted = [
            bag.with_weights(own)
            for bag, own in zip(bags, np.clip(weights, 1.0 / _MOST, _MOST), strict=True)
        ]
    return weighted
