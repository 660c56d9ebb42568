"""Bayesian online changepoint detection against all segmentations, and against predictives one by one."""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_t

from caesura_lab.evaluation.baselines.bocpd_baseline import NormalInverseWishart, SegmentEvidence, detect

ONE = NormalInverseWishart((0.3,), 0.4, 3.0, (0.7,))
TWO = NormalInverseWishart((0.1, -0.2), 0.5, 4.5, (0.6, 1.4))
THREE = NormalInverseWishart((0.0, 0.1, 0.2), 0.8, 5.0, (1.0, 0.5, 2.0))


def log_predictives(rows: np.ndarray, prior: NormalInverseWishart) -> float:
    """Log p(rows) as a product of Student-t predictives, the prior updated row by row; Murphy 2007, (258)."""
    mean, weight = np.array(prior.mean), prior.mean_weight
    degrees, scatter = prior.degrees, prior.degrees * np.diag(np.square(prior.spread))
    total, width = 0.0, len(mean)
    for row in rows:
        freedom = degrees - width + 1
        shape = scatter * (weight + 1) / (weight * freedom)
        total += multivariate_t(mean, shape, df=freedom).logpdf(row)
        scatter = scatter + weight / (weight + 1) * np.outer(row - mean, row - mean)
        mean = (weight * mean + row) / (weight + 1)
        weight, degrees = weight + 1, degrees + 1
    return total


def all_segmentations(rows: np.ndarray, prior: NormalInverseWishart, mean_segment: float, least: int):
    """(starts, log joint) of every segmentation whose segments but the last have `least` rows."""
    n, hazard = len(rows), 1.0 / (mean_segment - least + 1)
    for chosen in product([False, True], repeat=n - 1):
        starts = [0, *(i + 1 for i, here in enumerate(chosen) if here)]
        lengths = [b - a for a, b in pairwise([*starts, n])]
        if all(length >= least for length in lengths[:-1]):
            joint = sum(log_predictives(rows[a:b], prior) for a, b in pairwise([*starts, n]))
            joint += sum((length - least) * np.log1p(-hazard) + np.log(hazard) for length in lengths[:-1])
            yield starts, joint + max(lengths[-1] - least, 0) * np.log1p(-hazard)


@pytest.mark.parametrize("prior", [ONE, TWO, THREE], ids=["one", "two", "three"])
def test_evidence_is_the_product_of_predictives(prior: NormalInverseWishart):
    rows = np.random.default_rng(1).normal(0.5, 1.0, (9, len(prior.mean)))
    evidence = SegmentEvidence(rows, prior)
    for t in (0, 3, 8):
        expected = [log_predictives(rows[s : t + 1], prior) for s in range(t + 1)]
        assert evidence.ending_at(t) == pytest.approx(expected, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("least", [1, 3])
@pytest.mark.parametrize("prior", [ONE, TWO], ids=["one", "two"])
@pytest.mark.parametrize("seed", range(4))
def test_eight_samples_against_every_segmentation(prior: NormalInverseWishart, least: int, seed: int):
    rng = np.random.default_rng(seed)
    rows = rng.normal(0.0, 0.5, (8, len(prior.mean)))
    rows[rng.integers(2, 6) :] += rng.normal(0.0, 3.0, len(prior.mean))
    detected = detect(rows, prior, 5.0, least)
    known = list(all_segmentations(rows, prior, 5.0, least))
    assert detected.log_evidence == pytest.approx(logsumexp([joint for _, joint in known]), abs=1e-9)
    best, _ = max(known, key=lambda one: one[1])
    assert [0, *detected.starts.tolist()] == best
    for start in range(8):
        of_start = [joint for starts, joint in known if starts[-1] == start]
        expected = logsumexp(of_start) if of_start else -np.inf
        assert detected.log_joint[start] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("first", [7, 20, 33])
def test_a_segment_starts_at_its_first_observation(first: int):
    rows = np.random.default_rng(first).normal(0.0, 0.1, (60, 2))
    rows[first:] += 4.0
    rows[first + 12 :, 1] -= 8.0
    assert detect(rows, TWO, 20.0, 3).starts.tolist() == [first, first + 12]


def test_what_comes_later_changes_no_evidence_of_what_came_before():
    rows = np.random.default_rng(3).normal(0.0, 1.0, (30, 2))
    early, late = SegmentEvidence(rows[:12], TWO), SegmentEvidence(rows, TWO)
    assert early.ending_at(11) == pytest.approx(late.ending_at(11), abs=1e-9)


@pytest.mark.parametrize("least", [2, 3])
def test_a_mean_that_no_hazard_gives_is_refused(least: int):
    """A mean of 2 with segments of 3 and more had a hazard above 1, and a posterior of nan."""
    with pytest.raises(ValueError, match=f"mean segment is 2 observations, expected more than {least}"):
        detect(np.zeros((9, 1)), ONE, 2.0, least)
