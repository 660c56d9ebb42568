"""Annotations on disk."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from caesura_lab.annotation.edits import AnnotationEditor
from caesura_lab.annotation.storage import (
    check_writable,
    new_annotation,
    open_annotation,
    save_annotation,
    save_draft,
)
from caesura_lab.ground_truth import TruthError, read_annotation
from caesura_protocol.errors import SourceError
from caesura_protocol.formats.read import load_recording
from caesura_protocol.recording import Recording

TOP = Path(__file__).resolve().parents[3]
ANNOTATED = sorted((TOP / "data" / "real").rglob("*.ann.json"))


@pytest.fixture
def file(tmp_path: Path) -> Path:
    t = np.arange(100) / 50.0
    recording = Recording(t, {"pos": np.outer(t, [0.1, 0.0, 0.0])}, wrench_source="joint_torque_estimate")
    recording.save(tmp_path / "x.npz")
    return tmp_path / "x.npz"


def test_a_new_annotation_names_its_recording_and_takes_all_of_it(file: Path):
    document = new_annotation(load_recording(file), file, "A")
    assert document["window"] == [0.0, 1.98]
    assert document["recording"] == {
        "file": "x.npz",
        "sha256": hashlib.sha256(file.read_bytes()).hexdigest(),
    }


def test_what_the_recording_states_of_the_hand_is_kept(file: Path):
    """`unknown` took its place."""
    recording = replace(load_recording(file), hand_on_robot="no")
    document = new_annotation(recording, file, "A")
    assert (document["hand_on_robot"], document["hand_force_in_wrench"]) == ("no", False)
    unstated = new_annotation(replace(recording, wrench_source=None), file, "A")
    assert unstated["hand_force_in_wrench"] is None


def test_a_bag_is_annotated_and_saved(file: Path, tmp_path: Path):
    """A directory has no SHA-256, and without one nothing could be saved."""
    (tmp_path / "bag").mkdir()
    editor = AnnotationEditor(new_annotation(load_recording(file), tmp_path / "bag", "A"))
    editor.edit("start", 0.5)
    save_annotation(editor.document, tmp_path / "bag.ann.json")
    assert read_annotation(tmp_path / "bag.ann.json").source is None


def test_the_annotation_of_another_recording_is_not_opened(file: Path):
    """x.csv beside x.npz: marks were set on the one and saved as those of the other."""
    path = file.with_name("x.ann.json")
    save_annotation(new_annotation(load_recording(file), file, "A"), path)
    table = file.with_suffix(".csv")
    table.write_text("t,px,py,pz\n0,0,0,0\n")
    with pytest.raises(TruthError, match=r"made for x\.npz with SHA-256 .* x\.csv has .* --out"):
        open_annotation(path, load_recording(file), table, "A")


def test_a_draft_replaces_no_file(file: Path):
    path = file.with_name("x.ann.json")
    written = [save_draft(new_annotation(load_recording(file), file, each), path) for each in "AB"]
    assert [one.name for one in written] == ["x.ann.json.unsaved", "x.ann.json.unsaved-2"]
    assert [json.loads(one.read_text())["annotator"] for one in written] == ["A", "B"]
    assert not path.exists()


def test_what_is_saved_is_what_the_judge_reads(file: Path):
    editor = AnnotationEditor(new_annotation(load_recording(file), file, "A"))
    editor.edit("start", 0.5)
    editor.edit("motion", 1.0)
    path = file.with_name("x.ann.json")
    save_annotation(editor.document, path)
    truth = read_annotation(path)
    assert [(point.t, point.kind) for point in truth.points] == [(0.5, "start")]
    assert [(span.t0, span.t1, span.kind) for span in truth.spans] == [(0.5, 1.98, "motion")]
    assert open_annotation(path, load_recording(file), file, "B") == editor.document


def test_nothing_is_written_that_the_judge_could_not_read(file: Path):
    path = file.with_name("x.ann.json")
    path.write_text("as it was")
    with pytest.raises(TruthError, match="level is 'minor'"):
        save_annotation({"window": [0, 1], "changepoints": [{"t": 0.5, "tol": 0.1, "level": "minor"}]}, path)
    assert path.read_text() == "as it was"
    assert {each.name for each in file.parent.iterdir()} == {"x.npz", "x.ann.json"}


def test_an_annotation_that_cannot_be_read_is_not_replaced_by_a_new_one(file: Path):
    path = file.with_name("x.ann.json")
    path.write_text("{")
    with pytest.raises(TruthError, match="not a readable annotation"):
        open_annotation(path, load_recording(file), file, "A")


def test_a_file_that_cannot_be_written_is_named(file: Path):
    document = new_annotation(load_recording(file), file, "A")
    with pytest.raises(SourceError, match="nowhere"):
        save_annotation(document, file.parent / "nowhere" / "x.ann.json")


def test_an_annotation_is_not_begun_where_it_cannot_be_saved(file: Path):
    """The marks were lost at the end: neither the annotation nor its draft could be written."""
    with pytest.raises(SourceError, match=r"nowhere/x\.ann\.json: no such directory"):
        check_writable(file.parent / "nowhere" / "x.ann.json")
    with pytest.raises(SourceError, match="it is a directory"):
        check_writable(file.parent)
    check_writable(file.with_name("x.ann.json"))


def test_there_are_annotations_to_read():
    assert len(ANNOTATED) >= 25


@pytest.mark.parametrize("path", ANNOTATED, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_the_published_annotations_keep_every_byte_when_they_are_opened_and_saved(path: Path, tmp_path: Path):
    copy = tmp_path / path.name
    save_annotation(json.loads(path.read_text(encoding="utf-8")), copy)
    assert copy.read_bytes() == path.read_bytes()
