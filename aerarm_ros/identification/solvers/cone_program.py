"""Convex programs over cones, for Clarabel."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.solvers.compressed_columns import CompressedColumns
from aerarm_ros.identification.solvers.solver_error import SolverError

Array = npt.NDArray[np.float64]


class ConeProgram:
    """A quadratic objective over unknowns y such that each `offset - rows y` lies in a cone.

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
        """Add a constraint on the unknowns from `first` on; most cones' dimension is its rows.

        Parameters
        ----------
        cone : str
            One of Clarabel's.
        rows, offset : (m, k), (m,) ndarray
        dimension : int, optional
            Of the cone, where it is not m.
        first : int
            Unknown that the first column is for.
        """
        if not len(rows):
            return
        padded = np.zeros((len(rows), self._count))
        padded[:, first : first + rows.shape[1]] = rows
        self._rows.append(padded)
        self._offsets.append(offset)
        self._cones.append((cone, None if cone == 'ExponentialConeT' else dimension or len(rows)))

    def minimise(self, quadratic: Array, linear: Array) -> Array:
        """Return the y that minimises `sum(quadratic y^2) / 2 + linear y`.

        Raises
        ------
        SolverError
            If there is none, or none was found.
        """
        import clarabel

        settings = clarabel.DefaultSettings()
        settings.verbose = False
        if hasattr(settings, 'max_threads'):
            settings.max_threads = 1  # same input, same bits out
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
    """Return the upper triangle of a symmetric matrix, column by column, as PSD cones have it."""
    rows, columns = np.triu_indices(len(matrix))
    order = np.lexsort((rows, columns))
    rows, columns = rows[order], columns[order]
    return np.asarray(matrix[rows, columns] * np.where(rows == columns, 1.0, np.sqrt(2.0)))
