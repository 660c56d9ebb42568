"""Recordings that are dropped into the page: what is received, looked at and refused."""

from __future__ import annotations

import asyncio
import io
import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import AsyncIterator, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, get_args
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np
import pytest
from starlette.requests import ClientDisconnect

from caesura_clients.dashboard import recording_playback_process, recordings
from caesura_clients.dashboard.correction_requests import EditRefused
from caesura_clients.dashboard.pages.recording_upload import received
from caesura_clients.dashboard.recordings import RecordingDesk
from caesura_clients.dashboard.wrench_source_words import WRENCH_SOURCE_WORDS
from caesura_protocol.messages import WrenchSource
from caesura_protocol.programs.safety import CellSettings
from caesura_protocol.recording import ASSUMED_FRAME
from dashboard.conftest import ran
from harness.demonstrations import guided
from harness.processes import eventually

CSV = "time,x,y,z\n" + "\n".join(f"{i / 100},0.1,0.2,0.3" for i in range(50))


@pytest.fixture
def desk(tmp_path_factory, monkeypatch) -> Iterator[RecordingDesk]:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path_factory.mktemp("temporary")))
    with RecordingDesk("tcp/127.0.0.1:1", None) as desk:
        yield desk


def sent(desk: RecordingDesk, upload: str, name: str, content: bytes) -> Path:
    path = desk.begin_file(upload, name)
    desk.count(upload, len(content))
    path.write_bytes(content)
    return path


def looked(path: Path) -> dict[str, Any]:
    return recording_playback_process.look({"file": str(path)})


def asked(upload: str, **changes: Any) -> dict[str, Any]:
    return {"upload": upload, "station": "cell-9", "session": "s1", "answers": {}, **changes}


@pytest.mark.parametrize(
    ("upload", "name"),
    [("u-1", "../a.csv"), ("u-1", "a/b/c.csv"), ("u-1", ".hidden"), ("..", "a.csv"), ("u-1", "a/../../b")],
)
def test_a_name_that_leads_out_of_the_folder_is_refused(desk: RecordingDesk, upload: str, name: str):
    with pytest.raises(EditRefused, match="is not the name of a file"):
        desk.begin_file(upload, name)


def test_a_name_that_is_too_long_is_refused_with_its_length(desk: RecordingDesk):
    with pytest.raises(EditRefused, match="has 304 bytes, expected at most 255: rename the file"):
        desk.begin_file("u-1", "n" * 300 + ".csv")
    with pytest.raises(EditRefused, match="has 304 bytes"):
        desk.begin_file("u-1", "folder/" + "日" * 100 + ".csv")


@pytest.mark.parametrize("upload", ["..", ".", "", "{outside}", "../{name}"])
def test_only_what_is_held_is_removed(desk: RecordingDesk, tmp_path: Path, upload: str):
    held, kept = sent(desk, "u-1", "a.csv", b"1"), tmp_path / "kept.csv"
    kept.write_text("1")
    beside = Path(tempfile.mkdtemp(dir=held.parents[2]))
    try:
        desk.drop(upload.format(outside=tmp_path, name=beside.name))
        assert (kept.exists(), held.exists(), beside.exists()) == (True, True, True)
    finally:
        shutil.rmtree(beside, ignore_errors=True)


def test_an_upload_beyond_the_limit_is_refused_and_removed(desk: RecordingDesk, monkeypatch):
    monkeypatch.setattr(recordings, "BYTES", 1000)
    path = sent(desk, "u-1", "a.csv", b"1" * 900)
    with pytest.raises(EditRefused, match="larger than"):
        desk.count("u-1", 200)
    assert not path.exists()
    with pytest.raises(EditRefused, match="was removed"):
        desk.count("u-1", 1)  # of what still comes


def test_the_oldest_recording_makes_room_for_the_next(desk: RecordingDesk):
    paths = [sent(desk, f"u-{i}", "a.csv", b"1") for i in range(recordings.UPLOADS + 1)]
    assert [path.exists() for path in paths] == [False, *[True] * recordings.UPLOADS]


def test_its_files_are_gone_with_the_dashboard():
    with RecordingDesk(None, None) as desk:
        path = sent(desk, "u-1", "a.csv", b"1")
    assert not path.exists()


