"""The description of a session in an export: of its opening, with every change, and of its close."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from caesura_clients.bridge.replay_ring import StoredBatch
from caesura_clients.bridge.sources.file import FileSource
from caesura_clients.bridge.unstored_batch_export import save_unstored
from caesura_lab.export.lerobot_dataset import write_sessions
from caesura_lab.export.mcap_file import write_mcap
from caesura_lab.export.session_from_journal import read_session_export
from caesura_protocol.codec import encode, pack_samples
from caesura_protocol.formats.read import load_recording
from caesura_protocol.formats.write import write_csv
from caesura_protocol.messages import Close, Describe, Description, Open, SampleBatch
from caesura_service.journal import Record
from caesura_service.offline_segmentation import recording_of
from harness.commands import application
from harness.demonstrations import guided
from lab.export.test_mcap import kept

OPENING = Open(session="s1", columns=("t", "px", "py", "pz"))
WIPE = Description(task="wipe", operator="Ann")
RENAMED = WIPE.model_copy(update={"task": "wipe the table"})
FULL = Description(
    task='wipe: "桥" #1', operator="Ann", note="too fast, again", tags=("wet", 'a,b "c"'), success=False
)


def description_of(*messages: object) -> Description:
    one = np.array([[0.0, 0.1, 0.2, 0.3]])
    first: SampleBatch = pack_samples(one, OPENING.columns, session="s1", epoch=0, seq=0)
    opening, *later = messages
    return recording_of(
        Record("cell-1", "s1", float(i), message) for i, message in enumerate((opening, first, *later))
    ).description


def test_a_session_of_an_older_journal_has_none():
    assert description_of(OPENING, Close(session="s1", last_seq=0)) == Description()


def test_changes_count_in_their_order_and_a_bridge_that_opens_again_changes_nothing():
    opening = OPENING.model_copy(update={"description": WIPE})
    change = Describe(session="s1", author="Ann", before=WIPE, description=RENAMED)
    again = opening.model_copy(update={"epoch": 1})
    closing = Close(session="s1", last_seq=0, success=True)
    assert description_of(opening, change, again) == RENAMED
    succeeded = RENAMED.model_copy(update={"success": True})
    assert description_of(opening, change, again, closing) == succeeded
    doubted = succeeded.model_copy(update={"success": None})
    undone = Describe(session="s1", author="Ann", before=succeeded, description=doubted)
    assert description_of(opening, change, closing, undone) == doubted


@pytest.mark.parametrize("suffix", ["mcap", "npz", "csv"])
def test_every_file_of_a_session_has_its_description(tmp_path: Path, suffix: str):
    """npz had none, and no reader read that of an MCAP: a demonstration that failed was one of none."""
    taught = read_session_export(kept(guided(), description=FULL), "cell-1", "s1")
    file = tmp_path / f"s1.{suffix}"
    if suffix == "mcap":
        write_mcap(file, taught)
    elif suffix == "npz":
        taught.recording.save(file)
    else:
        write_csv(file, taught.recording)
    read = load_recording(file)
    assert (read.description, read.ignored) == (FULL, ())
    copy = tmp_path / f"copy.{suffix}"
    assert CliRunner().invoke(application(), ["export", str(file), "-o", str(copy)]).exit_code == 0
    assert load_recording(copy).description == FULL
    assert FileSource(read).description == FULL


def test_a_dataset_has_the_descriptions_of_its_files(tmp_path: Path):
    replace(guided(), description=FULL).save(tmp_path / "a.npz")
    command = ["export", str(tmp_path / "a.npz"), "-o", str(tmp_path / "set"), "--format", "lerobot"]
    done = CliRunner().invoke(application(), command)
    assert done.exit_code == 0, done.output
    (one,) = json.loads((tmp_path / "set" / "meta" / "caesura.json").read_text(encoding="utf-8"))
    stated = {"task": FULL.task, "operator": "Ann", "note": FULL.note, "tags": [*FULL.tags], "success": False}
    assert one["description"] == stated
    info = json.loads((tmp_path / "set" / "meta" / "info.json").read_text(encoding="utf-8"))
    assert "next.success" in info["features"]


def test_a_dataset_of_a_session_has_its_description(tmp_path: Path):
    write_sessions(tmp_path / "set", [read_session_export(kept(guided(), description=WIPE), "cell-1", "s1")])
    (one,) = json.loads((tmp_path / "set" / "meta" / "caesura.json").read_text(encoding="utf-8"))
    assert one["description"] == {"task": "wipe", "operator": "Ann"}


def test_what_other_software_means_by_these_names_is_listed_as_ignored(tmp_path: Path):
    one = guided()
    other = {
        "task": np.arange(3),
        "success": np.array("half"),
        "tags": np.array("a, b"),
        "note": np.array(""),
    }
    np.savez(tmp_path / "other.npz", t=one.t, pos=one.signals["pos"], operator=np.array("Bo"), **other)
    read = load_recording(tmp_path / "other.npz")
    assert read.description == Description(operator="Bo")
    assert sorted(read.ignored) == ["note", "success", "tags", "task"]
    np.savez(tmp_path / "plain.npz", t=one.t, pos=one.signals["pos"], success=np.array(True))
    assert load_recording(tmp_path / "plain.npz").description.success is True


def test_unstored_samples_keep_the_description_of_their_session(tmp_path: Path):
    journal = kept(guided(), description=FULL)
    opening, *rest = (record.message for record in journal.replay("cell-1", "s1"))
    batches = [one for one in rest if isinstance(one, SampleBatch)]
    assert isinstance(opening, Open)
    path = save_unstored(
        "cell-1", opening, [StoredBatch(one.seq, 0.0, 20, encode(one)) for one in batches], tmp_path
    )
    assert load_recording(path).description == FULL
