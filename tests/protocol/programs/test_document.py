"""A program as a file: written, validated, read again, and refused with the place that is wrong."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from caesura_protocol.app_kinds import APP_KINDS
from caesura_protocol.messages import Phase, Program
from caesura_protocol.programs.document import (
    UNITS,
    BadProgramError,
    ProgramFile,
    document,
    read_document,
)
from harness.programs import as_file, pick_and_place, press

ROOT = Path(__file__).resolve().parents[3]
SCHEMA = ROOT / "protocol/caesura_protocol/programs/schema/program.v2.json"


def taught() -> Program:
    return Program(
        station="cell-1",
        session="monday",
        instance="service",
        epoch=3,
        version=7,
        t=12.0,
        complete=True,
        apps=pick_and_place(),
        notes=("Not observed: 1.00–1.20 s (samples were lost).",),
    )


def changed(file: ProgramFile, path: Path, **app: Any) -> Path:
    content = json.loads(file.as_json())
    content["apps"][1] |= app
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


def test_a_file_says_what_it_is_where_it_comes_from_and_in_which_units() -> None:
    content = json.loads(document(taught()).as_json())
    assert content["format"] == "caesura.program"
    assert content["version"] == 2
    assert (content["station"], content["session"], content["instance"]) == ("cell-1", "monday", "service")
    assert content["revision"] == 7
    assert content["units"] == dict(UNITS)
    assert content["apps"][2]["preconditions"] == list(APP_KINDS["transport"].preconditions)


def test_apps_are_grouped_by_phase_and_a_group_keeps_the_name_it_is_given(tmp_path: Path) -> None:
    apps = pick_and_place()
    edges = [apps[0].t0, apps[1].t0, apps[2].t0, apps[-1].tn]
    phases = [
        Phase(t0=t0, tn=tn, kind=kind, probability=0.9, certainty="final", first_segment=i, last_segment=i)
        for i, (kind, t0, tn) in enumerate(zip(("free", "contact", "free"), edges, edges[1:], strict=False))
    ]
    file, path = document(taught(), phases=phases), tmp_path / "p.json"
    assert [(one.first, one.name) for one in file.groups] == [
        (0, "free 1"),
        (1, "contact 1"),
        (2, "free 2"),
    ]
    assert file.groups[-1].last == len(apps) - 1
    content = json.loads(file.as_json())
    content["groups"][1]["name"] = "pick"
    path.write_text(json.dumps(content), encoding="utf-8")
    jsonschema.validate(content, json.loads(SCHEMA.read_text("utf-8")))
    assert read_document(path).groups[1].name == "pick"
    assert document(taught()).groups == ()


def test_what_is_written_validates_and_reads_the_same(tmp_path: Path) -> None:
    file, path = document(taught()), tmp_path / "p.json"
    path.write_text(file.as_json(), encoding="utf-8")
    jsonschema.validate(json.loads(file.as_json()), json.loads(SCHEMA.read_text("utf-8")))
    assert read_document(path) == file


def test_the_schema_is_that_of_the_model() -> None:
    script = ROOT / "scripts/write_program_schema.py"
    checked = subprocess.run([sys.executable, script, "--check"], check=False, capture_output=True, text=True)
    assert checked.returncode == 0, checked.stdout


def test_a_program_from_the_wire_and_a_segmented_recording_are_read_too(tmp_path: Path) -> None:
    wire, segmented = tmp_path / "wire.json", tmp_path / "My Recording.json"
    wire.write_text(taught().model_dump_json(), encoding="utf-8")
    apps = [one.model_dump(mode="json") for one in press()]
    segmented.write_text(json.dumps({"segments": [], "program": apps}), encoding="utf-8")
    assert read_document(wire) == document(taught())
    assert read_document(segmented).session == "my-recording"
    assert [one.kind for one in read_document(segmented).apps] == [one.kind for one in press()]


def test_what_was_assumed_of_a_recording_is_in_the_notes_of_its_program(tmp_path: Path) -> None:
    # It was in the table of `segment` alone: check and scripts knew nothing of it.
    path, apps = tmp_path / "p.json", [one.model_dump(mode="json") for one in press()]
    warnings = ["Warning: joints disagree.", "Order: assumed.", "Not observed."]
    content = {"segments": [], "program": apps, "notes": ["Not observed."], "warnings": warnings}
    path.write_text(json.dumps(content), encoding="utf-8")
    assert read_document(path).notes == ("Not observed.", "joints disagree.", "Order: assumed.")
    path.write_text(json.dumps(content | {"notes": 7}), encoding="utf-8")
    with pytest.raises(BadProgramError, match="notes is 7"):
        read_document(path)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"kind": "dance"}, r"app 2 \(dance\): kind is 'dance', expected 'cartesian_motion'"),
        ({"target": [0.1, 0.2]}, r"app 2 \(apply force\): target\.2 is missing$"),
        (
            {"confidence": 1.5},
            r"app 2 \(apply force\): confidence is 1\.5, expected less than or equal to 1$",
        ),
        ({"t0": "soon"}, r"app 2 \(apply force\): t0 is 'soon', expected a valid number$"),
    ],
)
def test_an_app_that_is_none_is_named_with_its_value(
    wrong: dict[str, Any], said: str, tmp_path: Path
) -> None:
    with pytest.raises(BadProgramError, match=said):
        read_document(changed(as_file(press()), tmp_path / "p.json", **wrong))


NAMED = b'{"format": "caesura.program", "station": "a", "session": "b", "instance": "c", '


@pytest.mark.parametrize(
    ("content", "found"),
    [
        (b"", "line 1, column 1: no JSON, expected a program as a JSON object"),
        (b"{", "line 1, column 2: no JSON, expected a program as a JSON object"),
        (b"\xff", "no text in UTF-8, expected a program as a JSON object"),
        (b"[" * 100_000, "nested too deeply, expected a program as a JSON object"),
        (b"[]", "holds a list, expected an object"),
        (
            b'{"format": "caesura.program", "version": 3}',
            "version is 3, expected at most 2: a newer",
        ),
        (b'{"format": "caesura.program", "station": "Cell 1"}', "station is 'Cell 1', expected 1 to 64 of a"),
        (NAMED + b'"apps": 3}', "apps is 3, expected an array"),
        (NAMED + b'"apps": [3]}', "app 1 (?) is 3, expected an object"),
        (b"{}", "station is missing"),
    ],
)
def test_what_is_no_program_is_refused_with_its_name(content: bytes, found: str, tmp_path: Path) -> None:
    """It once read "Input should be a valid tuple, got 3"."""
    path = tmp_path / "no.json"
    path.write_bytes(content)
    with pytest.raises(BadProgramError) as refused:
        read_document(path)
    assert str(refused.value).startswith(f"{path}: {found}")


def test_what_is_not_finite_is_not_written() -> None:
    spoilt = press()[0].model_copy(update={"target": (float("nan"), 0.0, 0.0)})
    with pytest.raises(ValueError, match=r"app 1 \(move to contact\): target\.0 is nan, expected a finite"):
        as_file((spoilt,)).as_json()


def test_names_in_a_file_are_names_so_that_a_script_made_of_it_is_only_the_script(tmp_path: Path) -> None:
    content = json.loads(as_file(press()).as_json()) | {"station": '"""\nimport os\n"""'}
    path = tmp_path / "p.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(BadProgramError, match="station"):
        read_document(path)