def test_what_is_no_recording_is_refused_with_what_was_expected(desk: RecordingDesk):
    sent(desk, "u-1", "notes.txt", b"1")
    with pytest.raises(EditRefused, match=r"notes\.txt: expected one file \(\.npz, \.csv"):
        desk.look("u-1")


@pytest.mark.slow
@pytest.mark.parametrize("rest", [b"", b"\xcf" * 100], ids=["nothing", "rubbish"])
def test_an_mcap_that_ends_in_its_header_is_refused_with_what_is_wrong(desk: RecordingDesk, rest: bytes):
    pytest.importorskip("mcap", reason="mcap is not installed (extra mcap)")
    sent(desk, "u-1", "cut.mcap", b"\x89MCAP0\r\n" + rest)
    with pytest.raises(EditRefused, match=r"cut\.mcap: not a readable mcap file"):
        desk.look("u-1")


def test_a_bad_request_or_a_station_with_a_robot_is_refused(desk: RecordingDesk):
    sent(desk, "u-1", "a.csv", b"1")
    with pytest.raises(EditRefused, match="station is 'Cell 9'"):
        desk.play(asked("u-1", station="Cell 9"), frozenset())
    with pytest.raises(EditRefused, match="wrench_source"):
        desk.play(asked("u-1", answers={"wrench_source": "nose"}), frozenset())
    with pytest.raises(EditRefused, match="The robot of station cell-9 is connected"):
        desk.play(asked("u-1"), frozenset({"cell-9"}))


def test_a_task_follows_the_rule_for_names(desk: RecordingDesk):
    """An invisible character passed, and ended the process that played."""
    sent(desk, "u-1", "a.csv", CSV.encode())
    with pytest.raises(EditRefused, match=r"^Not played: task is 'a\\u202e', expected text on one line"):
        desk.play(asked("u-1", task="a\u202e"), frozenset())
    with pytest.raises(EditRefused, match="task has 121 characters, expected at most 120 characters"):
        desk.play(asked("u-1", task="x" * 121, operator=""), frozenset())


def test_a_refusal_names_no_mapping_file_on_a_page(desk: RecordingDesk):
    said = 'a.csv.toml: roll pitch yaw turn to 180 rad: probably in deg. State unit = "deg" for each of them'
    expected = "a.csv: roll pitch yaw turn to 180 rad: probably in deg. Choose deg as their unit."
    assert desk._in_words(said, "u-1") == expected


def test_a_session_name_that_is_taken_is_refused_with_what_has_it_and_what_to_do(
    desk: RecordingDesk, monkeypatch: pytest.MonkeyPatch
):
    """The recording was sent, and then refused with the number of a batch and the epoch of a bridge."""
    sent(desk, "u-1", "a.csv", b"1")
    held = "a demonstration 'peg in hole' of Ann, which has ended after 15.1 s"
    words = rf"cell-9/s1 is taken by {held}: type another session name\."
    with pytest.raises(EditRefused, match=words):
        desk.play(asked("u-1"), frozenset(), lambda *_: held)
    monkeypatch.setattr(desk, "_follow", lambda *_: None)
    monkeypatch.setattr(desk, "_start", lambda *_: None)
    desk.play(asked("u-1"), frozenset())
    sent(desk, "u-2", "b.csv", b"1")
    with pytest.raises(EditRefused, match=r"is taken by the recording a\.csv, which is being played: type"):
        desk.play(asked("u-2"), frozenset())


def test_a_csv_is_looked_at_by_its_columns_and_others_by_what_they_state(tmp_path: Path):
    (tmp_path / "odd.csv").write_text(CSV)
    found = looked(tmp_path / "odd.csv")
    assert found["guess"]["columns"] == {"t": "time", "px": "x", "py": "y", "pz": "z"}
    assert found["stated"] == {}
    (tmp_path / "odd.csv").write_text("# wrench_source: flange_sensor\n# hand on robot: no\n" + CSV)
    found = looked(tmp_path / "odd.csv")
    assert found["stated"] == {"wrench_source": "flange_sensor", "hand_on_robot": "no"}
    guided().save(tmp_path / "own.npz")
    found = looked(tmp_path / "own.npz")
    assert found["notes"] == []
    assert found["stated"] == {"wrench_source": "flange_sensor", "force_frame": "base", "length_unit": "m"}
    assert (found["samples"], found["hasWrench"]) == (len(guided().t), True)


