"""The thesis' decision: what is above a threshold, neighbours as one, named by exactly its samples."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from caesura_service.changepoint.channel_model import ModelInput
from caesura_service.changepoint.filter_parameters import FilterParameters
from caesura_service.changepoint.hazard import Geometric
from caesura_service.changepoint.offline_posterior import segment_offline
from caesura_service.changepoint.presets import PRESETS
from caesura_service.changepoint.probability_threshold_segmenter import (
    ThresholdSegmenter,
    runs_above,
    threshold_path,
)
from caesura_service.changepoint.run_length_filter import PathSegment, RunLengthFilter
from service.changepoint.brute_force import BruteForce, demonstration
from service.streams import pieces

HAZARD = Geometric(8.0)
EXACT = FilterParameters(prune_ratio=0.0, keep_youngest=0, cap=1000, window=64, certain=1.0)
NAMES = ["default", "integrated", "contact", "force"]


def check_same(
    path: list[PathSegment] | tuple[PathSegment, ...], expected: list[PathSegment] | tuple[PathSegment, ...]
) -> None:
    assert [one.start for one in path] == [one.start for one in expected]
    for one, other in zip(path, expected, strict=True):
        np.testing.assert_allclose(one.kind_log_evidence, other.kind_log_evidence, atol=1e-9)


def test_neighbouring_samples_above_the_threshold_are_one_changepoint_at_the_most_probable():
    runs = runs_above([1.0, 0.1, 0.3, 0.4, 0.25, 0.0, 0.1, 0.21, 0.2])
    assert runs == [(0, 0, 0), (2, 4, 3), (7, 7, 7)]


def test_a_sample_below_the_threshold_keeps_two_changepoints_apart():
    assert [run.start for run in runs_above([1.0, 0.0, 0.5, 0.19, 0.5])] == [0, 2, 4]
    assert [run.start for run in runs_above([1.0, 0.0, 0.5, 0.19, 0.5], 0.1)] == [0, 2]


def test_a_boundary_that_was_declared_is_merged_with_nothing_before_it():
    probability = [1.0, 0.0, 0.6, 1.0, 1.0, 0.3]
    assert [run.start for run in runs_above(probability, boundaries=[3, 4])] == [0, 2, 3, 4]


@pytest.mark.parametrize("level", [0.0, 1.0, -0.2, float("nan")])
def test_a_threshold_that_is_no_probability_is_refused(level: float):
    with pytest.raises(ValueError, match="expected a probability between 0 and 1"):
        runs_above([1.0], level)
    with pytest.raises(ValueError, match="expected a probability between 0 and 1"):
        ThresholdSegmenter(PRESETS["force"].online(), level)


def test_there_is_one_probability_an_observation():
    with pytest.raises(ValueError, match="expected \\(3,\\)"):
        threshold_path(PRESETS["force"].lattice(), demonstration(0)[:3], [1.0, 0.0])


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", [0, 1])
def test_offline_and_online_decide_as_the_marginals_of_all_segmentations(name: str, seed: int):
    lattice = PRESETS[name].lattice()
    data = [one for one, _ in pieces(np.random.default_rng(seed), 11)]
    brute = BruteForce(lattice, data, HAZARD)
    offline = segment_offline(lattice, HAZARD, data)
    for level in (0.05, 0.2, 0.5):
        starts = [run.start for run in runs_above(brute.changepoint_probability(), level)]
        expected = [PathSegment(s, brute.kinds[s, e]) for s, e in pairwise([*starts, len(data)])]

        check_same(offline.threshold_path(level), expected)
        online = ThresholdSegmenter(RunLengthFilter(lattice, HAZARD, EXACT), level)
        for observed in data:
            online.step(observed)
        check_same(online.path(), expected)


@pytest.mark.slow
@settings(max_examples=8, deadline=None, derandomize=True)
@given(st.integers(0, 2**32 - 1), st.sampled_from(NAMES), st.sampled_from([2, 10, 40]))
def test_what_is_kept_on_the_way_is_what_the_whole_would_give_and_final_stays(
    seed: int, name: str, window: int
):
    lattice, parameters = PRESETS[name].lattice(), FilterParameters(window=window, certain=1.0)
    online = ThresholdSegmenter(RunLengthFilter(lattice, Geometric(20.0), parameters))
    data: list[ModelInput] = []
    before: list[tuple[PathSegment, int]] = []
    for observed, boundary in pieces(np.random.default_rng(seed), 60):
        online.step(observed, boundary=boundary)
        data.append(observed)
        starts = [one.start for one in (*online.final, *online.path())]
        now = list(zip(online.final, starts[1:], strict=False))
        assert now[: len(before)] == before
        before = now
    boundaries = online.online.boundaries
    whole = threshold_path(lattice, data, online.online.smoothed, boundaries=boundaries)
    check_same([*online.final, *online.path()], whole)


def test_a_long_segment_costs_no_more_as_it_grows():
    rng = np.random.default_rng(1)
    online = ThresholdSegmenter(PRESETS["integrated"].online())
    tapes, undecided = [], []
    for _ in range(300):
        online.step(ModelInput(rng.normal(0, 5e-4, 3), rng.normal(0, 0.2, 3)))
        tapes.append(len(online._tapes))
        undecided.append(online.online.count - online._undecided)
    assert max(tapes) <= 3
    assert max(undecided) <= online.online.parameters.window + 1
