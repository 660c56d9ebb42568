"""A file states that people changed the results of its session: its samples do not show that."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from caesura_protocol.formats.read import load_recording
from caesura_protocol.messages import Edit, EditProgram, NameProgram, Undo
from caesura_protocol.recording import RecordingError
from caesura_service.journal import Record
from caesura_service.offline_segmentation import recording_of
from harness.commands import application
from harness.demonstrations import guided
from lab.export.test_mcap import kept


def test_corrections_and_edits_of_the_program_are_counted() -> None:
    journal = kept(guided())
    taught = list(journal.replay("cell-1", "s1"))
    assert recording_of(taught).changes == 0
    undone = Edit(session="s1", revision=0, author="Ann", action=Undo())
    named = EditProgram(session="s1", revision=0, author="Ann", action=NameProgram(name="Fill"))
    changed = [Record("cell-1", "s1", 1.0, message) for message in (undone, named)]
    assert recording_of([*taught, *changed]).changes == 2


@pytest.mark.parametrize("suffix", ["npz", "csv", "mcap"])
def test_every_reader_names_the_changes_that_the_samples_lack(tmp_path: Path, suffix: str) -> None:
    replace(guided(), changes=3).save(tmp_path / "s1.npz")
    copy = tmp_path / f"copy.{suffix}"
    done = CliRunner().invoke(application(), ["export", str(tmp_path / "s1.npz"), "-o", str(copy)])
    assert done.exit_code == 0, done.output
    said = "People changed the results of this session 3 times, by corrections or edits of the program"
    assert said in done.stderr
    read = load_recording(copy)
    assert (read.changes, read.ignored) == (3, ())
    assert [one.startswith(said) for one in read.cautions] == [True]


def test_a_number_of_changes_that_is_none_is_refused(tmp_path: Path) -> None:
    one = guided()
    wrong = {"t": one.t, "pos": one.signals["pos"], "changes_by_people": np.array("some")}
    np.savez(tmp_path / "bad.npz", **wrong)
    with pytest.raises(RecordingError, match="changes_by_people is 'some', expected the number of changes"):
        load_recording(tmp_path / "bad.npz")
