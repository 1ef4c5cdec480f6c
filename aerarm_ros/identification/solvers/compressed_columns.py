"""A sparse matrix by columns, as the cone solver reads it."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CompressedColumns:
    """Compressed sparse columns (CSC) of a dense matrix.

    Clarabel reads the attributes below, which are those of `scipy.sparse.csc_matrix`;
    importing that would take longer than solving the problem.

    Attributes
    ----------
    data : (nnz,) ndarray
        Entries other than zero, column by column.
    indices : (nnz,) ndarray of int
        Their rows, increasing in each column.
    indptr : (columns + 1,) ndarray of int
        Where each column begins.
    shape : tuple of two ints
    has_canonical_format : bool
        Rows are sorted and none occurs twice.
    """

    data: Array
    indices: npt.NDArray[np.int64]
    indptr: npt.NDArray[np.int64]
    shape: tuple[int, int]
    has_canonical_format: bool = True

    @classmethod
    def of(cls, dense: Array) -> 'CompressedColumns':
        """Return the entries of a dense matrix that aren't zero."""
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
        """Number of entries."""
        return len(self.data)
