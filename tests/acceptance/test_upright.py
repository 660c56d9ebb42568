"""Which way is up: stated on the command line and in files, on the wire, and in the program of a session."""

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
from caesura_clients.bridge.settings import BridgeSettings
from caesura_clients.bridge.sources.file import FileSource
from caesura_clients.bridge.sources.registry import SourceOptions, open_source
from caesura_clients.full_samples import read_recording
from caesura_clients.query import snapshot
from caesura_clients.recorder import Recorder
from caesura_clients.session_state_reader import Update
from caesura_protocol.codec import decode, encoding_of, pack_samples
from caesura_protocol.errors import ProtocolError
from caesura_protocol.formats.read import load_recording
from caesura_protocol.formats.write import WRITERS
from caesura_protocol.messages import Control, SampleBatch
from caesura_protocol.programs.document import read_document
from caesura_protocol.programs.safety import CellSettings
from caesura_protocol.recording import Recording, RecordingError
from caesura_protocol.rotations import upright_rotation
from caesura_protocol.transport.zenoh_transport import ZenohTransport
from caesura_service.app import Service
from caesura_service.config import ServiceConfig
from caesura_service.journal import Record
from caesura_service.offline_segmentation import opening_of, recording_of
from harness.commands import application
from harness.demonstrations import guided
from harness.peer import Peer
from harness.tilted import tilted

DATA = Path(__file__).parents[2] / "data"
CEILING, CEILING_M = (0.0, 0.0, -1.0), 0.9
WRONG = {
    "0,1,1": "up is 0,1,1 of length 1.41421, expected 1 ± 0.001: is it 0,0.707107,0.707107?",
    "0,0,-9.81": "of length 9.81, expected 1 ± 0.001: up points away from gravity: is it 0,0,1? "
    "It is 0,0,-1 where these numbers point away already",
    "0,0,0": "up is 0,0,0 of length 0, expected 1 ± 0.001",
    "nan,0,1": "up is nan,0,1, expected three numbers x,y,z of length 1 ± 0.001",
    "0,1": "up is '0,1', expected three numbers x,y,z of length 1 ± 0.001, or one of x, -x, y, -y, z, -z",
    "down": "up is 'down', expected three numbers x,y,z",
}


def caesura(*words: object):
    return CliRunner().invoke(application(), [str(word) for word in words], env={"COLUMNS": "300"})


def hanging(name: str = "pick_and_place", *, states: bool = True) -> Recording:
    """A recording of an arm that hangs from a ceiling, CEILING_M above the table."""
    turn = upright_rotation(CEILING)
    assert turn is not None
    turned = tilted(load_recording(DATA / f"{name}.npz"), turn.T, CEILING if states else None)
    placed = turned.signals["pos"] + [0.0, 0.0, CEILING_M]
    return replace(turned, signals={**turned.signals, "pos": placed})


# --- command line ---------------------------------------------------------------------------------------


def test_segment_weighs_against_the_direction_that_is_stated(tmp_path):
    # On a hanging arm a carried load read as a contact.
    hanging(states=False).save(tmp_path / "a.npz")
    out = tmp_path / "out.json"
    found = {}
    for options in ((), ("--up", "-z"), ("--up", "0,0,-1")):
        done = caesura("segment", tmp_path / "a.npz", *options, "--json", out)
        assert done.exit_code == 0, done.output
        content = json.loads(out.read_text())
        found[options] = [one["load_kg"] for one in content["segments"] if one["load_kg"]]
        assert content["up"] == (list(CEILING) if options else None)
        assert ("with -z of the base upwards" in " ".join(done.output.split())) is bool(options)
    assert found["--up", "-z"] == found["--up", "0,0,-1"] == pytest.approx([0.2504, 0.2363], abs=1e-3)
    assert found[()] != pytest.approx(found["--up", "-z"], abs=0.1)


