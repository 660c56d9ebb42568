"""`caesura evaluate`, its suites, formats and refusals."""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from caesura_lab.commands import register
from caesura_lab.evaluation.baselines.simple_baselines import Baseline, thresholds
from caesura_lab.evaluation.cases.suites import FileCase, SimulatedDemonstration, SuiteOptions, suite
from caesura_lab.evaluation.methods import PresetMethod
from caesura_lab.evaluation.reports.report import report
from caesura_lab.evaluation.runner import NotApplicable, judge, judge_all
from caesura_lab.ground_truth import TruthError, read_truth, truth_file, truth_of
from caesura_lab.teacher.scenarios import BASIC, SKILLS, Scenario
from caesura_protocol.formats.read import load_recording

DATA = Path(__file__).parents[3] / "data"
BUTTON = DATA / "button.npz"


def run(*arguments: object):
    app = typer.Typer()
    register(app)
    return CliRunner().invoke(app, ["evaluate", *map(str, arguments)])


def test_text_has_a_row_for_every_method():
    result = run(BUTTON, "--confusion")
    assert result.exit_code == 0, result.output
    for name in ("default", "integrated", "thresholds", "zero velocity", "PELT linear", "Gaussian online"):
        assert name in result.stdout
    assert "default: share of the time of each true class" in result.stdout
    assert max(map(len, result.stdout.splitlines())) <= 80


def test_what_is_doubtful_of_a_recording_is_said_as_by_segment(tmp_path: Path):
    """A recording in m that was declared to be in mm had an F1 of 0.71 in place of 0.90, without a word."""
    shutil.copy(BUTTON, tmp_path / "one.npz")
    shutil.copy(truth_file(BUTTON), tmp_path / "one.ann.json")
    result = run(tmp_path / "one.npz", "--length-unit", "mm", "--no-baselines", "--workers", "1")
    assert result.exit_code == 0
    stated, line = [one for one in result.stderr.splitlines() if one.startswith("warning")]
    assert stated.startswith("warning: one.npz: length_unit 'm' of the file is not used: ")
    assert line.startswith("warning: one.npz: positions are within 0.000")
    assert "is the declared unit right?" in line
    assert "warning" not in run(BUTTON, "--preset", "default", "--no-baselines").stderr


def test_a_refused_recording_is_left_out_and_named(tmp_path: Path):
    """One value that was not finite ended the evaluation of all recordings without a figure."""
    for name in ("one", "two"):
        shutil.copy(BUTTON, tmp_path / f"{name}.npz")
        shutil.copy(truth_file(BUTTON), tmp_path / f"{name}.ann.json")
    content = dict(np.load(BUTTON))
    content["force"][7] = np.nan
    np.savez(tmp_path / "two.npz", **content)
    options = ("--preset", "default", "--no-baselines", "--slack", "0", "--format", "json")
    result = run(tmp_path, *options, "--workers", "1")
    assert result.exit_code == 1
    why = "two.npz: sample 7: fx is nan, expected a finite number"
    refusal, last = result.stderr.splitlines()
    assert refusal.startswith(f"error: {why}")
    assert last == "error: 1 of 2 recordings refused"
    found = json.loads(result.stdout)
    assert found["title"].startswith("files: 1 recording,")
    (note,) = found["missing"]
    assert note.startswith(f"left out: {why}")
    alone = json.loads(run(tmp_path / "one.npz", *options).stdout)
    assert alone == found | {"missing": []}


def test_json_says_the_same_as_markdown(tmp_path: Path):
    out = tmp_path / "out.json"
    one = ("--preset", "default", "--no-baselines")
    assert run(BUTTON, *one, "--format", "json", "-o", out).exit_code == 0
    method = json.loads(out.read_text())["methods"][0]
    value = method["measures"]["f1"]["value"]
    markdown = run(BUTTON, *one, "--format", "markdown").stdout
    row = next(line for line in markdown.splitlines() if line.startswith("| default"))
    assert f"| {value:.2f} " in row
    assert method["recordings"] == 1


