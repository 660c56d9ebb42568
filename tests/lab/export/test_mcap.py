"""An exported session, read back with the reader that other tools use."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jsonschema import Draft202012Validator
from mcap.reader import make_reader

from caesura_lab.export.mcap_file import entries, write_mcap
from caesura_lab.export.session_from_journal import read_session_export
from caesura_protocol.codec import pack_samples
from caesura_protocol.formats.mcap_schemas import CHANNELS, schema_of
from caesura_protocol.formats.mcap_write import UPRIGHT
from caesura_protocol.messages import (
    Ack,
    App,
    Changepoint,
    Close,
    Description,
    Edit,
    EditProgram,
    Error,
    Gap,
    Insert,
    InsertApp,
    NameProgram,
    Open,
    Segment,
)
from caesura_protocol.recording import Recording, RecordingError
from caesura_service.journal import Journal, MemoryJournal, Record
from caesura_service.offline_segmentation import BATCH_SAMPLES, opening_of, segment_recording
from caesura_service.ownership.registry import Registry
from caesura_service.publishing.session_state import program_of
from caesura_service.segmentation.pipeline import make_pipeline
from caesura_service.sessions.limits import Limits
from harness.demonstrations import guided
from harness.sessions import OWNER, answer, new_registry

BEGAN = 1_773_480_413.25  # [s] time of day at session time 0
TRAVEL = 0.0625  # [s] of the batch that was quickest
NS = 10**9


def kept(
    recording: Recording, *, lost: range = range(0), closed: bool = True, **fields: Any
) -> MemoryJournal:
    """The journal of a service that was taught a recording, but for what was lost on the way."""
    journal = MemoryJournal()
    opening = opening_of(recording, "default").model_copy(update={"session": "s1", **fields})
    journal.append(Record("cell-1", "s1", BEGAN, opening))
    matrix = recording.matrix()
    starts = list(enumerate(range(0, len(matrix), BATCH_SAMPLES)))
    for seq, first in starts:
        rows = matrix[first : first + BATCH_SAMPLES]
        at = BEGAN + float(rows[-1, 0]) + TRAVEL + 0.03 * (seq % 5)
        if seq == lost.stop and lost:
            journal.append(
                Record("cell-1", "s1", at, Error(code="evicted", message="lost", value=lost.start, limit=seq))
            )
        if seq not in lost:
            batch = pack_samples(rows, recording.columns, session="s1", epoch=0, seq=seq)
            journal.append(Record("cell-1", "s1", at, batch))
    if closed:
        journal.append(Record("cell-1", "s1", at, Close(session="s1", last_seq=starts[-1][0])))
    return journal


@dataclass
class File:
    """What stands in an MCAP file."""

    messages: dict[str, list[tuple[int, dict[str, Any]]]]  # by topic: log time [ns], message
    schemas: dict[str, tuple[str, dict[str, Any]]]  # by topic: name, JSON Schema
    metadata: dict[str, str]

    def of(self, topic: str) -> list[dict[str, Any]]:
        return [message for _, message in self.messages[topic]]


def read(path: Path) -> File:
    file = File({topic: [] for topic in CHANNELS}, {}, {})
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        for schema, channel, message in reader.iter_messages():
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            file.schemas[channel.topic] = (schema.name, json.loads(schema.data))
            file.messages[channel.topic].append((message.log_time, json.loads(message.data)))
        (found,) = reader.iter_metadata()
        file.metadata = found.metadata
    return file


def exported(journal: Journal, directory: Path) -> File:
    write_mcap(directory / "s1.mcap", read_session_export(journal, "cell-1", "s1"))
    assert [path.name for path in directory.iterdir()] == ["s1.mcap"]
    return read(directory / "s1.mcap")


@pytest.fixture(scope="module")
def recording() -> Recording:
    made = guided()
    rng = np.random.default_rng(1)
    turned = np.tile([1.0, 0.0, 0.0, 0.0], (made.t.size, 1)) + 1e-3 * rng.standard_normal((made.t.size, 4))
    return replace(
        made, signals={**made.signals, "quat": turned, "gripper": rng.random((made.t.size, 1)) / 20}
    )


@pytest.fixture(scope="module")
def file(recording: Recording, tmp_path_factory: pytest.TempPathFactory) -> File:
    return exported(kept(recording), tmp_path_factory.mktemp("mcap"))


def test_every_sample_comes_back_bit_for_bit(recording: Recording, file: File):
    taught = read_session_export(kept(recording), "cell-1", "s1").recording
    states, wrenches = file.of("/state"), file.of("/wrench")
    for name in ("pos", "quat"):
        assert np.array_equal([one[name] for one in states], taught.signals[name])
    assert np.array_equal([one["gripper"] for one in states], taught.signals["gripper"][:, 0])
    assert np.array_equal([one["force"] for one in wrenches], taught.signals["force"])
    for found in (states, wrenches):
        assert np.array_equal([one["t"] for one in found], taught.t)
    for name, values in recording.signals.items():
        assert np.array_equal(taught.signals[name], values)


def test_the_results_are_those_of_the_session(recording: Recording, file: File):
    view = segment_recording(recording)
    assert [Segment.model_validate({**NOTHING, **one}) for one in file.of("/segments")] == list(view.segments)
    assert [Changepoint.model_validate(one) for one in file.of("/changepoints")] == list(view.changepoints)
    (program,) = file.of("/program")
    assert [App.model_validate({**NOTHING, **one}) for one in program["apps"]] == list(view.apps)
    assert program["complete"]
    note, fingers = program["notes"]
    assert fingers.startswith("Taught and in no app: the fingers")  # whose opening is noise here
    assert note.startswith("Wrench source flange_sensor: ")


EDITS = (
    Edit(session="s1", revision=0, author="Ann", action=Insert(t=2.0)),
    EditProgram(session="s1", revision=0, author="Ann", action=NameProgram(name="Press")),
    EditProgram(
        session="s1",
        revision=1,
        author="Ann",
        action=InsertApp(after=None, kind="cartesian_motion", target=(0.4, 0.0, 0.4)),
    ),
)


@pytest.mark.parametrize("outcome", ["none", "before the edits", "after them"])
def test_the_program_is_the_one_that_people_edited(outcome: str, tmp_path: Path):
    """The inferred apps were exported, without a word; and those before a correction that a kill followed."""
    journal = kept(guided(), closed=outcome != "none")
    registry = Registry(
        owner=OWNER,
        pipeline_factory=make_pipeline,
        default_preset="default",
        journal=journal,
        limits=Limits(),
    )
    registry.restore()
    before = journal.outcome("cell-1", "s1")
    for edit in EDITS:
        assert isinstance(answer(registry.handle_command("cell-1", edit, BEGAN + 60.0)), Ack)
    if outcome == "before the edits":
        journal.store_outcome("cell-1", before)
    (state,) = registry.index.all_states()
    shown = program_of(state)
    file = exported(journal, tmp_path)
    (program,) = file.of("/program")
    Draft202012Validator(schema_of("/program")).validate(program)
    made = [(one["kind"], one["t0"], one["tn"], one.get("added")) for one in program["apps"]]
    assert made == [(one.kind, one.t0, one.tn, one.added) for one in shown.apps]
    assert made[0][3] == 2
    assert (program["name"], program["edit_revision"]) == ("Press", 2)
    assert len(file.of("/segments")) == len(state.view.segments)


# What is left out of a file because it is None.
NOTHING = dict.fromkeys(
    (
        "runner_up",
        "force_held",
        "load_kg",
        "load_sd_kg",
        "target",
        "orientation",
        "joints",
        "force",
        "force_taught",
        "gripper_width",
    )
)


def test_every_message_is_as_its_schema_says(file: File):
    assert set(file.schemas) == set(CHANNELS) - {"/gaps"}
    for topic, (name, schema) in file.schemas.items():
        assert (name, schema) == (CHANNELS[topic][0], schema_of(topic))
        Draft202012Validator.check_schema(schema)
        validator = Draft202012Validator(schema)
        for _, message in file.messages[topic]:
            validator.validate(message)
    wrong = Draft202012Validator(schema_of("/segments"))
    assert not wrong.is_valid({**file.of("/segments")[0], "position_end": [0.0, 0.0]})


def fields_of(schema: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Every schema of a value below a schema."""
    for field in schema["properties"].values():
        inner = field["items"] if field["type"] == "array" else field
        yield inner
        if inner["type"] == "object":
            yield from fields_of(inner)


