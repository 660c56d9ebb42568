"""The filter against brute force: every segmentation of a short series, written out."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from caesura_service.changepoint.channel_model import ModelInput
from caesura_service.changepoint.compiled_filter import CompiledRunLengthFilter
from caesura_service.changepoint.evidence import log_sum_exp
from caesura_service.changepoint.filter_parameters import FilterParameters
from caesura_service.changepoint.hazard import Geometric, Refractory
from caesura_service.changepoint.offline_posterior import segment_offline
from caesura_service.changepoint.presets import PRESETS
from caesura_service.changepoint.run_length_filter import RunLengthFilter
from caesura_service.changepoint.segment_model_set import SegmentKind, SegmentModelSet
from caesura_service.changepoint.segments import stretches
from caesura_service.changepoint.smoothed_probabilities import INTERVAL_REACH
from service.changepoint.brute_force import BruteForce, demonstration, kind_log_evidence, segmentations
from service.streams import pieces

EXACT = FilterParameters(prune_ratio=0.0, keep_youngest=0, cap=1000, window=64, certain=1.0)
HAZARD = Refractory(8.0, 3)
LATTICES = [
    *(pytest.param(preset.lattice(), id=name) for name, preset in PRESETS.items()),
    pytest.param(PRESETS["default"].lattice(orientation=True, torque=True), id="default with turns"),
]


def check_against(brute: BruteForce, online: RunLengthFilter | CompiledRunLengthFilter) -> None:
    """Posterior, smoothed probabilities and best segmentation are those of the segmentations written out."""
    assert float(log_sum_exp(online.log_joint)) == pytest.approx(brute.total, abs=1e-9)
    expected = [brute.probability([path[-1] == start for path in brute.paths]) for start in online.starts]
    np.testing.assert_allclose(online.posterior, expected, atol=1e-9)
    got = [online.changepoint_probability(start) for start in range(brute.n)]
    np.testing.assert_allclose(got, brute.changepoint_probability(), atol=1e-9)

    best = brute.best
    path = [*online.final, *online.map_path()]
    assert tuple(segment.start for segment in path) == best
    for segment, end in zip(path, (*best[1:], brute.n), strict=True):
        np.testing.assert_allclose(segment.kind_log_evidence, brute.kinds[segment.start, end], atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("lattice", LATTICES)
@pytest.mark.parametrize("made", [RunLengthFilter, CompiledRunLengthFilter])
@pytest.mark.parametrize("seed", [0, 1])
def test_filter_agrees_with_the_sum_over_all_segmentations(
    lattice: SegmentModelSet, made: type[RunLengthFilter | CompiledRunLengthFilter], seed: int
) -> None:
    data = demonstration(seed)
    online = made(lattice, HAZARD, EXACT)
    for observed in data:
        online.step(observed)
    assert online.starts.size == len(data) - lattice.stepwise
    check_against(BruteForce(lattice, data, HAZARD), online)


@pytest.mark.slow
@pytest.mark.parametrize("lattice", LATTICES)
@pytest.mark.parametrize(("taken", "at"), [((3,), 4), ((4,), 8), ((2, 6), 9), ((11,), 12)], ids=str)
def test_a_conditioned_filter_agrees_with_the_sum_over_all_segmentations_with_the_boundary(
    lattice: SegmentModelSet, taken: tuple[int, ...], at: int
) -> None:
    data = demonstration(2)
    kinds = kind_log_evidence(lattice, data)
    then, in_the_end = (BruteForce(lattice, some, HAZARD, taken, kinds=kinds) for some in (data[:at], data))
    for made in (RunLengthFilter, CompiledRunLengthFilter):
        online = made(lattice, HAZARD, EXACT)
        for observed in data:
            online.step(observed)
            if online.count == at:
                for start in taken:
                    online.condition_on_start(start)
                check_against(then, online)
        check_against(in_the_end, online)
        assert online.starts.min() == online.root >= taken[-1]


@pytest.mark.slow
@pytest.mark.parametrize("lattice", LATTICES)
@pytest.mark.parametrize(
    ("starts", "without"), [((4,), ()), ((), (3, 4, 5)), ((2, 9), (3, 8, 11)), ((1,), ()), ((), (1, 11))]
)
def test_what_is_known_of_a_start_is_heeded(
    lattice: SegmentModelSet, starts: tuple[int, ...], without: tuple[int, ...]
) -> None:
    data = demonstration(2)
    kinds = kind_log_evidence(lattice, data)
    filters = [made(lattice, HAZARD, EXACT) for made in (RunLengthFilter, CompiledRunLengthFilter)]
    for i, observed in enumerate(data):
        known = [start for start in starts if start <= i]
        brute = BruteForce(lattice, data[: i + 1], HAZARD, known, without, free=known, kinds=kinds)
        for online in filters:
            online.step(observed, changepoint=True if i in starts else False if i in without else None)
            check_against(brute, online)
    assert all(online.root >= max(starts, default=0) for online in filters)


@pytest.mark.parametrize("made", [RunLengthFilter, CompiledRunLengthFilter])
def test_what_is_known_holds_when_something_else_is_taken_for_certain(
    made: type[RunLengthFilter | CompiledRunLengthFilter],
) -> None:
    lattice, data = PRESETS["default"].lattice(), demonstration(2)
    online = made(lattice, HAZARD, EXACT)
    for i, observed in enumerate(data):
        online.step(observed, changepoint={7: True, 9: False, 10: False}.get(i))
        if i == 8:
            start = online.map_path()[-1].start
            if start > online.root:
                online.condition_on_start(start)
    check_against(BruteForce(lattice, data, HAZARD, [7], [9, 10], free=[7]), online)
    online.condition_on_start(11)
    check_against(BruteForce(lattice, data, HAZARD, [7, 11], [9, 10], free=[7]), online)


class Recorded(RunLengthFilter):
    """A filter that remembers what it was conditioned on, and at which observation."""

    def condition_on_start(self, start: int) -> None:
        assert start in {segment.start for segment in self.map_path()}
        before = [segment.start for segment in (*self.final, *self.map_path())]
        super().condition_on_start(start)
        assert [segment.start for segment in (*self.final, *self.map_path())] == before
        self.taken = [*getattr(self, "taken", []), (start, self.count)]


@pytest.mark.parametrize("name", ["default", "integrated", "force"])
def test_what_is_certain_conditions_the_filter_and_is_final_at_once(name: str) -> None:
    lattice, data = PRESETS[name].lattice(), demonstration(2)
    online = Recorded(lattice, HAZARD, replace(EXACT, certain=0.8, certain_after=3))
    for observed in data:
        online.step(observed)
    check_against(BruteForce(lattice, data, HAZARD, [start for start, _ in online.taken]), online)
    assert all(count - 1 - start >= 3 for start, count in online.taken)
    assert online.root >= online.taken[-1][0]


def test_how_probable_a_certain_changepoint_was_is_not_forgotten() -> None:
    online = RunLengthFilter(PRESETS["default"].lattice(), HAZARD, EXACT)
    for observed in demonstration(2):
        online.step(observed)
    before = [online.changepoint_probability(s) for s in range(online.count)]
    alone = [s for s in range(1, online.count - INTERVAL_REACH) if before[s + 1] + before[s + 2] < 0.2]
    start = min(alone, key=lambda s: abs(before[s] - 0.5))
    event = online.event_probability(start)
    online.condition_on_start(start)
    assert online.changepoint_probability(start) == pytest.approx(1.0, abs=1e-12)
    around = range(max(start - INTERVAL_REACH, 0), start + INTERVAL_REACH + 1)
    assert [online.changepoint_probability(s, about=start) for s in around] == [before[s] for s in around]
    np.testing.assert_allclose(
        online.smoothed[start - 1 : start + 2], before[start - 1 : start + 2], atol=1e-12
    )
    assert online.event_probability(start) == event
    assert online.event_probability(start + 1) > 0.99
    assert online.event_probability(start + 1, others=(start,)) < 0.5


def test_conditioning_off_leaves_everything_to_coalescence() -> None:
    online = Recorded(PRESETS["default"].lattice(), HAZARD, FilterParameters(certain=1.0, certain_after=0))
    for observed in demonstration(2, 80):
        online.step(observed)
    assert not hasattr(online, "taken")
    assert online.final


@pytest.mark.parametrize("start", [-1, 0, 3, 7, 30])
def test_only_what_is_open_and_in_the_window_can_be_conditioned_on(start: int) -> None:
    online = RunLengthFilter(PRESETS["default"].lattice(), HAZARD, replace(EXACT, window=4))
    for observed in demonstration(2, 8):
        online.step(observed)
    online.condition_on_start(7)
    with pytest.raises(ValueError, match=f"start is {start}, expected"):
        online.condition_on_start(start)


@pytest.mark.parametrize("lattice", LATTICES)
def test_smoothing_is_exact_inside_a_short_window(lattice: SegmentModelSet) -> None:
    data = demonstration(3)
    wide = RunLengthFilter(lattice, HAZARD, EXACT)
    narrow = RunLengthFilter(lattice, HAZARD, replace(EXACT, window=4))
    for observed in data:
        wide.step(observed)
        narrow.step(observed)
    for start in range(len(data) - 4, len(data)):
        assert narrow.changepoint_probability(start) == pytest.approx(
            wide.changepoint_probability(start), abs=1e-12
        )


@pytest.mark.parametrize("name", ["integrated", "default"])
@pytest.mark.parametrize("made", [RunLengthFilter, CompiledRunLengthFilter])
def test_a_boundary_is_certain_and_cuts_every_hypothesis(
    made: type[RunLengthFilter | CompiledRunLengthFilter], name: str
) -> None:
    """What follows a gap is segmented as a recording of its own."""
    lattice, data = PRESETS[name].lattice(), demonstration(4)
    online = made(lattice, HAZARD, EXACT)
    for i, observed in enumerate(data):
        online.step(observed, boundary=i == 7)
    assert online.changepoint_probability(7) == pytest.approx(1.0, abs=1e-12)
    assert online.starts.min() == 7
    assert any(segment.start == 7 for segment in online.map_path())
    alone = made(lattice, HAZARD, EXACT)
    for observed in data[7:]:
        alone.step(observed)
    np.testing.assert_allclose(online.posterior, alone.posterior, atol=1e-12)
    after = [alone.changepoint_probability(start) for start in range(len(data) - 7)]
    got = [online.changepoint_probability(start) for start in range(len(data))]
    np.testing.assert_allclose(got[8:], after[1:], atol=1e-9)


SMALL = st.builds(
    FilterParameters,
    prune_ratio=st.sampled_from([0.0, 1e-6, 1e-2]),
    keep_youngest=st.sampled_from([0, 4, 20]),
    cap=st.sampled_from([21, 100]),
    window=st.sampled_from([2, 10, 40]),
    certain=st.sampled_from([0.6, 0.9, 0.99, 1.0]),
    certain_after=st.sampled_from([0, 3, 15]),
)


@pytest.mark.slow
@settings(max_examples=12, deadline=None, derandomize=True)
@given(st.integers(0, 2**32 - 1), st.sampled_from(sorted(PRESETS)), SMALL)
def test_what_is_final_is_never_revised(seed: int, name: str, parameters: FilterParameters) -> None:
    online = RunLengthFilter(PRESETS[name].lattice(), Geometric(20.0), parameters)
    before: list[tuple[int, int, bytes]] = []
    for observed, boundary in pieces(np.random.default_rng(seed), 70):
        online.step(observed, boundary=boundary)
        path = [*online.final, *online.map_path()]
        starts = [segment.start for segment in path]
        now = [
            (segment.start, end, segment.kind_log_evidence.tobytes())
            for segment, end in zip(online.final, starts[1:], strict=False)
        ]
        assert now[: len(before)] == before
        assert starts == sorted(set(starts))
        assert online.starts.min() >= online.root == path[len(now)].start
        assert online.posterior.sum() == pytest.approx(1.0, abs=1e-9)
        for one in stretches(online):
            assert 0.0 <= one.start_probability <= 1.0
            assert one.start_interval[0] <= one.start <= one.start_interval[1]
        before = now


def test_pruning_drops_almost_nothing_of_the_posterior() -> None:
    data = demonstration(6, 60)
    lattice = PRESETS["integrated"].lattice()
    exact, pruned = RunLengthFilter(lattice, HAZARD, EXACT), RunLengthFilter(lattice, HAZARD)
    for observed in data:
        exact.step(observed)
        pruned.step(observed)
    assert pruned.starts.size < exact.starts.size
    np.testing.assert_allclose(pruned.posterior, exact.posterior[pruned.starts], atol=1e-4)
    got = [pruned.changepoint_probability(s) for s in range(25, 60)]
    np.testing.assert_allclose(got, [exact.changepoint_probability(s) for s in range(25, 60)], atol=1e-4)


def test_standing_still_costs_no_more_as_time_passes() -> None:
    rng = np.random.default_rng(7)
    online = CompiledRunLengthFilter(PRESETS["default"].lattice(), Geometric(30.0))
    living, hand = [], np.zeros(3)
    for _ in range(600):
        hand = 0.9 * hand + rng.normal(0, 2e-4, 3)  # within half a millimetre
        online.step(ModelInput(hand, rng.normal(0, 0.2, 3)))
        living.append(online.starts.size)
    assert max(living[300:]) <= max(living[:300]) + 5
    assert max(living) <= online.parameters.cap


def test_a_value_that_is_not_finite_is_refused_and_changes_nothing() -> None:
    online = RunLengthFilter(PRESETS["integrated"].lattice(), HAZARD)
    online.step(ModelInput(np.zeros(3), np.zeros(3)))
    with pytest.raises(ValueError, match="observation 1: force"):
        online.step(ModelInput(np.zeros(3), np.array([0.0, np.nan, 0.0])))
    assert online.count == 1
    assert online.starts.tolist() == [0]


def _weight_after(before: SegmentKind, after: SegmentKind) -> float:
    """No two rests and no two contacts in a row; a traced line is rarely beside another movement."""
    both = before, after
    if {kind.name for kind in both} in ({"contact"}, {"steady"}, {"hold"}, {"steady", "hold"}):
        return 0.0
    traced = any(kind.channels[0] == "traced" for kind in both)
    return 0.01 if traced and all(kind.motion == "motion" for kind in both) else 1.0


def test_a_transition_prior_agrees_with_the_sum_over_all_segmentations_and_kinds() -> None:
    """Every sequence of kinds, each with its prior given the kind before, in one product."""
    lattice, data = PRESETS["default"].lattice(), demonstration(5, 5)
    kinds, names = dict(kind_log_evidence(lattice, data)), [kind.name for kind in lattice.kinds]
    kinds |= {(0, end): kinds[1, end] for end in range(2, 6)}  # stepwise: it counts from the second one on
    weights = np.array([kind.weight for kind in lattice.kinds])

    follows = np.array([[_weight_after(one, other) for other in lattice.kinds] for one in lattice.kinds])

    def log_prior(kind: int, before: int | None) -> float:
        after = np.ones(len(names)) if before is None else follows[before]
        likely = weights * after
        return float(np.log(likely[kind] / likely.sum())) if likely[kind] else -np.inf

    prior = np.log(weights / weights.sum())
    joints = []
    for path in segmentations(len(data)):
        if 1 in path:
            continue
        spans = list(pairwise([*path, len(data)]))
        for labels in product(range(len(names)), repeat=len(spans)):
            total = 0.0
            for i, ((start, end), kind) in enumerate(zip(spans, labels, strict=True)):
                length = np.array([end - start])
                last = i == len(spans) - 1
                hazard = HAZARD if i else Geometric(HAZARD.mean_samples)
                mass = hazard.log_survival(length - 1) if last else hazard.log_mass(length)
                total += float(mass[0]) + kinds[start, end][kind] - prior[kind]
                total += log_prior(kind, labels[i - 1] if i else None)
            joints.append((lattice.power * total, path, labels))
    values = np.array([total for total, _, _ in joints])
    expected = float(log_sum_exp(values))
    starts = [
        float(np.exp(log_sum_exp(values[[s in path for _, path, _ in joints]]) - expected)) for s in range(5)
    ]
    assert segment_offline(lattice, HAZARD, data).log_evidence == pytest.approx(expected, abs=1e-9)
    for made in (RunLengthFilter, CompiledRunLengthFilter):
        online = made(lattice, HAZARD, EXACT)
        for observed in data:
            online.step(observed)
        assert float(log_sum_exp(online.log_joint)) == pytest.approx(expected, abs=1e-9)
        np.testing.assert_allclose([online.changepoint_probability(s) for s in range(5)], starts, atol=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_no_two_rests_and_no_two_contacts_follow_each_other(seed: int) -> None:
    preset = PRESETS["default"]
    online = preset.online()
    for observed, boundary in pieces(np.random.default_rng(seed), 120):
        online.step(observed, boundary=boundary)
        shown = stretches(online)
        assert all(np.isfinite(one.verdict.log_odds) for one in shown)
        for one, other in pairwise(shown):
            both = {one.verdict.kind.name, other.verdict.kind.name}
            again = any(both <= set(group) for group in preset.unrepeated)
            assert not again or other.start in online.boundaries
