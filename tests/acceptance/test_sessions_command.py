"""`caesura sessions export` and `delete`: the journal of a service that runs, and of one that does not."""

from __future__ import annotations

import errno
import json
import os
import pty
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader
from typer.testing import CliRunner

from caesura_protocol.codec import pack_samples
from caesura_protocol.formats.read import load_recording
from caesura_protocol.messages import Close, Describe, Description
from caesura_service.config import ServiceConfig, journal_path
from caesura_service.journal import Record, SqliteJournal
from caesura_service.journal.sqlite_database import is_in_use
from caesura_service.offline_segmentation import BATCH_SAMPLES, opening_of, segment_recording
from harness.commands import application
from harness.demonstrations import guided
from harness.journals import journal_file, write_short_sessions
from harness.processes import eventually, serving


@pytest.fixture
def directory(tmp_path: Path) -> Path:
    """A journal with an open session s1 at two stations and a closed s2."""
    recording = guided()
    matrix = recording.matrix()
    with SqliteJournal(journal_path(tmp_path, ServiceConfig().instance)) as journal:
        for station, session in (("cell-1", "s1"), ("cell-2", "s1"), ("cell-1", "s2")):
            opening = opening_of(recording).model_copy(update={"session": session})
            journal.append(Record(station, session, 0.0, opening))
            starts = list(enumerate(range(0, len(matrix), BATCH_SAMPLES)))
            for seq, first in (*reversed(starts[:3]), *starts[3:]):  # as they came, not in order
                rows = matrix[first : first + BATCH_SAMPLES]
                batch = pack_samples(rows, recording.columns, session=session, epoch=0, seq=seq)
                journal.append(Record(station, session, 0.0, batch))
        journal.append(Record("cell-1", "s2", 0.0, Close(session="s2", last_seq=len(starts) - 1)))
    return tmp_path


def caesura(*arguments: object):
    return CliRunner().invoke(application(), ["sessions", *map(str, arguments)])


def kept(directory: Path) -> list[str]:
    with SqliteJournal(journal_path(directory, ServiceConfig().instance), alone=False) as journal:
        return ["/".join(key) for key in journal.sessions()]


def running(directory: Path) -> SqliteJournal:
    """What a service holds while it runs."""
    return SqliteJournal(journal_path(directory, ServiceConfig().instance))


def test_an_exported_session_is_the_recording_that_was_taught(directory):
    out = directory / "s2.npz"
    with running(directory):
        done = caesura("export", "s2", "-o", out, "--journal", directory)
    assert done.exit_code == 0, done.stderr
    assert done.stdout == f"{out}: {len(guided().t)} samples, {guided().t[-1]:.2f} s\n"
    exported = load_recording(out)
    np.testing.assert_allclose(exported.matrix(), guided().matrix(), rtol=0, atol=1e-12)
    assert segment_recording(exported).segments == segment_recording(guided()).segments


def test_an_export_onto_a_full_disk_leaves_the_file_that_was_there(directory, monkeypatch):
    out = directory / "s2.npz"
    out.write_bytes(b"an earlier export")

    def half(path: Path, **_: object) -> None:
        path.write_bytes(b"half")
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", half)
    done = caesura("export", "s2", "-o", out, "--journal", directory)
    assert done.exit_code == 1
    assert done.stderr == f"error: cannot write {out}: No space left on device\n"
    assert out.read_bytes() == b"an earlier export"
    assert not list(directory.glob("*part*"))


def test_a_journal_that_no_service_has_open_is_named_with_what_only_it_has(directory):
    gone, twin = journal_path(directory, "gone"), journal_path(directory, "twin")
    shutil.copy(journal_path(directory, ServiceConfig().instance), gone)
    with SqliteJournal(gone) as journal:
        journal.append(Record("cell-9", "s9", 0.0, opening_of(guided()).model_copy(update={"session": "s9"})))
        journal.append(Record("cell-2", "s1", 0.0, Close(session="s1", last_seq=53)))
    shutil.copy(gone, twin)
    journal_path(directory, "unreadable").write_bytes(b"rubbish" * 1000)
    with running(directory):
        done = caesura("journals", "--journal", directory)
    assert done.exit_code == 0, done.stderr
    assert "unreadable.sqlite is no journal" in done.stderr
    of_instance, of_gone, none, of_twin, only = done.stdout.splitlines()
    assert of_instance.endswith("3 sessions, 2 of them open; a service has it open")
    assert of_gone.startswith(f"{gone}: ")
    assert of_gone.endswith("4 sessions, 2 of them open; no service has it open")
    assert only.strip().startswith("only there: cell-2/s1, cell-9/s9; if instance twin never")
    assert of_twin.endswith("4 sessions, 2 of them open; no service has it open")
    assert none.strip() == (
        "no session is only there: if instance gone never starts again, move gone.sqlite* away"
    )


