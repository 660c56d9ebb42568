"""`caesura segment` as a user calls it: what it writes, and what it says of what it cannot use."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from caesura_lab.commands.segment import announce_compilation
from caesura_protocol.package_version_and_extras import installed_version
from caesura_service.numba_support import mark_compiled
from harness.commands import application

DATA = Path(__file__).parents[2] / "data"
KINDS = {"motion", "contact", "transport", "steady", "hold", "sliding"}


def caesura(*words: object):
    return CliRunner().invoke(application(), [str(word) for word in words])


def recording(path: Path, t: np.ndarray, **arrays: np.ndarray) -> Path:
    pos = np.column_stack([0.1 * np.sin(t), 0 * t, 0 * t])
    np.savez(path, **{"t": t, "pos": pos} | arrays)
    return path


def test_it_writes_segments_changepoints_and_program(tmp_path: Path):
    out = tmp_path / "out.json"
    done = caesura("segment", DATA / "pick_and_place.npz", "--json", out)
    assert done.exit_code == 0, done.output
    found = json.loads(out.read_text())
    assert {"segments", "changepoints", "program"} <= set(found)
    for one in found["segments"]:
        assert {"t0", "tn", "kind", "motion", "contact", "probability"} <= set(one)
        assert one["kind"] in KINDS
    assert len(found["changepoints"]) == len(found["segments"]) - 1
    assert "transport" in {app["kind"] for app in found["program"]}
    assert "move to contact" in done.output


@pytest.mark.parametrize("words", [("segment", "--json"), ("export", "-o")])
def test_the_recording_is_not_replaced_by_what_is_made_of_it(tmp_path: Path, words: tuple[str, str]):
    """`segment a.npz --json a.npz` left JSON in its place, and an export onto itself dropped columns."""
    file = recording(tmp_path / "a.npz", np.arange(0.0, 2.0, 0.01), temperature=np.full(200, 20.0))
    before = file.read_bytes()
    command, option = words
    done = caesura(command, file, option, file)
    why = f"error: cannot write {file}: it is the file that is read; name another file\n"
    assert (done.exit_code, done.stderr) == (1, why)
    assert file.read_bytes() == before


def test_results_do_not_replace_another_recording(tmp_path: Path):
    # `segment --json a.npz b.npz`, with --json meant as a flag, left JSON in the place of the first one.
    a, b = (recording(tmp_path / name, np.arange(0.0, 2.0, 0.01)) for name in ("a.npz", "b.npz"))
    before = a.read_bytes()
    done = caesura("segment", "--json", a, b)
    words = "it is a recording; --json takes the name of the file to write, such as b.json"
    assert (done.exit_code, done.stderr) == (1, f"error: cannot write {a}: {words}\n")
    assert a.read_bytes() == before


@pytest.mark.parametrize(
    ("preset", "without", "is_said"),
    [("default", "gripper", True), ("default", "nothing", False), ("constant_velocity", "gripper", False)],
)
def test_without_a_gripper_state_it_says_which_loads_are_not_found(
    tmp_path: Path, preset: str, without: str, is_said: bool
):
    with np.load(DATA / "pick_and_place.npz") as taught:
        np.savez(tmp_path / "a.npz", **{name: taught[name] for name in taught.files if name != without})
    done = caesura("segment", tmp_path / "a.npz", "--preset", preset)
    assert done.exit_code == 0, done.output
    assert ("No gripper state: a light load" in done.output) == is_said


def test_a_threshold_divides_as_in_the_thesis(tmp_path: Path):
    found = []
    for options in ([], ["--threshold", 0.2]):
        out = tmp_path / "out.json"
        done = caesura(
            "segment", DATA / "pick_and_place.npz", "--preset", "integrated_tab_4_5", *options, "--json", out
        )
        assert done.exit_code == 0, done.output
        found.append(json.loads(out.read_text()))
    best, above = found
    assert len(above["segments"]) < len(best["segments"])
    assert all(one["probability"] > 0.2 for one in above["changepoints"])


def test_a_threshold_that_is_no_probability_is_one_clear_line():
    done = caesura("segment", DATA / "button.npz", "--threshold", 2)
    assert done.exit_code == 1
    assert done.output.strip() == "error: --threshold is 2.0, expected a probability between 0 and 1"


@pytest.mark.parametrize(
    ("name", "t", "words"),
    [
        ("one", np.array([0.0]), "nothing to segment in 1 sample over"),
        (
            "slow",
            np.arange(0.0, 12.0, 0.3),
            "39 gaps between them; expected t in seconds, more than 0.2 s, and pauses of at most",
        ),
        (
            "counted",
            np.concatenate([np.arange(300), np.arange(200)]) / 100,
            ".npz: sample 300: time goes back",
        ),
        ("restarted", np.tile(np.arange(0, 5, 0.01), 2), "time goes back from 4.99 s to 0 s"),
        ("unix", np.concatenate([np.arange(20) / 100, 1.76e9 + np.arange(20) / 100]), "time leaps"),
        ("milliseconds", np.arange(0.0, 3000.0, 10.0), "samples are 10 s apart, at most 0.5 s are plausible"),
    ],
)
def test_what_cannot_be_segmented_is_one_clear_line(tmp_path: Path, name: str, t: np.ndarray, words: str):
    done = caesura("segment", recording(tmp_path / f"{name}.npz", t))
    assert done.exit_code == 1
    (line,) = [line for line in done.output.splitlines() if line.strip()]
    assert line.startswith("error: ")
    assert words in line
    assert f"{name}.npz" in line


def test_many_gaps_are_not_listed_one_by_one(tmp_path: Path):
    t = np.arange(0, 60, 0.01)
    done = caesura("segment", recording(tmp_path / "gaps.npz", t[t % 5.0 < 4.0]))
    assert done.exit_code == 0
    assert done.output.count("no samples") == 5
    assert "6 more gaps; is t in seconds?" in done.output


def test_dropped_samples_are_reported(tmp_path: Path):
    t = np.repeat(np.arange(0, 5, 0.01), np.tile([2, *9 * [1]], 50))
    done = caesura("segment", recording(tmp_path / "repeats.npz", t))
    assert done.exit_code == 0
    assert "50 of 550 samples were dropped" in done.output


def test_a_result_that_cannot_be_written_is_said_before_the_work(tmp_path: Path):
    done = caesura("segment", DATA / "button.npz", "--json", tmp_path / "nowhere" / "out.json")
    assert done.exit_code == 1
    assert "no such directory" in done.output
    assert "contact" not in done.output


def test_an_unknown_preset_is_refused_with_those_that_exist():
    for command in (["segment", DATA / "button.npz"], ["serve"]):
        done = caesura(*command, "--preset", "magic")
        assert done.exit_code != 0
        assert "magic" in done.output or "unknown preset" in done.output


@pytest.mark.parametrize("kept", [False, True])
def test_the_first_segment_says_that_the_filter_is_compiled(tmp_path, monkeypatch, capsys, kept):
    monkeypatch.setattr("caesura_service.numba_support.decorators.cache_directory", lambda room: tmp_path)
    (tmp_path / "step.py312.nbc").write_bytes(b"")  # as an interrupted compilation leaves one
    if kept:
        mark_compiled()
    compiled: list[str] = []
    monkeypatch.setattr("caesura_service.prepare.prepare", lambda: compiled.append("now"))
    announce_compilation()
    assert compiled == ([] if kept else ["now"])
    assert capsys.readouterr().err == ("" if kept else "compiling the filter (once, about a minute)\n")


def test_times_of_day_are_shown_from_the_start_and_written_as_they_are(tmp_path: Path):
    out = tmp_path / "out.json"
    with np.load(DATA / "pick_and_place.npz") as taught:
        arrays = {name: taught[name] for name in taught.files}
    recording = tmp_path / "bag.npz"
    np.savez(recording, **(arrays | {"t": arrays["t"] + 1_700_000_001.05}))
    done = caesura("segment", recording, "--json", out)
    assert done.exit_code == 0, done.output
    found = json.loads(out.read_text())
    start = found["segments"][0]["t0"]
    assert start > 1_700_000_000.0
    assert done.output.count("times [s] from 2023-11-14 22:13:21 UTC on, the start") == 1
    assert "17000000" not in done.output
    for one in (*found["segments"], *found["program"]):
        assert f"{one['t0'] - start:.2f}" in done.output


def test_a_name_in_brackets_is_no_markup(tmp_path: Path):
    """A bag's note named "a mapping with  names others", and a file `x[/].npz` ended the command."""
    t = np.arange(300) / 100.0
    done = caesura("segment", recording(tmp_path / "x[red].npz", t, **{"[topics]": t}))
    assert done.exit_code == 0
    assert "x[red].npz (default)" in done.stdout
    assert "ignored [topics]" in done.stdout


