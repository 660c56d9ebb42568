"""`--suite real`: open annotations, recordings that lie elsewhere, and what an annotation declares."""

from __future__ import annotations

import hashlib
import json
import pickle
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from caesura_lab.annotation.storage import new_annotation, save_annotation
from caesura_lab.commands import register
from caesura_lab.evaluation.baselines.simple_baselines import Baseline, thresholds
from caesura_lab.evaluation.cases import suites
from caesura_lab.evaluation.cases.annotated_declarations import with_annotated_declarations
from caesura_lab.evaluation.cases.suites import (
    FileCase,
    ReadingOptions,
    SimulatedDemonstration,
    SuiteOptions,
    missing_recordings,
    suite,
)
from caesura_lab.evaluation.reports.report import as_json, report
from caesura_lab.evaluation.reports.tables import as_markdown
from caesura_lab.evaluation.runner import judge
from caesura_lab.ground_truth import (
    ToleranceOptions,
    TrueSegment,
    Truth,
    TruthError,
    truth_file,
    truth_of,
)
from caesura_protocol.formats.read import load_recording
from caesura_protocol.recording import Recording
from caesura_service.offline_segmentation import capabilities_of, segment_recording
from harness import ros
from harness.commands import application

BUTTON = Path(__file__).parents[3] / "data" / "button.npz"
QUICK = Baseline("quick", thresholds)
BASE = load_recording(BUTTON)
SPARSE = replace(BASE, t=BASE.t[::5], signals={name: one[::5] for name, one in BASE.signals.items()})
EMPTY = {"window": [0, 5], "changepoints": []}


def sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def annotate(path: Path, file: str, sha: str, **also: Any) -> None:
    source = {"file": file, "sha256": sha, "source": f"some/repository {file}", "licence": "MIT"}
    points = {"changepoints": [{"t": 2.0, "tol": 0.15, "level": "major"}]}
    path.write_text(json.dumps(EMPTY | points | {"recording": source} | also))


@pytest.fixture
def extent(tmp_path: Path) -> SuiteOptions:
    """Three recordings, two of them annotated openly, one beside; one open annotation without recording."""
    data, annotations = tmp_path / "data", tmp_path / "annotations"
    data.mkdir()
    annotations.mkdir()
    for name in ("kit_0.npz", "kit_1.npz", "old_0.npz"):
        shutil.copy(BUTTON, data / name)
    for name in ("kit_0", "kit_1", "gone_7"):
        annotate(annotations / f"{name}.ann.json", f"{name}.npz", sha256(BUTTON))
    (data / "old_0.ann.json").write_text(json.dumps(EMPTY | {"robot": "ur5e"}))
    return SuiteOptions(data=data, annotations=annotations)


def test_open_annotations_meet_their_recordings_and_those_with_their_own_are_judged_too(extent: SuiteOptions):
    cases = suite("real", extent)
    assert [case.name for case in cases] == ["kit_0.npz", "kit_1.npz", "old_0.npz"]
    assert all(case.load()[1].window == (0.0, 5.0) for case in cases)


def test_a_missing_recording_is_named_with_its_source_in_every_output(extent: SuiteOptions):
    (note,) = missing_recordings("real", extent)
    assert note.startswith("gone_7.npz: not in ")
    assert note.endswith("its source: some/repository gone_7.npz")
    assert missing_recordings("teacher", extent) == missing_recordings(None, extent) == []
    result = report("one", ["quick"], judge(suite("real", extent)[0], [QUICK]), [note])
    assert note in as_markdown(result)
    assert as_json(result)["missing"] == [note]


def test_the_open_annotation_replaces_the_one_beside_the_recording(extent: SuiteOptions):
    (extent.data / "kit_0.ann.json").write_text(json.dumps(EMPTY | {"window": [0, 1]}))
    cases = suite("real", extent)
    assert [case.name for case in cases].count("kit_0.npz") == 1
    assert cases[0].load()[1].window == (0.0, 5.0)


def test_a_second_reading_of_a_recording_is_not_judged_twice(extent: SuiteOptions):
    annotate(extent.annotations / "kit_0.b.ann.json", "kit_0.npz", sha256(BUTTON), window=[0, 2])
    annotate(extent.annotations / "a_kit_0.ann.json", "kit_0.npz", sha256(BUTTON), window=[0, 3])
    cases = suite("real", extent)
    assert [case.name for case in cases] == ["kit_0.npz", "kit_1.npz", "old_0.npz"]
    assert cases[0].load()[1].window == (0.0, 5.0)


