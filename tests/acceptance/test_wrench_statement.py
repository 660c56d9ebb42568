"""What is stated of the wrench and of the hand, at the wire, in files and on the command line."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import msgpack
import numpy as np
import pytest
from typer.testing import CliRunner

from caesura_clients.bridge.bridge import Bridge
from caesura_clients.bridge.sources.file import FileSource
from caesura_clients.bridge.sources.registry import SourceOptions, open_source
from caesura_clients.full_samples import read_recording
from caesura_clients.query import snapshot
from caesura_clients.recorder import Recorder
from caesura_clients.session_state_reader import Update
from caesura_protocol.codec import decode, encoding_of, pack_samples
from caesura_protocol.errors import CaesuraError, ProtocolError, SourceError
from caesura_protocol.formats.read import load_recording
from caesura_protocol.formats.write import WRITERS
from caesura_protocol.messages import Open, SampleBatch, Snapshot, WrenchReport
from caesura_protocol.recording import ASSUMED_FRAME, Recording, RecordingError
from caesura_protocol.transport.zenoh_transport import ZenohTransport
from caesura_service.app import Service
from caesura_service.config import ServiceConfig
from caesura_service.journal import Record
from caesura_service.offline_segmentation import opening_of, recording_of, segment_recording
from clients.conftest import free_port
from harness.commands import application
from harness.demonstrations import guided
from harness.peer import Peer

DATA = Path(__file__).parents[2] / "data"
ASSUMED = (
    "assumed: the recording does not state its wrench source; contact and load are off. "
    "State it with --wrench-source"
)
NOTED = ASSUMED.replace("State it with --wrench-source", "State the wrench source.")  # where a page reads it
ESTIMATE = "joint_torque_estimate"


def caesura(*words: object):
    return CliRunner().invoke(application(), [str(word) for word in words], env={"COLUMNS": "300"})


def stating(source: str | None, hand: str = "unknown") -> Recording:
    return replace(guided(), wrench_source=source, hand_on_robot=hand)  # type: ignore[arg-type]


def silent(recording: Recording, path: Path) -> Path:
    """The recording as a file that states neither source nor hand."""
    replace(recording, wrench_source=None, hand_on_robot="unknown").save(path)
    assert {"wrench_source", "hand_on_robot"}.isdisjoint(np.load(path).files)
    return path


# --- at the wire ----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def endpoint() -> Iterator[str]:
    with Service(ServiceConfig(instance="test-1", listen="tcp/127.0.0.1:0")) as service:
        yield service.endpoint


def taught(endpoint: str, recording: Recording, session: str) -> Snapshot:
    """Play a recording to the service and read its results."""
    with ZenohTransport(endpoint, timeout_s=20.0) as transport:
        with Bridge(transport, "cell-1", FileSource(recording, pace=math.inf), session=session) as bridge:
            bridge.run()
        return snapshot(transport, "cell-1", session)


@pytest.mark.parametrize(
    ("source", "hand", "contact"),
    [
        ("flange_sensor", "yes", True),
        ("flange_sensor", "no", True),
        ("flange_sensor", "unknown", True),
        ("flange_sensor_with_hand", "yes", False),
        (ESTIMATE, "yes", False),
        (ESTIMATE, "unknown", False),
        (ESTIMATE, "no", True),
        ("none", "no", False),
    ],
)
def test_what_is_stated_decides_whether_contact_and_load_are_on(endpoint, source, hand, contact):
    found = taught(endpoint, stating(source, hand), f"s-{source}-{hand}")
    wrench = found.status.wrench
    assert (wrench.source, wrench.stated, wrench.hand_on_robot) == (source, True, hand)
    assert (wrench.contact_models, wrench.transport_models) == (contact, contact)
    assert ("contact" in {segment.contact for segment in found.segments.segments}) is contact
    assert wrench.note.startswith(f"Wrench source {source}: ")
    assert "assumed" not in wrench.note
    assert found.program.notes[0] in wrench.note


def test_an_unstated_source_is_reported_as_assumed_and_contact_and_load_are_off(endpoint):
    found = taught(endpoint, stating(None), "s-unstated")
    wrench = found.status.wrench
    assert (wrench.source, wrench.stated, wrench.hand_on_robot) == (
        "flange_sensor_with_hand",
        False,
        "unknown",
    )
    assert not wrench.contact_models
    assert not wrench.transport_models
    assert NOTED in wrench.note
    assert NOTED in found.program.notes[0]
    assert {segment.contact for segment in found.segments.segments} == {"free"}
    assert not [segment for segment in found.segments.segments if segment.load_kg is not None]


def test_an_unstated_source_without_force_is_none(endpoint):
    whole = guided()
    found = taught(endpoint, Recording(whole.t, {"pos": whole.signals["pos"]}), "s-bare")
    assert (found.status.wrench.source, found.status.wrench.stated) == ("none", False)
    assert "assumed" in found.status.wrench.note


def test_an_opening_that_contradicts_itself_is_refused_with_the_alternatives(endpoint):
    opening = opening_of(stating("flange_sensor_with_hand")).model_copy(
        update={"session": "s-contradiction", "hand_on_robot": "no"}
    )
    with Peer(endpoint) as peer, pytest.raises(ProtocolError) as refused:
        peer.command(opening)
    assert (refused.value.code, refused.value.value) == ("malformed", "no")
    for word in ("hand_on_robot is 'no'", "flange_sensor_with_hand", "flange_sensor", ESTIMATE):
        assert word in str(refused.value)


def test_a_bridge_refuses_a_source_that_contradicts_itself(endpoint):
    source = FileSource(stating("flange_sensor_with_hand"))
    source.hand_on_robot = "no"
    with (
        ZenohTransport(endpoint, timeout_s=20.0) as transport,
        pytest.raises(SourceError, match="contradicts"),
    ):
        Bridge(transport, "cell-1", source)


def test_messages_of_before_the_statement_are_still_read():
    said = {"type": "open", "session": "s1", "epoch": 0, "columns": ["t", "px"], "wrench_source": "none"}
    opening = decode(msgpack.packb(said), encoding_of(Open), Open)
    assert (opening.wrench_source, opening.hand_on_robot, opening.up) == ("none", "unknown", None)
    reported = {
        "source": "none",
        "contact_models": False,
        "transport_models": False,
        "tare": None,
        "note": "",
    }
    report = decode(msgpack.packb(reported), encoding_of(WrenchReport), WrenchReport)
    assert (report.stated, report.hand_on_robot, report.up) == (True, "unknown", None)


def test_a_recorded_session_states_what_the_session_stated(endpoint):
    for source, hand in ((None, "unknown"), (ESTIMATE, "no")):
        name = f"s-recorded-{hand}"
        found = taught(endpoint, stating(source, hand), name)
        recorder = Recorder(name)
        recorder.add_batch(batch_of(stating(source, hand), name))
        kept = recorder.recording(found)
        assert (kept.wrench_source, kept.hand_on_robot) == (source, hand)


def batch_of(recording: Recording, session: str) -> SampleBatch:
    """The first batch of a recording."""
    return pack_samples(recording.matrix()[:20], recording.columns, session=session, epoch=0, seq=0)


# --- files ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".npz", ".csv"])
def test_what_is_stated_survives_a_file_and_what_is_not_stated_is_not_written(tmp_path, suffix):
    for stated in (stating(ESTIMATE, "no"), stating("flange_sensor"), stating(None)):
        WRITERS[suffix](tmp_path / f"a{suffix}", stated)
        read = load_recording(tmp_path / f"a{suffix}")
        assert (read.wrench_source, read.hand_on_robot) == (stated.wrench_source, stated.hand_on_robot)
    assert b"unknown" not in (tmp_path / f"a{suffix}").read_bytes()


def test_a_file_without_force_needs_no_statement(tmp_path):
    whole = guided()
    Recording(whole.t, {"pos": whole.signals["pos"]}).save(tmp_path / "a.npz")
    assert load_recording(tmp_path / "a.npz").wrench_source == "none"


@pytest.mark.parametrize(
    ("stated", "expected"),
    [
        ({"wrench_source": "guess"}, "'guess', expected one of .*flange_sensor_with_hand"),
        ({"hand_on_robot": "maybe"}, "'maybe', expected one of yes, no, unknown"),
        ({"wrench_source": "flange_sensor_with_hand", "hand_on_robot": "no"}, "contradicts"),
    ],
)
def test_a_recording_with_a_wrong_statement_is_refused(stated, expected):
    with pytest.raises(RecordingError, match=expected):
        replace(guided(), **stated)


def test_arguments_override_what_a_file_states(tmp_path):
    stating(ESTIMATE, "yes").save(tmp_path / "a.npz")
    assert load_recording(tmp_path / "a.npz", hand_on_robot="no").hand_on_robot == "no"


def test_a_mapping_states_both(tmp_path):
    (tmp_path / "log.csv").write_text("t,x,y,z,f,g,h\n" + "\n".join(f"{i},0,0,0,1,2,3" for i in range(3)))
    (tmp_path / "log.toml").write_text(
        f'wrench_source = "{ESTIMATE}"\nhand_on_robot = "no"\n[time]\ncolumn = "t"\n'
        '[columns]\npx = "x"\npy = "y"\npz = "z"\nfx = "f"\nfy = "g"\nfz = "h"\n'
    )
    read = load_recording(tmp_path / "log.csv", mapping=tmp_path / "log.toml")
    assert (read.wrench_source, read.hand_on_robot) == (ESTIMATE, "no")


@pytest.mark.parametrize("file", sorted(DATA.glob("*.npz")), ids=lambda path: path.stem)
def test_the_repositorys_recordings_state_source_and_hand(file):
    read = load_recording(file)
    assert (read.wrench_source, read.hand_on_robot) == ("flange_sensor", "yes")


def test_a_session_of_the_journal_states_what_its_opening_stated():
    for source, hand in ((None, "unknown"), (ESTIMATE, "no")):
        opening = opening_of(stating(source, hand))
        records = [
            Record("cell-1", "file", 0.0, opening),
            Record("cell-1", "file", 0.0, batch_of(stating(source, hand), "file")),
        ]
        read = recording_of(records)
        assert (read.wrench_source, read.hand_on_robot) == (source, hand)


# --- command line ---------------------------------------------------------------------------------------


def test_segment_says_assumed_where_the_file_states_nothing(tmp_path):
    file = silent(load_recording(DATA / "button.npz"), tmp_path / "silent.npz")
    done = caesura("segment", file, "--json", tmp_path / "out.json")
    assert done.exit_code == 0, done.output
    assert ASSUMED in " ".join(done.output.split())
    found = json.loads((tmp_path / "out.json").read_text())
    assert not found["wrench"]["stated"]
    assert {one["contact"] for one in found["segments"]} == {"free"}
    stated = caesura("segment", file, "--wrench-source", "flange_sensor", "--hand-on-robot", "yes")
    assert "Wrench source flange_sensor: " in stated.output
    assert "assumed" not in stated.output
    assert "contact" in stated.output


def test_segment_turns_contact_on_for_an_estimate_without_a_hand(tmp_path):
    stating(ESTIMATE).save(tmp_path / "a.npz")
    out = tmp_path / "out.json"
    for options, contact in (((), False), (("--hand-on-robot", "no"), True)):
        done = caesura("segment", tmp_path / "a.npz", *options, "--json", out)
        assert done.exit_code == 0, done.output
        assert json.loads(out.read_text())["wrench"]["contact_models"] is contact


@pytest.mark.parametrize("command", ["segment", "report", "export", "bridge", "doctor"])
def test_a_command_refuses_a_wrong_statement_with_the_valid_ones(tmp_path, command):
    file = silent(guided(), tmp_path / "silent.npz")
    words = {
        "report": (file, "-o", tmp_path / "a.html"),
        "export": (file, "-o", tmp_path / "a.csv"),
        "bridge": ("--source", "file", "--file", file),
        "doctor": ("--file", file),
    }.get(command, (file,))
    done = caesura(command, *words, "--wrench-source", "none", "--hand-on-robot", "maybe")
    assert done.exit_code == 1
    assert "error: --hand-on-robot is 'maybe', expected one of yes, no, unknown" in done.output


def without_frame(path: Path) -> Path:
    """A recording as a file that states no frame of its force, and an order of its quaternions."""
    recording = guided()
    turned = np.tile([1.0, 0.0, 0.0, 0.0], (recording.t.size, 1))  # a flange that points down
    stated = replace(recording, signals={**recording.signals, "quat": turned}, wrench_source="flange_sensor")
    stated.save(path)
    kept = {key: value for key, value in np.load(path).items() if key != "force_frame"}
    np.savez(path, **kept)
    return path


def test_the_frame_of_a_force_is_stated_on_the_command_line(tmp_path):
    # Who had such a file had to write it anew.
    file = without_frame(tmp_path / "a.npz")
    out = tmp_path / "out.json"
    for options, frame in (((), "base"), (("--force-frame", "flange"), "flange")):
        done = caesura("segment", file, *options, "--json", out)
        assert done.exit_code == 0, done.output
        assert json.loads(out.read_text())["wrench"]["frame"] == frame
        assert ("Frame of the force: base, assumed" in done.output) == (frame == "base")
        copy = tmp_path / "b.npz"
        assert caesura("export", file, "-o", copy, *options).exit_code == 0
        assert ("force_frame" in np.load(copy).files) == (frame == "flange")
    source = open_source("file", SourceOptions(file=file, force_frame="flange"))
    assert source.force_frame == "flange"


@pytest.mark.parametrize(
    "command", ["segment", "report", "export", "bridge", "doctor", "annotate", "evaluate"]
)
def test_a_command_refuses_a_frame_that_the_file_contradicts(tmp_path, command):
    file = tmp_path / "a.npz"
    guided().save(file)
    (tmp_path / "a.ann.json").write_text(json.dumps({"window": [0, 5], "changepoints": []}))
    words = {
        "report": (file, "-o", tmp_path / "a.html"),
        "export": (file, "-o", tmp_path / "a.csv"),
        "bridge": ("--source", "file", "--file", file),
        "doctor": ("--file", file),
        "annotate": (file, "--port", free_port()),
    }.get(command, (file,))
    done = caesura(command, *words, "--force-frame", "flange")
    assert done.exit_code == 1
    assert "--force-frame flange does not fit a.npz: it states base" in done.output


def test_what_is_assumed_of_a_file_is_in_the_program_of_its_session(endpoint, tmp_path):
    # The bridge said so on its own terminal: session, dashboard and check knew nothing of it.
    file = without_frame(tmp_path / "a.npz")
    assumed = load_recording(file).assumed
    assert assumed == (ASSUMED_FRAME,)
    notes = taught(endpoint, load_recording(file), "s-assumed").program.notes
    assert [one for one in notes if one in assumed] == [ASSUMED_FRAME]
    assert notes == segment_recording(load_recording(file)).notes, "as from the file"
    stated = load_recording(file, force_frame="base")
    assert ASSUMED_FRAME not in taught(endpoint, stated, "s-stated").program.notes


def test_a_session_of_the_journal_does_not_state_what_was_assumed(tmp_path):
    recording = load_recording(without_frame(tmp_path / "a.npz"))
    opening = opening_of(recording)
    assert opening.assumed == ("force_frame",)
    records = [Record("cell-1", "file", 0.0, one) for one in (opening, batch_of(recording, "file"))]
    assert recording_of(records).assumed == (ASSUMED_FRAME,)
    assert "force_frame" not in recording_of(records).stated_options


def test_a_recorded_session_does_not_state_a_frame_that_was_assumed(endpoint, tmp_path):
    file = without_frame(tmp_path / "a.npz")
    for frame, stated in ((None, False), ("flange", True)):
        recording = load_recording(file, force_frame=frame)
        name = f"s-frame-{frame}".lower()
        found = taught(endpoint, recording, name)
        assert found.status.wrench.frame_stated is stated
        recorder = Recorder(name)
        recorder.add_batch(batch_of(recording, name))
        assert ("force_frame" in recorder.recording(found).stated_options) is stated
        with ZenohTransport(endpoint, timeout_s=20.0) as transport:
            update = Update(found.status, (), (), None, found.program)
            assert ("force_frame" in read_recording(transport, update).stated_options) is stated


def test_an_assumption_of_another_name_is_refused(endpoint):
    opening = opening_of(guided()).model_dump() | {"session": "s-wrong", "assumed": ["hand"]}
    with Peer(endpoint) as peer, pytest.raises(ProtocolError, match="assumed"):
        peer.command(Open.model_construct(**opening))


def test_a_live_source_states_its_frame_itself():
    with pytest.raises(SourceError, match="force_frame is 'flange', expected 'base', which the source"):
        open_source("teacher", SourceOptions(scenario="button", force_frame="flange"))


def test_a_report_says_assumed(tmp_path):
    file = silent(guided(), tmp_path / "silent.npz")
    done = caesura("report", file, "-o", tmp_path / "a.html")
    assert done.exit_code == 0, done.output
    html = (tmp_path / "a.html").read_text()
    assert NOTED in html
    assert "wrench flange_sensor_with_hand (assumed)" in html


def test_an_exported_file_states_no_more_than_was_stated(tmp_path):
    file = silent(guided(), tmp_path / "silent.npz")
    for out in ("a.npz", "a.csv", "a.mcap"):
        assert caesura("export", file, "-o", tmp_path / out).exit_code == 0
        assert load_recording(tmp_path / out).wrench_source is None
        options = ("--wrench-source", ESTIMATE, "--hand-on-robot", "no")
        assert caesura("export", file, "-o", tmp_path / out, *options).exit_code == 0
        read = load_recording(tmp_path / out)
        assert (read.wrench_source, read.hand_on_robot) == (ESTIMATE, "no")


def test_the_doctor_says_what_a_file_states(tmp_path):
    file = silent(guided(), tmp_path / "silent.npz")
    assert ASSUMED in caesura("doctor", "--file", file).output
    stated = caesura("doctor", "--file", file, "--wrench-source", "flange_sensor", "--hand-on-robot", "yes")
    assert "source flange_sensor, hand on the robot: yes; contact and load are on" in stated.output
    assert "assumed" not in stated.output
    off = caesura("doctor", "--file", file, "--wrench-source", ESTIMATE)
    assert "contact and load are off" in off.output
    assert "--hand-on-robot no" in off.output


def test_the_bridge_asks_where_the_wrench_of_a_file_is_measured(tmp_path):
    file = silent(guided(), tmp_path / "silent.npz")
    done = caesura("bridge", "--source", "file", "--file", file, "--connect", "tcp/127.0.0.1:1")
    assert done.exit_code == 1
    for word in ("where is this wrench measured?", "--wrench-source", ESTIMATE, "flange_sensor_with_hand"):
        assert word in done.output
    with pytest.raises(CaesuraError, match="where is this wrench measured"):
        open_source("file", SourceOptions(file=file))
    source = open_source("file", SourceOptions(file=file, wrench_source=ESTIMATE, hand_on_robot="no"))
    assert (source.wrench_source, source.hand_on_robot) == (ESTIMATE, "no")


def test_the_bridge_plays_a_file_without_force_and_without_a_statement(tmp_path):
    whole = guided()
    Recording(whole.t, {"pos": whole.signals["pos"]}).save(tmp_path / "a.npz")
    assert open_source("file", SourceOptions(file=tmp_path / "a.npz")).wrench_source == "none"


def test_the_simulated_teacher_states_source_and_hand():
    pytest.importorskip("pinocchio")
    for options, hand in ((SourceOptions(), "yes"), (SourceOptions(hand_on_robot="unknown"), "unknown")):
        source = open_source("teacher", options)
        assert (source.wrench_source, source.hand_on_robot) == ("flange_sensor", hand)
    with pytest.raises(SourceError, match="'maybe', expected one of yes, no, unknown"):
        open_source("teacher", SourceOptions(hand_on_robot="maybe"))


def test_a_file_says_the_same_as_a_session(endpoint):
    for source, hand in ((None, "unknown"), (ESTIMATE, "no")):
        recording = stating(source, hand)
        live = taught(endpoint, recording, f"s-same-{hand}")
        assert segment_recording(recording).wrench == live.status.wrench