@pytest.mark.parametrize("text", WRONG)
@pytest.mark.parametrize("command", ["segment", "report", "export", "bridge", "evaluate", "check"])
def test_a_command_refuses_a_wrong_direction_with_the_limit(tmp_path, command, text):
    file = tmp_path / "a.npz"
    guided().save(file)
    (tmp_path / "a.ann.json").write_text(json.dumps({"window": [0, 5], "changepoints": []}))
    (tmp_path / "program.json").write_text(json.dumps({"program": []}))
    words = {
        "report": (file, "-o", tmp_path / "a.html"),
        "export": (file, "-o", tmp_path / "a.csv"),
        "bridge": ("--source", "file", "--file", file),
        "check": (tmp_path / "program.json",),
    }.get(command, (file,))
    done = caesura(command, *words, "--up", text)
    assert done.exit_code == 1
    assert "error: --up is " in done.output
    assert WRONG[text] in done.output


def test_the_simulated_teacher_stands_upright():
    done = caesura("bridge", "--source", "teacher", "--scenario", "pick_and_place", "--up", "-z")
    assert done.exit_code == 1
    assert "--up is -z, and the simulated teacher's robot stands upright" in done.output


# --- files ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".npz", ".csv", ".mcap"])
def test_the_direction_survives_a_file(tmp_path, suffix):
    up = tuple((np.array([0.3, -0.5, 0.8]) / math.sqrt(0.98)).tolist())
    source, out = tmp_path / "a.npz", tmp_path / f"b{suffix}"
    guided().save(source)
    text = ",".join(map(repr, up))
    done = caesura("export", source, "-o", out, "--up", text)
    assert done.exit_code == 0, done.output
    assert load_recording(out).up == pytest.approx(up, abs=1e-15)
    assert load_recording(source).up is None
    again = tmp_path / f"c{suffix}"
    assert caesura("export", out, "-o", again).exit_code == 0
    assert load_recording(again).up == load_recording(out).up


@pytest.mark.parametrize(
    "stated", [np.array([0, 0, -1]), np.array([0.0, 0.0, -1.0], np.float32), np.array("-z"), np.array(b"-z")]
)
def test_an_archive_has_it_as_numbers_or_as_a_text(tmp_path, stated):
    guided().save(tmp_path / "a.npz")
    np.savez(tmp_path / "b.npz", **np.load(tmp_path / "a.npz"), up=stated)
    assert load_recording(tmp_path / "b.npz").up == CEILING


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        ([0.0, 1.0, 1.0], "up is 0,1,1 of length 1\\.41421, expected 1 ± 0\\.001"),
        ([np.nan, 0.0, 1.0], "up is nan,0,1, expected three numbers"),
        ([[0.0, 0.0, -1.0]], "up has 3 values, expected one"),
        ([0.0, 1.0], "up has 2 values, expected one"),
        (["0", "0", "-1"], "up has 3 values, expected one"),
    ],
)
def test_an_archive_with_a_wrong_direction_is_refused(tmp_path, stated, words):
    guided().save(tmp_path / "a.npz")
    np.savez(tmp_path / "b.npz", **np.load(tmp_path / "a.npz"), up=np.array(stated))
    with pytest.raises(RecordingError, match=words):
        load_recording(tmp_path / "b.npz")


def test_a_long_text_for_a_direction_is_cut_in_the_refusal(tmp_path):
    WRITERS[".csv"](tmp_path / "a.csv", guided())
    (tmp_path / "a.csv").write_text(f"# up: {'9' * 100_000}\n{(tmp_path / 'a.csv').read_text()}")
    with pytest.raises(RecordingError, match="up is '999") as refused:
        load_recording(tmp_path / "a.csv")
    assert len(str(refused.value)) < 500


def test_what_is_not_stated_is_not_written(tmp_path):
    WRITERS[".csv"](tmp_path / "a.csv", guided())
    assert "up" not in (tmp_path / "a.csv").read_text()
    guided().save(tmp_path / "a.npz")
    assert "up" not in np.load(tmp_path / "a.npz").files


