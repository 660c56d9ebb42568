"""`caesura evaluate --evidence`: motion libraries against each other, on what no truth is needed for."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from caesura_lab.commands import register
from caesura_lab.evaluation.cases.suites import FileCase
from caesura_lab.evaluation.studies import motion_library_evidence
from caesura_lab.evaluation.studies.motion_library_evidence import (
    LIBRARIES,
    LibraryEvidence,
    grid,
    library_evidence,
    with_profiles,
)
from caesura_protocol.recording import RecordingError
from caesura_service.changepoint.channel_model import ModelInput
from caesura_service.changepoint.default_presets import DEFAULT, STROKES, human_motion_library
from caesura_service.changepoint.hazard import Geometric
from caesura_service.changepoint.offline_posterior import segment_offline

BUTTON = Path(__file__).parents[3] / "data" / "button.npz"


def run(*arguments: object):
    app = typer.Typer()
    register(app)
    return CliRunner().invoke(app, ["evaluate", "--evidence", *map(str, arguments)])


@pytest.fixture(scope="module")
def button() -> LibraryEvidence:
    return library_evidence(FileCase(BUTTON))


def test_only_the_library_of_movements_is_exchanged():
    other = with_profiles(STROKES, LIBRARIES["lognormal"]())
    before, after = STROKES.channels(1.5), other.channels(1.5)
    assert [name for name in before if before[name] != after[name]] == ["moving"]
    assert len(after["moving"].library) == 16
    assert after["moving"].noise == before["moving"].noise
    assert after["moving"].target == before["moving"].target
    assert after["moving"].library.rest_scale_ratio == before["moving"].library.rest_scale_ratio
    assert other.kinds == STROKES.kinds


def test_the_presets_own_library_gives_the_presets_own_evidence():
    rng = np.random.default_rng(0)
    data = [
        ModelInput(p, f) for p, f in zip(rng.normal(0, 0.02, (12, 3)), rng.normal(0, 1, (12, 3)), strict=True)
    ]
    same = with_profiles(STROKES, human_motion_library().profiles)
    reported = [
        segment_offline(preset.lattice(), Geometric(20.0), data).log_evidence for preset in (STROKES, same)
    ]
    assert reported[0] == reported[1]


def test_movements_without_a_library_are_refused():
    with pytest.raises(ValueError, match=r"preset 'default' has no library of movements.*expected 'strokes'"):
        with_profiles(DEFAULT, LIBRARIES["lognormal"]())


def test_a_movement_of_the_teacher_is_no_overdamped_response(button: LibraryEvidence):
    assert button.observations == pytest.approx(117, abs=2)
    assert set(button.log_evidence) == set(LIBRARIES)
    assert button.log_evidence["minimum jerk"] > button.log_evidence["overdamped"] + 30.0


def test_more_profiles_are_not_more_evidence(button: LibraryEvidence):
    """Each of a mixture's profiles is less likely: what it adds is bounded, and may be negative."""
    one, all_three = button.log_evidence["minimum jerk"], button.log_evidence["all three"]
    assert abs(all_three - one) < 20.0


def test_the_table_counts_what_each_library_is_behind():
    names = list(LIBRARIES)
    reported = [
        LibraryEvidence("a", 100, dict.fromkeys(names, 90.0) | {names[0]: 100.0}),
        LibraryEvidence("b", 50, dict.fromkeys(names, 80.0) | {names[1]: 85.0}),
    ]
    rows = {row[0]: row[1:] for row in grid(reported).rows}
    assert rows["a"][:3] == ("100", "0.0", "-10.0")
    assert rows["b"][:3] == ("50", "-5.0", "0.0")
    assert rows["total"][:3] == ("150", "0.0", "-5.0")
    assert rows["per observation"][1:3] == ("0.000", "-0.033")
    assert rows["best in"] == ("2", "1", "1", "0", "0", "0")


def test_a_recording_needs_no_annotation(tmp_path: Path, button: LibraryEvidence):
    shutil.copy(BUTTON, tmp_path / "mine.npz")
    result = run(tmp_path / "mine.npz", "--format", "json")
    assert result.exit_code == 0, result.output
    one = json.loads(result.stdout)["per_recording"][0]
    assert one["recording"] == "mine.npz"
    assert one["log_evidence"] == pytest.approx(button.log_evidence)


@pytest.mark.slow
def test_a_refused_recording_is_left_out_and_named(tmp_path: Path, button: LibraryEvidence):
    # It ended the comparison of all recordings without a figure.
    content = dict(np.load(BUTTON))
    content["force"][7] = np.nan
    np.savez(tmp_path / "spoilt.npz", **content)
    shutil.copy(BUTTON, tmp_path / "whole.npz")
    files = (tmp_path / "spoilt.npz", tmp_path / "whole.npz")
    result = run(*files, "--format", "json", "--workers", "1")
    why = "spoilt.npz: sample 7: fx is nan, expected a finite number"
    refusal, last = result.stderr.splitlines()
    assert refusal.startswith(f"error: {why}")
    assert (result.exit_code, last) == (1, "error: 1 of 2 recordings refused")
    found = json.loads(result.stdout)
    assert [one["recording"] for one in found["per_recording"]] == ["whole.npz"]
    (note,) = found["missing"]
    assert note.startswith(f"left out: {why}")


def test_a_file_without_an_annotation_is_read_with_the_stated_names_and_units(
    tmp_path: Path, button: LibraryEvidence
):
    # The options were dropped where the truth was missing.
    content = dict(np.load(BUTTON))
    columns = np.column_stack([content["t"], content["pos"] * 1000.0, content["force"]])
    names = "zeit,x_mm,y_mm,z_mm,a,b,c"
    np.savetxt(tmp_path / "log.csv", columns, delimiter=",", header=names, comments="", fmt="%.17g")
    (tmp_path / "map.toml").write_text(
        'wrench_source = "flange_sensor"\nforce_frame = "base"\nlength_unit = "mm"\n'
        '[time]\ncolumn = "zeit"\n'
        '[columns]\npx = "x_mm"\npy = "y_mm"\npz = "z_mm"\nfx = "a"\nfy = "b"\nfz = "c"\n'
    )
    result = run(tmp_path / "log.csv", "--mapping", tmp_path / "map.toml", "--format", "json")
    assert result.exit_code == 0, result.output
    (one,) = json.loads(result.stdout)["per_recording"]
    assert one["log_evidence"] == pytest.approx(button.log_evidence, rel=1e-6)


def test_text_fits_a_terminal(monkeypatch: pytest.MonkeyPatch, button: LibraryEvidence):
    monkeypatch.setattr(motion_library_evidence, "library_evidence", lambda _: button)
    text = run(BUTTON).stdout
    assert "minimum jerk" in text
    assert max(map(len, text.splitlines())) <= 80
    assert "…" not in text


def test_what_cannot_be_compared_is_one_line(tmp_path: Path):
    result = run("--suite", "thesis")
    assert result.exit_code == 1
    suites = "teacher, skills, hand, estimates, movements, tasks, repetitions, real, sensors, tempo, windows"
    assert f"known: {suites}, starts" in result.stderr
    (tmp_path / "none.npz").write_bytes(b"")
    assert run(tmp_path / "none.npz").exit_code == 1
    with pytest.raises(RecordingError):
        library_evidence(FileCase(tmp_path / "none.npz"))
