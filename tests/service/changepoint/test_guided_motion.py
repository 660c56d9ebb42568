"""Guided motion and corners: what a movement may do, and where one ends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import multivariate_t

from caesura_service.changepoint.channel_model import ModelInput
from caesura_service.changepoint.channel_model_checks import rows_after
from caesura_service.changepoint.corner_weight import CornerWeight
from caesura_service.changepoint.default_presets import (
    GUIDED_NOISE_M,
    NORMAL_NU,
    SLOW,
    corner,
    corner_of_rotation,
    guided_motion,
)
from caesura_service.changepoint.guided_motion import GuidedMotion

CORNER = CornerWeight(gamma=30.0, pace=SLOW)
STEP_M = 0.01
# [mm] steps of a simulated person who wipes to and fro (wiping, person 30001, 5.2 to 6.8 s)
TURNS_BACK = [
    (15.2, -35.9),
    (9.3, -37.2),
    (3.3, -32.4),
    (0.9, -27.5),
    (0.5, -22.6),
    (2.2, -13.9),
    (5.3, -0.7),
]
GOES_ON = [
    (6.9, 4.8),
    (5.4, 3.6),
    (6.6, 12.7),
    (9.0, 29.8),
    (7.7, 35.6),
    (3.4, 30.5),
    (-0.5, 25.7),
    (0.0, 20.0),
]


def observed(path: np.ndarray) -> list[ModelInput]:
    return [ModelInput(position, np.zeros(3)) for position in path]


def bent(turn_deg: float, dip: float, *, reach: int = 6) -> np.ndarray:
    """A path at STEP_M a step that turns in one place, where its speed is this share of that; (n, 3) [m]."""
    ahead = np.array([np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg)), 0.0])
    sizes = [*[1.0] * reach, dip, *[1.0] * reach]
    steps = [s * STEP_M * (np.array([1.0, 0.0, 0.0]) if i <= reach else ahead) for i, s in enumerate(sizes)]
    return np.cumsum([np.zeros(3), *steps], axis=0)


def zigzag(leg: int, legs: int = 6) -> np.ndarray:
    """A path whose direction swings by 45° to each side, once in two legs of so many steps; (n, 3) [m]."""
    swing = np.sin(np.pi * (np.arange(legs * leg) + 0.5) / leg)
    sizes, heading = STEP_M * np.sqrt(0.02 + swing**2), np.radians(45.0) * swing
    steps = sizes[:, None] * np.column_stack([np.cos(heading), np.sin(heading), np.zeros(heading.size)])
    return np.cumsum([np.zeros(3), *steps], axis=0)


def weight_at(path: np.ndarray, start: int) -> float:
    return float(CORNER.log_evidence(rows_after(CORNER, observed(path)))[start])


def test_evidence_is_a_mean_over_scales_of_products_of_student_t_densities() -> None:
    """Every step has a multivariate Student t of its own, by scipy; the segment has one of the scales."""
    model = GuidedMotion(0.8, floor=0.002, share=0.3, burst=0.004, burst_steps=2, nu=6.0, scales=(0.7, 1.5))
    path = np.cumsum(np.random.default_rng(3).normal(0.0, 0.004, (9, 3)), axis=0)
    steps = np.diff(path, axis=0)
    expected = []
    for scale in model.scales:
        densities = []
        for n, step in enumerate(steps):  # the hypothesis that starts at observation 1
            before, earlier = (steps[n - k] if n >= k else np.zeros(3) for k in (1, 2))
            mean = 2.0 * 0.8 * before - 0.8**2 * earlier
            scale2 = 0.002**2 + 0.3**2 * before @ before + (0.004**2 if n < 2 else 0.0)
            shape = scale2 * scale**2 * np.eye(3)
            densities.append(multivariate_t(mean, shape, df=model.nu).logpdf(step))
        expected.append(sum(densities))
    rows = rows_after(model, observed(path))
    assert model.log_evidence(rows)[1] == pytest.approx(np.log(np.mean(np.exp(expected))), abs=1e-9)


def test_a_jolt_is_no_reason_for_a_new_movement() -> None:
    """A movement of the model at about 0.2 m/s that is pushed aside once, by 12 mm a step."""
    model = guided_motion()
    steps = [np.zeros(3), np.zeros(3)]
    for n in range(40):
        error = np.array([0.0, 0.012 if n == 20 else 0.0, 0.0])
        pushed = np.array([0.0006, 0.0, 0.0]) + error
        steps.append(2.0 * model.correlation * steps[-1] - model.correlation**2 * steps[-2] + pushed)
    path = observed(np.cumsum(steps[1:], axis=0))
    for nu, cuts in ((model.nu, False), (NORMAL_NU, True)):
        other = replace(model, nu=nu)
        whole, later = (other.log_evidence(rows_after(other, path))[start] for start in (1, 21))
        assert (other.log_evidence(rows_after(other, path[:21]))[1] + later > whole) == cuts, nu


@pytest.mark.parametrize("turn", [[0.3, -1.0, 2.0], [3.0, 0.0, 0.1]])
def test_both_turn_with_the_base_frame_and_go_along_with_its_origin(turn: list[float]) -> None:
    path = bent(80.0, 0.3) + np.random.default_rng(0).normal(0.0, 2e-4, (14, 3))
    moved = Rotation.from_rotvec(turn).apply(path) + np.array([0.4, -0.2, 0.3])
    for model in (guided_motion(), CORNER):
        one, other = (model.log_evidence(rows_after(model, observed(p))) for p in (path, moved))
        np.testing.assert_allclose(one, other, rtol=1e-7, atol=1e-7)


def test_an_arc_is_one_movement_rather_than_two() -> None:
    """A circle of 10 cm at a steady 0.1 m/s: what a library of strokes would cut."""
    angle = np.concatenate([np.linspace(0.0, 0.15, 4), 0.15 + 0.1 * np.arange(1, 60)])
    circle = 0.1 * np.column_stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)])
    model = guided_motion()
    rows = rows_after(model, observed(circle[:30]))
    first_half = model.log_evidence(rows)[1]
    both = model.log_evidence(rows_after(model, observed(circle)))
    assert both[1] > first_half + both[30]


def test_a_turn_at_a_dip_starts_a_movement() -> None:
    assert weight_at(bent(100.0, 0.2), 7) > 25.0


@pytest.mark.parametrize("dip", [0.0, 0.2, 0.6, 1.0])
def test_what_only_slows_down_is_a_via_point(dip: float) -> None:
    weights = corner().log_evidence(rows_after(corner(), observed(bent(0.0, dip))))
    np.testing.assert_allclose(weights, 0.0, atol=1e-6)


def test_what_only_turns_is_a_via_point() -> None:
    assert weight_at(bent(100.0, 1.0), 7) < 0.01 * CORNER.gamma


@pytest.mark.parametrize(("leg", "missed"), [(3, [4]), (6, []), (14, [2])])
def test_a_corner_has_no_time_of_its_own(leg: int, missed: list[int]) -> None:
    """The same zigzag by a quick, a usual and a slow hand: chords that miss its corners, and the weight."""
    path = observed(zigzag(leg))

    def weights(*chords: int) -> np.ndarray:
        corner = replace(CORNER, chords=chords)
        return corner.log_evidence(rows_after(corner, path)) / CORNER.gamma

    alone = {chord: weights(chord) for chord in CORNER.chords}
    assert [chord for chord, each in alone.items() if each.max() < 0.4] == missed
    np.testing.assert_array_equal(weights(*CORNER.chords), np.max([*alone.values()], axis=0))


def test_what_turns_beside_a_corner_is_no_second_one() -> None:
    """Within 0.2 s of a turn back two movements began: the ways of the second one lead around the first."""
    path = np.cumsum([np.zeros(3), *(0.001 * np.array([x, y, 0.0]) for x, y in TURNS_BACK + GOES_ON)], axis=0)
    weights, curved = (
        model.log_evidence(rows_after(model, observed(path)))
        for model in (corner(), replace(corner(), straight=0.0))
    )
    assert weights[6:9].min() > 50.0
    assert curved[10] > 50.0
    assert weights[10] < corner().standing


@pytest.mark.parametrize(("across_deg", "is_straight"), [(10.0, True), (90.0, True), (180.0, False)])
def test_a_way_is_straight_up_to_an_arc_of_130_degrees(across_deg: float, is_straight: bool) -> None:
    """A corner of 100° with an arc before it, which turns as much as stated over the longest chord."""
    chord = max(CORNER.chords)
    turns = np.radians(across_deg) * np.arange(-6, 1) / chord
    steps = [
        *np.column_stack([np.cos(turns), np.sin(turns)]),
        *np.diff(bent(100.0, 0.2)[6:, :2], axis=0) / STEP_M,
    ]
    path = STEP_M * np.cumsum([np.zeros(2), *steps], axis=0)
    one = replace(CORNER, chords=(chord,))
    straight = replace(one, straight=0.8)
    observations = observed(np.pad(path, ((0, 0), (0, 1))))
    share = max(straight.log_evidence(rows_after(straight, observations))) / max(
        one.log_evidence(rows_after(one, observations))
    )
    assert (share > 0.8) == is_straight


def test_at_the_rules_own_limits_a_corner_has_half_of_half_its_weight() -> None:
    assert weight_at(bent(45.0, 0.6), 7) == pytest.approx(0.25 * CORNER.gamma, rel=0.35)


def test_a_corner_at_standstill_weighs_what_any_start_costs() -> None:
    """The lesser weight at standstill, the whole one in flight: a corner takes no rest's place."""
    corner = replace(CORNER, standing=10.0, fast=0.5 * STEP_M)
    for dip, gamma in ((0.0, 10.0), (0.25, 10.0 + 20.0 * 0.25), (0.5, 30.0)):
        rows = rows_after(corner, observed(bent(120.0, dip)))
        whole = weight_at(bent(120.0, dip), 7) / CORNER.gamma
        assert corner.log_evidence(rows)[7] == pytest.approx(gamma * whole, abs=1e-9)