def test_a_recording_that_is_not_the_annotated_one_is_refused_with_both_hashes(extent: SuiteOptions):
    path = extent.data / "kit_1.npz"
    replace(BASE, t=BASE.t + 0.01).save(path)
    with pytest.raises(TruthError) as refusal:
        [judge(case, [QUICK]) for case in suite("real", extent)]
    assert sha256(path) in str(refusal.value)
    assert sha256(BUTTON) in str(refusal.value)
    assert "kit_1.npz" in str(refusal.value)


def test_a_hash_beside_the_recording_counts_as_well(tmp_path: Path):
    shutil.copy(BUTTON, tmp_path / "x.npz")
    annotate(tmp_path / "x.ann.json", "x.npz", "0" * 64)
    with pytest.raises(TruthError, match="0" * 64):
        FileCase(tmp_path / "x.npz").load()


def test_a_suite_without_a_single_recording_says_how_many_are_missing(extent: SuiteOptions):
    for file in extent.data.iterdir():
        file.unlink()
    with pytest.raises(TruthError, match=r"no annotated recording.*3 are missing"):
        suite("real", extent)
    extent.data.rmdir()
    with pytest.raises(TruthError, match="no such directory"):
        suite("real", extent)


def test_an_open_annotation_must_name_its_recording(extent: SuiteOptions):
    (extent.annotations / "x.ann.json").write_text(json.dumps(EMPTY))
    with pytest.raises(TruthError, match=r"x\.ann\.json: 'recording' is missing"):
        suite("real", extent)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"recording": "x.npz"}, "recording is 'x.npz', expected an object"),
        ({"recording": {"file": "x.npz"}}, r"'recording.sha256' is missing"),
        ({"recording": {"file": "../x.npz", "sha256": "0" * 64}}, "without a directory"),
        ({"recording": {"file": "x.npz", "sha256": "0" * 63}}, "expected 64 lower-case hex digits"),
        ({"wrench_source": "wrist"}, "wrench_source is 'wrist', expected one of"),
        ({"hand_on_robot": True}, "hand_on_robot is True, expected one of"),
        ({"robot": 5}, "robot is 5, expected text"),
        (
            {"changepoints": [{"t": 1, "tol": 0.1, "level": "major", "t_alt": "x"}]},
            r"changepoints\[0\]: t_alt is 'x', expected a finite number",
        ),
        (
            {"changepoints": [{"t": 1, "tol": 0.1, "level": "major", "kind": "strat"}]},
            r"changepoints\[0\]: kind is 'strat', expected one of start, stop, contact_on, ",
        ),
        (  # it was read in silence, and judged nowhere
            {"changepoints": [{"t": 5.2, "tol": 0.1, "level": "major"}]},
            r"changepoints\[0\]: t is 5\.200 s, expected a time within the window from 0\.000 to 5\.000 s",
        ),
        (
            {"changepoints": [{"t": 1, "tol": 0.1, "level": "major", "t_alt": -0.1}]},
            r"changepoints\[0\]: t_alt is -0\.100 s, expected a time within the window",
        ),
    ],
)
def test_a_declaration_that_is_off_is_named(change: dict, expected: str):
    with pytest.raises(TruthError, match=expected):
        truth_of(EMPTY | change, "x")


def test_a_second_accepted_time_is_read():
    mark = {"t": 3.1, "t_alt": 2.85, "tol": 0.15, "level": "major", "kind": "contact_off"}
    (point,) = truth_of(EMPTY | {"changepoints": [mark]}, "x").points
    assert point.accepted_s == (3.1, 2.85)
    assert (point.nearest_s(2.9), point.nearest_s(3.0)) == (2.85, 3.1)


def test_phases_are_read_in_the_order_of_time():
    phases = [{"t0": 2, "t1": 4.5, "name": "peel"}, {"t0": 0, "t1": 2, "name": "reach"}]
    assert truth_of(EMPTY | {"phases": phases}, "x").phases == (
        TrueSegment(0, 2, "reach"),
        TrueSegment(2, 4.5, "peel"),
    )
    assert truth_of(EMPTY, "x").phases == ()


@pytest.mark.parametrize(
    ("phases", "expected"),
    [
        ([{"t0": 0, "t1": 2}], r"'phases\[0\].name' is missing"),
        ([{"t0": 0, "t1": 2, "name": ""}], r"phases\[0\]: name is '', expected text"),
        ([{"t0": 3, "t1": 2, "name": "peel"}], r"phases\[0\]: t0 is 3 and t1 is 2"),
        (
            [{"t0": 0, "t1": 2, "name": "reach"}, {"t0": 1.5, "t1": 3, "name": "peel"}],
            "phases: 'peel' begins at 1.5 s, expected 2 s or later",
        ),
    ],
)
def test_a_phase_that_is_off_is_named(phases: list, expected: str):
    with pytest.raises(TruthError, match=expected):
        truth_of(EMPTY | {"phases": phases}, "x")


