"""Flipped bits: every one of them changes nothing, or is found and named; what is whole goes on."""

from __future__ import annotations

import random
import shutil
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from caesura_lab.export.session_from_journal import read_session_export
from caesura_protocol.keys import StoredPage
from caesura_protocol.messages import Ack, Edit, Insert, Undo
from caesura_service.journal import JournalError, JournalSettings, PeerJournals, Record, SqliteJournal
from caesura_service.journal.journal import Refused
from caesura_service.journal.rows import UNREADABLE_OUTCOME
from caesura_service.journal.sqlite_statements import COLUMNS_4
from caesura_service.ownership.registry import Registry
from caesura_service.publishing.session_state import program_of
from harness.failing import SOURCE as FAILING
from harness.journals import ended, taught
from harness.journals import written as recorded
from harness.power import COMPILER, NO_COMPILER, build, environment
from harness.processes import eventually
from harness.sessions import NAME, STATION, answer, batch, batches, new_registry, opening, unowned
from harness.sessions import closing as close_of

NEVER = JournalSettings(commit_s=3600.0)
COUNT = 14  # batches of a session
FILE_FLIPS, LOG_FLIPS = 100, 30
OTHER = "cell-2"


def edit(revision: int, action: Insert | Undo) -> Edit:
    return Edit(session=NAME, revision=revision, author="Ann", action=action)


def teach(journal: SqliteJournal) -> None:
    """An open and a closed session at two stations, both with edits; a closed one beside the first."""
    registry = new_registry(journal)
    for station in (STATION, OTHER):
        registry.handle_command(station, opening(), 1.0)
        for each in batches(COUNT):
            registry.handle_samples(station, each, 2.0)
        journal.commit()
        for revision, action in enumerate((Insert(t=1.235), Insert(t=0.535), Undo())):
            assert isinstance(answer(registry.handle_command(station, edit(revision, action), 3.0)), Ack)
    registry.handle_command(OTHER, close_of(COUNT - 1), 4.0)
    registry.handle_command(STATION, opening("s2"), 5.0)
    for each in batches(COUNT, "s2"):
        registry.handle_samples(STATION, each, 6.0)
    registry.handle_command(STATION, close_of(COUNT - 1, "s2"), 7.0)


def shown(registry: Registry) -> dict[tuple[str, str], object]:
    """What can be asked of every session."""
    known = [unowned(standing) for standing in registry.index.all_states()]
    return {
        (one.station, one.session): (one.view, program_of(one), one.lifecycle, one.revision, one.undoable)
        for one in known
    }


def after_restart(path: Path, caplog: pytest.LogCaptureFixture) -> tuple[object, list[str]]:
    """What a service finds in a file, and what it says of damage."""
    caplog.clear()
    try:
        with SqliteJournal(path, NEVER) as journal:
            registry = new_registry(journal)
            failed = [str(one.error) for one in registry.restore(10.0)]
            recorded = {key: tuple(journal.replay(*key)) for key in sorted(journal.sessions())}
            journal.enforce_retention(20.0)
            found = shown(registry), recorded, journal.sessions(), journal.epoch_of(STATION)
    except JournalError as error:
        return None, [str(error)]
    return found, failed + [one.getMessage() for one in caplog.records if one.levelname != "INFO"]


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A journal as a service leaves it that ends."""
    path = tmp_path_factory.mktemp("written") / "caesura-1.sqlite"
    with SqliteJournal(path, NEVER) as journal:
        teach(journal)
    return path


@pytest.fixture(scope="module")
def left(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A journal as a service leaves it that is killed: nearly all is in its log."""
    directory = tmp_path_factory.mktemp("left")
    path = directory / "caesura-1.sqlite"
    with SqliteJournal(path, NEVER) as journal:
        teach(journal)
        shutil.copytree(directory, directory / "killed")
    return directory / "killed" / path.name