@pytest.mark.parametrize("topic", CHANNELS)
def test_schemas_keep_to_what_viewers_read(topic: str):
    """Foxglove's reader knows objects with properties, scalars, and arrays of either; nothing else."""
    schema = schema_of(topic)
    assert schema["type"] == "object"
    for field in fields_of(schema):
        assert field["type"] in {"object", "number", "integer", "string", "boolean"}
    words = json.dumps(schema)
    for word in ("$ref", "anyOf", "oneOf", "prefixItems", "null"):
        assert f'"{word}"' not in words


def test_log_times_are_the_times_of_day_of_the_samples_and_of_what_they_are_about(
    recording: Recording, file: File
):
    zero = round((BEGAN + TRAVEL) * NS)
    for topic in ("/state", "/wrench"):
        for when, message in file.messages[topic]:
            assert abs(when - zero - round(message["t"] * NS)) <= 1000
    for topic, key in (("/segments", "t0"), ("/changepoints", "t")):
        for when, message in file.messages[topic]:
            assert abs(when - zero - round(message[key] * NS)) <= 1000
    assert file.messages["/program"][0][0] == max(when for when, _ in file.messages["/state"])


def test_a_panel_can_draw_the_flange_and_its_path(recording: Recording, file: File):
    frames, (path,) = file.messages["/tf"], file.of("/path")
    times = np.array([when for when, _ in frames])
    assert (np.diff(times) >= 0.0099 * NS).all()
    for when, frame in frames:
        assert frame["timestamp"]["sec"] * NS + frame["timestamp"]["nsec"] == when
        assert (frame["parent_frame_id"], frame["child_frame_id"]) == ("base", "flange")
    drawn = np.array([[frame["translation"][axis] for axis in "xyz"] for _, frame in frames])
    there = {
        tuple(row)
        for row in read_session_export(kept(recording), "cell-1", "s1").recording.signals["pos"].tolist()
    }
    assert {tuple(row) for row in drawn.tolist()} <= there
    norms = [sum(frame["rotation"][axis] ** 2 for axis in "xyzw") for _, frame in frames]
    np.testing.assert_allclose(norms, 1.0)
    assert 0.09 <= (recording.t[-1] - recording.t[0]) / len(path["poses"]) <= 0.11