def declared(recording: Recording, **content: Any) -> Recording:
    return with_annotated_declarations(recording, truth_of(EMPTY | content, "x"))


def test_an_annotation_declares_the_wrench_where_the_recording_does_not():
    unstated = Recording(BASE.t, BASE.signals)
    assert declared(unstated, wrench_source="joint_torque_estimate").wrench_source == "joint_torque_estimate"
    assert declared(unstated).wrench_source == unstated.wrench_source
    stated = replace(unstated, wrench_source="flange_sensor_with_hand")
    assert declared(stated, wrench_source="joint_torque_estimate").wrench_source == "flange_sensor_with_hand"


@pytest.mark.parametrize("content", [{}, {"wrench_source": "flange_sensor"}])
def test_the_hand_in_the_wrench_makes_a_flange_sensor_one_with_hand(content: dict):
    unstated = Recording(BASE.t, BASE.signals)
    assert declared(unstated, **content, hand_force_in_wrench=True).wrench_source == "flange_sensor_with_hand"
    estimate = replace(unstated, wrench_source="joint_torque_estimate")
    assert declared(estimate, **content, hand_force_in_wrench=True).wrench_source == "joint_torque_estimate"


def test_an_annotation_declares_the_hand_where_recordings_can_hold_it():
    unstated = Recording(BASE.t, BASE.signals)
    said = declared(unstated, hand_on_robot="no")
    if hasattr(unstated, "hand_on_robot"):
        assert said.hand_on_robot == "no"
        assert declared(said, hand_on_robot="yes").hand_on_robot == "no"
    else:
        assert said == unstated


def test_capabilities_are_those_of_a_session():
    for source in ("flange_sensor", "flange_sensor_with_hand", "joint_torque_estimate"):
        recording = replace(BASE, wrench_source=source)
        report = segment_recording(recording).wrench
        found = capabilities_of(recording)
        assert (found.contact_models, found.transport_models) == (
            report.contact_models,
            report.transport_models,
        )
    assert capabilities_of(replace(BASE, wrench_source="flange_sensor")).contact_models
    assert not capabilities_of(replace(BASE, wrench_source="flange_sensor_with_hand")).contact_models


def test_sets_are_by_robot_where_stated_else_by_the_name_before_its_number(extent: SuiteOptions):
    assert FileCase(Path("kit_panda_0.npz")).group == "kit_panda"
    assert FileCase(Path("kul-12.csv")).group == "kul"
    assert FileCase(Path("button.npz")).group == "button"
    assert FileCase(Path("7.npz")).group == "7"
    assert SimulatedDemonstration("button", 1, "lognormal").group == "button"
    verdicts = [verdict for case in suite("real", extent) for verdict in judge(case, [QUICK])]
    assert [verdict.groups for verdict in verdicts] == [("kit",), ("kit",), ("ur5e", "old")]


def test_what_is_made_of_one_person_or_demonstration_is_one_subject(extent: SuiteOptions):
    people = [SimulatedDemonstration(scenario, 7, "lognormal") for scenario in ("button", "curves")]
    assert {case.subject for case in people} == {"person 7"}
    assert SimulatedDemonstration("button", 8, "lognormal").subject == "person 8"
    for name in ("windows", "starts"):
        assert {case.subject for case in suite(name, extent)} == {case.name for case in suite("real", extent)}
    for name, source in (("kit_0", "some/repository: a_1.npz:left"), ("kit_1", "some/repository: a_1.npz")):
        named = {"file": f"{name}.npz", "sha256": sha256(BUTTON), "source": source}
        annotate(extent.annotations / f"{name}.ann.json", f"{name}.npz", sha256(BUTTON), recording=named)
    verdicts = [verdict for case in suite("real", extent) for verdict in judge(case, [QUICK])]
    assert [one.subject for one in verdicts] == ["some/repository: a_1.npz"] * 2 + ["old_0.npz"]


def test_a_robot_of_several_sets_is_shown_as_a_whole_and_set_by_set(extent: SuiteOptions):
    for name in ("kit_0", "kit_1"):
        annotate(extent.annotations / f"{name}.ann.json", f"{name}.npz", sha256(BUTTON), robot="panda")
    annotate(extent.data / "old_0.ann.json", "old_0.npz", sha256(BUTTON), robot="panda")
    shutil.copy(BUTTON, extent.data / "gone_7.npz")
    verdicts = [verdict for case in suite("real", extent) for verdict in judge(case, [QUICK])]
    (section,) = report("one", ["quick"], verdicts).sections
    assert {name: some[0].recordings for name, some in section.sets.items()} == {
        "gone": 1,
        "panda": 3,
        "kit": 2,
        "old": 1,
    }


