"""The filter against brute force: every segmentation of a short series, written out."""

from __future__ import annotations

import numpy as np
import pytest

from caesura_service.changepoint.evidence import log_sum_exp
from caesura_service.changepoint.hazard import Geometric
from caesura_service.changepoint.lattice import Lattice
from caesura_service.changepoint.models import Observed
from caesura_service.changepoint.online import FilterParameters, OnlineFilter
from caesura_service.changepoint.presets import PRESETS
from service.changepoint.brute_force import BruteForce, demonstration

EXACT = FilterParameters(prune_ratio=0.0, keep_youngest=0, cap=1000, window=64)
HAZARD = Geometric(8.0)
LATTICES = [pytest.param(preset.lattice(), id=name) for name, preset in PRESETS.items()]


@pytest.mark.parametrize("lattice", LATTICES)
@pytest.mark.parametrize("seed", [0, 1])
def test_filter_agrees_with_the_sum_over_all_segmentations(lattice: Lattice, seed: int) -> None:
    data = demonstration(seed)
    online = OnlineFilter(lattice, HAZARD, EXACT)
    for observed in data:
        online.step(observed)
    brute = BruteForce(lattice, data, HAZARD)

    assert float(log_sum_exp(online.log_joint)) == pytest.approx(brute.total, abs=1e-9)
    expected = [brute.probability([path[-1] == start for path in brute.paths]) for start in range(len(data))]
    np.testing.assert_allclose(online.posterior, expected, atol=1e-9)
    got = [online.changepoint_probability(start) for start in range(len(data))]
    np.testing.assert_allclose(got, brute.changepoint_probability(), atol=1e-9)

    best = brute.best
    path = [*online.final, *online.map_path()]
    assert tuple(segment.start for segment in path) == best
    for segment, end in zip(path, (*best[1:], len(data)), strict=True):
        np.testing.assert_allclose(segment.kind_log_evidence, brute.kinds[segment.start, end], atol=1e-9)


@pytest.mark.parametrize("lattice", LATTICES)
def test_smoothing_is_exact_inside_a_short_window(lattice: Lattice) -> None:
    data = demonstration(3)
    wide = OnlineFilter(lattice, HAZARD, EXACT)
    narrow = OnlineFilter(
        lattice, HAZARD, FilterParameters(prune_ratio=0.0, keep_youngest=0, cap=1000, window=4)
    )
    for observed in data:
        wide.step(observed)
        narrow.step(observed)
    for start in range(len(data) - 4, len(data)):
        assert narrow.changepoint_probability(start) == pytest.approx(
            wide.changepoint_probability(start), abs=1e-12
        )


def test_a_boundary_is_certain_and_cuts_every_hypothesis() -> None:
    data = demonstration(4)
    online = OnlineFilter(PRESETS["integrated"].lattice(), HAZARD, EXACT)
    for i, observed in enumerate(data):
        online.step(observed, boundary=i == 7)
    assert online.changepoint_probability(7) == pytest.approx(1.0, abs=1e-12)
    assert online.starts.min() == 7
    assert any(segment.start == 7 for segment in online.map_path())
    alone = OnlineFilter(PRESETS["integrated"].lattice(), HAZARD, EXACT)
    for observed in data[7:]:
        alone.step(observed)
    np.testing.assert_allclose(online.posterior, alone.posterior, atol=1e-12)


def test_what_is_final_is_never_revised() -> None:
    rng = np.random.default_rng(5)
    online = OnlineFilter(PRESETS["default"].lattice(), Geometric(30.0))
    before: list[int] = []
    position = np.zeros(3)
    for i in range(150):
        position = position + (rng.normal(0, 0.01, 3) if (i // 20) % 2 else rng.normal(0, 2e-4, 3))
        force = np.array([0.0, 0.0, 8.0 * ((i // 30) % 2)]) + rng.normal(0, 0.2, 3)
        online.step(Observed(position, force))
        now = [segment.start for segment in online.final]
        assert now[: len(before)] == before
        before = now
    assert len(before) > 3


def test_pruning_drops_almost_nothing_of_the_posterior() -> None:
    data = demonstration(6, 60)
    lattice = PRESETS["integrated"].lattice()
    exact, pruned = OnlineFilter(lattice, HAZARD, EXACT), OnlineFilter(lattice, HAZARD)
    for observed in data:
        exact.step(observed)
        pruned.step(observed)
    assert pruned.starts.size < exact.starts.size
    np.testing.assert_allclose(pruned.posterior, exact.posterior[pruned.starts], atol=1e-4)
    got = [pruned.changepoint_probability(s) for s in range(25, 60)]
    np.testing.assert_allclose(got, [exact.changepoint_probability(s) for s in range(25, 60)], atol=1e-4)


def test_standing_still_costs_no_more_as_time_passes() -> None:
    rng = np.random.default_rng(7)
    online = OnlineFilter(PRESETS["default"].lattice(), Geometric(30.0))
    living = []
    for _ in range(600):
        online.step(Observed(rng.normal(0, 5e-4, 3), rng.normal(0, 0.2, 3)))
        living.append(online.starts.size)
    assert max(living[300:]) <= max(living[:300]) + 5
    assert max(living) <= online.parameters.cap


def test_a_value_that_is_not_finite_is_refused_and_changes_nothing() -> None:
    online = OnlineFilter(PRESETS["integrated"].lattice(), HAZARD)
    online.step(Observed(np.zeros(3), np.zeros(3)))
    with pytest.raises(ValueError, match="observation 1: force"):
        online.step(Observed(np.zeros(3), np.array([0.0, np.nan, 0.0])))
    assert online.count == 1
    assert online.starts.tolist() == [0]
