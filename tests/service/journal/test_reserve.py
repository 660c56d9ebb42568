"""On a full disk a deletion makes room, by a reserve: what the runbook advises works."""

from __future__ import annotations

import errno
import os
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path
from types import SimpleNamespace

import pytest

from caesura_protocol.codec import encode
from caesura_service.journal import EncodedBatch, JournalError, JournalSettings, SqliteJournal
from caesura_service.journal.journal import JournalFullError
from caesura_service.journal.reserve import OPENING, SHARE, SIZE, SUFFIX, Reserve
from harness.power import COMPILER, NO_COMPILER, build, environment
from harness.processes import eventually
from harness.sessions import NAME, STATION
from service.journal.test_deletion import FIRST, record

PAYLOAD = encode(FIRST).payload
FILES = 32
DISK = SHARE * SIZE + (48 << 20)  # [bytes] room for a reserve, and for what the tests write before


def append(journal: SqliteJournal, seq: int, session: str) -> None:
    """As a service does, which has the payload of a batch already. Nothing reads it again."""
    journal.append_batch(STATION, session, float(seq), EncodedBatch(FIRST.epoch, seq, PAYLOAD))


def taught(journal: SqliteJournal, count: int, session: str) -> None:
    for seq in range(count):
        append(journal, seq, session)
    journal.commit()


def full() -> JournalError:
    return JournalFullError("full")


def test_room_is_kept_and_given_back_for_a_full_disk_alone(tmp_path):
    reserve, file = Reserve(tmp_path / "one.sqlite"), tmp_path / f"one.sqlite{SUFFIX}"
    reserve.keep()
    assert file.stat().st_size == SIZE
    assert file.stat().st_mode & 0o777 == 0o600
    assert not reserve.release(JournalError("in use by another process"))
    assert file.exists()
    assert reserve.release(full())
    assert not file.exists()
    assert not reserve.release(full()), "there is none any more"
    reserve.keep()
    assert not file.exists(), "not at once again"


def test_a_small_disk_is_left_to_the_journal(tmp_path, monkeypatch):
    monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=SHARE * SIZE - 1))
    Reserve(tmp_path / "one.sqlite").keep()
    assert list(tmp_path.iterdir()) == []


def kept(file: Path) -> None:
    Reserve(file.with_name(file.name.removesuffix(SUFFIX))).keep()


def test_a_reserve_without_its_room_is_given_it(tmp_path):
    """An empty one, whose maker was killed, and a sparse copy counted as one for ever."""
    file = tmp_path / f"one.sqlite{SUFFIX}"
    for size in (0, SIZE - OPENING, SIZE):
        with file.open("wb") as sparse:
            sparse.truncate(size)
        kept(file)
        assert (file.stat().st_size, file.stat().st_blocks * 512 >= SIZE) == (SIZE, True)