def test_a_report_has_every_slack_and_every_set_with_its_margin(extent: SuiteOptions):
    methods = [QUICK, Baseline("nothing", lambda signals: thresholds(signals)[:0])]
    tolerance_options = [ToleranceOptions(), ToleranceOptions(slack_s=0.2)]
    cases = suite("real", extent)
    verdicts = [one for case in cases for one in judge(case, methods, tolerance_options)]
    result = report("one", ["quick", "nothing"], verdicts)
    assert [section.slack_s for section in result.sections] == [0.0, 0.2]
    plain = as_json(result)
    assert plain["with_slack"][0]["slack_s"] == 0.2
    for section in (plain, *plain["with_slack"]):
        assert {name: sets[0]["recordings"] for name, sets in section["sets"].items()} == {
            "kit": 2,
            "ur5e": 1,
        }
        first, other = section["sets"]["kit"]
        assert first["first_exceeds_it_by"] == {}
        ahead = other["first_exceeds_it_by"]["f1"]
        values = [one["measures"]["f1"]["value"] for one in (first, other)]
        assert ahead["value"] == pytest.approx(values[0] - values[1])
        assert ahead["low"] <= ahead["value"] <= ahead["high"]
    markdown = as_markdown(result)
    assert "set kit: 2 recordings; no slack" in markdown
    assert "set ur5e: 1 recording; 0.2 s of slack" in markdown


def test_slack_finds_what_lies_just_outside_of_the_tolerance():
    truth = {"window": [0, 11.799], "changepoints": [{"t": 5.0, "tol": 0.1, "level": "major"}]}

    class Late:
        name = "late"
        tags, group, subject = (), "one", "late"

        def load(self) -> tuple[Recording, Truth]:
            return BASE, truth_of(truth, "late")

    found = Baseline("late", lambda signals: (signals.t < 5.25).sum(keepdims=True))
    verdicts = judge(Late(), [found], [ToleranceOptions(), ToleranceOptions(slack_s=0.2)])
    assert [(one.slack_s, one.hits) for one in verdicts] == [(0.0, 0), (0.2, 1)]


def test_sets_that_would_say_nothing_new_are_not_shown(extent: SuiteOptions):
    alone = report("one", ["quick"], judge(FileCase(BUTTON), [QUICK]))
    assert alone.sections[0].sets == {}
    cases = suite("real", extent)
    each_its_own = [verdict for case in (cases[0], cases[2]) for verdict in judge(case, [QUICK])]
    assert report("one", ["quick"], each_its_own).sections[0].sets == {}


def test_a_bag_is_judged_by_its_name_and_in_its_directory(tmp_path: Path):
    """A bag's directory was searched for annotated recordings, and one beside its annotation was not seen."""
    bag = ros.write_bag(tmp_path / "bag", ros.sensor_topics(SPARSE), "mcap")
    recording = load_recording(bag, wrench_source="flange_sensor")
    annotation = new_annotation(recording, bag, "A")
    begun = float(recording.t[0])
    annotation["changepoints"] = [{"t": begun + 2.0, "tol": 0.15, "level": "major", "kind": "start"}]
    save_annotation(annotation, tmp_path / "bag.ann.json")
    for named in (bag, tmp_path):
        (case,) = suites.files([named])
        assert case.name == "bag"
        (verdict,) = judge(case, [QUICK])
        assert verdict.recording == "bag"
    hashed = annotation | {"recording": {"file": "bag", "sha256": "0" * 64}}
    (tmp_path / "bag.ann.json").write_text(json.dumps(hashed))
    with pytest.raises(TruthError, match="has no SHA-256"):
        case.load()


def test_the_source_that_an_mcap_states_holds_as_that_of_an_npz(tmp_path: Path):
    """An annotation's source replaced that of Caesura's MCAP; of npz and csv it fills in what is missing."""
    shutil.copy(BUTTON, tmp_path / "one.npz")
    file = tmp_path / "one.mcap"
    exported = CliRunner().invoke(application(), ["export", str(tmp_path / "one.npz"), "-o", str(file)])
    assert exported.exit_code == 0, exported.output
    (tmp_path / "one.ann.json").write_text(json.dumps(EMPTY | {"wrench_source": "joint_torque_estimate"}))
    for path in (tmp_path / "one.npz", file):
        recording, _ = FileCase(path).load()
        assert (recording.wrench_source, recording.cautions) == ("flange_sensor", ())


