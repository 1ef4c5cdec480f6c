"""The last link of an arm, and what it carries."""

from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from aerarm_ros.model.inertia import checked_body

Array = npt.NDArray[np.float64]


class LastLink:
    """The last body of a model, which may carry another one.

    Parameters
    ----------
    model : pin.Model
        It is changed in place.
    """

    def __init__(self, model: Any) -> None:
        self._model = model
        self._own = pin.Inertia(model.inertias[model.njoints - 1])

    def carry(self, payload: npt.ArrayLike) -> None:
        """Add a body to the link, in place of one added before; see `Dynamics.carry`."""
        whole = self._own.toDynamicParameters() + checked_payload(payload)
        self._model.inertias[self._model.njoints - 1] = pin.Inertia.FromDynamicParameters(whole)


def checked_payload(payload: npt.ArrayLike) -> Array:
    """Return a payload's (10,) inertial parameters; raises ValueError if no body has them."""
    return checked_body('payload', payload, ': give the ten of payload.yaml')
