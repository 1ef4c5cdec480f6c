"""Convex cone programs for the solver Clarabel."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.errors import IdentificationError, SolverError
from aerarm_ros.identification.regression.base_parameters import Prior
from aerarm_ros.identification.regression.regression import TriangularSystem
from aerarm_ros.identification.solvers.estimate import LARGEST_LOAD_FRICTION, PhysicalLimits
from aerarm_ros.model.inertia import minimum_eigenvalue, pseudo_inertia
from aerarm_ros.motion.signals import Array


@dataclass(frozen=True, eq=False)
class CompressedColumns:
    """Compressed sparse columns (CSC) of a dense matrix.

    Clarabel reads the attributes below, which equal those of `scipy.sparse.csc_matrix`; importing
    SciPy's class would take longer than solving the problem.

    Attributes
    ----------
    data : (nnz,) ndarray
        Nonzero entries, column by column.
    indices : (nnz,) ndarray of int
        Row numbers, increasing in each column.
    indptr : (columns + 1,) ndarray of int
        Index of the first entry of each column.
    has_canonical_format : bool
        Whether rows are sorted without duplicates.
    """

    data: Array
    indices: npt.NDArray[np.int64]
    indptr: npt.NDArray[np.int64]
    shape: tuple[int, int]
    has_canonical_format: bool = True

    @classmethod
    def of(cls, dense: Array) -> 'CompressedColumns':
        """Return the nonzero entries of a dense matrix."""
        columns, rows = np.nonzero(dense.T)
        counts = np.bincount(columns, minlength=dense.shape[1])
        return cls(
            data=np.ascontiguousarray(dense[rows, columns], dtype=float),
            indices=rows.astype(np.int64),
            indptr=np.concatenate(([0], np.cumsum(counts))).astype(np.int64),
            shape=(dense.shape[0], dense.shape[1]),
        )

    @property
    def nnz(self) -> int:
        """Number of nonzero entries."""
        return len(self.data)


class ConeProgram:
    """Cone program: quadratic objective over unknowns y, with each `offset - rows y` in a cone.

    Parameters
    ----------
    count : int
        Number of unknowns.
    """

    def __init__(self, count: int) -> None:
        self._count = count
        self._rows: list[Array] = []
        self._offsets: list[Array] = []
        self._cones: list[tuple[str, int | None]] = []

    def add(
        self, cone: str, rows: Array, offset: Array, dimension: int | None = None, first: int = 0
    ) -> None:
        """Add a constraint on the unknowns starting at `first`.

        Parameters
        ----------
        cone : str
            Name of a Clarabel cone.
        dimension : int, optional
            Dimension of the cone; by default the number of rows m.
        first : int
            Index of the unknown of the first column.
        """
        if not len(rows):
            return
        padded = np.zeros((len(rows), self._count))
        padded[:, first : first + rows.shape[1]] = rows
        self._rows.append(padded)
        self._offsets.append(offset)
        self._cones.append((cone, None if cone == 'ExponentialConeT' else dimension or len(rows)))

    def minimise(self, quadratic: Array, linear: Array) -> Array:
        """Return the y that minimizes `sum(quadratic y^2) / 2 + linear y`.

        Raises
        ------
        SolverError
            If no solution exists, or none was found.
        """
        import clarabel

        settings = clarabel.DefaultSettings()
        settings.verbose = False
        if hasattr(settings, 'max_threads'):
            settings.max_threads = 1  # one thread, for reproducible results
        cones = [(getattr(clarabel, name), dimension) for name, dimension in self._cones]
        solver = clarabel.DefaultSolver(
            CompressedColumns.of(np.diag(quadratic)),
            linear,
            CompressedColumns.of(np.vstack(self._rows)),
            np.concatenate(self._offsets),
            [cone() if dimension is None else cone(dimension) for cone, dimension in cones],
            settings,
        )
        solution = solver.solve()
        if str(solution.status) not in ('Solved', 'AlmostSolved'):
            raise SolverError(str(solution.status))
        return np.asarray(solution.x)


def triangle(matrix: Array) -> Array:
    """Return the upper triangle of a symmetric matrix, column by column, as in PSD cones."""
    rows, columns = np.triu_indices(len(matrix))
    order = np.lexsort((rows, columns))
    rows, columns = rows[order], columns[order]
    return np.asarray(matrix[rows, columns] * np.where(rows == columns, 1.0, np.sqrt(2.0)))


class PhysicalProgram(ConeProgram):
    """Cone program over physically possible parameters, without the cones of single links.

    Unknowns are the deviation x from the prior in standard deviations, and the residual r. With r
    as unknown, R (mean + std x) + r = z is a constraint, and R is never squared. The further
    unknowns of the caller follow.

    Parameters
    ----------
    system : TriangularSystem
        System weighted to unit variance.
    further : int
        Number of further unknowns of the caller.

    Attributes
    ----------
    count : int
        Number of parameters p; x has the indices below p, r starts at p.
    """

    def __init__(
        self, system: TriangularSystem, prior: Prior, limits: PhysicalLimits, further: int = 0
    ) -> None:
        self.count = len(prior.mean)
        super().__init__(2 * self.count + further)
        self._prior = prior
        self._limits = limits
        equations = np.hstack([system.R * prior.std, np.eye(self.count)])
        self.add('ZeroConeT', equations, system.z - system.R @ prior.mean)
        linear = [_mass_bounds(prior, limits), _sign_bounds(prior, limits)]
        if limits.load is not None and limits.load.any():
            linear.append(_load_bounds(prior, limits, limits.load))
        if limits.bounds.total_mass is not None:
            linear.append(_total_mass_bounds(prior, limits))
        if limits.bounds.centres:
            linear.append(_centre_bounds(prior, limits))
        for rows, offsets in linear:
            self.add('NonnegativeConeT', -rows, offsets)

    def scaled_pseudo_inertia(self, link: int) -> tuple[Array, Array]:
        """Return the pseudo-inertia of a link, relative to mass and size, as a function of x.

        Returns
        -------
        columns : (10, 4, 4) ndarray
        constant : (4, 4) ndarray
            The matrix is `constant` plus the sum of x_i times `columns[i]`, where x contains the
            link's deviations from the prior in standard deviations.
        """
        part = slice(10 * link, 10 * link + 10)
        length = np.array([1.0 / self._limits.size[link]] * 3 + [1.0])
        unit = np.outer(length, length) / self._limits.mass[link]
        columns = unit * pseudo_inertia(np.diag(self._prior.std[part]))
        return columns, unit * pseudo_inertia(self._prior.mean[part])

    def parameters(self, quadratic: Array, linear: Array) -> Array:
        """Return the (p,) parameters at the minimum, without rounding errors of the solver.

        Parameters
        ----------
        quadratic, linear : (2 p + further,) ndarray
            Objective, as in `minimise`.

        Raises
        ------
        IdentificationError
            If the solver found no solution, or violated its constraints.
        """
        x = self.minimise(quadratic, linear)[: self.count]
        theta = self._prior.mean + self._prior.std * x
        start = 10 * len(self._limits.mass)
        signed, nonnegative = theta[start:], self._limits.nonnegative
        signed[nonnegative] = np.maximum(signed[nonnegative], 0.0)
        if self._limits.load is not None:
            load = self._limits.load
            signed[load] = np.minimum(signed[load], LARGEST_LOAD_FRICTION)
        if minimum_eigenvalue(theta[:start].reshape(-1, 10)) < 0.0:
            raise IdentificationError(
                'the semidefinite program left its constraints: check the scale of the masses and '
                'inertias in the URDF'
            )
        return np.asarray(theta)


def _mass_bounds(prior: Prior, limits: PhysicalLimits) -> tuple[Array, Array]:
    """Return G, h of G x + h >= 0, which limits the masses to a factor of CAD."""
    n = len(limits.mass)
    rows, offsets = np.zeros((2, n, len(prior.mean))), np.empty((2, n))
    links, masses = np.arange(n), 10 * np.arange(n)
    for side, sign, factor in ((0, 1.0, 1.0 / limits.mass_factor), (1, -1.0, limits.mass_factor)):
        rows[side, links, masses] = sign * prior.std[masses] / limits.mass
        offsets[side] = sign * (prior.mean[masses] / limits.mass - factor)
    return rows.reshape(2 * n, -1), offsets.ravel()


def _total_mass_bounds(prior: Prior, limits: PhysicalLimits) -> tuple[Array, Array]:
    """Return G, h of G x + h >= 0, which limits the sum of the masses to its range (3.13)."""
    masses, unit = 10 * np.arange(len(limits.mass)), limits.mass.sum()
    row = np.zeros(len(prior.mean))
    row[masses] = prior.std[masses] / unit
    low, high = limits.total_mass / unit
    total = prior.mean[masses].sum() / unit
    return np.array([row, -row]), np.array([total - low, high - total])


def _centre_bounds(prior: Prior, limits: PhysicalLimits) -> tuple[Array, Array]:
    """Return G, h of G x + h >= 0, which limits centres of mass to their boxes (3.12)."""
    rows, offsets = [], []
    for sign, box in zip((1.0, -1.0), limits.centre_box, strict=True):
        for link, corner in enumerate(box):
            for axis in range(3):
                row = np.zeros(len(prior.mean))
                row[10 * link + 1 + axis], row[10 * link] = sign, -sign * corner[axis]
                row /= limits.mass[link] * limits.size[link]
                rows.append(row * prior.std)
                offsets.append(float(row @ prior.mean))
    return np.array(rows), np.array(offsets)


def _sign_bounds(prior: Prior, limits: PhysicalLimits) -> tuple[Array, Array]:
    """Return G, h of G x + h >= 0, which keeps friction and rotor inertia non-negative."""
    index = 10 * len(limits.mass) + np.flatnonzero(limits.nonnegative)
    rows = np.zeros((len(index), len(prior.mean)))
    rows[np.arange(len(index)), index] = 1.0
    return rows, prior.mean[index] / prior.std[index]


def _load_bounds(
    prior: Prior, limits: PhysicalLimits, load: npt.NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Return G, h of G x + h >= 0, which limits a gear's loss to its transmitted torque."""
    index = 10 * len(limits.mass) + np.flatnonzero(load)
    rows = np.zeros((len(index), len(prior.mean)))
    rows[np.arange(len(index)), index] = -prior.std[index]
    return rows, LARGEST_LOAD_FRICTION - prior.mean[index]