@pytest.mark.parametrize("lock", [None, b"", b"rubbish" * 1000])
def test_a_journal_is_in_use_only_while_a_process_has_locked_it(directory, lock):
    """Other than after a crash, which leaves the file of the lock."""
    path = journal_path(directory, ServiceConfig().instance)
    with running(directory):
        assert is_in_use(path)
    beside = path.with_name(f"{path.name}.lock")
    beside.unlink() if lock is None else beside.write_bytes(lock)
    assert not is_in_use(path)


def test_a_session_is_exported_as_mcap_while_the_service_runs(directory):
    out = directory / "s2.mcap"
    with running(directory):
        done = caesura("export", "s2", "-o", out, "--journal", directory)
    assert done.exit_code == 0, done.stderr
    assert done.stdout == f"{out}: {len(guided().t)} samples, {guided().t[-1]:.2f} s\n"
    with out.open("rb") as stream:
        topics = {channel.topic for _, channel, _ in make_reader(stream).iter_messages()}
    made = {"/segments", "/changepoints", "/phases", "/program", "/path"}
    assert topics == {"/state", "/wrench", "/tf", *made}


def test_mcap_without_its_extra_is_one_line_that_names_it(directory, monkeypatch):
    monkeypatch.setattr("caesura_lab.commands.journal_sessions.find_spec", lambda name: None)
    done = caesura("export", "s2", "-o", directory / "s2.mcap", "--journal", directory)
    assert (done.exit_code, done.stdout) == (1, "")
    assert done.stderr == "error: writing .mcap needs pip install '.[mcap]' in a clone of Caesura\n"


def test_sessions_are_exported_as_the_episodes_of_a_dataset(directory):
    out = directory / "demos"
    stated = ("--station", "cell-1", "--task", "press a button", "--success", "--failed", "s2", "--fps", "50")
    with running(directory):
        done = caesura(
            "export", "s1", "s2", "-o", out, "--format", "lerobot", *stated, "--journal", directory
        )
    assert done.exit_code == 0, done.stderr
    assert done.stdout == f"{out}: 2 episodes, 540 frames at 50 Hz\n"
    rows = pq.read_table(out / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert [(row["session"], row["success"], row["tasks"]) for row in rows] == [
        ("s1", True, ["press a button"]),
        ("s2", False, ["press a button"]),
    ]
    frames = pq.read_table(out / "data/chunk-000/file-000.parquet").to_pydict()
    force = guided().signals["force"][::4]
    np.testing.assert_allclose(frames["observation.wrench"][270:], force, rtol=0, atol=1e-6)
    subtasks = pq.read_table(out / "meta/subtasks.parquet")["subtask"].to_pylist()
    assert {"move", "press"} <= set(subtasks)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("s1", "s2", "-o", "both.npz"), "2 sessions for one .npz file"),
        (("s2", "-o", "s2.mcap", "--fps", "50"), "--without-language are not for .mcap"),
        (("s2", "-o", "s2.txt", "--format", "npz"), "cannot write s2.txt: expected the suffix .npz"),
        (("s2", "-o", "d", "--format", "lerobot", "--failed", "s9"), "--failed s9: exported episodes are s2"),
        (("s2", "-o", "d", "--format", "lerobot", "--fps", "500"), "500 frames a second, and its samples"),
        (("s2", "-o", ".", "--format", "lerobot"), ". exists: a dataset is written to a new directory"),
    ],
)
def test_what_does_not_fit_the_format_is_one_line(directory, arguments, words, monkeypatch):
    monkeypatch.chdir(directory)
    done = caesura("export", *arguments, "--station", "cell-1", "--journal", directory)
    assert (done.exit_code, done.stdout) == (1, "")
    (line,) = done.stderr.splitlines()
    assert words in line
    assert not [one for one in directory.iterdir() if one.suffix != ".sqlite" and "sqlite" not in one.name]