@pytest.mark.parametrize("what", ["directory", "link", "link to nothing", "second name", "pipe"])
def test_what_is_no_reserve_is_named_and_left_alone(tmp_path, what, caplog):
    """It was taken for one, and nothing was said."""
    file, others = tmp_path / f"one.sqlite{SUFFIX}", tmp_path / "others"
    others.write_bytes(b"0" * 100)
    makers = {
        "directory": file.mkdir,
        "link": lambda: file.symlink_to(others),
        "link to nothing": lambda: file.symlink_to(tmp_path / "nothing"),
        "second name": lambda: file.hardlink_to(others),
        "pipe": lambda: os.mkfifo(file),
    }
    makers[what]()
    reserve = Reserve(tmp_path / "one.sqlite")
    reserve.keep()
    assert "on a full disk deletions make no room; remove what is there" in caplog.text
    assert not reserve.lend(full())
    assert others.read_bytes() == b"0" * 100
    assert not (tmp_path / "nothing").exists()


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of its own, where mounting is permitted, for FILES files."""
    where = tmp_path / "disk"
    where.mkdir()
    mounting = ["mount", "-t", "tmpfs", "-o", f"size={DISK},nr_inodes={FILES}", "tmpfs", str(where)]
    if subprocess.run(mounting, check=False, capture_output=True).returncode:
        pytest.skip("mounting is not permitted")
    try:
        yield where
    finally:
        subprocess.run(["umount", where], check=True)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("records", "free"),
    [(14_000, None), (26_000, None), (26_000, 1 << 40)],
    ids=["little waits", "more waits than the reserve holds", "more waits, and a quota is full"],
)
def test_what_another_process_deletes_on_a_disk_without_a_byte_makes_room(disk, records, free, monkeypatch):
    """`caesura sessions delete` said "deleted", and the service could not write for ever after.

    What waits took the room that was given back for the deletion, or needed all its room at once. What is
    deleted holds 18 MB, the new session 7 or 13 MB, of which the log and the file take some.
    """
    if free is not None:
        monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=free))
    path = disk / "caesura-1.sqlite"
    with SqliteJournal(path, JournalSettings(commit_s=0.01)) as journal:
        for name in ("old", "older"):
            taught(journal, 18_000, name)
        eventually((disk / f"{path.name}{SUFFIX}").exists)
        fill(disk)
        with journal._writing, pytest.raises(JournalError, match="no room left"):  # all of it waits
            taught(journal, records, "new")
        eventually(lambda: journal.report().trouble is not None)
        assert (journal.report().waiting > SIZE) == (records > 20_000)
        for name in ("old", "older"):
            with SqliteJournal(path, alone=False) as another:
                another.delete(STATION, name)
        eventually(lambda: journal.report().trouble is None)
        eventually(lambda: count(path) == 1)
        assert [one.session for one in journal.copies()] == ["new"]
        journal.append(record(0, "newest"), now=True)


QUOTA = """
import ctypes, sys
from contextlib import suppress
from pathlib import Path
from caesura_service.journal import JournalError, SqliteJournal
from caesura_service.journal.reserve import SUFFIX
from harness.processes import eventually
from harness.sessions import STATION
from service.journal.test_deletion import record, taught
path = Path(sys.argv[1])
reserve = path.with_name(path.name + SUFFIX)
with SqliteJournal(path) as journal:
    taught(journal, 10, "old")
    eventually(reserve.exists)
    ctypes.CDLL(None).fail_from(1, 0)
    try:
        journal.append(record(0), now=True)
    except JournalError as error:
        print(type(error).__name__, error)
    with suppress(JournalError):
        journal.delete(STATION, "old")
    eventually(lambda: not reserve.exists())
    ctypes.CDLL(None).fail_from(0, 0)
    eventually(lambda: journal.report().trouble is None)
    journal.append(record(0), now=True)
