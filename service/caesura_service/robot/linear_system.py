"""Linear algebra of small matrices for an inner loop.

The functions call the routines of LAPACK that np.linalg.solve and np.linalg.eigh call, at a third of their time:
these prepare for stacks of matrices of any type.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgesv, dsyevd

Array = NDArray[np.float64]


def solve(matrix: Array, right: Array) -> Array:
    """Return x of matrix (n, n) x = right (n,) or (n, m). Raises LinAlgError for a singular matrix."""
    _, _, found, failed = dgesv(matrix, right)
    if failed:
        raise np.linalg.LinAlgError("Singular matrix")
    return np.ascontiguousarray(found)


def eigh(matrix: Array) -> tuple[Array, Array]:
    """Return the eigenvalues (n,), the lowest first, and eigenvectors, in columns, of a symmetric matrix (n, n).

    Raises LinAlgError where they are not found.
    """
    values, vectors, failed = dsyevd(matrix, lower=1)
    if failed:
        raise np.linalg.LinAlgError("Eigenvalues did not converge")
    return values, np.ascontiguousarray(vectors)