def test_a_closed_session_can_be_deleted_while_the_service_runs_and_an_open_one_cannot(directory):
    with running(directory):
        assert caesura("delete", "s2", "--yes", "--journal", directory).stdout == "cell-1/s2 deleted\n"
        refused = caesura("delete", "s1", "--yes", "--station", "cell-1", "--journal", directory)
    assert (refused.exit_code, refused.stdout) == (1, "")
    assert "error: cell-1/s1 is open: `caesura stop cell-1`" in refused.stderr
    assert kept(directory) == ["cell-1/s1", "cell-2/s1"]


def test_without_a_service_any_session_can_be_deleted(directory):
    assert caesura("delete", "s1", "--yes", "--station", "cell-1", "--journal", directory).exit_code == 0
    assert kept(directory) == ["cell-2/s1", "cell-1/s2"]


def test_a_session_is_named_with_its_station_as_messages_list_it(directory):
    """cell-1/s1 was refused by a sentence that listed it as known."""
    assert caesura("delete", "cell-2/s1", "--yes", "--journal", directory).stdout == "cell-2/s1 deleted\n"
    assert kept(directory) == ["cell-1/s1", "cell-1/s2"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("cell-3/s1",), "no session 's1' at cell-3 in"),
        (("cell-2/s1", "--station", "cell-1"), "no session 'cell-2/s1' at cell-1 in"),
        (("s9",), "no session 's9' at any station in"),
        (("s9",), "known: cell-1/s1, cell-2/s1, cell-1/s2"),
        (("s9",), "--journal names the directory of another service"),
        (("s1",), "several stations have a session 's1': name one of cell-1, cell-2 with --station"),
        (("s1", "--station", "cell-3"), "no session 's1' at cell-3"),
        (("s1", "--instance", "other"), "other.sqlite: this runs where the service does"),
    ],
)
@pytest.mark.parametrize("command", [("delete",), ("export", "-o", "out.npz")])
def test_a_session_that_is_not_meant_clearly_is_one_line(directory, command, arguments, words):
    done = caesura(*command, *arguments, "--journal", directory)
    assert (done.exit_code, done.stdout) == (1, "")
    (line,) = done.stderr.splitlines()
    assert words in line
    assert len(kept(directory)) == 3


@pytest.mark.parametrize(
    ("out", "words"),
    [
        ("out.txt", "expected the suffix .npz or .mcap"),
        ("nowhere/out.npz", "No such file or directory"),
        ("nowhere/out.mcap", "No such file or directory"),
    ],
)
def test_a_file_that_cannot_be_written_is_one_line(directory, out, words):
    done = caesura("export", "s2", "-o", directory / out, "--journal", directory)
    assert (done.exit_code, done.stdout) == (1, "")
    assert words in done.stderr


def copied(directory: Path, instance: str, batches: int, *, close: bool = False) -> None:
    """A further instance, which has some of cell-1/s1."""
    with SqliteJournal(journal_path(directory, ServiceConfig().instance)) as first:
        records = list(first.replay("cell-1", "s1"))[: batches + 1]
    with SqliteJournal(journal_path(directory, instance)) as journal:
        for record in records:
            journal.append(record)
        if close:
            journal.append(Record("cell-1", "s1", 0.0, Close(session="s1", last_seq=batches - 1)))


def test_of_several_instances_the_copy_that_is_furthest_along_is_exported(directory):
    copied(directory, "other", 4)
    out = directory / "s1.npz"
    where = ("--station", "cell-1", "--journal", directory)
    assert caesura("export", "s1", "-o", out, *where).exit_code == 0
    assert load_recording(out).t.size == len(guided().t)
    assert caesura("export", "s1", "-o", out, *where, "--instance", "other").exit_code == 0
    assert load_recording(out).t.size == 4 * BATCH_SAMPLES


def test_a_copy_with_a_refused_close_is_exported_after_the_one_that_counts(directory):
    """An instance that was frozen had closed the session: fewer samples were exported."""
    copied(directory, "other", 4, close=True)
    with SqliteJournal(journal_path(directory, "other")) as frozen:
        frozen.store_takeover("cell-1", 1)
    with SqliteJournal(journal_path(directory, ServiceConfig().instance)) as owner:
        described = Describe(
            session="s1", author="Ann", before=Description(), description=Description(task="wipe")
        )
        owner.append(Record("cell-1", "s1", 1.0, described))
        owner.store_takeover("cell-1", 2)
    out = directory / "s1.npz"
    done = caesura("export", "s1", "-o", out, "--station", "cell-1", "--journal", directory)
    assert done.exit_code == 0, done.stderr
    assert load_recording(out).t.size == len(guided().t)


