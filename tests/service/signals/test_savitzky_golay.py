"""The causal filter against SciPy's own, and its delay."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from caesura_service.signals.backend import best
from caesura_service.signals.savitzky_golay import SavitzkyGolay

Array = NDArray[np.float64]

FILTER = SavitzkyGolay(window=11, order=2, rate_hz=100.0)


def everywhere(rows: Array) -> tuple[Array, Array]:
    rows = np.ascontiguousarray(rows)  # as a Conditioner has them: test_compiled looks for other compilations
    fits = np.empty((len(rows) - 10, 2, rows.shape[1]))
    for centre, both in enumerate(fits, start=5):
        speed = best().fit_polynomials(rows, centre, FILTER.taps, rows.shape[1], both)
        assert speed == pytest.approx(float(np.linalg.norm(both[1, :3])), rel=1e-12)
    return fits[:, 0], fits[:, 1]


def test_it_smooths_as_scipy_does() -> None:
    rows = np.random.default_rng(0).normal(size=(60, 3))
    assert_allclose(everywhere(rows)[0], savgol_filter(rows, 11, 2, axis=0)[5:-5], atol=1e-14)


def test_its_slope_is_scipys_derivative() -> None:
    rows = np.random.default_rng(1).normal(size=(60, 4))
    expected = savgol_filter(rows, 11, 2, deriv=1, delta=0.01, axis=0)[5:-5]
    assert_allclose(everywhere(rows)[1], expected, atol=1e-11)


def test_a_parabola_passes_unchanged_half_a_window_late() -> None:
    t = np.arange(40) / 100.0
    assert_allclose(everywhere(np.tile(t * t, (3, 1)).T)[0][:, 0], (t * t)[5:-5], atol=1e-15)
    assert FILTER.delay_s == 0.05


def test_fewer_rows_than_a_window_are_kept() -> None:
    assert len(FILTER.tail(np.ones((10, 3)))) == 10
    assert len(FILTER.tail(np.ones((30, 3)))) == 10


@pytest.mark.parametrize("window", [10, 1, 0, -3])
def test_a_window_that_has_no_centre_is_refused(window: int) -> None:
    with pytest.raises(ValueError, match=f"window is {window}, expected an odd number from 3"):
        SavitzkyGolay(window, 2, 100.0)


@pytest.mark.parametrize("order", [0, 11])
def test_an_order_that_the_window_cannot_carry_is_refused(order: int) -> None:
    with pytest.raises(ValueError, match=f"order is {order}, expected 1 to 10"):
        SavitzkyGolay(11, order, 100.0)
