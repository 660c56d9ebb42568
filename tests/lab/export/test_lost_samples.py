"""Samples that were lost on the way are lost in every file of the session, and named by who reads it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from caesura_lab.export.mcap_file import write_mcap
from caesura_lab.export.session_from_journal import read_session_export
from caesura_protocol.formats.read import load_recording
from caesura_protocol.formats.write import write_csv
from caesura_protocol.recording import Recording, RecordingError
from caesura_service.conditioned_recording import condition
from caesura_service.offline_segmentation import BATCH_SAMPLES, recording_of, segment_recording
from harness.commands import application
from harness.demonstrations import guided
from lab.export.test_mcap import kept

BATCHES = -(-guided().t.size // BATCH_SAMPLES)
LOST = {
    "one batch": range(BATCHES // 2, BATCHES // 2 + 1),  # shorter than a pause of the source that is a gap
    "the first ones": range(3),
    "several": range(10, 15),
}


@pytest.mark.parametrize("lost", LOST.values(), ids=LOST)
def test_a_session_with_lost_samples_is_the_same_from_every_file(tmp_path: Path, lost: range) -> None:
    journal = kept(guided(), lost=lost)
    taught = read_session_export(journal, "cell-1", "s1")
    write_mcap(tmp_path / "s1.mcap", taught)
    recording_of(journal.replay("cell-1", "s1")).save(tmp_path / "s1.npz")
    write_csv(tmp_path / "s1.csv", taught.recording)
    assert taught.view.gaps
    for suffix in ("mcap", "npz", "csv"):
        read = load_recording(tmp_path / f"s1.{suffix}")
        assert read.ignored == ()
        assert any("Samples were lost at " in one for one in read.cautions)
        view = segment_recording(read)
        assert view.gaps == taught.view.gaps
        assert (view.segments, view.apps) == (taught.view.segments, taught.view.apps)
        starts = [one.after_gap for one in condition(read).observations]
        assert sum(starts) == sum(one.t0 < one.tn for one in view.gaps)


def test_what_was_lost_at_the_end_is_a_gap_after_the_last_sample(tmp_path: Path) -> None:
    whole = guided()
    end = float(whole.t[-1])
    replace(whole, lost=((end, end),)).save(tmp_path / "cut.npz")
    (gap,) = segment_recording(load_recording(tmp_path / "cut.npz")).gaps
    assert (gap.t0, gap.tn, gap.reason) == (end, end, "evicted")


def test_losses_at_the_ends_are_shown_as_times_before_and_after(tmp_path: Path) -> None:
    whole = guided()
    ends = [(float(t), float(t)) for t in (whole.t[0], whole.t[-1])]
    replace(whole, lost=tuple(ends)).save(tmp_path / "cut.npz")
    done = CliRunner().invoke(application(), ["segment", str(tmp_path / "cut.npz")])
    known = [line for line in done.output.splitlines() if line.startswith("no samples")]
    times = [f"{t0:.2f} s" for t0, _ in ends]
    assert known == [f"no samples before {times[0]}", f"no samples after {times[1]}"]


@pytest.mark.parametrize("lost", ["", "3.9", "5 to 4", "1 to nan", "1 to inf", "a to b", "1 to 2;3 to 4"])
def test_losses_that_are_no_times_are_refused(tmp_path: Path, lost: str) -> None:
    one = guided()
    np.savez(tmp_path / "bad.npz", t=one.t, pos=one.signals["pos"], lost=np.array(lost))
    with pytest.raises(RecordingError, match=r"bad\.npz: lost is .*, expected times \[s\] such as"):
        load_recording(tmp_path / "bad.npz")


def test_losses_have_the_unit_of_the_times(tmp_path: Path) -> None:
    one = guided()
    arrays = {"t": 1000.0 * one.t, "pos": one.signals["pos"], "lost": np.array("1500 to 1600")}
    np.savez(tmp_path / "ms.npz", **arrays)
    assert load_recording(tmp_path / "ms.npz", time_unit="ms").lost == ((1.5, 1.6),)


def test_a_recording_without_losses_states_none() -> None:
    assert "lost" not in guided().stated_options
    assert isinstance(recording_of(kept(guided()).replay("cell-1", "s1")), Recording)
    assert recording_of(kept(guided()).replay("cell-1", "s1")).lost == ()