@pytest.mark.parametrize(
    ("speed", "turn_deg", "corner_deg"), [(0.1, 75.0, 63.9), (0.1, 30.0, 0.0), (1.0, 75.0, 74.9)]
)
def test_a_turn_is_less_by_what_the_noise_of_both_ways_explains(
    speed: float, turn_deg: float, corner_deg: float
) -> None:
    """At 10 mm/s a guiding hand's noise explains 39° between 0.2 and 0.3 s, at 100 mm/s 4°."""
    exact = CornerWeight(gamma=30.0, pace=0.0, chords=(2,))
    noisy = replace(exact, noise=GUIDED_NOISE_M)
    slow, whole = (
        model.log_evidence(rows_after(model, observed(path)))[7]
        for model, path in ((noisy, speed * bent(turn_deg, 0.0)), (exact, bent(corner_deg, 0.0)))
    )
    assert slow == pytest.approx(whole, abs=0.05)


def speeding_up(turn_deg: float) -> np.ndarray:
    """A path that slows down to a standstill, turns, and speeds up again as slowly; (n, 3) [m]."""
    ahead = np.array([np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg)), 0.0])
    sizes = STEP_M * np.array([1.0, 1.0, 1.0, 0.9, 0.6, 0.3, 0.05])
    steps = [*sizes[:, None] * np.array([1.0, 0.0, 0.0]), *sizes[-2::-1, None] * ahead]
    return np.cumsum([np.zeros(3), *steps], axis=0)