def test_the_metadata_says_what_the_numbers_are(file: File):
    assert file.metadata["station"] == "cell-1"
    for key, value in (("session", "s1"), ("preset", "default"), ("wrench_source", "flange_sensor")):
        assert file.metadata[key] == value
    assert float(file.metadata["began_s"]) == pytest.approx(BEGAN + TRAVEL, abs=1e-6)
    assert {"length_unit", "force_frame", "units", "clock", "columns"} <= set(file.metadata)


def test_the_metadata_has_what_operators_state(recording: Recording, tmp_path: Path):
    # A file of a session lost its task, its operator and whether it had succeeded.
    described = {"task": "wipe", "operator": "Ann", "tags": ("wet",), "success": False}
    file = exported(kept(recording, description=Description(**described)), tmp_path)
    found = {key: file.metadata[key] for key in described}
    assert found == {"task": "wipe", "operator": "Ann", "tags": '["wet"]', "success": "false"}
    assert not {"task", "note", "success"} & set(exported(kept(recording), tmp_path).metadata)


def test_an_orientation_that_was_not_recorded_is_not_passed_off_as_one(recording: Recording, tmp_path: Path):
    left = {name: values for name, values in recording.signals.items() if name not in {"quat", "q"}}
    file = exported(kept(replace(recording, signals=left)), tmp_path)
    assert {tuple(frame["rotation"].values()) for frame in file.of("/tf")} == {UPRIGHT}
    assert file.metadata["orientation"] == "not recorded: /tf and /path show the axes of the base"
    assert "orientation" not in exported(kept(recording), tmp_path).metadata