def test_a_bag_beside_its_recording_is_not_judged_twice(tmp_path: Path):
    shutil.copy(BUTTON, tmp_path / "one.npz")
    (tmp_path / "one.ann.json").write_text(json.dumps(EMPTY))
    (tmp_path / "one").mkdir()
    (tmp_path / "one" / "metadata.yaml").touch()
    (tmp_path / "one.mcap").touch()
    assert [case.name for case in suites.files([tmp_path])] == ["one.npz"]


def test_a_recording_that_is_named_twice_is_judged_once(tmp_path: Path):
    """`caesura evaluate data/button.npz data` counted it twice, and its interval was too narrow."""
    for name in ("one", "two"):
        shutil.copy(BUTTON, tmp_path / f"{name}.npz")
        (tmp_path / f"{name}.ann.json").write_text(json.dumps(EMPTY))
    named = [tmp_path / "two.npz", tmp_path, tmp_path / ".." / tmp_path.name / "two.npz"]
    assert [case.name for case in suites.files(named)] == ["two.npz", "one.npz"]


MAPPING = """
wrench_source = "flange_sensor"
[time]
column = "Time [ms]"
unit = "ms"
[columns]
px = { column = "X", unit = "mm" }
py = { column = "Y", unit = "mm" }
pz = { column = "Z", unit = "mm" }
"""


def test_a_csv_of_other_software_is_judged_with_its_mapping(tmp_path: Path):
    """`caesura annotate log.csv --mapping log.toml` made an annotation that nothing could be judged by."""
    table, mapping = tmp_path / "log.csv", tmp_path / "log.toml"
    mapping.write_text(MAPPING)
    rows = np.column_stack([BASE.t, BASE.signals["pos"]])[::10] * 1000.0
    np.savetxt(table, rows, delimiter=",", header="Time [ms],X,Y,Z", comments="")
    save_annotation(new_annotation(load_recording(table, mapping=mapping), table, "A"), truth_file(table))
    (case,) = suites.files([table], ReadingOptions(mapping=mapping))
    recording, truth = pickle.loads(pickle.dumps(case)).load()
    np.testing.assert_allclose(recording.signals["pos"], BASE.signals["pos"][::10], atol=1e-9)
    assert truth.window == pytest.approx((0.0, recording.t[-1]), abs=1e-3)


def test_a_csv_in_another_unit_is_judged_in_it(tmp_path: Path):
    table = tmp_path / "log.csv"
    rows = np.column_stack([BASE.t, 1000.0 * BASE.signals["pos"]])[::10]
    np.savetxt(table, rows, delimiter=",", header="t,px,py,pz", comments="")
    truth_file(table).write_text(json.dumps(EMPTY))
    (case,) = suites.files([table], ReadingOptions(length_unit="mm"))
    assert case.load()[0].length_unit == "mm"


def test_the_source_of_a_bags_wrench_is_its_mappings_before_its_annotations(tmp_path: Path):
    bag = ros.write_bag(tmp_path / "bag", ros.sensor_topics(SPARSE), "mcap")
    annotation = new_annotation(load_recording(bag, wrench_source="flange_sensor"), bag, "A")
    save_annotation(annotation, tmp_path / "bag.ann.json")
    for stated, source in (('wrench_source = "none"', "none"), ("", "flange_sensor")):
        (tmp_path / "bag.toml").write_text(stated)
        (case,) = suites.files([bag], ReadingOptions(mapping=tmp_path / "bag.toml"))
        assert case.load()[0].wrench_source == source


def test_the_environment_names_the_directory_of_recordings(tmp_path: Path):
    shutil.copy(BUTTON, tmp_path / "mine_0.npz")
    (tmp_path / "mine_0.ann.json").write_text(json.dumps(EMPTY | {"changepoints": []}))
    app = typer.Typer()
    register(app)
    arguments = ["evaluate", "--suite", "real", "--preset", "default", "--no-baselines", "--format", "json"]
    result = CliRunner().invoke(app, arguments, env={"CAESURA_REAL_DATA": str(tmp_path)})
    assert result.exit_code == 0, result.output
    printed = json.loads(result.stdout)
    (method,) = printed["methods"]
    assert [one["recording"] for one in method["per_recording"]] == ["mine_0.npz"]
    assert len(printed["missing"]) == len(suites.open_annotations())
    elsewhere = CliRunner().invoke(app, arguments, env={"CAESURA_REAL_DATA": "/nowhere"})
    assert elsewhere.exit_code == 1
    assert "/nowhere: no such directory" in elsewhere.stderr
