"""What the user knows about the links besides their drawing."""

from dataclasses import dataclass

import numpy as np

from aerarm_ros.identification.recording.identification_error import IdentificationError


@dataclass(frozen=True)
class LinkBounds:
    """Additional constraints of the semidefinite program.

    Attributes
    ----------
    total_mass : tuple of two floats, optional
        Least and largest mass of all links that a joint moves (3.13) [kg], from weighing.
    centres : bool
        Keep each centre of mass in the box that the link's inertia has according to CAD (3.12).
    """

    total_mass: tuple[float, float] | None = None
    centres: bool = False

    def __post_init__(self) -> None:
        """Check the masses."""
        if self.total_mass is not None:
            low, high = self.total_mass
            if not (np.isfinite([low, high]).all() and 0.0 <= low < high):
                raise IdentificationError(
                    f'total mass {low:g} .. {high:g} kg must rise from a number not below 0'
                )