def test_the_flank_of_a_dip_weighs_no_more_than_its_bottom() -> None:
    """Where a hand that has stopped is at 30 mm/s again, a start had 1.4 times what a stop weighs."""
    weights = corner().log_evidence(rows_after(corner(), observed(speeding_up(90.0))))
    assert weights[7] == weights.max() > 0.9 * corner().standing
    assert weights[8:].max() < corner().standing


@pytest.mark.parametrize("rest", [1, 6])
def test_a_corner_is_not_where_a_rest_begins_after_which_the_hand_turns(rest: int) -> None:
    """Six steps ahead, a rest of so many observations, six steps aside: of a position, and of a rotation."""
    steps = [*[(1.0, 0.0, 0.0)] * 6, *[(0.02, 0.02, 0.0)] * rest, *[(0.0, 1.0, 0.0)] * 6]
    path = STEP_M * np.cumsum([np.zeros(3), *np.array(steps)], axis=0)
    turns = [ModelInput(np.zeros(3), np.zeros(3), rotation=10.0 * rotation) for rotation in path]
    for model, seen in ((corner(), observed(path)), (corner_of_rotation(), turns)):
        began = model.log_evidence(rows_after(model, seen))[7]
        assert began > 10.0 if rest == 1 else began == 0.0


def cost_of_start(step_m: float) -> float:
    """[nats] What a straight path at so much a step loses where a movement ends and another begins."""
    model, path = guided_motion(), observed(np.outer(np.arange(24), [step_m, 0.0, 0.0]))
    whole, first = (model.log_evidence(rows_after(model, part)) for part in (path, path[:12]))
    return float(whole[0] - first[0] - whole[12])


def test_a_clear_corner_pays_for_a_movement_that_begins_in_flight() -> None:
    """A turn of 100° at half of the speed: its weight is what any start costs, and what its speed costs."""
    dip = 0.5
    rows = rows_after(corner(), observed(bent(100.0, dip)))
    assert corner().log_evidence(rows)[7] > corner().standing + cost_of_start(dip * STEP_M)


def test_a_movement_that_pauses_is_weighed_by_how_little_it_gets_away() -> None:
    """The weight is that of the way of three steps, and only where a segment has had three of its own."""
    model = replace(guided_motion(), pace=0.0)
    path = np.cumsum(np.full((9, 3), 0.0005), axis=0)
    with_weights, without = (
        m.log_evidence(rows_after(m, observed(path))) for m in (model, replace(model, away=0.0))
    )
    each = np.log(-np.expm1(-0.5 * 3 * 0.0015**2 / model.away**2))
    np.testing.assert_allclose(with_weights - without, each * np.maximum(np.arange(6, -3, -1), 0), atol=1e-9)


@pytest.mark.parametrize(("deviation_m", "peaks"), [(1e-4, 0.01), (3e-4, 0.7)])
def test_a_hand_at_rest_has_no_corners(deviation_m: float, peaks: float) -> None:
    """Nor has a noisy sensor, of whose steps most are as long as those of a slow movement."""
    tremor = np.random.default_rng(1).normal(0.0, deviation_m, (400, 3))
    steps = np.linalg.norm(np.diff(tremor, axis=0), axis=1)
    assert np.mean(steps > SLOW) == pytest.approx(peaks, abs=0.05)
    weights = CORNER.log_evidence(rows_after(CORNER, observed(tremor)))
    assert (weights == 0.0).all()


def test_the_youngest_hypotheses_have_no_corner_yet() -> None:
    weights = CORNER.log_evidence(rows_after(CORNER, observed(bent(100.0, 0.2)[:10])))
    assert (weights[-CORNER.chords[0] :] == 0.0).all()
