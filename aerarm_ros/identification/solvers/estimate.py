"""Table of solvers, estimate of one solver, and limits of physically possible parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.joint_model import JointModel, LinkBounds
from aerarm_ros.model.inertia import minimum_eigenvalue
from aerarm_ros.motion.signals import Array

if TYPE_CHECKING:  # only for type annotations
    from aerarm_ros.identification.model_fit import ModelFit

    _Solve = Callable[[ModelFit, 'PhysicalLimits'], Array | tuple[Array, tuple[str, ...]]]

# A printed link with motor, screws and cables weighs half to twice its CAD mass.
MASS_FACTOR = 2.0
# A gear loses at most the torque that it transmits.
LARGEST_LOAD_FRICTION = 1.0


@dataclass(frozen=True, eq=False)
class PhysicalLimits:
    """Limits of physically consistent parameters.

    Attributes
    ----------
    mass : (n,) ndarray
        Masses according to CAD [kg].
    size : (n,) ndarray
        Lengths that scale the pseudo-inertia's entries [m].
    nonnegative : (p - 10 n,) ndarray of bool
        Whether each joint coefficient must not be negative.
    load : (p - 10 n,) ndarray of bool, optional
        Joint coefficients of load-dependent friction, at most 1, because a gear loses at most the
        torque that it transmits.
    mass_factor : float
        Largest factor between masses and `mass`, thesis (3.11).
    centre, reach : (n, 3) ndarray, optional
        Centres of mass according to CAD, and tolerance along each axis of the link's frame [m].
        By default a centre lies within `size` of the frame's origin.
    bounds : LinkBounds
        User's bounds of total mass and centres of mass.
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
        """Lower and upper bounds of the centres of mass [m], (n, 3) each; thesis (3.12)."""
        centre = np.zeros((len(self.mass), 3)) if self.centre is None else self.centre
        reach = np.repeat(self.size[:, None], 3, axis=1) if self.reach is None else self.reach
        return centre - reach, centre + reach

    @property
    def total_mass(self) -> Array:
        """Lower and upper bound (2,) of the total mass of all links [kg], thesis (3.13)."""
        if self.bounds.total_mass is not None:
            return np.array(self.bounds.total_mass)
        return np.asarray(self.mass.sum() * np.array([1.0 / self.mass_factor, self.mass_factor]))


_NEGLIGIBLE = 1e-3  # standard deviations


@dataclass(frozen=True, eq=False)
class Estimate:
    """Dynamic parameters with their uncertainty.

    Attributes
    ----------
    solver : str
        Name in `SOLVERS`.
    model : JointModel
        Model that defines the columns.
    theta : (p,) ndarray
        Parameters in the order of `model.columns`.
    std : (p,) ndarray or None
        Standard deviations; None if the solver has none.
    determined : (p,) ndarray or None
        Fraction to which the data determine each parameter: 1 if only data, 0 if only the prior.
    seconds : float
        Computing time of the solver [s].
    notes : tuple of str
        Notes for the user.
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
        """Inertial parameters (n, 10) of the links, thesis (3.3)."""
        return np.asarray(self.theta[: 10 * self.model.n].reshape(-1, 10))

    @property
    def min_pseudo_inertia_eigenvalue(self) -> float:
        """Smallest eigenvalue of the pseudo-inertia matrices of all links."""
        return minimum_eigenvalue(self.inertial)

    @property
    def physically_consistent(self) -> bool:
        """Whether the parameters are possible for real links and joints.

        Every pseudo-inertia matrix is positive semidefinite, masses are positive, and friction and
        rotor inertia are non-negative.
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
        """Mask (p,) of the parameters that are joint coefficients at the lower bound 0."""
        start = 10 * self.model.n
        held = np.zeros(len(self.theta), dtype=bool)
        if self.std is not None:
            signed = [term.nonnegative for _, term in self.model.joint_columns]
            held[start:] = self.theta[start:] < _NEGLIGIBLE * self.std[start:]
            held[start:] &= np.array(signed, dtype=bool)
        return held

    def joint_values(self, symbol: str) -> Array:
        """Return the (n,) coefficients of one kind of term, 0 for joints without the term."""
        values = np.zeros(self.model.n)
        start = 10 * self.model.n
        for index, (joint, term) in enumerate(self.model.joint_columns, start=start):
            if term.symbol == symbol:
                values[joint] = self.theta[index]
        return values


@dataclass(frozen=True)
class Solver:
    """Entry of the table `SOLVERS`.

    Attributes
    ----------
    solve : callable
        Function of fit and limits; returns the parameters (p,) and notes for the user. Raises
        IdentificationError if there is no solution.
    text : str
        Description in the report.
    order : int
        Position in the tables of the report.
    is_fast : bool
        Whether the solver takes milliseconds.
    """

    solve: Callable[[ModelFit, PhysicalLimits], tuple[Array, tuple[str, ...]]]
    text: str
    order: int
    is_fast: bool


SOLVERS: dict[str, Solver] = {}
"""All solvers by name; `solvers.py` imports the modules that fill this table."""


def solver(name: str, text: str, order: int, is_fast: bool = False) -> Callable[[_Solve], _Solve]:
    """Return a decorator that adds a function as a solver; see `Solver` for the arguments.

    The function may return the parameters alone, if it has no notes.
    """

    def add(solve: _Solve) -> _Solve:
        def with_notes(fit: ModelFit, limits: PhysicalLimits) -> tuple[Array, tuple[str, ...]]:
            found = solve(fit, limits)
            return found if isinstance(found, tuple) else (found, ())

        SOLVERS[name] = Solver(with_notes, text, order, is_fast)
        return solve

    return add