def test_a_session_is_deleted_at_every_instance_that_has_it(directory):
    copied(directory, "other", len(guided().t) // BATCH_SAMPLES, close=True)
    with running(directory):  # where it is open, but not as far
        done = caesura("delete", "s1", "--yes", "--station", "cell-1", "--journal", directory)
    assert done.stdout == "cell-1/s1 deleted\n", done.stderr
    assert kept(directory) == ["cell-2/s1", "cell-1/s2"]
    with SqliteJournal(journal_path(directory, "other")) as journal:
        assert journal.sessions() == ()


def test_a_journal_that_cannot_be_read_is_passed_over_where_there_are_others(directory):
    (directory / "other.sqlite").write_text("a letter to my mother " * 100)
    done = caesura("export", "s2", "-o", directory / "s2.npz", "--journal", directory)
    assert done.exit_code == 0
    assert "skipped: " in done.stderr
    assert "other.sqlite is no journal" in done.stderr
    done = caesura("export", "s2", "-o", "s2.npz", "--journal", directory, "--instance", "other")
    assert done.exit_code == 1


@pytest.mark.slow
def test_on_a_terminal_delete_asks_first(directory):
    terminal, keys = pty.openpty()
    try:
        os.write(terminal, b"y\n")
        command = [
            sys.executable,
            "-m",
            "caesura_clients",
            "sessions",
            "delete",
            "s2",
            "--journal",
            directory,
        ]
        done = subprocess.run(command, stdin=keys, capture_output=True, text=True, timeout=60.0, check=False)
    finally:
        os.close(terminal)
        os.close(keys)
    assert "Delete samples, results and corrections of cell-1/s2 in " in done.stdout
    assert (done.returncode, "cell-1/s2" in kept(directory)) == (0, False)


def test_without_a_terminal_delete_is_refused_unless_yes_is_said(directory):
    # A script, or `docker exec` without -t, deleted for good without a question.
    refused = caesura("delete", "s2", "--journal", directory)
    assert (refused.exit_code, refused.stdout, len(kept(directory))) == (1, "", 3)
    (line,) = refused.stderr.splitlines()
    assert "cell-1/s2 is kept: there is no terminal to ask in. --yes deletes its samples" in line
    assert str(directory) in line
    assert caesura("delete", "s2", "--yes", "--journal", directory).exit_code == 0
    assert "cell-1/s2" not in kept(directory)


def test_who_says_no_keeps_the_session(directory, monkeypatch):
    terminal = SimpleNamespace(isatty=lambda: True)
    monkeypatch.setattr("caesura_lab.commands.journal_sessions.sys", SimpleNamespace(stdin=terminal))
    words = ["sessions", "delete", "s2", "--journal", str(directory)]
    done = CliRunner().invoke(application(), words, input="n\n")
    assert "Delete samples, results and corrections of cell-1/s2 in " in done.output
    assert (done.exit_code, "cell-1/s2" in kept(directory)) == (1, True)


def test_a_session_with_damaged_results_is_listed_and_its_samples_are_exported(tmp_path):
    """No list had it."""
    names = [f"s{number:02d}" for number in range(18)]  # of which a service holds the last 16
    write_short_sessions(tmp_path, [("cell-1", name) for name in names])
    with journal_file(journal_path(tmp_path, "caesura-1")) as file:
        file.execute("UPDATE outcomes SET snapshot = substr(snapshot, 1, 50) WHERE session_id = 2")
    with serving(tmp_path) as service:
        asked = ("list", "--connect", service.endpoint)
        eventually(lambda: "damaged" in caesura(*asked).stdout)
        _, _, _, *rows, _, last = caesura(*asked).stdout.splitlines()
        assert [row.split()[1] for row in rows] == [*names[2:], "s01"]
        out = tmp_path / "s01.npz"
        assert last == (
            "cell-1/s01: its results are damaged; on the service's machine, "
            "`caesura sessions export s01 --station cell-1` writes its samples"
        )
        listed = json.loads(caesura(*asked, "--json").stdout)
        assert [(one["session"], one["state"]) for one in listed if one["damage"]] == [("s01", "damaged")]
        done = caesura("export", "s01", "--station", "cell-1", "-o", out, "--journal", tmp_path)
    assert done.exit_code == 0, done.stderr
    assert load_recording(out).t.size == 20