def test_an_orientation_as_axis_times_angle_is_found_and_read(tmp_path: Path):
    """As a controller of Universal Robots writes it: a half turn about x."""
    (tmp_path / "ur.csv").write_text(
        "time,x,y,z,rotvec_x,rotvec_y,rotvec_z\n0,1,2,3,3.14159,0,0\n0.01,1,2,3,3.14159,0,0\n"
    )
    columns = looked(tmp_path / "ur.csv")["guess"]["columns"]
    assert {"rx", "ry", "rz"} <= set(columns)
    request = recordings.Answers.model_validate({"columns": columns, "sure": True}).model_dump()
    source = recording_playback_process.source_of({"file": str(tmp_path / "ur.csv"), "answers": request})
    assert np.abs(source.recording.signals["quat"][0]) == pytest.approx([1.0, 0.0, 0.0, 0.0], abs=1e-5)


def test_answers_make_the_source_and_the_mapping_for_the_next_time(tmp_path: Path, capsys):
    (tmp_path / "odd.csv").write_text(CSV)
    columns = {"t": "time", "px": "x", "py": "y", "pz": "z"}
    answers = {"columns": columns, "units": {"pos": "cm"}, "robot": "panda", "sure": True}
    request = recordings.Answers.model_validate(answers).model_dump()
    source = recording_playback_process.source_of({"file": str(tmp_path / "odd.csv"), "answers": request})
    assert source.recording.signals["pos"][0].tolist() == pytest.approx([0.001, 0.002, 0.003])
    assert source.recording.setting.robot == "panda"
    assert set(source.declared_units) == {"time", "length", "angle", "force"}
    assert 'px = { column = "x", unit = "cm" }' in json.loads(capsys.readouterr().out)["mapping"]


def test_a_file_without_a_frame_of_its_force_takes_the_answer(tmp_path: Path):
    recording = guided()
    turned = np.tile([1.0, 0.0, 0.0, 0.0], (recording.t.size, 1))
    signals = {**recording.signals, "quat": turned}
    replace(recording, signals=signals, assumed=(ASSUMED_FRAME,)).save(tmp_path / "a.npz")
    assert "force_frame" not in looked(tmp_path / "a.npz")["stated"], "the page asks for it"
    for frame, stated in ((None, "base"), ("flange", "flange")):
        answers = recordings.Answers(wrench_source="flange_sensor", force_frame=frame).model_dump()
        source = recording_playback_process.source_of({"file": str(tmp_path / "a.npz"), "answers": answers})
        assert (source.force_frame, source.assumed) == (stated, () if frame else ("force_frame",))


def test_the_direction_that_is_up_is_answered_or_as_in_the_file(tmp_path: Path, capsys):
    hangs = (0.0, 0.0, -1.0)
    replace(guided(), setting=CellSettings(up=hangs)).save(tmp_path / "a.npz")
    assert looked(tmp_path / "a.npz")["stated"]["up"] == "0,0,-1"
    (tmp_path / "odd.csv").write_text(CSV)
    answers = recordings.Answers(columns={"t": "time", "px": "x", "py": "y", "pz": "z"}, up="-z").model_dump()
    source = recording_playback_process.source_of({"file": str(tmp_path / "odd.csv"), "answers": answers})
    assert source.recording.up == hangs
    assert 'up = "0,0,-1"' in json.loads(capsys.readouterr().out)["mapping"]


def test_a_direction_that_is_none_is_refused_in_words(desk: RecordingDesk):
    sent(desk, "u-1", "a.csv", CSV.encode())
    with pytest.raises(EditRefused, match=r"^Not played: up is 0,1,1 of length 1\.41421, expected 1"):
        desk.play(asked("u-1", answers={"up": "0,1,1"}), frozenset())


def test_what_a_child_process_warns_of_stays_with_what_it_played(desk: RecordingDesk):
    sent(desk, "u-1", "a.csv", CSV.encode())
    said = '{"warning": "the service ignores that up is 0,0,-1"}\n{"share": 1.0, "done": true}\n'
    child = SimpleNamespace(stdout=io.StringIO(said), wait=lambda: 0)
    desk._follow(child, recordings.Playback("u-1", "a.csv", "cell-1", "s1"))  # type: ignore[arg-type]
    (played,) = desk.plays
    assert (played.warning, played.done) == ("the service ignores that up is 0,0,-1", True)


