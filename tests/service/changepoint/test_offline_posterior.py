"""The offline recursion against brute force and against the online filter; hazards as distributions."""

from __future__ import annotations

import numpy as np
import pytest

from caesura_service.changepoint.evidence import log_sum_exp
from caesura_service.changepoint.filter_parameters import FilterParameters
from caesura_service.changepoint.hazard import Geometric, Hazard, NegativeBinomial, Refractory, Uniform
from caesura_service.changepoint.offline_posterior import segment_offline
from caesura_service.changepoint.presets import PRESETS
from caesura_service.changepoint.run_length_filter import RunLengthFilter
from service.changepoint.brute_force import BruteForce, demonstration

HAZARDS = [Geometric(8.0), Uniform(12), Uniform(5), NegativeBinomial(6.0, 3.0), Refractory(8.0, 2, 0.1)]
EXACT = FilterParameters(prune_ratio=0.0, keep_youngest=0, cap=1000, window=64, certain=1.0)


@pytest.mark.parametrize("hazard", HAZARDS, ids=repr)
@pytest.mark.parametrize("name", ["default", "integrated"])
def test_offline_agrees_with_the_sum_over_all_segmentations(name: str, hazard: Hazard) -> None:
    lattice, data = PRESETS[name].lattice(), demonstration(8, 10)
    offline = segment_offline(lattice, hazard, data)
    brute = BruteForce(lattice, data, hazard)
    assert offline.log_evidence == pytest.approx(brute.total, abs=1e-9)
    np.testing.assert_allclose(offline.changepoint_probability, brute.changepoint_probability(), atol=1e-9)
    assert tuple(segment.start for segment in offline.path) == brute.best


@pytest.mark.slow
@pytest.mark.parametrize("hazard", HAZARDS[:1] + HAZARDS[3:], ids=repr)
@pytest.mark.parametrize("name", PRESETS)
def test_online_at_the_last_sample_equals_offline(name: str, hazard: Hazard) -> None:
    lattice, data = PRESETS[name].lattice(), demonstration(9, 40)
    offline = segment_offline(lattice, hazard, data)
    online = RunLengthFilter(lattice, hazard, EXACT)
    for observed in data:
        online.step(observed)
    assert float(log_sum_exp(online.log_joint)) == pytest.approx(offline.log_evidence, abs=1e-8)
    assert [s.start for s in (*online.final, *online.map_path())] == [s.start for s in offline.path]
    got = [online.changepoint_probability(start) for start in range(len(data))]
    np.testing.assert_allclose(got, offline.changepoint_probability, atol=1e-8)


def test_pruning_changes_almost_nothing() -> None:
    lattice, data, hazard = PRESETS["integrated"].lattice(), demonstration(10, 60), Geometric(8.0)
    exact = segment_offline(lattice, hazard, data)
    pruned = segment_offline(lattice, hazard, data, prune_ratio=1e-8)
    np.testing.assert_allclose(pruned.changepoint_probability, exact.changepoint_probability, atol=1e-3)
    assert [s.start for s in pruned.path] == [s.start for s in exact.path]


def test_an_empty_recording_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one"):
        segment_offline(PRESETS["default"].lattice(), Geometric(8.0), [])


@pytest.mark.parametrize("hazard", HAZARDS, ids=repr)
def test_a_hazard_is_a_distribution_and_its_survival(hazard: Hazard) -> None:
    n = np.arange(1, 4000)
    mass = np.exp(hazard.log_mass(n))
    assert mass.sum() == pytest.approx(1.0, abs=1e-9)
    for length in (1, 3, 10):
        survival = float(np.exp(hazard.log_survival(np.array([length]))[0]))
        assert survival == pytest.approx(1.0 - mass[:length].sum(), abs=1e-9)
    assert float(hazard.log_survival(np.array([0]))[0]) == pytest.approx(0.0, abs=1e-12)


def test_lengths_have_the_mean_that_was_asked_for() -> None:
    n = np.arange(1, 4000)
    for hazard in (Geometric(20.0), NegativeBinomial(20.0, 4.0)):
        assert (n * np.exp(hazard.log_mass(n))).sum() == pytest.approx(20.0, abs=1e-6)


@pytest.mark.parametrize(
    "bad",
    [lambda: Geometric(1.0), lambda: Uniform(0), lambda: NegativeBinomial(0.5), lambda: Refractory(5.0, -1)],
)
def test_a_hazard_that_is_no_distribution_is_refused(bad) -> None:
    with pytest.raises(ValueError, match="expected"):
        bad()
