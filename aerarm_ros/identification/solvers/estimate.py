"""The result of one solver."""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.arm_parameters import LinkBounds
from aerarm_ros.identification.joint_model import JointModel
from aerarm_ros.model.inertia import minimum_eigenvalue
from aerarm_ros.motion.signals import Array

# A printed link with motor, screws and cables weighs between half and twice its drawing.
MASS_FACTOR = 2.0
# ... and a gear loses no more of the torque than it carries.
LARGEST_LOAD_FRICTION = 1.0


@dataclass(frozen=True, eq=False)
class PhysicalLimits:
    """Constraints of physical consistency.

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


_NEGLIGIBLE = 1e-3  # standard deviations


@dataclass(frozen=True, eq=False)
class Estimate:
    """Dynamic parameters and how well they are known.

    Attributes
    ----------
    solver : str
        A name in `solvers.SOLVERS`.
    model : JointModel
        Gives the meaning of the columns.
    theta : (p,) ndarray
        In the order of `model.columns`.
    std : (p,) ndarray or None
        Standard deviations; None if the solver has none.
    determined : (p,) ndarray or None
        Share of each parameter that comes from data (1) rather than from the prior (0).
    seconds : float
        Time the solver took.
    notes : tuple of str
        What the user should know.
    """

    solver: str
    model: JointModel
    theta: Array
    std: Array | None = None
    determined: Array | None = None
    seconds: float = 0.0
    notes: tuple[str, ...] = field(default=())

    @property
    def inertial(self) -> Array:
        """(n, 10) inertial parameters of the links, thesis (3.3)."""
        return np.asarray(self.theta[: 10 * self.model.n].reshape(-1, 10))

    @property
    def min_pseudo_inertia_eigenvalue(self) -> float:
        """Smallest eigenvalue of all links' pseudo-inertia matrices."""
        return minimum_eigenvalue(self.inertial)

    @property
    def physically_consistent(self) -> bool:
        """Whether real links and joints could have these parameters.

        Every pseudo-inertia matrix is positive semidefinite (zero mass is none), and friction
        and rotor inertia are not negative.
        """
        joint_values = self.theta[10 * self.model.n :]
        signs = [term.nonnegative for _, term in self.model.joint_columns]
        return bool(
            self.min_pseudo_inertia_eigenvalue >= 0.0
            and np.all(self.inertial[:, 0] > 0.0)
            and np.all(joint_values[np.array(signs, dtype=bool)] >= 0.0)
        )

    @property
    def held_at_zero(self) -> npt.NDArray[np.bool_]:
        """(p,) which coefficients of a joint lie at their bound 0; none without deviations."""
        start = 10 * self.model.n
        held = np.zeros(len(self.theta), dtype=bool)
        if self.std is not None:
            signed = [term.nonnegative for _, term in self.model.joint_columns]
            held[start:] = self.theta[start:] < _NEGLIGIBLE * self.std[start:]
            held[start:] &= np.array(signed, dtype=bool)
        return held

    def joint_values(self, symbol: str) -> Array:
        """Return the (n,) coefficients of one kind of term, 0 where a joint lacks it."""
        values = np.zeros(self.model.n)
        start = 10 * self.model.n
        for index, (joint, term) in enumerate(self.model.joint_columns, start=start):
            if term.symbol == symbol:
                values[joint] = self.theta[index]
        return values
