"""The result of one solver."""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.parameters.joint_model import JointModel
from aerarm_ros.model.inertia import minimum_eigenvalue

Array = npt.NDArray[np.float64]

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
