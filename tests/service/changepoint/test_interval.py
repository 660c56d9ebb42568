"""The 90 % interval of a changepoint: quantiles of masses that are even around their middles."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from caesura_service.changepoint.preset import SEGMENTATION_HZ
from caesura_service.changepoint.segments import PLACE_STEPS, interpolated_quantile
from caesura_service.constants import GRID_HZ

MASSES = st.lists(st.floats(0.0, 1.0), min_size=1, max_size=11).filter(lambda mass: sum(mass) > 1e-3)


@given(MASSES, st.floats(0.01, 0.99))
def test_a_quantile_is_that_of_masses_which_are_even_around_their_middles(
    mass: list[float], share: float
) -> None:
    at = interpolated_quantile(mass, share)
    middles = np.arange(len(mass))
    assert -PLACE_STEPS <= at <= len(mass) - 1 + PLACE_STEPS
    covered = np.clip((at - middles + PLACE_STEPS) / (2.0 * PLACE_STEPS), 0.0, 1.0)
    assert covered @ mass == pytest.approx(share * sum(mass), abs=1e-9)


def test_one_mass_alone_has_nine_tenths_within_nine_tenths_of_where_it_may_lie() -> None:
    low, high = (interpolated_quantile([1.0], share) for share in (0.05, 0.95))
    assert (low, high) == (pytest.approx(-0.9 * PLACE_STEPS), pytest.approx(0.9 * PLACE_STEPS))


def test_a_mass_of_nothing_is_passed() -> None:
    assert interpolated_quantile([0.0, 0.0, 1.0], 0.5) == pytest.approx(2.0)
    assert interpolated_quantile([1.0, 0.0, 0.0], 0.5) == pytest.approx(0.0)


def test_a_boundary_is_sought_within_that_many_steps() -> None:
    """`RecentRows.boundary` looks at one row less than a step to either side."""
    rows = GRID_HZ / SEGMENTATION_HZ
    assert (rows - 1.0) / rows == pytest.approx(PLACE_STEPS)
