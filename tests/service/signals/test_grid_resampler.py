"""Jittered, gapped, repeated samples become a fixed grid; nothing is invented."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray
from scipy.integrate import quad

from caesura_service.signals.cell_average import cell_means
from caesura_service.signals.grid_resampler import MAX_WAITING_SAMPLES, GridState, Resampled, Resampler

Array = NDArray[np.float64]

GRID = Resampler(grid_hz=100.0, gap_limit_s=0.25)
HOLDING = Resampler(grid_hz=100.0, gap_limit_s=0.25, pose=1, hold_limit_s=0.126)


def samples(t: Array, *columns: Array) -> Array:
    return np.column_stack([t, *columns])


def resample(t: Array, *columns: Array, grid: Resampler = GRID) -> Resampled:
    return grid.advance(None, samples(t, *columns))[1]


def grid_times(resampled: Resampled, anchor: float) -> Array:
    rows = [block.first + np.arange(len(block.rows)) for block in resampled.blocks]
    return anchor + np.concatenate(rows) / 100.0


def values(resampled: Resampled) -> Array:
    return np.concatenate([block.rows for block in resampled.blocks])


def jittered(rng: np.random.Generator, rate_hz: float, n: int) -> Array:
    t: Array = (np.arange(n) + rng.uniform(-0.4, 0.4, n)) / rate_hz
    return t


def test_a_cell_is_the_mean_of_the_interpolant_over_it() -> None:
    rng = np.random.default_rng(0)
    t, x = np.sort(rng.uniform(0.0, 0.1, 30)), rng.normal(size=30)
    edges = np.linspace(t[0], t[-1], 8)
    expected = [
        quad(lambda s: float(np.interp(s, t, x)), a, b, points=t[(t > a) & (t < b)], limit=200)[0] / (b - a)
        for a, b in pairwise(edges)
    ]
    assert_allclose(cell_means(edges, samples(t, x))[:, 0], expected, atol=1e-10)


@pytest.mark.parametrize("rate_hz", [40.0, 60.0, 100.0, 250.0, 1000.0])
def test_a_straight_line_stays_where_it_was_at_every_rate(rate_hz: float) -> None:
    t = jittered(np.random.default_rng(1), rate_hz, 200)
    resampled = resample(t, 3.0 - 2.0 * t)
    assert_allclose(values(resampled)[:, 0], 3.0 - 2.0 * grid_times(resampled, t[0]), atol=1e-12)


def test_rows_begin_with_the_first_whole_cell_and_end_with_the_last() -> None:
    (block,) = resample(np.arange(0.0, 1.0005, 0.001), np.zeros(1001)).blocks
    assert (block.first, len(block.rows)) == (1, 99)


def test_a_fast_disturbance_is_averaged_away() -> None:
    t = np.arange(2001) / 1000.0
    hum = np.sin(2 * np.pi * 200.0 * t)
    assert np.abs(values(resample(t, hum))).max() < 1e-9


@pytest.mark.parametrize("rate_hz", [50.0, 100.0, 1000.0])
def test_noise_is_never_amplified(rate_hz: float) -> None:
    rng = np.random.default_rng(2)
    t = jittered(rng, rate_hz, 2000)
    assert values(resample(t, rng.normal(size=2000))).std() < 1.0


def test_samples_whose_time_does_not_advance_are_dropped_and_counted() -> None:
    t = np.array([0.0, 0.01, 0.01, 0.02, 0.005, 0.02, 0.03, 0.04])
    x = np.array([0.0, 1.0, 99.0, 2.0, 99.0, 99.0, 3.0, 4.0])
    resampled = resample(t, x)
    assert resampled.repeats == 3
    assert_array_equal(values(resampled), values(resample(t[x < 99], x[x < 99])))


def test_a_hole_is_reported_and_not_bridged() -> None:
    t = np.concatenate([np.arange(0.0, 1.0, 0.01), np.arange(1.5, 2.0, 0.01)])
    resampled = resample(t, t)
    assert resampled.gaps == ((pytest.approx(0.99), 1.5),)
    at = grid_times(resampled, 0.0)
    assert not np.any((at > 0.99) & (at < 1.5))
    assert [block.restarts for block in resampled.blocks] == [False, True]
    assert_allclose(values(resampled)[:, 0], at, atol=1e-12)


def test_the_grid_keeps_its_anchor_across_a_gap() -> None:
    t = np.concatenate([np.arange(0.0, 1.0, 0.01), np.arange(1.5037, 2.0, 0.01)])
    after = resample(t, t).blocks[1]
    assert after.first == 151
    assert_allclose(after.rows[0, 0], 1.51, atol=1e-12)


def test_a_pause_within_the_limit_is_interpolated() -> None:
    t = np.concatenate([np.arange(0.0, 1.0, 0.01), np.arange(1.2, 2.0, 0.01)])
    resampled = resample(t, t)
    assert resampled.gaps == ()
    assert_array_equal(np.diff(np.round(grid_times(resampled, 0.0), 9)) > 0.015, False)


def test_samples_lost_for_good_end_a_stretch_however_short_the_time() -> None:
    state, _ = GRID.advance(None, samples(np.arange(50) / 100.0, np.zeros(50)))
    _, resampled = GRID.advance(state, samples(0.5 + np.arange(50) / 100.0, np.ones(50)), broken=True)
    assert resampled.gaps == ((0.49, 0.5),)
    assert_array_equal(values(resampled), 1.0)


def test_held_columns_keep_their_last_value() -> None:
    t = np.array([0.0, 0.013, 0.04, 0.06])
    grid = Resampler(100.0, 0.25, held=1)
    resampled = resample(t, t, np.array([5.0, 6.0, 7.0, 8.0]), grid=grid)
    assert_array_equal(values(resampled)[:, 1], [5.0, 6.0, 6.0, 7.0, 7.0])


@pytest.mark.parametrize("read_hz", [8.0, 15.0, 25.0, 40.0])
def test_a_pose_that_a_faster_clock_has_held_is_interpolated_between_its_readings(read_hz: float) -> None:
    """A pose on a straight line, read a few times a second and stamped at 200 Hz, beside a force."""
    t = np.arange(400) / 200.0
    read_at = (
        np.ceil(np.floor(t * read_hz + 1e-9) / read_hz * 200.0 - 1e-9) / 200.0
    )  # the first stamp after it
    force = np.sin(9.0 * t)
    rows, at = values(resample(t, 1.0 + 2.0 * read_at, force, grid=HOLDING)), slice(0, 170)
    assert_allclose(rows[at, 0], 1.0 + 2.0 * (np.arange(170) + 1) / 100.0, atol=1e-12)
    assert_array_equal(rows[at, 1], values(resample(t, force))[at, 0])


def test_a_rest_of_repeated_poses_stays_a_rest() -> None:
    t = np.arange(200) / 200.0
    rows = values(resample(t, np.where(t < 0.5, 1.0, 1.0 + t), grid=HOLDING))[:, 0]
    assert_array_equal(rows[:48], 1.0)
    assert_allclose(rows[50:], 1.0 + (np.arange(50, len(rows)) + 1) / 100.0, atol=1e-12)


def test_rows_wait_for_a_new_pose_as_long_as_the_limit_and_no_longer() -> None:
    t = np.arange(100) / 200.0
    state, known = None, []
    for row in samples(t, np.where(t <= 0.2, t, 0.2)):
        state, resampled = HOLDING.advance(state, row[None])
        known += [float(row[0])] * sum(len(block.rows) for block in resampled.blocks)
    grid_s = (np.arange(len(known)) + 1) / 100.0
    late_s = np.array(known) - grid_s
    assert late_s[:19].max() <= 0.015
    assert 0.1 < late_s[20] <= HOLDING.hold_limit_s + 0.01
    assert late_s[33:].max() <= 0.015


def test_a_quaternion_that_changes_sign_does_not_pass_through_zero() -> None:
    t = np.arange(100) / 1000.0
    signs = np.where(np.arange(100) % 3 == 0, -1.0, 1.0)
    grid = Resampler(100.0, 0.25, quaternion=slice(0, 4))
    resampled = resample(t, *(signs * c for c in (0.5, -0.5, 0.5, 0.5)), grid=grid)
    assert_allclose(np.abs(values(resampled)), 0.5, atol=1e-15)


def test_too_many_samples_in_one_cell_are_refused() -> None:
    t = np.append(0.0, 0.006 + np.arange(MAX_WAITING_SAMPLES) * 1e-9)
    with pytest.raises(ValueError, match=f"{len(t)} samples within 0.01 s, expected at most"):
        resample(t, t)


def test_too_many_samples_in_one_cell_are_refused_however_few_come_at_a_time() -> None:
    t = np.append(0.0, 0.006 + np.arange(MAX_WAITING_SAMPLES) * 1e-9)
    pushes = [*np.array_split(samples(t, t)[:-1], 100), samples(t, t)[-1:]]
    grid, state = Resampler(100.0, 0.25, every=10, phase=6), None
    for push in pushes[:-1]:
        state, _ = grid.advance(state, push)
    with pytest.raises(ValueError, match=f"{len(t)} samples within 0.01 s, expected at most"):
        grid.advance(state, pushes[-1])
    _, later = grid.advance(state, samples(np.array([0.1]), np.array([0.1])))
    assert_allclose(values(later)[:, 0], grid_times(later, 0.0), atol=1e-12)


def test_the_state_stays_small_over_a_long_session() -> None:
    state: GridState | None = None
    for i in range(200):
        state, _ = GRID.advance(state, samples(i * 0.1 + np.arange(100) / 1000.0, np.zeros(100)))
    assert state is not None
    assert state.known < 20


def test_a_clock_that_was_set_back_is_refused_and_changes_nothing() -> None:
    resampler = Resampler(100.0, 0.25)
    times = np.arange(0.0, 1.0, 0.001)
    state, _ = resampler.advance(None, samples(times, times))
    with pytest.raises(
        ValueError, match=r"time goes back by 0\.999 s, from 0\.999 s to 0 s, expected within 0\.25 s"
    ):
        resampler.advance(state, samples(times, times))
    late, resampled = resampler.advance(state, np.array([[0.9, 0.9], [1.0, 1.0]]))
    assert resampled.repeats == 1
    assert late is not None


def test_a_clock_that_leaps_is_refused() -> None:
    resampler = Resampler(100.0, 0.25)
    with pytest.raises(
        ValueError, match=r"sample 1: time leaps by \S+ s, from 1 s to 1760000000 s, expected within 3600 s"
    ):
        resampler.advance(None, np.array([[1.0, 0.0], [1.76e9, 0.0]]))


def test_a_time_of_day_is_refused_with_its_digits() -> None:
    """It was shown as "from 1.79e+09 s to 1.79e+09 s"."""
    with pytest.raises(
        ValueError, match=r"by 3600 s, from 1790000003\.999 s to 1789996403\.999 s, .* end this"
    ):
        Resampler(100.0, 0.25).advance(None, np.array([[1790000003.999, 0.0], [1789996403.999, 0.0]]))


def test_rows_come_together_and_are_the_same() -> None:
    t = np.sort(np.random.default_rng(0).uniform(0.0, 3.0, 900))
    t = t[(t < 1.3) | (t > 1.7)]
    together = Resampler(100.0, 0.25, every=10, phase=6)
    state, blocks = None, []
    for push in np.array_split(t, 57):
        state, resampled = together.advance(state, samples(push, push))
        blocks += resampled.blocks
    assert state is not None
    ends = [block.first + len(block.rows) for block in blocks if len(block.rows)]
    before_the_gap = max(end for end in ends if end < 150)
    assert {(end - 6) % 10 for end in ends if end != before_the_gap} == {0}
    blocks.append(together.flush(state)[1])
    alone = [row for block in resample(t, t).blocks for row in block.rows]
    np.testing.assert_array_equal([row for block in blocks for row in block.rows], alone)
