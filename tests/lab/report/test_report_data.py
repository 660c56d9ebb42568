"""What a report shows against the view it comes from, and against every view on the way."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from caesura_lab.ground_truth import TrueChangepoint, TrueSegment, Truth
from caesura_lab.report.figures.style import whole
from caesura_lab.report.report_data import DELAYS_S, ReportData, collect
from caesura_lab.report.tables import (
    APP_COLUMNS,
    APP_NOTE,
    SEGMENT_COLUMNS,
    SEGMENT_NOTE,
    notes,
    program_table,
    ranges,
    segments_table,
)
from caesura_lab.report.times_from_start import from_start
from caesura_protocol.formats.read import load_recording
from caesura_protocol.recording import Recording
from caesura_service.offline_segmentation import batches, opening_of, views
from caesura_service.segmentation.pipeline import SegmentationPipeline, make_pipeline
from harness.demonstrations import guided

DATA = Path(__file__).parents[3] / "data"


@pytest.fixture(scope="module")
def recording() -> Recording:
    return load_recording(DATA / "pick_and_place.npz")


@pytest.fixture(scope="module")
def content(recording: Recording) -> ReportData:
    return collect(recording, "default")


def without(recording: Recording, name: str) -> Recording:
    kept = {signal: values for signal, values in recording.signals.items() if signal != name}
    return Recording(recording.t, kept, wrench_source="none", name=recording.name)


def with_gap(recording: Recording, t0: float, tn: float) -> Recording:
    kept = (recording.t < t0) | (recording.t > tn)
    return Recording(
        recording.t[kept],
        {name: values[kept] for name, values in recording.signals.items()},
        wrench_source="flange_sensor",
    )


@pytest.mark.slow
def test_every_chosen_changepoint_is_as_probable_as_the_drawn_ones_around_it(
    recording: Recording, content: ReportData
):
    pipeline = make_pipeline(opening_of(recording), "default")
    assert isinstance(pipeline, SegmentationPipeline)
    for samples in batches(recording):
        pipeline.push(samples)
    pipeline.finish()
    starts = [span.start for span in pipeline._shown().spans][1:]
    drawn = np.append(0.0, content.changes.online)  # no curve has the first observation
    for one, start in zip(content.view.changepoints, starts, strict=True):
        around = [index for index in range(start - 1, start + 2) if index == start or index not in starts]
        assert min(drawn[around].sum(), 1.0) == pytest.approx(one.probability, abs=1e-12)


@pytest.mark.parametrize("preset", ["default", "integrated"])
def test_the_run_length_image_holds_what_every_view_on_the_way_said(preset: str):
    recording = guided()
    runs = collect(recording, preset).run_lengths
    for view in views(recording, preset):
        now = view.observations - 1
        if now >= 0:
            column = runs.now == now
            assert tuple(runs.start_t[runs.start[column]]) == view.posterior_starts
            assert tuple(runs.probability[column]) == view.posterior_probabilities


def test_every_moment_is_certain_that_some_segment_is_going_on(content: ReportData):
    runs = content.run_lengths
    assert np.bincount(runs.now, runs.probability) == pytest.approx(np.ones(runs.t.size))


def test_what_is_known_later_is_a_diagonal_of_the_image(content: ReportData):
    runs = content.run_lengths
    for delay_s in DELAYS_S:
        known, steps = runs.start_probability_after(delay_s), round(10 * delay_s)
        assert np.isnan(known[-steps:]).all()
        assert known[17] == runs.probability[(runs.start == 17) & (runs.now == 17 + steps)].sum()


def test_the_image_of_a_long_recording_is_no_larger_than_allowed(content: ReportData):
    runs, (first, last) = content.run_lengths, whole(content)
    assert runs.image(first, last).shape == (content.signals.t.size,) * 2
    assert runs.image(first, last, most=40).shape == (40, 40)
    assert runs.image(first, last, most=40).max() == runs.probability.max()


def test_the_image_of_a_part_is_cut_from_that_of_the_whole(content: ReportData):
    runs, (first, last) = content.run_lengths, whole(content)
    part = runs.image(first + 2.0, first + 3.5)
    assert part.shape == (15, 15)
    assert (part == runs.image(first, last)[20:35, 20:35]).all()


def test_signals_meet_the_segments_at_their_ends(content: ReportData):
    t, position = content.signals.t, content.signals.position
    for one in content.view.segments:
        last = np.argmin(np.abs(t - one.tn + 1e-6))  # of two that are as near, the earlier one
        assert position[last] == pytest.approx(one.position_end)


def test_online_and_offline_agree_on_contacts(content: ReportData):
    for t in (1.7, 4.2, 7.5):
        at = np.abs(content.changes.t - t) < 0.15
        assert content.changes.online[at].sum() > 0.9
        assert content.changes.offline[at].sum() > 0.9


def test_without_a_wrench_there_is_no_force_to_draw():
    assert collect(without(guided(), "force"), "default").signals.force is None


def test_a_gap_divides_what_is_drawn_and_is_reported():
    content = collect(with_gap(guided(), 2.0, 2.6), "default")
    first, second = content.signals.stretches
    assert content.signals.t[first][-1] < 2.0
    assert content.signals.t[second][0] > 2.6
    assert any("No samples between" in note for note in notes(content.view))


def test_a_recording_too_short_to_see_anything_says_so():
    whole = guided()
    short = Recording(whole.t[:3], {name: values[:3] for name, values in whole.signals.items()})
    with pytest.raises(ValueError, match="expected at least"):
        collect(short, "default")


def test_tables_have_a_row_for_every_segment_and_app(content: ReportData):
    for table, things in (
        (segments_table(content.view), content.view.segments),
        (program_table(content.view), content.view.apps),
    ):
        assert len(table.rows) == len(table.kinds) == len(things)
        assert all(len(row) == len(table.columns) for row in table.rows)


def test_a_row_says_what_its_segment_says(content: ReportData):
    table = segments_table(content.view)
    carried = next(i for i, one in enumerate(content.view.segments) if one.kind == "transport")
    row = dict(zip((column.name for column in table.columns), table.rows[carried], strict=True))
    one = content.view.segments[carried]
    assert row["kind"] == "transport"
    assert row["from"] == f"{one.t0:.2f}"
    assert row["x"] == f"{1000 * one.position_end[0]:.0f}".replace("-", "−")
    assert row["load"] == f"{one.load_kg:.2f} ± {one.load_sd_kg:.2f}"
    assert row["runner-up"] == one.runner_up
    assert row["log odds"] == f"{one.log_odds:.1f}"


def test_no_row_has_a_force_where_there_is_no_wrench(recording: Recording):
    bare = collect(without(recording, "force"), "default")
    assert bare.view.wrench.source == "none"
    table = segments_table(bare.view)
    names = [column.name for column in table.columns]
    assert {row[names.index(name)] for row in table.rows for name in ("Fx", "Fy", "Fz")} == {""}


def test_numbers_in_a_row_are_written_as_a_range():
    assert ranges([0, 1, 2, 7, 9, 10]) == "0–2, 7, 9–10"


def test_times_of_day_are_shown_from_the_start(recording: Recording, content: ReportData):
    of_day = replace(recording, t=recording.t + 1_700_000_001.05)
    shifted = collect(of_day, "default", truth_of(content, 1_700_000_001.05))
    shown = from_start(shifted)
    start = shifted.view.segments[0].t0
    assert notes(shown.view, shown.notes)[1].startswith("Times [s] from 2023-11-14 22:13:21 UTC on")
    for table in (segments_table, program_table):
        cells = [cell for row in table(shown.view).rows for cell in row]
        assert "0.00" in cells or table is program_table
        assert not any(cell.startswith("1700") for cell in cells)
    assert [one.t for one in shown.view.changepoints] == [one.t - start for one in shifted.view.changepoints]
    for before, after in (
        (shifted.signals.t, shown.signals.t),
        (shifted.changes.t, shown.changes.t),
        (shifted.run_lengths.start_t, shown.run_lengths.start_t),
    ):
        assert np.array_equal(before - start, after)
    assert shown.truth is not None
    changed = [one.t - start for one in shifted.view.changepoints]
    assert [one.t for one in shown.truth.points] == pytest.approx(changed, abs=1e-6)
    assert from_start(content) is content, "a session that counts from 0 stays as it is"


def truth_of(content: ReportData, later_s: float) -> Truth:
    points = tuple(TrueChangepoint(one.t + later_s, 0.1) for one in content.view.changepoints)
    return Truth("bag", (later_s, later_s + 10.0), points, (TrueSegment(later_s, later_s + 1.0, "motion"),))


@pytest.mark.parametrize(
    ("columns", "note"), [(SEGMENT_COLUMNS, SEGMENT_NOTE), (APP_COLUMNS, APP_NOTE)], ids=["segments", "apps"]
)
def test_every_number_of_a_table_is_explained_below_it(columns, note):
    """Confidence, size, ± and a negative log odds were not."""
    plain = {"#", "kind", "app", "from", "to", "lasts", "runner-up", "of segments"}
    named = {column.name for column in columns} - plain
    assert {name for name in named if name.lower() not in note.lower()} == set()
    assert "±" in note