@pytest.mark.parametrize("stated", ['"-z"', '"0,0,-1"', "[0, 0, -1]", "[0.0, 0.0, -1.0]"])
def test_a_mapping_states_it(tmp_path, stated):
    file, mapping = log_of(tmp_path, f"up = {stated}")
    assert load_recording(file, mapping=mapping).up == CEILING


def test_a_mapping_with_a_wrong_direction_is_refused(tmp_path):
    file, mapping = log_of(tmp_path, "up = [0, 1, 1]")
    with pytest.raises(
        RecordingError, match=r"log\.toml: up is 0,1,1 of length 1\.41421, expected 1 ± 0\.001"
    ):
        load_recording(file, mapping=mapping)


def log_of(folder: Path, stated: str) -> tuple[Path, Path]:
    """A csv of other software, and a mapping that states something at its top."""
    rows = "\n".join(f"{i},0,0,0,1,2,3" for i in range(3))
    (folder / "log.csv").write_text(f"t,x,y,z,f,g,h\n{rows}")
    (folder / "log.toml").write_text(
        f'wrench_source = "flange_sensor"\n{stated}\n[time]\ncolumn = "t"\n'
        '[columns]\npx = "x"\npy = "y"\npz = "z"\nfx = "f"\nfy = "g"\nfz = "h"\n'
    )
    return folder / "log.csv", folder / "log.toml"


@pytest.mark.parametrize("text", WRONG)
def test_a_file_with_a_wrong_direction_is_refused(tmp_path, text):
    WRITERS[".csv"](tmp_path / "a.csv", guided())
    content = (tmp_path / "a.csv").read_text()
    (tmp_path / "a.csv").write_text(f"# up: {text}\n{content}")
    with pytest.raises(RecordingError) as refused:
        load_recording(tmp_path / "a.csv")
    assert WRONG[text] in str(refused.value)


# --- at the wire ----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def endpoint() -> Iterator[str]:
    with Service(ServiceConfig(instance="test-1", listen="tcp/127.0.0.1:0")) as service:
        yield service.endpoint


@pytest.mark.parametrize(
    ("up", "words"),
    [
        ([0.0, 1.0, 1.0], "up is 0,1,1 of length 1.41421, expected 1 ± 0.001"),
        ([0.0, 0.0, 0.0], "open.up: up is 0,0,0 of length 0, expected 1 ± 0.001"),
        ([1.7e308] * 3, "of length inf, expected 1 ± 0.001;"),
        ([5e-324] * 3, "of length 9.88131e-324, expected 1 ± 0.001;"),
        ([0.0, 0.0, math.nan], "finite number"),
        ([0.0, 1.0], "up"),
        ("-z", "up"),
    ],
)
def test_an_opening_with_a_wrong_direction_is_refused_in_words(up, words):
    said = {"command": {"type": "open", "session": "s1", "columns": ["t", "px"], "up": up}}
    with pytest.raises(ProtocolError) as refused:
        decode(msgpack.packb(said), encoding_of(Control), Control)
    assert refused.value.code == "malformed"
    assert words in str(refused.value)


def test_an_opening_that_is_sent_again_is_the_same_one(endpoint):
    # A direction that was made to have length 1 anew differed in its last bit.
    opening = opening_of(hanging()).model_copy(update={"session": "s-twice", "up": (0.48, -0.6, 0.64)})
    with Peer(endpoint) as peer:
        assert [peer.command(opening).state for _ in range(2)] == ["open", "open"]


def test_a_session_states_the_direction_in_status_program_and_recording(endpoint):
    recording = hanging("button")
    with ZenohTransport(endpoint, timeout_s=20.0) as transport:
        source = FileSource(replace(recording, setting=CellSettings()), pace=math.inf)
        settings = BridgeSettings(setting=CellSettings(up=CEILING))
        with Bridge(transport, "cell-1", source, session="s-hangs", settings=settings) as bridge:
            bridge.run()
        found = snapshot(transport, "cell-1", "s-hangs")
        assert found.status.wrench.up == found.program.up == CEILING
        assert "with -z of the base upwards" in found.status.wrench.note
        assert read_recording(transport, Update(found.status, (), (), None, found.program)).up == CEILING
    recorder = Recorder("s-hangs")
    recorder.add_batch(first_batch(recording, "s-hangs"))
    assert recorder.recording(found).up == CEILING


