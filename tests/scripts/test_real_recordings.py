"""Which recordings are present, and whether they are the ones that were annotated."""

from __future__ import annotations

import hashlib
import json
import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from caesura_lab.ground_truth import read_annotation
from caesura_protocol.formats.read import load_recording

TOP = Path(__file__).resolve().parents[2]
ANNOTATIONS = TOP / "data" / "real"
PAGES = TOP / "docs"


@pytest.fixture
def real(script, monkeypatch):
    monkeypatch.delenv("CAESURA_REAL_DATA", raising=False)
    return script("real_recordings")


@pytest.fixture
def one_annotated(real, tmp_path, monkeypatch):
    """One annotation, and a directory for its recording, of which the bytes are b"samples"."""
    annotations, recordings = tmp_path / "annotations", tmp_path / "recordings"
    annotations.mkdir()
    recordings.mkdir()
    named = {
        "file": "x.npz",
        "sha256": hashlib.sha256(b"samples").hexdigest(),
        "source": "someone/arm: demo.csv",
        "licence": "MIT",
    }
    (annotations / "x.ann.json").write_text(json.dumps({"recording": named}), encoding="utf-8")
    monkeypatch.setattr(real.recordings, "__defaults__", (annotations,))
    return recordings


def test_a_recording_with_the_annotated_bytes_is_in_order(real, one_annotated, capsys):
    (one_annotated / "x.npz").write_bytes(b"samples")
    assert real.main([str(one_annotated), "--copy"]) == 0
    assert "1 of 1 recordings" in capsys.readouterr().out
    assert (one_annotated / "x.ann.json").is_file()


def test_a_missing_recording_is_named_with_where_it_comes_from(real, one_annotated, capsys):
    assert real.main([str(one_annotated)]) == 1
    out = capsys.readouterr().out
    assert "missing" in out
    assert "clone someone/arm" in out
    assert "CAESURA_REAL_DATA" in out


def test_other_bytes_are_not_taken_for_the_annotated_ones(real, one_annotated, capsys):
    (one_annotated / "x.npz").write_bytes(b"other samples")
    assert real.main([str(one_annotated), "--copy"]) == 1
    assert "differs" in capsys.readouterr().out
    assert not (one_annotated / "x.ann.json").exists()


def test_the_variable_says_where_they_are_unless_the_argument_does(real, tmp_path, monkeypatch):
    monkeypatch.setenv("CAESURA_REAL_DATA", str(tmp_path))
    assert real.directory_of(None) == tmp_path
    assert real.directory_of(tmp_path / "other") == tmp_path / "other"


def test_every_published_annotation_says_what_it_is_of(real):
    wanted = list(real.recordings(ANNOTATIONS))
    assert len(wanted) == 50
    for each in wanted:
        assert each.annotation.name == each.file.replace(".npz", ".ann.json")
        assert each.licence == "MIT"
        assert len(each.sha256) == 64
        assert "/" in each.source.partition(":")[0]


def test_the_published_counts_are_those_of_the_command(real, capsys):
    assert real.main(["--counts"]) == 0
    page = (PAGES / "annotation.md").read_text(encoding="utf-8")
    published = re.findall(r"^\| (\S+/\S+) \|.*\| MIT \| (.*) \|$", page, re.MULTILINE)
    _, *rows = (line.split() for line in capsys.readouterr().out.splitlines())
    assert [[repository, *cells.split(" | ")] for repository, cells in published] == rows


def test_the_recordings_evaluated_apart_are_those_of_the_annotator_who_saw_no_result(real):
    page = (PAGES / "judge.md").read_text(encoding="utf-8")
    (command,) = re.findall(r"^    caesura evaluate (delft_panda_\{1,.*) \\$", page, re.MULTILINE)
    groups = re.findall(r"(\w+_)\{([\d,]+)\}\.npz", command)
    named = {f"{name}{number}.npz" for name, numbers in groups for number in numbers.split(",")}
    content = (json.loads(path.read_text(encoding="utf-8")) for path in ANNOTATIONS.glob("*.ann.json"))
    assert named == {each["file"] for each in content if each["annotator"] == "C"}


@pytest.mark.parametrize("path", sorted(ANNOTATIONS.glob("*.ann.json")), ids=lambda path: path.stem)
def test_a_published_annotation_keeps_to_the_protocol(path):
    content = json.loads(path.read_text(encoding="utf-8"))
    assert content["hand_on_robot"] in {"yes", "no", "unknown"}
    for point in content["changepoints"]:
        assert point.get("kind", "dip") in {"start", "stop", "contact_on", "contact_off", "corner", "dip"}
        assert point["level"] == "optional" or "kind" in point
        assert point["tol"] >= 0.15
        assert "t_alt" not in point or point["t"] - point["t_alt"] > 0.2


@pytest.mark.parametrize("path", sorted(ANNOTATIONS.rglob("*.ann.json")), ids=lambda path: path.stem)
def test_an_annotation_lies_within_its_recording(real, path):
    directory = real.directory_of(None)
    named = json.loads(path.read_text(encoding="utf-8"))
    file = directory / named["file"]
    if not file.is_file():
        pytest.skip(f"no {file}: see scripts/real_recordings.py")
    truth, recording = read_annotation(path), load_recording(file)
    first, last = float(recording.t.min()), float(recording.t.max())
    step = float(np.median(np.diff(np.unique(recording.t))))
    assert first - 0.001 <= truth.window[0] < truth.window[1] <= last + step
    assert all(truth.window[0] <= point.t <= truth.window[1] for point in truth.points)
    spans = sorted((span.t0, span.t1) for span in truth.spans)
    assert all(t0 < t1 for t0, t1 in spans)
    assert all(before[1] <= after[0] for before, after in pairwise(spans))
    assert named["wrench_source"] == recording.wrench_source
