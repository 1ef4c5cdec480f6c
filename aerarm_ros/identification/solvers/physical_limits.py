"""What the links and joints of a real arm obey."""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.parameters.link_bounds import LinkBounds

Array = npt.NDArray[np.float64]

# A printed link with motor, screws and cables weighs between half and twice its drawing.
MASS_FACTOR = 2.0
# ... and a gear loses no more of the torque than it carries.
LARGEST_LOAD_FRICTION = 1.0


@dataclass(frozen=True, eq=False)
class PhysicalLimits:
    """What a real arm obeys.

    Attributes
    ----------
    mass : (n,) ndarray
        Masses according to CAD [kg].
    size : (n,) ndarray
        Lengths that make the pseudo-inertia's entries comparable [m].
    nonnegative : (p - 10 n,) ndarray of bool
        Which of the joints' coefficients cannot be negative.
    load : (p - 10 n,) ndarray of bool, optional
        Which of them are friction per torque: a gear loses no more than it carries, so not above 1.
    mass_factor : float
        Masses lie within this factor of `mass`, thesis (3.11).
    centre, reach : (n, 3) ndarray, optional
        Centres of mass according to CAD, and how far from there they may lie along each axis of
        the link's frame [m]. By default within `size` of the frame's origin.
    bounds : LinkBounds
        Which further constraints the program has.
    """

    mass: Array
    size: Array
    nonnegative: npt.NDArray[np.bool_]
    load: npt.NDArray[np.bool_] | None = None
    mass_factor: float = MASS_FACTOR
    centre: Array | None = None
    reach: Array | None = None
    bounds: LinkBounds = field(default_factory=LinkBounds)

    @property
    def centre_box(self) -> tuple[Array, Array]:
        """(n, 3) least and largest coordinates of the centres of mass (3.12) [m]."""
        centre = np.zeros((len(self.mass), 3)) if self.centre is None else self.centre
        reach = np.repeat(self.size[:, None], 3, axis=1) if self.reach is None else self.reach
        return centre - reach, centre + reach

    @property
    def total_mass(self) -> Array:
        """(2,) least and largest mass of all links together (3.13) [kg]."""
        if self.bounds.total_mass is not None:
            return np.array(self.bounds.total_mass)
        return self.total_of_links

    @property
    def total_of_links(self) -> Array:
        """(2,) mass of all links where each is as light, or as heavy, as it may be [kg]."""
        return np.asarray(self.mass.sum() * np.array([1.0 / self.mass_factor, self.mass_factor]))
