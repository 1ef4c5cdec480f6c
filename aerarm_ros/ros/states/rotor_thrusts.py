"""One message of rotor_command."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class RotorThrusts(NamedTuple):
    """Commanded thrusts of a drone's rotors, as sent.

    Attributes
    ----------
    names
        Of the rotors, n of them.
    thrust
        (n,) [N]
    stamp
        [s]
    lead_ns
        How long before the newest state it came [ns].
    """

    names: tuple[str, ...]
    thrust: NDArray[np.float64]
    stamp: float
    lead_ns: int