def test_without_a_wrench_no_force_is_shown(tmp_path: Path):
    done = caesura("segment", recording(tmp_path / "nowrench.npz", np.arange(0.0, 3.0, 0.001)))
    assert done.exit_code == 0, done.output
    assert " N " not in done.output
    assert "–" in done.output


def copies(directory: Path, *names: str) -> list[Path]:
    """Recordings of these names, all of pressing a button."""
    directory.mkdir(exist_ok=True)
    files = [directory / f"{name}.npz" for name in names]
    for file in files:
        file.write_bytes((DATA / "button.npz").read_bytes())
    return files


def test_json_on_stdout_is_all_of_stdout_and_states_what_it_depends_on():
    """`--json -` wrote a file of that name, beside the tables."""
    first, again = (caesura("segment", DATA / "button.npz", "--json", "-") for _ in range(2))
    found = json.loads(first.stdout)
    assert first.stdout == again.stdout
    assert {"segments", "program"} <= set(found)
    origin = found["origin"]
    assert origin["file"] == str(DATA / "button.npz")
    assert origin["sha256"] == hashlib.sha256((DATA / "button.npz").read_bytes()).hexdigest()
    assert (origin["preset"], origin["options"]) == ("default", {})
    assert origin["version"] == installed_version()


def test_several_recordings_are_a_line_and_a_file_each(tmp_path: Path):
    copies(tmp_path / "taught", "one", "two")
    (tmp_path / "taught" / "notes.txt").write_text("no recording")
    done = caesura("segment", tmp_path / "taught", "--json", tmp_path / "found")
    assert done.exit_code == 0, done.output
    assert [line.partition(": ")[0] for line in done.stdout.splitlines()] == [
        str(tmp_path / "taught" / f"{name}.npz") for name in ("one", "two")
    ]
    assert "wrench flange_sensor" in done.stdout
    assert {file.name for file in (tmp_path / "found").iterdir()} == {"one.json", "two.json"}
    assert json.loads((tmp_path / "found" / "two.json").read_text())["segments"]


