"""A joint command as it arrives, before anything about it is believed."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

# Whoever sent a command; None for somebody who cannot be told from another.
Source = bytes | str | None
Values = Sequence[float] | NDArray[np.float64] | None


class OfferedCommand(NamedTuple):
    """What somebody wants the joints to do, and who.

    Attributes
    ----------
    names
        The joints of the values below, in any order.
    position, velocity, effort
        One value for each name [rad], [rad/s], [Nm], NaN where unused; None or empty if
        unused for all. What is given chooses a joint's mode, see `CommandBuffer`.
    age_of_stamp
        Age of the state that the command answers [s].
    source
        Who sent it: a second publisher is rejected while the first one's command lasts;
        so is None, somebody who cannot be told from another.
    allowed
        Whether that publisher may command at all.
    """

    names: Sequence[str]
    position: Values
    velocity: Values
    effort: Values
    age_of_stamp: float
    source: Source
    allowed: bool = True