def test_what_was_lost_is_there_as_a_gap_and_in_the_programs_notes(recording: Recording, tmp_path: Path):
    file = exported(kept(recording, lost=range(30, 40)), tmp_path)
    (gap,) = [Gap.model_validate(one) for one in file.of("/gaps")]
    assert gap.reason == "evicted"
    assert gap.tn - gap.t0 == pytest.approx(1.005)
    assert any("samples were lost" in note for note in file.of("/program")[0]["notes"])


def test_an_open_session_is_exported_as_far_as_it_has_come(recording: Recording, tmp_path: Path):
    file = exported(kept(recording, closed=False), tmp_path)
    assert not file.of("/program")[0]["complete"]
    assert file.of("/segments")[-1]["certainty"] == "provisional"


def test_what_was_kept_of_a_closed_session_is_not_reckoned_again(recording: Recording, tmp_path: Path):
    journal = kept(guided(), preset="fake")
    new_registry(journal).restore()  # with the fake pipeline; keeps how the session ended
    assert journal.outcome("cell-1", "s1") is not None
    file = exported(journal, tmp_path)
    assert {one["kind"] for one in file.of("/segments")} == {"motion"}


def test_millimetres_stay_what_they_are_and_are_drawn_in_metres(recording: Recording, tmp_path: Path):
    signals = {**guided().signals, "pos": 1000.0 * guided().signals["pos"]}
    scaled = replace(guided(), signals=signals, length_unit="mm")
    file = exported(kept(scaled), tmp_path)
    assert file.metadata["length_unit"] == "mm"
    assert abs(file.of("/state")[0]["pos"][0] - 300.0) < 2.0
    assert abs(file.of("/tf")[0]["translation"]["x"] - 0.3) < 0.002
    assert file.of("/tf")[0]["rotation"] == {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}


def test_joints_are_drawn_where_they_put_the_flange(tmp_path: Path):
    t = np.arange(100) / 100.0
    q = np.tile([0.0, -0.3, 0.0, -2.0, 0.0, 1.8, 0.8], (100, 1)) + 0.1 * t[:, None]
    file = exported(kept(Recording(t=t, signals={"q": q}, wrench_source="none")), tmp_path)
    assert np.array_equal([one["q"] for one in file.of("/state")], q)
    assert file.of("/wrench") == []
    x, y, z = (file.of("/tf")[0]["translation"][axis] for axis in "xyz")
    assert 0.3 < np.linalg.norm([x, y, z]) < 1.2


def test_what_the_service_refused_is_not_drawn(recording: Recording, tmp_path: Path):
    spoiled = guided()
    positions = spoiled.signals["pos"].copy()
    positions[200] = 1e9
    file = exported(kept(replace(spoiled, signals={**spoiled.signals, "pos": positions})), tmp_path)
    assert max(abs(frame["translation"]["x"]) for frame in file.of("/tf")) < 2.0


def test_times_that_go_back_a_little_are_written_in_order(tmp_path: Path):
    t = guided().t.copy()
    t[100:102] = t[102:99:-2][:2]
    taught = read_session_export(kept(replace(guided(), t=t)), "cell-1", "s1")
    times = [entry.t for entry in entries(taught)]
    assert times == sorted(times)
    assert np.array_equal(
        [entry.fields["t"] for entry in entries(taught) if entry.topic == "/state"], taught.recording.t
    )


def test_a_session_without_samples_cannot_be_exported():
    journal = MemoryJournal()
    journal.append(Record("cell-1", "s1", 0.0, Open(session="s1", columns=("t", "px", "py", "pz"))))
    with pytest.raises(RecordingError, match="no samples"):
        read_session_export(journal, "cell-1", "s1")


def test_a_file_that_cannot_be_finished_leaves_nothing(recording: Recording, tmp_path: Path):
    taught = read_session_export(kept(recording), "cell-1", "s1")
    broken = replace(taught, began_s=-1e12)
    with pytest.raises(Exception, match=r"out of range|format requires"):
        write_mcap(tmp_path / "out.mcap", broken)
    assert list(tmp_path.iterdir()) == []