def test_default_without_a_principle_is_a_preset_too():
    result = run(BUTTON, "--preset", "default", "--preset", "without_explained_turns", "--no-baselines")
    assert result.exit_code == 0, result.output
    assert "without_explained_turns" in "".join(result.stdout.split())


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ((), "either files or one --suite"),
        ((BUTTON, "--suite", "real"), "either files or one --suite"),
        (
            ("--suite", "nonsense"),
            "known: teacher, skills, hand, estimates, movements, tasks, repetitions, real, sensors, "
            "tempo, windows, starts, thesis, roundtrip, realism, coaching",
        ),
        (("--suite", "real", "--data", "/nowhere"), "no such directory"),
        (("--suite", "teacher", "--robot", "ur5"), "'ur5' is not known, expected one of"),
        (
            ("--suite", "real", "--robot", "ur5e"),
            "--robot ur5e is for a --suite of ['teacher', 'skills', 'hand', 'estimates', 'roundtrip']",
        ),
        ((BUTTON, "--robot", "ur5e"), "--robot ur5e is for a --suite of"),
        ((BUTTON, "--speed", "optimal"), "--speed optimal is for --suite roundtrip"),
        (
            ("--suite", "roundtrip", "--mutations", "1", "--speed", "optimal"),
            "--suite roundtrip without --mutations",
        ),
        (("--suite", "real", "--length-unit", "mm"), "--length-unit mm is for files, and --suite real"),
        ((BUTTON, "--mapping", "log.toml"), "--mapping log.toml is for csv files and rosbag2; button.npz"),
        ((BUTTON, "--preset", "nonsense"), "unknown preset"),
        ((BUTTON, "--preset", "without"), ", without_power"),
        (("/nowhere/x.npz",), "no such file"),
        ((BUTTON, "-o", "/nowhere/x.txt", "--no-baselines", "--preset", "default"), "cannot write"),
    ],
)
def test_misuse_is_one_line(arguments: tuple, expected: str):
    result = run(*arguments)
    assert result.exit_code == 1
    assert expected in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1


def test_the_speed_of_a_round_trip_says_in_one_line_which_extra_is_missing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in [name for name in sys.modules if name.startswith(("toppra", "caesura_lab.retiming"))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "toppra", None)
    result = run("--suite", "roundtrip", "--speed", "optimal")
    assert result.exit_code == 1
    assert "the speed optimal needs toppra: pip install" in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1


def test_a_preset_that_cannot_be_applied_says_so_and_stops_no_other():
    real = Path(os.environ.get("CAESURA_REAL_DATA", DATA.parents[1] / "shared" / "data" / "real"))
    case = FileCase(real / "modena_panda_0.npz")
    if not case.path.is_file():
        pytest.skip(f"the real recordings are not in {real}")
    refused, judged = judge(case, [PresetMethod("force"), PresetMethod("default")])
    assert isinstance(refused, NotApplicable)
    assert "force only" in refused.reason
    assert not isinstance(judged, NotApplicable)


def test_the_hand_in_the_wrench_is_the_annotations_to_say(tmp_path: Path):
    (tmp_path / "b.npz").write_bytes(BUTTON.read_bytes())
    content = json.loads((DATA / "button.ann.json").read_text()) | {"hand_force_in_wrench": True}
    (tmp_path / "b.ann.json").write_text(json.dumps(content))
    assert FileCase(tmp_path / "b.npz").load()[0].wrench_source == "flange_sensor_with_hand"


@pytest.mark.parametrize(
    ("name", "scenarios"),
    [("teacher", BASIC), ("skills", SKILLS), ("hand", {"wiping": BASIC["wiping"], **SKILLS})],
)
def test_the_teacher_teaches_every_scenario_with_each_profile_a_third(
    name: str, scenarios: Mapping[str, Scenario]
):
    cases = suite(name, SuiteOptions(seeds=3))
    assert {case.group for case in cases} == set(scenarios)
    assert len(cases) == 3 * len(scenarios)
    assert all(isinstance(case, SimulatedDemonstration) and case.seed > 0 for case in cases)
    profiles = [case.profile for case in cases]
    assert {profiles.count(profile) for profile in set(profiles)} == {len(scenarios)}