@pytest.mark.parametrize(
    ("said", "opened"),
    [
        ('{"opened": true}\n{"share": 0.5}\n{"error": "it is gone"}\n', True),
        ('{"error": "conflict: the session is closed"}\n', False),
    ],
)
def test_a_session_is_linked_to_once_the_service_has_opened_it(desk: RecordingDesk, said: str, opened: bool):
    """One that was refused had a link, too: to no session, or to another one of that name."""
    sent(desk, "u-1", "a.csv", CSV.encode())
    child = SimpleNamespace(stdout=io.StringIO(said), wait=lambda: 0)
    desk._follow(child, recordings.Playback("u-1", "a.csv", "cell-1", "s1"))  # type: ignore[arg-type]
    (played,) = desk.plays
    assert (played.opened, bool(played.error)) == (opened, True)


def test_every_wrench_source_has_words():
    assert set(WRENCH_SOURCE_WORDS) == set(get_args(WrenchSource))


def test_a_bag_leaves_its_wrench_open_and_takes_the_answer(tmp_path: Path, capsys):
    pytest.importorskip("rosbags", reason="rosbags is not installed (extra ros2)")
    from harness import ros  # noqa: PLC0415

    bag = ros.write_bag(tmp_path / "bag", ros.sensor_topics(guided()), "mcap")
    found = looked(bag)
    assert (found["stated"], found["bag"], found["hasWrench"]) == ({}, True, True)
    answers = recordings.Answers(wrench_source="flange_sensor", hand_on_robot="no").model_dump()
    source = recording_playback_process.source_of({"file": str(bag), "answers": answers})
    assert (source.wrench_source, source.hand_on_robot) == ("flange_sensor", "no")
    assert (
        json.loads(capsys.readouterr().out)["mapping"]
        == 'wrench_source = "flange_sensor"\nhand_on_robot = "no"\n'
    )


@pytest.mark.slow
def test_recordings_are_looked_at_one_after_the_other(desk: RecordingDesk, monkeypatch):
    """Each may take 4 GB: four at once took all that a machine has."""
    at_once: list[int] = []
    start, reading = desk._start, threading.Lock()

    def counted(upload: str, job: Mapping[str, Any]) -> subprocess.Popen[str]:
        at_once.append(1 if reading.acquire(blocking=False) else 2)
        child = start(upload, job)
        communicate = child.communicate

        def done(*args: Any, **named: Any) -> tuple[str, str]:
            said = communicate(*args, **named)
            reading.release()
            return said

        child.communicate = done  # type: ignore[method-assign]
        return child

    monkeypatch.setattr(desk, "_start", counted)
    for number in range(2):
        sent(desk, f"u-{number}", "a.csv", CSV.encode())
    with ThreadPoolExecutor(2) as threads:
        looks = list(threads.map(desk.look, ("u-0", "u-1")))
    assert at_once == [1, 1]
    assert [look["name"] for look in looks] == ["a.csv", "a.csv"]


def test_a_column_that_caesura_does_not_have_is_refused_by_name(desk: RecordingDesk):
    sent(desk, "u-1", "a.csv", CSV.encode())
    request = asked("u-1", answers={"columns": {"t": "time", "pq": "x"}})
    with pytest.raises(EditRefused, match="pq: Caesura has no such column"):
        desk.play(request, frozenset())


def test_a_recording_that_is_read_is_not_read_again_written_or_removed(desk: RecordingDesk):
    path = sent(desk, "u-1", "a.csv", CSV.encode())
    desk._reserve("u-1", recordings.UPLOADS)
    for act in (lambda: desk.look("u-1"), lambda: desk.begin_file("u-1", "b.csv")):
        with pytest.raises(EditRefused, match="is being read"):
            act()
    with pytest.raises(EditRefused, match="is being read"):
        desk.play(asked("u-1"), frozenset())
    desk.drop("u-1")
    assert path.exists()


def test_a_recording_that_is_read_without_an_end_is_given_up(desk: RecordingDesk, monkeypatch):
    """Two of them kept every further recording from being played until the dashboard was started again."""
    monkeypatch.setattr(recordings, "LOOK_S", 0.01)
    rows = "\n".join(f"{i / 1000},0.1,0.2,0.3" for i in range(400_000))
    sent(desk, "u-1", "long.csv", f"t,px,py,pz\n{rows}\n".encode())
    desk.play(asked("u-1"), frozenset())
    eventually(lambda: bool(desk.plays[0].error))
    assert desk.plays[0].error == "long.csv: not read after 0.01 s."
    assert not desk._children