def flipped(file: Path, rng: random.Random, count: int) -> Iterator[int]:
    """Flip one bit after the other, of a copy of the file's content each; the byte."""
    content = file.read_bytes()
    for _ in range(count):
        bit = rng.randrange(8 * len(content))
        damaged = bytearray(content)
        damaged[bit // 8] ^= 1 << bit % 8
        file.write_bytes(damaged)
        yield bit // 8


@pytest.mark.slow
@pytest.mark.parametrize(
    ("made", "suffix", "count"),
    [("written", "", FILE_FLIPS), ("left", "-wal", LOG_FLIPS)],
    ids=["file", "log"],
)
def test_a_flipped_bit_changes_nothing_or_is_named(request, tmp_path, caplog, made, suffix, count):
    source: Path = request.getfixturevalue(made)

    def copied(number: int) -> Path:
        shutil.copytree(source.parent, tmp_path / str(number), ignore=shutil.ignore_patterns("killed"))
        return tmp_path / str(number) / source.name

    expected, said = after_restart(copied(-1), caplog)
    assert said == []
    rng, named = random.Random(5), 0
    for number in range(count):
        path = copied(number)
        (byte,) = flipped(path.with_name(path.name + suffix), rng, 1)
        found, said = after_restart(path, caplog)
        assert said or found == expected, f"byte {byte} of the {suffix or 'file'}: changed in silence"
        named += bool(said)
    assert named > count / 4


def spoil(path: Path, what: str) -> None:
    """Change what is in the file, as SQLite itself would write it."""
    with closing(sqlite3.connect(path)) as database:
        database.execute(what)
        database.commit()


@pytest.mark.parametrize(
    "what",
    [
        "UPDATE records SET payload = zeroblob(length(payload)) WHERE place = 5",
        "UPDATE records SET at = at + 1 WHERE place = 5",
        "UPDATE records SET seq = 99 WHERE place = 5",
        "DELETE FROM records WHERE place = 5",
        "UPDATE records SET session_id = 2, seq = 99 WHERE place = 5",
    ],
)
def test_a_damaged_record_costs_its_session_alone_whose_name_is_free_then(written, tmp_path, caplog, what):
    path = Path(shutil.copy(written, tmp_path))
    expected, _ = after_restart(Path(shutil.copy(written, tmp_path / "whole.db")), caplog)
    spoil(path, what)
    with SqliteJournal(path, NEVER) as journal:
        registry = new_registry(journal)
        (failed,) = registry.restore(10.0)
        assert (failed.station, failed.session) == (STATION, NAME)
        assert f"{STATION}/{NAME}" in str(failed.error)
        others = {key: known for key, known in expected[0].items() if key != (STATION, NAME)}
        assert shown(registry) == others
        assert (STATION, NAME) not in journal.sessions()
        assert answer(registry.handle_command(STATION, opening(), 11.0)) == Ack(
            session=NAME, next_seq=0, state="open"
        )
        for each in batches(COUNT):
            registry.handle_samples(STATION, each, 12.0)
    assert "is set aside as cell-1/s1.damaged-1" in caplog.text
    with SqliteJournal(path, NEVER) as journal:
        assert new_registry(journal).restore() == []


def test_a_damaged_outcome_is_rebuilt_from_the_records(written, tmp_path, caplog):
    path = Path(shutil.copy(written, tmp_path))
    expected, _ = after_restart(Path(shutil.copy(written, tmp_path / "whole.db")), caplog)
    spoil(path, "UPDATE outcomes SET last_seq = last_seq + 1")
    found, said = after_restart(path, caplog)
    assert found[0] == expected[0]
    assert sorted(said) == [
        UNREADABLE_OUTCOME % (name, "its results are damaged") for name in ("cell-1/s2", "cell-2/s1")
    ]


def test_a_closed_session_with_a_damaged_record_can_be_asked_for_and_not_be_corrected(
    written, tmp_path, caplog
):
    path = Path(shutil.copy(written, tmp_path))
    spoil(path, "UPDATE records SET at = at + 1 WHERE seq = 3 AND session_id = 2")
    for _ in range(2):
        with SqliteJournal(path, NEVER) as journal:
            registry = new_registry(journal)
            assert registry.restore(10.0) == []
            assert (OTHER, NAME) in shown(registry)
            registry.handle_command(OTHER, edit(3, Insert(t=0.8)), 11.0)
            while registry.rebuilding:
                registry.rebuild_step(OTHER)
            refusal = answer(registry.handle_command(OTHER, edit(3, Insert(t=0.8)), 12.0))
            assert f"{OTHER}/{NAME} is damaged" in str(refusal)


def test_of_a_torn_file_the_sessions_that_are_whole_are_kept(written, tmp_path, caplog):
    path = Path(shutil.copy(written, tmp_path))
    expected, _ = after_restart(Path(shutil.copy(written, tmp_path / "whole.db")), caplog)
    content = bytearray(path.read_bytes())
    last = content.rfind(b"caesura.SampleBatch")  # of the page that has a batch of the last session
    page = last // 4096 * 4096
    content[page : page + 4096] = b"\xff" * 4096
    path.write_bytes(content)
    found, said = after_restart(path, caplog)
    whole = {key for key in found[0] if found[0][key] == expected[0][key]}
    assert set(found[0]) == whole
    assert 1 <= len(whole) < 3
    lost = set(expected[0]) - whole
    assert all(any(f"{'/'.join(key)} is not kept" in line for line in said) for key in lost)


def test_of_a_torn_file_the_epochs_of_its_stations_are_kept(written, tmp_path):
    path = Path(shutil.copy(written, tmp_path))
    with SqliteJournal(path, NEVER) as journal:
        journal.store_epoch(OTHER, 8)
        journal.store_takeover(OTHER, 7)
    content = bytearray(path.read_bytes())
    page = content.rfind(b"caesura.SampleBatch") // 4096 * 4096
    content[page : page + 4096] = b"\xff" * 4096
    path.write_bytes(content)
    with SqliteJournal(path, NEVER) as journal:
        (copy,) = journal.copies(OTHER)
        assert (journal.epoch_of(OTHER), copy.owner_epoch) == (8, 7)


def test_of_a_torn_file_a_session_that_is_set_aside_stays_so_with_its_reason(written, tmp_path):
    """It was copied as an open session, which no limit deletes, without the reason."""
    path = Path(shutil.copy(written, tmp_path))
    refused = Refused(edits=1, described=0, close=False)

    def aside() -> list[tuple[object, ...]]:
        columns = "session, opened, touched, closed, size, record_count, damage"
        with closing(sqlite3.connect(path)) as database:
            return database.execute(f"SELECT {columns} FROM sessions WHERE damage IS NOT NULL").fetchall()

    with SqliteJournal(path, NEVER) as journal:
        journal.retract(STATION, NAME, refused, "another instance's change counts")
    (expected,) = aside()
    content = bytearray(path.read_bytes())
    page = content.rfind(b"caesura.SampleBatch") // 4096 * 4096
    content[page : page + 4096] = b"\xff" * 4096
    path.write_bytes(content)
    with SqliteJournal(path, NEVER) as journal:
        assert aside() == [expected]
        assert len(journal.changes(STATION, str(expected[0]))) == 2
        assert [*path.parent.glob("*.damaged-*")]


def cut(path: Path, *session_ids: int) -> None:
    """Break the chain of pages in which a file has outcomes: SQLite reports them as malformed."""
    with closing(sqlite3.connect(path)) as database:
        database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        query = "SELECT pageno FROM dbstat WHERE name = 'outcomes' AND path LIKE '%+000000' ORDER BY path"
        firsts = [(number - 1) * 4096 for (number,) in database.execute(query)]  # of each row's further pages
    content = bytearray(path.read_bytes())
    for session_id in session_ids:
        page = firsts[session_id - 1]
        content[page : page + 4] = b"\xff" * 4
    path.write_bytes(content)


def reported(journal: SqliteJournal) -> list[tuple[str, str, bool]]:
    journal.enforce_retention(20.0)
    return [(one.station, one.session, one.set_aside) for one in journal.report().damaged]


def test_a_session_that_is_set_aside_is_in_the_report_with_its_reason(written, tmp_path):
    """Only the log had it."""
    path = Path(shutil.copy(written, tmp_path))
    spoil(path, "UPDATE records SET at = at + 1 WHERE place = 5")
    for _ in range(2):
        with SqliteJournal(path, NEVER) as journal:
            new_registry(journal).restore(10.0)
            eventually(lambda: reported(journal) == [(STATION, NAME, True)])
            assert "its checksum is not" in journal.report().damaged[0].why


def test_an_outcome_whose_pages_are_damaged_costs_no_other_session(tmp_path, monkeypatch):
    """In a file that is not searched at the start. The station was not served, and no page was listed."""
    monkeypatch.setattr("caesura_service.journal.damaged_file.CHECKED_BYTES", 0)
    path = tmp_path / "caesura-1.sqlite"
    names = [f"s{number:02d}" for number in range(20)]
    for name in names:
        result = ended(*["motion", "steady"] * 200, t=2.0, session=name)
        recorded(tmp_path, taught(2.0), session=name, closed=result)
    cut(path, 2, 20)  # a stored one, and one that the service loads
    with SqliteJournal(path, NEVER) as journal:
        registry = new_registry(journal)
        assert registry.restore(10.0) == []
        held = registry.index.sessions[STATION]
        assert [one.name for one in held] == names[-16:]
        journal.flush()
        pages = registry.stored.page(lambda _key: True, StoredPage())
        assert [one.status.session for one in pages if one] == ["s03", "s02", "s00"]
        eventually(lambda: (STATION, "s01", False) in reported(journal))
    with SqliteJournal(path, NEVER, alone=False) as journal:
        assert read_session_export(journal, STATION, "s01").recording.t.size == 200


def test_of_a_torn_file_a_session_without_readable_results_keeps_its_samples(tmp_path):
    """It was not kept."""
    for name in ("s1", "s2"):
        recorded(
            tmp_path,
            taught(2.0),
            session=name,
            closed=ended(*["motion", "steady"] * 200, t=2.0, session=name),
        )
    path = tmp_path / "caesura-1.sqlite"
    cut(path, 1)
    with SqliteJournal(path, NEVER) as journal:
        assert [*path.parent.glob("*.damaged-*")]
        assert journal.sessions() == ((STATION, "s1"), (STATION, "s2"))
        assert len([*journal.replay(STATION, "s1")]) == 12
        eventually(lambda: reported(journal) == [(STATION, "s1", False)])


def without_checksums(path: Path) -> None:
    """As version 3 wrote it."""
    with closing(sqlite3.connect(path)) as database:
        for table, column, _ in COLUMNS_4:
            database.execute(f"ALTER TABLE {table} DROP COLUMN {column}")
        database.execute("PRAGMA user_version = 3")


def test_a_journal_of_version_3_is_read_by_itself_and_beside_and_goes_on(written, tmp_path, caplog):
    path = Path(shutil.copy(written, tmp_path))
    expected, _ = after_restart(Path(shutil.copy(written, tmp_path / "whole.db")), caplog)
    without_checksums(path)
    beside = PeerJournals(tmp_path / "caesura-2.sqlite")
    assert [found.copy.edits for found in beside.copies(OTHER)] == [3]
    (found,) = beside.copies(OTHER)
    assert len(list(beside.records(found))) == 1 + COUNT + 3 + 1
    assert beside.outcome(found) is not None
    shown_now, said = after_restart(path, caplog)
    assert (shown_now, said) == (expected, [])
    with SqliteJournal(path, NEVER) as journal:
        registry = new_registry(journal)
        registry.restore()
        for each in batches(COUNT + 4)[COUNT:]:
            registry.handle_samples(STATION, each, 20.0)
    spoil(path, f"UPDATE records SET at = at + 1 WHERE seq = {COUNT + 1}")
    _, said = after_restart(path, caplog)
    assert any("is damaged: its checksum" in line for line in said)


UNREADABLE = """
import ctypes, sys
from pathlib import Path
from caesura_service.journal import SqliteJournal
from harness.sessions import new_registry
path, only_once = Path(sys.argv[1]), int(sys.argv[2])
fail_from = ctypes.CDLL(None).fail_from
with SqliteJournal(path) as journal:
    registry = new_registry(journal)
    replay, calls = registry._takeover._replay_own, []
    def failing(*given):
        if not calls:
            journal._database.execute("PRAGMA shrink_memory")
            fail_from(1, only_once)
        calls.append(given)
        return replay(*given)
    registry._takeover._replay_own = failing
    left_out = registry.restore()
    failed = fail_from(0, 0)
    print(bool(failed), len(left_out), len(registry.index.all_states()), *journal.sessions())
    for each in left_out:
        print(each.error)
"""


@pytest.mark.slow
@pytest.mark.skipif(COMPILER is None, reason=NO_COMPILER)
@pytest.mark.parametrize("only_once", [1, 0])
def test_a_session_that_cannot_be_read_just_then_is_not_set_aside(tmp_path, only_once):
    """SQLite calls a file malformed that it cannot read: the session was set aside, for good."""
    library, journals = tmp_path / "failing.so", tmp_path / "journals"
    with SqliteJournal(journals / "caesura-1.sqlite", NEVER) as journal:
        journal.append(Record(STATION, NAME, 0.0, opening()))
        for seq in range(300):
            journal.append(Record(STATION, NAME, 0.0, batch(seq)))
    build(FAILING, library)
    watched = {"LD_PRELOAD": str(library), "FAILING_IN": str(journals)}
    command = [sys.executable, "-c", UNREADABLE, str(journals / "caesura-1.sqlite"), str(only_once)]
    ended = subprocess.run(
        command, env=environment() | watched, capture_output=True, text=True, timeout=60.0, check=False
    )
    assert ended.returncode == 0, ended.stderr
    said, *why = ended.stdout.splitlines()
    assert said == f"True {1 - only_once} {only_once} ('cell-1', 's1')"
    assert all("cannot be read or written, the disk fails" in one for one in why)
