"""The time of day of a demonstration stays with its samples from file to file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from typer.testing import CliRunner

from caesura_protocol.formats.read import load_recording
from caesura_protocol.recording import RecordingError
from caesura_service.offline_segmentation import recording_of
from harness.commands import application
from harness.demonstrations import guided
from lab.export.test_mcap import BEGAN, TRAVEL, kept

NS = 10**9


def export(source: Path, out: Path) -> None:
    done = CliRunner().invoke(application(), ["export", str(source), "-o", str(out)])
    assert done.exit_code == 0, done.output


def log_time_ns(path: Path) -> int:
    with path.open("rb") as stream:
        _, _, first = next(make_reader(stream).iter_messages(topics=["/state"]))
        return int(first.log_time)


def test_a_session_has_the_time_of_day_at_which_its_batches_came():
    found = recording_of(kept(guided()).replay("cell-1", "s1"))
    assert found.began_s == pytest.approx(BEGAN + TRAVEL, abs=1e-6)


@pytest.mark.parametrize("suffix", ["npz", "csv", "mcap"])
def test_a_copy_has_the_time_of_day_of_its_original(tmp_path: Path, suffix: str):
    """A copy of a session's MCAP began in 1970, and an npz of it had no time of day."""
    replace(guided(), began_s=BEGAN).save(tmp_path / "taught.npz")
    copy = tmp_path / f"copy.{suffix}"
    export(tmp_path / "taught.npz", copy)
    assert (load_recording(copy).began_s, load_recording(copy).ignored) == (BEGAN, ())
    export(copy, tmp_path / "again.mcap")
    assert log_time_ns(tmp_path / "again.mcap") == int(BEGAN) * NS + round((BEGAN % 1.0 + guided().t[0]) * NS)


@pytest.mark.parametrize("kind", ["npz", "csv"])
def test_dates_of_a_file_are_the_times_of_day_of_its_copy(tmp_path: Path, kind: str):
    one, first = guided(), np.datetime64("2026-11-24T18:04:32.250000000", "ns")
    dates = first + np.round((one.t - one.t[0]) * NS).astype("timedelta64[ns]")
    dated = tmp_path / f"dated.{kind}"
    if kind == "npz":
        np.savez(dated, t=dates, pos=one.signals["pos"])
    else:
        rows = [f"{date},{x},{y},{z}" for date, (x, y, z) in zip(dates, one.signals["pos"], strict=True)]
        dated.write_text("\n".join(["t,px,py,pz", *rows]), encoding="utf-8")
    export(dated, tmp_path / "copy.mcap")
    assert log_time_ns(tmp_path / "copy.mcap") == first.astype(np.int64)
    assert load_recording(dated).assumed[0].endswith(", taken as UTC.")


def test_a_recording_whose_time_of_day_is_not_known_states_none(tmp_path: Path):
    guided().save(tmp_path / "open.npz")
    export(tmp_path / "open.npz", tmp_path / "copy.mcap")
    assert load_recording(tmp_path / "copy.mcap").began_s is None
    assert "began_s" not in np.load(tmp_path / "open.npz").files


def test_a_time_of_day_that_is_none_is_refused(tmp_path: Path):
    one = guided()
    np.savez(tmp_path / "bad.npz", t=one.t, pos=one.signals["pos"], began_s=np.array("noon"))
    with pytest.raises(RecordingError, match="began_s is 'noon', expected a time of day"):
        load_recording(tmp_path / "bad.npz")