def test_two_that_are_asked_for_at_once_do_not_exceed_the_number_of_plays(desk: RecordingDesk, monkeypatch):
    for number in range(4):
        sent(desk, f"u-{number}", "a.csv", CSV.encode())
    monkeypatch.setattr(desk, "_follow", lambda *_: None)
    together = threading.Barrier(4)
    started: list[str] = []
    monkeypatch.setattr(desk, "_start", lambda upload, _: started.append(upload))
    keep = desk._keep

    def kept(one: recordings.Playback) -> None:
        with suppress(threading.BrokenBarrierError):
            together.wait(0.3)
        keep(one)

    monkeypatch.setattr(desk, "_keep", kept)
    refused: list[str] = []

    def play(number: int) -> None:
        try:
            desk.play(asked(f"u-{number}", session=f"s{number}"), frozenset())
        except EditRefused as error:
            refused.append(str(error))

    threads = [threading.Thread(target=play, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert (len(started), len(refused)) == (recordings.PLAYS, 4 - recordings.PLAYS)


def test_folders_of_an_upload_count_as_its_files(desk: RecordingDesk):
    for number in range(recordings.FILES // 2):
        sent(desk, "u-1", f"{number}/a.db3", b"")
    with pytest.raises(EditRefused, match="more than"):
        desk.begin_file("u-1", "more/a.db3")


def test_what_was_removed_is_not_counted_again(desk: RecordingDesk):
    sent(desk, "u-1", "a.csv", b"1")
    desk.drop("u-1")
    with pytest.raises(EditRefused, match="was removed"):
        desk.count("u-1", 0)  # the empty end of a request
    assert desk._held == {}


class Parts:
    """A request whose body comes in parts; one of them is an error: the browser has gone away."""

    def __init__(self, *parts: bytes | Exception) -> None:
        self.parts = parts

    async def stream(self) -> AsyncIterator[bytes]:
        for part in self.parts:
            await asyncio.sleep(0)
            if isinstance(part, Exception):
                raise part
            yield part


def receive(desk: RecordingDesk, name: str, *parts: bytes | Exception) -> Any:
    site: Any = SimpleNamespace(recordings=desk)
    request: Any = Parts(*parts)
    return received(site, "u-1", name, request)


def test_an_upload_that_is_cut_leaves_no_file(desk: RecordingDesk):
    with pytest.raises(ClientDisconnect):
        ran(receive(desk, "a.csv", b"1", ClientDisconnect()))
    assert (desk._held, list(desk._folder.path.iterdir())) == ({}, [])


def test_two_of_one_name_at_once_do_not_write_into_one_file(desk: RecordingDesk):
    async def both() -> list[Any]:
        return await asyncio.gather(receive(desk, "a.csv", *[b"1"] * 9), receive(desk, "a.csv", *[b"2"] * 9))

    answers = ran(both())
    assert sorted(one.status_code for one in answers) == [204, 413]
    assert next(desk._folder.path.glob("u-1/*")).read_bytes() == b"1" * 9


@pytest.mark.slow
def test_a_file_that_unfolds_to_more_than_a_machine_has_ends_its_own_process_alone(tmp_path: Path):
    file = tmp_path / "bomb.npz"
    with ZipFile(file, "w", ZIP_DEFLATED, compresslevel=1) as packed, packed.open("t.npy", "w") as array:
        header = {"descr": "<f8", "fortran_order": False, "shape": (1 << 27,)}
        np.lib.format.write_array_header_1_0(array, header)
        for _ in range(1 << 10):
            array.write(bytes(1 << 20))
    look = (
        "import sys\nfrom caesura_clients.dashboard import recording_playback_process\n"
        "recording_playback_process.MEMORY = 1 << 30\n"
        f"sys.exit(recording_playback_process.run({{'do': 'look', 'file': {str(file)!r}}}))"
    )
    one_thread = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "-c", look], check=False, capture_output=True, text=True, env=one_thread
    )
    assert json.loads(done.stdout) == {"error": "bomb.npz: needs more memory than 1 GB"}, done.stderr
