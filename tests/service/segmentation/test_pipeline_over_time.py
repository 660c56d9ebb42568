"""Views of a session as its samples come: what is final, when it is shown, and what it costs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from itertools import cycle, pairwise
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from caesura_protocol import messages as wire
from caesura_protocol.formats.read import load_recording
from caesura_protocol.recording import Recording
from caesura_service.offline_segmentation import batches, opening_of, segment_recording, views
from caesura_service.program import Context, Paths, ProgramSegment, task_program, with_regrips
from caesura_service.segmentation.pipeline import (
    LOOK_EVERY,
    PROGRAM_EVERY,
    SegmentationPipeline,
    make_pipeline,
)
from caesura_service.segmentation.pipeline_interface import PipelineView
from caesura_service.segmentation.segmenter import Segmenter
from service.streams import pieces

DATA = Path(__file__).parents[3] / "data"


@cache
def shown_of(name: str, preset: str = "default", threshold: float | None = None) -> Sequence[PipelineView]:
    """What is shown of a recording after each batch, and at its end."""
    return list(views(load_recording(DATA / f"{name}.npz"), preset, threshold=threshold))


COLUMNS = ("t", "px", "py", "pz", "fx", "fy", "fz", "gripper")


def stream(seed: int, n: int) -> np.ndarray:
    """n seconds of samples at 100 Hz, of pieces of anything, with holes here and there."""
    seen, holes = zip(*pieces(np.random.default_rng(seed), 10 * n), strict=True)
    coarse, fine = np.arange(10 * n) / 10, np.arange(100 * n) / 100
    held = np.interp(fine, coarse, [0.02 if one.holding == 1.0 else 0.08 for one in seen])
    values = np.array([[*one.position, *one.force] for one in seen])
    smooth = [np.interp(fine, coarse, column) for column in values.T]
    late = np.repeat(0.5 * np.cumsum(holes), 10)
    return np.column_stack([fine + late, *smooth, held])


def final_of(view: PipelineView) -> tuple[list[float], list[wire.Segment]]:
    """What is final, but for the loads, which free space that is still to come may change."""
    certain = [one.certainty == "final" for one in view.changepoints]
    assert certain == sorted(certain, reverse=True), "what is final comes before what is not"
    segments = [one for one in view.segments if one.certainty == "final"]
    assert segments == list(view.segments[: len(segments)])
    unweighed = [one.model_copy(update={"load_kg": None, "load_sd_kg": None}) for one in segments]
    return [one.t for one, sure in zip(view.changepoints, certain, strict=True) if sure], unweighed


def program_of(pipeline: SegmentationPipeline) -> tuple[wire.App, ...]:
    """From all that is shown at once, not as it grew."""
    view = pipeline.view
    sure = [1.0, *(one.probability for one in view.changepoints), 1.0]
    steps = [
        ProgramSegment(i, one, one.probability * min(sure[i], sure[i + 1]))
        for i, one in enumerate(view.segments)
    ]
    paths = Paths(pipeline._history.poses)
    if view.segments and not pipeline._finished:
        paths.settled_until = view.segments[-1].t0
    moment = pipeline._program.moment_at  # without forces where no contact is inferred
    grips = with_regrips(steps, Context(pipeline._grips, moment))
    return task_program(steps, grips, moment, least_s=0.3, paths=paths, gaps=view.gaps)


def test_a_program_that_is_left_is_made_as_it_would_have_been_and_is_as_before_until_then():
    wiping = load_recording(DATA / "wiping.npz")
    opening = wire.Open(session="any", columns=wiping.columns, wrench_source=wiping.wrench_source)
    whole, apart = (make_pipeline(opening, "default") for _ in range(2))
    left = 0
    for samples in np.array_split(wiping.matrix(), 300):
        before = apart.view
        assert apart.push_without_program(samples) == whole.push(samples)
        if apart.has_due_program:
            between = apart.view
            assert [between.apps, between.notes, between.unapplied] == [
                before.apps,
                before.notes,
                before.unapplied,
            ]
            assert between._replace(apps=(), notes=()) == whole.view._replace(apps=(), notes=())
            left += between != whole.view
        apart.make_due_program()
        assert not apart.has_due_program
        assert apart.view == whole.view
    assert left > 3
    for pipeline in (whole, apart):
        pipeline.finish()
    assert apart.view == whole.view
    assert len(apart.view.apps) > 1


@pytest.mark.slow
def test_phases_hold_every_segment_and_a_final_one_is_never_revised(monkeypatch: pytest.MonkeyPatch):
    wiping, now_and_then = load_recording(DATA / "wiping.npz"), shown_of("wiping")
    monkeypatch.setattr("caesura_service.segmentation.pipeline.PROGRAM_EVERY", 1)
    monkeypatch.setattr("caesura_service.segmentation.pipeline.LOOK_EVERY", 1)
    always = list(views(wiping))
    assert now_and_then[-1].phases == always[-1].phases
    for count, view in enumerate(now_and_then):
        assert any(view.phases == seen.phases for seen in always[max(count - 150, 0) : count + 1])
    final: tuple[wire.Phase, ...] = ()
    for view in always:
        shown = tuple(view.phases)
        assert shown[: len(final)] == final
        final = tuple(one for one in shown if one.certainty == "final")
        assert shown[: len(final)] == final, "only the last ones may change"
        numbers = [n for one in shown for n in range(one.first_segment, one.last_segment + 1)]
        assert numbers == list(range(len(view.segments)))
    assert [one.kind for one in final] == ["free", "contact", "free"]
    reach, retract = view.segments[final[1].first_segment], view.segments[final[1].last_segment]
    assert (final[1].t0, final[1].tn) == (reach.t0, retract.tn)


@pytest.mark.slow
@settings(max_examples=8, deadline=None, derandomize=True)
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from(["default", "default", "integrated", "contact", "second_order_2"]),
    st.sampled_from([None, None, 0.2]),
    st.lists(st.integers(1, 60), min_size=1, max_size=5),
)
def test_what_was_shown_as_final_is_never_revised(
    seed: int, preset: str, threshold: float | None, cuts: list[int]
):
    opening = wire.Open(session="any", columns=COLUMNS, wrench_source="flange_sensor", preset=preset)
    pipeline, samples = make_pipeline(opening, preset, threshold=threshold), stream(seed, 7)
    assert isinstance(pipeline, SegmentationPipeline)
    changepoints: list[float] = []
    segments: list[wire.Segment] = []
    phases: list[wire.Phase] = []
    programs: dict[int, tuple[wire.App, ...]] = {0: ()}  # by how many observations they were made of
    for cut in cycle(cuts):
        is_news = pipeline.push(samples[:cut])
        samples = samples[cut:]
        if cut == 1:
            pipeline.declare_gap()
        if not len(samples):
            pipeline.finish()
        now, divided = final_of(pipeline.view)
        assert now[: len(changepoints)] == changepoints
        assert divided[: len(segments)] == segments
        count = pipeline.view.observations
        if is_news or not len(samples):
            programs[count] = program_of(pipeline)
        assert any(
            programs.get(count - old) == pipeline.view.apps for old in range(PROGRAM_EVERY + LOOK_EVERY)
        )
        changepoints, segments = now, divided
        assert list(pipeline.view.phases[: len(phases)]) == phases
        phases = [one for one in pipeline.view.phases if one.certainty == "final"]
        if not len(samples):
            break
    assert pipeline.view.apps == program_of(pipeline)


@pytest.mark.slow
@settings(max_examples=8, deadline=None, derandomize=True)
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from(["default", "integrated", "contact", "second_order_2"]),
    st.integers(200, 2000),
)
def test_how_samples_are_cut_into_batches_changes_no_bit(seed: int, preset: str, cut: int):
    opening = wire.Open(session="any", columns=COLUMNS, wrench_source="flange_sensor", preset=preset)
    samples = stream(seed, 20)

    def shown(cut: int) -> PipelineView:
        pipeline = make_pipeline(opening, preset)
        for first in range(0, len(samples), cut):
            pipeline.push(samples[first : first + cut])
        pipeline.finish()
        return pipeline.view

    assert shown(cut) == shown(10)


def test_a_whole_recording_has_the_results_of_a_session_at_its_end():
    assert segment_recording(load_recording(DATA / "wiping.npz")) == shown_of("wiping")[-1]


@pytest.mark.slow
@pytest.mark.parametrize(("preset", "threshold"), [("default", None), ("integrated", 0.2)])
def test_a_segment_is_shown_at_once_and_once_a_second_how_far_the_last_one_reaches_and_which_are_final(
    taught: Recording, monkeypatch: pytest.MonkeyPatch, preset: str, threshold: float | None
):
    def shown(view: PipelineView) -> tuple[object, ...]:
        return [(one.t0, one.kind) for one in view.segments], [one.t for one in view.changepoints], view.gaps

    def final(view: PipelineView) -> int:
        return sum(one.certainty == "final" for one in (*view.segments, *view.changepoints))

    now_and_then = shown_of("pick_and_place", preset, threshold)
    monkeypatch.setattr("caesura_service.segmentation.pipeline.LOOK_EVERY", 1)
    monkeypatch.setattr("caesura_service.segmentation.pipeline.PROGRAM_EVERY", 1)
    always = list(views(taught, preset, threshold=threshold))
    assert [shown(view) for view in now_and_then] == [shown(view) for view in always]
    pairs = zip(always, now_and_then, strict=True)
    late = [fresh.segments[-1].tn - view.segments[-1].tn for fresh, view in pairs if fresh.segments]
    assert 0.3 < max(late) < 0.1 * LOOK_EVERY
    became = {final(view): view.observations for view in reversed(always)}
    shown_final = {final(view): view.observations for view in reversed(now_and_then)}
    assert 0 < max(shown_final[count] - became[count] for count in shown_final) < LOOK_EVERY
    assert [view.t for view in now_and_then] == [view.t for view in always]
    assert [view.posterior_starts for view in now_and_then] == [view.posterior_starts for view in always]
    assert now_and_then[-1] == always[-1]


def test_a_program_follows_another_after_two_to_three_seconds_where_the_gripper_does_nothing(
    taught: Recording,
):
    signals = {name: values for name, values in taught.signals.items() if name != "gripper"}
    shown = list(views(replace(taught, signals=MappingProxyType(signals))))[:-1]
    made = [view.observations for before, view in pairwise(shown) if view.apps is not before.apps]
    apart = np.diff(made)
    assert len(apart) > 3
    assert apart.min() >= PROGRAM_EVERY
    assert apart.max() < PROGRAM_EVERY + LOOK_EVERY


def test_a_segment_that_is_shown_again_is_as_if_made_anew(taught: Recording, monkeypatch: pytest.MonkeyPatch):
    shown = [[*view.segments, *view.changepoints] for view in shown_of("pick_and_place")]
    monkeypatch.setattr(Segmenter, "_start_stays", lambda *_: False)
    monkeypatch.setattr(Segmenter, "_stays", lambda *_: False)
    assert shown == [[*view.segments, *view.changepoints] for view in views(taught, "default")]


def test_a_view_costs_no_more_as_the_demonstration_goes_on(taught: Recording):
    """A view used to build everything anew: 6 ms after 350 segments."""
    samples = np.concatenate(list(batches(taught)))
    pipeline = make_pipeline(opening_of(taught, "default"), "default")
    assert isinstance(pipeline, SegmentationPipeline)
    fresh = []
    for again in range(5):  # one rest joins two of them
        samples[:, 0] += 12.9 * bool(again)
        for first in range(0, len(samples), 100):
            pipeline.push(samples[first : first + 100])
            settled = min(len(pipeline._division.settled), pipeline._program.first)
            fresh.append(len(pipeline.view.segments) - settled)
    assert len(pipeline.view.segments) > 30  # enough for what grows to show
    assert max(fresh) < 20
    pipeline.finish()
    assert pipeline.view.apps == program_of(pipeline)


def test_a_threshold_decides_online_as_it_does_for_the_whole_recording(taught: Recording):
    every = shown_of("pick_and_place", "integrated", 0.2)
    kinds = [one.kind for one in every[-1].segments]
    assert kinds == ["motion", "contact", "contact", "motion", "transport", "transport", *kinds[6:]]
    assert any(one.certainty == "final" for one in every[-2].changepoints)
    with pytest.raises(ValueError, match="threshold is 20"):
        segment_recording(taught, threshold=20.0)
