"""Linear algebra of small matrices for an inner loop.

The routines of LAPACK are those of np.linalg.solve and np.linalg.eigh, which take three times as long: they
prepare for stacks of matrices of any type. For the same reason an inner loop multiplies by `dot`, not by `@`.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dgesv, dsyevd

from caesura_lab.teacher.motion_profiles import Array


def solve(matrix: Array, right: Array) -> Array:
    """Return x of matrix (n, n) x = right (n,) or (n, m). Raises LinAlgError for a singular matrix."""
    _, _, found, failed = dgesv(matrix, right)
    if failed:
        raise np.linalg.LinAlgError("Singular matrix")
    return np.ascontiguousarray(found)


def eigh(matrix: Array) -> tuple[Array, Array]:
    """Return eigenvalues (n,), the lowest first, and eigenvectors (n, n), in columns, of a symmetric matrix.

    Raises LinAlgError where they are not found.
    """
    values, vectors, failed = dsyevd(matrix, lower=1)
    if failed:
        raise np.linalg.LinAlgError("Eigenvalues did not converge")
    return values, np.ascontiguousarray(vectors)
