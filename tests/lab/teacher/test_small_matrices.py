"""Linear systems and eigenvectors of an inner loop: those of numpy, and of the definitions."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from caesura_lab.teacher.small_matrices import eigh, solve

SIZES = (1, 3, 6, 7)


def drawn(size: int) -> np.ndarray:
    """Of full rank, and not symmetric: a load makes a mass matrix so by its last bit."""
    return np.random.default_rng(size).normal(size=(size, size)) + 3.0 * size * np.eye(size)


@pytest.mark.parametrize("size", SIZES)
def test_a_system_is_solved_for_a_vector_and_for_columns_and_its_arguments_stay(size: int) -> None:
    matrix = drawn(size)
    given = matrix.copy()
    for right in (np.arange(1.0, size + 1.0), np.random.default_rng(0).normal(size=(size, 6))):
        found = solve(matrix, right)
        assert_allclose(matrix @ found, right, atol=1e-12)
        assert_allclose(found, np.linalg.solve(matrix, right), rtol=1e-12)
        assert found.flags.c_contiguous
    assert_array_equal(matrix, given)


def test_a_singular_system_is_refused() -> None:
    with pytest.raises(np.linalg.LinAlgError, match="Singular"):
        solve(np.ones((3, 3)), np.ones(3))


@pytest.mark.parametrize("size", SIZES)
def test_eigenvectors_are_turned_into_multiples_of_themselves_by_rising_eigenvalues(size: int) -> None:
    matrix = drawn(size) @ drawn(size).T
    given = matrix.copy()
    values, vectors = eigh(matrix)
    assert (np.diff(values) > 0.0).all()
    assert_allclose(matrix @ vectors, vectors * values, rtol=1e-9, atol=1e-9)
    assert_allclose(vectors.T @ vectors, np.eye(size), atol=1e-12)
    assert_array_equal(matrix, given)