"""


@pytest.mark.skipif(COMPILER is None, reason=NO_COMPILER)
def test_a_quota_that_is_used_up_is_named_and_the_reserve_given_back(tmp_path):
    """SQLite calls it a failed write, so the reserve stayed and a deletion had no room."""
    library, journals = tmp_path / "failing.so", tmp_path / "journals"
    journals.mkdir()
    build(Path(__file__).parents[2] / "harness" / "failing.c", library)
    watched = {"LD_PRELOAD": library, "FAILING_IN": journals, "FAILING_WRITES": errno.EDQUOT}
    command = [sys.executable, "-c", QUOTA, str(journals / "caesura-1.sqlite")]
    environ = environment() | {name: str(value) for name, value in watched.items()}
    ended = subprocess.run(command, env=environ, capture_output=True, text=True, timeout=60.0, check=False)
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.startswith("JournalFullError")
    assert "this user's quota is used up: free some" in ended.stdout


def refused(journal: SqliteJournal, session: str = "new", count: int = 20_000) -> None:
    """Teach until the disk is full; no more waits then than a deletion makes room for."""
    with pytest.raises(JournalError, match="no room left"):  # noqa: PT012 - which append does not matter
        for seq in range(count):
            append(journal, seq, session)
            if seq % 500 == 0:
                journal.commit()
    eventually(lambda: journal.report().trouble is not None)


@pytest.mark.slow
def test_samples_are_written_again_before_all_deletions_are_done(disk):
    """They waited for all of them: a day of sessions takes longer than bridges keep samples."""
    path = disk / "caesura-1.sqlite"
    with SqliteJournal(path) as journal:
        for number in range(3):
            taught(journal, 12_000, f"old{number}")
        eventually((disk / f"{path.name}{SUFFIX}").exists)
        fill(disk)
        refused(journal)
        with SqliteJournal(path, alone=False) as another:
            another._delete({(STATION, f"old{number}") for number in range(3)})
            another._has_deleted = False  # as one that is ended then
        eventually(lambda: journal.report().trouble is None)
        assert count(path) > 2, "sessions are still being deleted"
        journal.append(record(20_000, "new"))
        eventually(lambda: count(path) == 1)
        assert journal.report().trouble is None


@pytest.mark.slow
def test_each_deletion_on_a_disk_that_stays_full_makes_room(disk):
    """The reserve served the first one: after it `deleted` was said, and nothing could be written."""
    path = disk / "caesura-1.sqlite"
    with SqliteJournal(path, JournalSettings(commit_s=0.01)) as journal:
        for number in range(3):
            taught(journal, 16_000, f"old{number}")
        eventually((disk / f"{path.name}{SUFFIX}").exists)
        fill(disk)
        for number in range(3):
            refused(journal, f"new{number}")
            with SqliteJournal(path, alone=False) as another:
                another.delete(STATION, f"old{number}")
            eventually(lambda: journal.report().trouble is None)
            eventually(lambda: count(path) == 3)  # all of it is gone: nothing frees more in the next round
        assert {copy.session for copy in journal.copies()} == {"new0", "new1", "new2"}


def test_the_last_room_of_a_small_disk_is_for_deletions(disk):
    """A disk without room for a reserve had none for deletions either."""
    path, others = disk / "caesura-1.sqlite", disk / "others"
    with others.open("wb") as file:
        os.posix_fallocate(file.fileno(), 0, DISK - 4 * SIZE)
    with SqliteJournal(path, JournalSettings(commit_s=0.01)) as journal:
        taught(journal, 8000, "old")
        refused(journal, count=100_000)
        assert "the last 8 MB are for deletions" in str(journal.report().trouble)
        journal.delete(STATION, "old")
        eventually(lambda: journal.report().trouble is None)


def test_a_disk_stays_full_until_something_is_written(disk):
    """Where nothing waited, an empty transaction was taken for the end of the trouble."""
    with SqliteJournal(disk / "caesura-1.sqlite", JournalSettings(commit_s=0.01)) as journal:
        taught(journal, 10, NAME)
        eventually((disk / f"caesura-1.sqlite{SUFFIX}").exists)
        fill(disk)
        with pytest.raises(JournalError, match="no room left"):  # noqa: PT012 - which append does not matter
            for seq in range(100_000):
                journal.append(record(seq, "new"), now=True)
        assert journal.report().waiting == 0
        with pytest.raises(JournalError, match="no room left"):
            journal.flush()
        assert journal.report().trouble is not None
        (disk / "others").unlink()
        eventually(lambda: journal.report().trouble is None)
        journal.append(record(0, "newest"), now=True)


def test_a_journal_is_opened_and_deleted_from_on_a_disk_without_a_byte(disk):
    """A service did not start, and `caesura sessions delete` could not open its journal."""
    path = disk / "caesura-1.sqlite"
    with SqliteJournal(path) as journal:
        taught(journal, 3000, "old")
        taught(journal, 10, "kept")
        eventually((disk / f"{path.name}{SUFFIX}").exists)
    fill(disk)
    with SqliteJournal(path) as journal:
        assert journal.sessions() == ((STATION, "old"), (STATION, "kept"))
        assert (disk / f"{path.name}{SUFFIX}").stat().st_size == SIZE - OPENING, "the rest is for deletions"
    fill(disk, "more")
    with SqliteJournal(path, alone=False) as another:
        another.delete(STATION, "old")
    with SqliteJournal(path) as journal:
        eventually(lambda: count(path) == 1)
        journal.append(record(10, "kept"), now=True)
        assert [copy.last_seq for copy in journal.copies()] == [10]


def test_without_a_reserve_a_journal_on_a_full_disk_says_what_to_do(disk):
    path = disk / "caesura-1.sqlite"
    with SqliteJournal(path) as journal:
        taught(journal, 10, NAME)
        eventually((disk / f"{path.name}{SUFFIX}").exists)
    (disk / f"{path.name}{SUFFIX}").unlink()
    fill(disk)
    with pytest.raises(JournalError, match="there is no room left: free some"), SqliteJournal(path):
        pass


def test_a_disk_that_is_read_only_or_holds_no_further_file_is_named(disk):
    """`let this user read and write it` was advised, as for a file of another user."""
    path = disk / "caesura-1.sqlite"
    with SqliteJournal(path) as journal:
        taught(journal, 10, NAME)
    for number in range(FILES):
        with suppress(OSError):
            (disk / str(number)).touch()
    with (
        pytest.raises(JournalError, match="its disk holds no further file: delete some"),
        SqliteJournal(path),
    ):
        pass
    subprocess.run(["mount", "-o", "remount,ro", disk], check=True)
    with (
        pytest.raises(JournalError, match="its disk is read-only: mount it for writing"),
        SqliteJournal(path),
    ):
        pass


def count(path: Path) -> int:
    with closing(sqlite3.connect(path)) as reader:
        (found,) = reader.execute("SELECT count(*) FROM sessions").fetchone()
    return int(found)


def fill(disk: Path, name: str = "others") -> None:
    """Take all the room that there is."""
    with (disk / name).open("wb", buffering=0) as ballast:
        for piece in (bytes(1 << 20), bytes(4096)):  # in large pieces, and what is left in small ones
            with suppress(OSError):
                while ballast.write(piece):
                    pass