def test_the_guiding_hand_is_in_the_wrench_where_the_suite_says_so():
    case = next(case for case in suite("hand", SuiteOptions(seeds=1)) if case.group == "circle")
    assert case.name.endswith("-hand")
    assert case.load()[0].wrench_source == "flange_sensor_with_hand"


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"window": [1.0, 1.0]}, "expected it to have a length"),
        ({"window": None}, "window is None"),
        ({"window": [1]}, "window is .1., expected its first and last second"),
        ({"window": [0, "x"]}, "window.1. is 'x', expected a finite number"),
        (
            {"changepoints": [{"t": float("nan"), "tol": 0.1, "level": "major"}]},
            r"changepoints\[0\]: t is nan",
        ),
        ({"segments": [{"t0": 5, "t1": 2, "cls": "motion"}]}, r"segments\[0\]: t0 is 5 and t1 is 2"),
        ({"loads": [{"t0": 0, "t1": 1, "kg": -1}]}, r"loads\[0\]: kg is -1, expected 0 or more"),
        ({"forces": [{"t0": 0, "t1": 1}]}, r"'forces\[0\].newton' is missing"),
        ({"forces": {}}, "forces is {}, expected a list"),
        ({"changepoints": [{"t": 1, "tol": 0.1, "level": "minor"}]}, "level is 'minor'"),
        ({"changepoints": [5]}, r"changepoints\[0\] is 5, expected an object"),
        ({"changepoints": [{"t": 1, "level": "major"}]}, r"'changepoints\[0\].tol' is missing"),
        ({"changepoints": [{"t": 1, "tol": -1, "level": "major"}]}, "expected 0 s or more"),
        ({"segments": [{"t0": 0, "t1": 1, "cls": "flight"}]}, "cls is 'flight'"),
    ],
)
def test_an_annotation_that_is_off_is_named(change: dict, expected: str):
    content = {"window": [0, 5], "changepoints": []} | change
    with pytest.raises(TruthError, match=expected):
        truth_of(content, "x")


def test_a_recording_of_another_time_than_its_annotation_is_refused(tmp_path: Path):
    recording = load_recording(BUTTON)
    replace(recording, t=recording.t + 1e6).save(tmp_path / "x.npz")
    shutil.copy(truth_file(BUTTON), tmp_path / "x.ann.json")
    expected = r"window is \[0, 11.799\] s, and the recording lasts from 1000000 to 1"
    with pytest.raises(TruthError, match=expected):
        FileCase(tmp_path / "x.npz").load()


def test_a_window_that_goes_on_after_its_recording_is_cut_with_a_caution(tmp_path: Path):
    """Time without samples counted as one segment that was found: covering rose from 0.31 to 0.91."""
    shutil.copy(BUTTON, tmp_path / "x.npz")
    content = json.loads(truth_file(BUTTON).read_text())
    (tmp_path / "x.ann.json").write_text(json.dumps(content | {"window": [0.0, 99.0]}))
    recording, truth = FileCase(tmp_path / "x.npz").load()
    assert truth.window == (0.0, recording.t[-1])
    (cut,) = recording.cautions
    assert cut.startswith("the annotation's window is [0, 99] s, and the recording lasts from 0 to 11.79")
    assert cut.endswith("only what both have is judged")


def test_a_recording_that_cannot_be_conditioned_is_one_line(tmp_path: Path):
    """It was a traceback."""
    with np.load(BUTTON) as taught:
        np.savez(tmp_path / "x.npz", **{key: taught[key] for key in ("t", "pos", "force", "wrench_source")})
    shutil.copy(truth_file(BUTTON), tmp_path / "x.ann.json")
    result = run(tmp_path / "x.npz", "--no-baselines", "--force-frame", "flange")
    assert result.exit_code == 1
    assert result.stderr.startswith("error: x.npz: force_frame is 'flange' without orientation, expected")


def test_an_annotation_that_is_no_json_is_refused(tmp_path: Path):
    (tmp_path / "x.npz").touch()
    with pytest.raises(TruthError, match="not annotated"):
        read_truth(tmp_path / "x.npz")
    (tmp_path / "x.ann.json").write_text("{")
    with pytest.raises(TruthError, match="not a readable annotation"):
        read_truth(tmp_path / "x.npz")


@pytest.mark.slow
def test_processes_judge_as_one_does():
    cases, methods = [FileCase(BUTTON), FileCase(DATA / "dispenser.npz")], [Baseline("quick", thresholds)]
    alone, together = (list(judge_all(cases, methods, workers=workers)) for workers in (1, 2))
    assert sorted(map(repr, alone)) == sorted(map(repr, together))


def test_results_are_shown_by_kind_of_recording():
    case = SimulatedDemonstration("button", 1, "lognormal")
    result = report("one", ["default"], judge(case, [PresetMethod("default")]))
    judged = result.methods[0]
    assert [group.tag for group in judged.faults.groups][:2] == ["button", "lognormal"]
    assert [score.recording for score in judged.scores] == ["button-1-lognormal"]
    assert judged.estimates["recall"].value > 0.0
