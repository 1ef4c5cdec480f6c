"""The sparse format is SciPy's."""

import numpy as np
from scipy.sparse import csc_matrix

from aerarm_ros.identification.solvers.semidefinite_solver import CompressedColumns


def test_same_arrays_as_scipy() -> None:
    random = np.random.default_rng(0)
    dense = random.standard_normal((6, 5)) * (random.uniform(size=(6, 5)) > 0.5)
    dense[:, 2] = 0.0
    own, other = CompressedColumns.of(dense), csc_matrix(dense)
    for name in ('data', 'indices', 'indptr'):
        assert np.array_equal(getattr(own, name), getattr(other, name))
    assert (own.shape, own.nnz) == (other.shape, other.nnz)
    assert own.has_canonical_format