def test_a_recording_that_is_refused_does_not_stop_the_others(tmp_path: Path):
    files = copies(tmp_path / "taught", "one", "two")
    bad = tmp_path / "taught" / "bad.csv"
    bad.write_text("t,px,py,pz\n0,1,2,3\n0.1,1,2\n", encoding="utf-8")
    done = caesura("segment", files[0], bad, files[1], "--json", "-")
    assert done.exit_code == 1
    assert [json.loads(line)["origin"]["file"] for line in done.stdout.splitlines()] == [
        str(f) for f in files
    ]
    assert "line 3 has 3 values, expected 4" in done.stderr
    assert "1 of 3 recordings refused" in done.stderr


@pytest.mark.parametrize(
    ("names", "options", "words"),
    [
        (["a/one", "b/one"], ["--json", "found"], "would both be written to"),
        (["a/one", "a/two"], ["--json", "found.json"], "expected a directory for 2 recordings, or -"),
        (["a/one", "a/two"], ["--ask"], "--ask asks about one recording, and there are 2"),
        ([], ["empty"], "empty: a directory without metadata.yaml, expected one of .npz"),
    ],
)
def test_what_several_recordings_cannot_have_is_refused_before_one_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, names: list[str], options: list[str], words: str
):
    monkeypatch.chdir(tmp_path)
    Path("empty").mkdir()
    files = [copies(Path(name).parent, Path(name).name)[0] for name in names]
    done = caesura("segment", *files, *options)
    assert done.exit_code == 1
    assert words in done.output
    assert not done.stdout
    assert not Path("found.json").exists()


def test_what_is_not_read_of_a_file_is_stated_in_a_line_and_in_json(tmp_path: Path):
    rows = "\n".join(f"{i},{i / 100},{0.4 + 0.001 * i},0,0.3" for i in range(100))
    for name in ("one", "two"):
        (tmp_path / f"{name}.csv").write_text(f",t,px,py,pz\n{rows}\n", encoding="utf-8")
    done = caesura("segment", tmp_path)
    assert f"{tmp_path / 'one.csv'}: note: ignored a column without a name" in done.stderr
    assert "1 segment, 1 app, wrench none" in done.stdout
    done = caesura("segment", tmp_path, "--json", "-")
    assert [json.loads(line)["ignored"] for line in done.stdout.splitlines()] == [[""], [""]]