def first_batch(recording: Recording, session: str) -> SampleBatch:
    return pack_samples(recording.matrix()[:20], recording.columns, session=session, epoch=0, seq=0)


def test_a_session_of_the_journal_states_what_its_opening_stated():
    recording = hanging("button")
    records = [Record("cell-1", "file", 0.0, opening_of(recording))]
    records.append(Record("cell-1", "file", 0.0, first_batch(recording, "file")))
    assert recording_of(records).up == CEILING


def test_a_file_states_it_to_a_bridge(tmp_path):
    hanging("button").save(tmp_path / "a.npz")
    source = open_source("file", SourceOptions(file=tmp_path / "a.npz"))
    assert source.setting.up == CEILING


# --- programs -------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The program that a hanging arm was taught, as `caesura program` writes it."""
    folder = tmp_path_factory.mktemp("hanging")
    replace(hanging("button"), name="hanging").save(folder / "a.npz")
    found = caesura("segment", folder / "a.npz", "--json", folder / "result.json", "--robot", "ur5e")
    assert found.exit_code == 0, found.output
    written = caesura(
        "program", "--file", folder / "result.json", "--format", "json", "-o", folder / "program.json"
    )
    assert written.exit_code == 0, written.output
    return folder / "program.json"


def test_a_program_states_the_direction_and_one_without_is_still_read(program, tmp_path):
    content = json.loads(program.read_text())
    assert content["up"] == list(CEILING)
    assert read_document(program).up == CEILING
    for version in (1, 2):
        older = {key: value for key, value in content.items() if key != "up"} | {"version": version}
        (tmp_path / "older.json").write_text(json.dumps(older))
        assert read_document(tmp_path / "older.json").up is None


def test_check_compares_the_base_that_runs_a_program_with_the_taught_one(program):
    words = "was taught with -z of the base upwards"
    alone = caesura("check", program)
    assert f"warning: program: {words}: run it on a base with this mounting" in alone.output
    alike = caesura("check", program, "--up", "-z")
    assert words not in alike.output
    other = caesura("check", program, "--up", "z")
    assert other.exit_code == 1
    assert f"error: program: {words}, and the base that runs it has z of the base upwards, 180° apart" in (
        other.output
    )


def test_the_script_of_a_universal_robot_sets_the_mounting(program, tmp_path):
    done = caesura("program", "--file", program, "--format", "urscript", "-o", tmp_path / "a.script")
    assert done.exit_code == 0, done.output
    script = (tmp_path / "a.script").read_text()
    assert "\n  set_gravity([0.000000, 0.000000, -9.820000])  # " in script
    assert "# warning: was taught with -z of the base upwards: run it on a base with this mounting" in script
    content = json.loads(program.read_text()) | {"up": None}
    (tmp_path / "upright.json").write_text(json.dumps(content))
    done = caesura(
        "program", "--file", tmp_path / "upright.json", "--format", "urscript", "-o", tmp_path / "b.script"
    )
    assert done.exit_code == 0, done.output
    assert "gravity(" not in (tmp_path / "b.script").read_text()


def test_the_simulated_robot_refuses_what_a_hanging_arm_was_taught(program):
    done = caesura("execute", program, "--simulated")
    assert done.exit_code == 1
    assert "taught with -z of the base upwards, and the simulated robot stands upright" in done.output


def test_a_comparison_names_another_mounting(program, tmp_path):
    content = json.loads(program.read_text()) | {"up": None}
    (tmp_path / "upright.json").write_text(json.dumps(content))
    done = caesura("program", "--file", program, "--against", tmp_path / "upright.json")
    assert "up '0,0,-1', was none" in done.output
