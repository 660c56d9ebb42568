"""Sessions beyond those that a service holds: listed in pages, with their samples, from the journal."""

from __future__ import annotations

import sqlite3
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from caesura_clients import Caesura, query
from caesura_clients.cli.options import only_station
from caesura_clients.dashboard.network_follower import NetworkFollower
from caesura_clients.dashboard.session_list_rows import damaged as damaged_lines
from caesura_clients.dashboard.session_list_rows import sessions
from caesura_clients.session_corrections import send
from caesura_protocol.errors import NotFound, ProtocolError
from caesura_protocol.keys import SampleRange, StoredPage, session_key, stored_parameters
from caesura_protocol.messages import Describe, Description, Snapshot
from caesura_protocol.transport.memory import MemoryNetwork, MemoryQuestion
from caesura_service.app import Service
from caesura_service.config import ServiceConfig
from caesura_service.journal import (
    JournalUnreadableError,
    Outcome,
    SqliteJournal,
    StoredOutcome,
    sqlite_journal,
)
from caesura_service.journal.sqlite_statements import SELECT_OUTCOME
from caesura_service.ownership.stored_sessions import StoredSessions
from caesura_service.server.answering_thread import Pace
from caesura_service.server.memory_network import in_memory
from caesura_service.server.stored_session_server import (
    LISTING_RATE,
    PATIENCE_S,
    QUERIES,
    StoredSessionServer,
)
from caesura_service.sessions.limits import Limits
from harness.fake_pipeline import make_fake_pipeline
from harness.journals import ended, journal_file, taught, write_short_sessions, written
from harness.peer import MemoryPeer
from harness.processes import DEADLINE_S, eventually
from harness.sessions import batches, opening

TAUGHT = 36  # sessions; the service holds the last 16 of a station
NAMES = [f"s{i:02d}" for i in range(TAUGHT)]
STORED = NAMES[-17::-1]  # the newest first
INDEX: Any = SimpleNamespace(sessions={"cell-1": [SimpleNamespace(name="held")]})  # of an instance


@pytest.fixture(scope="module")
def caesura(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Caesura]:
    folder: Path = tmp_path_factory.mktemp("journal")
    for name in NAMES:
        written(folder, taught(2.0), session=name, closed=ended("motion", t=2.0, session=name))
    network = MemoryNetwork()
    config = ServiceConfig(instance="caesura-1", preset="fake", journal=folder)
    with Service(config, pipeline_factory=make_fake_pipeline, join=in_memory(network)):
        yield Caesura(network.transport())


def names(found: list[Snapshot]) -> list[str]:
    return [one.status.session for one in found]


def test_stored_sessions_come_in_pages_and_held_ones_are_not_among_them(caesura: Caesura):
    held = names(query.snapshots(caesura.transport))
    assert sorted(held) == NAMES[-16:]
    pages = [names(query.stored_snapshots(caesura.transport, skip=skip)) for skip in (0, 16, 32)]
    assert [sorted(page) for page in pages] == [sorted(STORED[:16]), sorted(STORED[16:]), []]
    assert query.stored_snapshots(caesura.transport, "cell-2") == []


def test_one_stored_session_has_its_results_and_its_samples(caesura: Caesura):
    (one,) = query.stored_snapshots(caesura.transport, "cell-1", "s03")
    assert one.segments.segments[0].kind == "motion"
    # It read "station 'cell-1' has no session s03", with its program in the journal.
    assert caesura.snapshot("cell-1", "s03") == one
    inferred = query.snapshot(caesura.transport, "cell-1", "s03", inferred=True)
    assert inferred.program == one.program
    found = query.samples(caesura.transport, "cell-1", "s03", SampleRange(0.0, 2.0, 1000))
    assert (found.first, found.last, found.counts[0]) == (0.0, 1.99, 200)
    with pytest.raises(NotFound):
        query.samples(caesura.transport, "cell-1", "s99", SampleRange(0.0, 2.0, 1000))


def test_a_stored_session_is_found_without_its_station(caesura: Caesura):
    assert only_station(caesura, None, "s03") == "cell-1"
    with pytest.raises(NotFound, match="no station has a session 's99'"):
        only_station(caesura, None, "s99")


def test_a_change_of_a_stored_session_is_refused_with_the_reason(caesura: Caesura):
    # It read "no such session at this station", with the names of other sessions, beside its results.
    late = Describe(session="s03", author="Ann", before=Description(), description=Description(task="late"))
    with pytest.raises(ProtocolError, match="newer sessions have taken the place of this one: it can be"):
        send(caesura.transport, "cell-1", late)
    with pytest.raises(ProtocolError, match="no such session at this station"):
        send(caesura.transport, "cell-1", late.model_copy(update={"session": "s99"}))


@pytest.mark.parametrize(
    "parameters", ["stored=17", "stored=0", "stored=all", "stored=4;skip=-1", "edits=x", "stored=4;edits=x"]
)
def test_a_page_that_makes_no_sense_is_refused(caesura: Caesura, parameters: str):
    key = session_key("*", "*", "snapshot")
    with pytest.raises(ProtocolError) as refused:
        query.decoded(caesura.transport.query(key, parameters=parameters), Snapshot)
    assert refused.value.code == "malformed"


def test_the_dashboard_lists_them_page_by_page_and_opens_one_by_its_name(caesura: Caesura):
    with NetworkFollower(caesura.transport, refresh_s=0.2) as follower:
        eventually(lambda: len(follower.world.updates) == 16)
        assert follower.world.update("cell-1", "s00") is None
        assert follower.read_stored("cell-1", "s00") == 1
        assert follower.world.update("cell-1", "s00") is not None
        assert [follower.read_stored() for _ in range(3)] == [16, 4, 0]
        assert {row["session"] for row in sessions(follower.world)} == set(NAMES)


@pytest.mark.parametrize(
    ("asked", "found", "listed"),
    [
        (("*", "*"), 16, 32 + 16),  # and those that the service holds, the last 16 of each station
        (("cell-1", "*"), 16, 16 + 16),
        (("*", "s00003"), 1, 1),
        (("cell-2", "s00003"), 1, 1),
        (("cell-1", "s00003"), 0, 0),
    ],
)
def test_a_page_costs_nothing_for_the_sessions_that_it_does_not_have(
    two_stations: Caesura, monkeypatch, asked: tuple[str, str], found: int, listed: int
):
    """A page of all stations listed every session: 0.7 s beside 20,000 of them."""
    read, outcomes = list[StoredOutcome](), SqliteJournal.outcomes

    def recorded(self: SqliteJournal, *key: str | None) -> Iterator[StoredOutcome]:
        for one in outcomes(self, *key):
            read.append(one)
            yield one

    monkeypatch.setattr(SqliteJournal, "outcomes", recorded)
    page = query.stored_snapshots(two_stations.transport, *asked)
    assert (len(page), len(read)) == (found, listed)


@pytest.fixture(scope="module")
def two_stations(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Caesura]:
    folder: Path = tmp_path_factory.mktemp("two")
    write_short_sessions(folder, [(f"cell-{1 + number % 2}", f"s{number:05d}") for number in range(80)])
    network = MemoryNetwork()
    config = ServiceConfig(instance="caesura-1", preset="fake", journal=folder)
    with Service(config, pipeline_factory=make_fake_pipeline, join=in_memory(network)):
        yield Caesura(network.transport())


@pytest.mark.parametrize(
    "asked", [(None, None), ("cell-1", None), (None, "s00008"), ("cell-1", "s00008")], ids=str
)
def test_a_page_needs_as_many_steps_of_the_database_beside_many_sessions_as_beside_few(
    tmp_path: Path, asked: tuple[str | None, str | None]
):
    def steps(sessions: int) -> int:
        folder = tmp_path / str(sessions)
        write_short_sessions(folder, [(f"cell-{number % 2}", f"s{number:05d}") for number in range(sessions)])
        counted: list[None] = []
        with SqliteJournal(folder / "caesura-1.sqlite") as journal:
            journal._reader.set_progress_handler(lambda: counted.append(None), 1)
            stored = StoredSessions(journal, lambda: INDEX, lambda _station: True)
            list(stored.page(lambda _key: True, StoredPage(), *asked))
        return len(counted)

    few, many = steps(300), steps(900)
    assert few == pytest.approx(many, rel=0.01)


def test_pages_of_any_filter_are_the_parts_of_one_list(two_stations: Caesura):
    everything = [f"s{number:05d}" for number in range(80)]
    stored = everything[47::-1]

    def pages(station: str, session: str) -> list[str]:
        found, page = list[str](), ["first"]
        while page:
            key = session_key(station, "*", "snapshot").replace("/*/snapshot", f"/{session}/snapshot")
            wanted = stored_parameters(StoredPage(5, len(found)))
            page = names(query.decoded(two_stations.transport.query(key, parameters=wanted), Snapshot))
            found += page
        return found

    assert pages("*", "*") == stored
    assert pages("cell-1", "*") == [name for name in stored if int(name[1:]) % 2 == 0]
    assert pages("*", "s0001$*") == [name for name in stored if name.startswith("s0001")]
    assert pages("cell-2", "s0001$*") == ["s00019", "s00017", "s00015", "s00013", "s00011"]
    assert pages("*", "s0001") == pages("*", "s000010") == []


def test_a_station_that_made_room_for_another_is_stored_and_taught_again(tmp_path: Path):
    network = MemoryNetwork()
    config = ServiceConfig(instance="test-1", preset="fake", journal=tmp_path, limits=Limits(stations=1))
    running = Service(config, pipeline_factory=make_fake_pipeline, join=in_memory(network))
    with running, MemoryPeer(network) as peer:
        caesura = Caesura(network.transport())
        for station in ("cell-1", "cell-2"):
            peer.command(opening("s1"), station)
            for one in batches(9):
                peer.send(one, station)
            peer.until_closed(8, station)
            assert [one.station for one in caesura.sessions()] == [station]
        eventually(lambda: len(query.stored_snapshots(caesura.transport, "cell-1")) == 1)
        found = query.samples(caesura.transport, "cell-1", "s1", SampleRange(0.0, 2.0, 1000))
        assert found.counts[0] == 180
        peer.command(opening("s2"), "cell-1")
        assert [(one.station, one.session) for one in caesura.sessions()] == [("cell-1", "s2")]


def test_a_page_of_another_station_does_not_wait_for_the_end_of_a_long_one(tmp_path: Path, monkeypatch):
    """A page of 16 long sessions takes seconds."""
    for station, count in (("cell-1", 16), ("cell-2", 1)):
        for name in NAMES[:count]:
            outcome = ended("motion", t=1.0, station=station, session=name)
            written(tmp_path, taught(1.0), station=station, session=name, closed=outcome)
    both_ask, begun, read, outcome_of = threading.Event(), threading.Event(), [], SqliteJournal.outcome

    def slow(self: SqliteJournal, station: str, session: str) -> Outcome | None:
        begun.set()
        assert both_ask.wait(DEADLINE_S)
        read.append(station)
        return outcome_of(self, station, session)

    with SqliteJournal(tmp_path / "caesura-1.sqlite") as journal:
        stored = StoredSessions(journal, lambda: INDEX, lambda _station: True)
        monkeypatch.setattr(SqliteJournal, "outcome", slow)
        first, second = (
            MemoryQuestion(session_key(station, "*", "snapshot"), "", None)
            for station in ("cell-1", "cell-2")
        )
        with StoredSessionServer(stored, "caesura-1") as server:
            server.enqueue(first, "cell-1", StoredPage())
            assert begun.wait(DEADLINE_S)
            server.enqueue(second, "cell-2", StoredPage())
            both_ask.set()
            assert first.ended.wait(DEADLINE_S)
            assert second.ended.wait(DEADLINE_S)
    assert (len(first.replies), len(second.replies)) == (16, 1)
    assert read.index("cell-2") <= 2


def test_a_page_waits_for_no_write_of_the_journal(tmp_path: Path):
    for name in ("s1", "s2"):
        written(tmp_path, taught(1.0), session=name, closed=ended("motion", t=1.0, session=name))
    with SqliteJournal(tmp_path / "caesura-1.sqlite") as journal, ThreadPoolExecutor(1) as reader:
        stored = StoredSessions(journal, lambda: INDEX, lambda _station: True)
        with journal._writing:
            page = reader.submit(lambda: list(stored.page(lambda _key: True, StoredPage())))
            assert names(page.result(DEADLINE_S)) == ["s2", "s1"]


def test_a_damaged_outcome_is_logged_once_however_often_it_is_asked_for(tmp_path: Path, caplog):
    """Each query logged a line, and stated that the session is rebuilt, which only the last ones are."""
    write_short_sessions(tmp_path, [("cell-1", name) for name in NAMES[:3]])
    path = tmp_path / "caesura-1.sqlite"
    with journal_file(path) as file:
        file.execute("UPDATE outcomes SET snapshot = x'00' WHERE session_id = 2")
    with SqliteJournal(path) as journal:
        stored = StoredSessions(journal, lambda: INDEX, lambda _station: True)
        for _ in range(20):
            assert names([*stored.page(lambda _key: True, StoredPage())]) == ["s02", "s00"]
    assert caplog.text.count("the outcome of cell-1/s01 cannot be read") == 1


def test_a_damaged_outcome_is_logged_before_a_client_can_learn_of_it(tmp_path: Path, monkeypatch):
    """A client that read that a session is damaged, and then the log, found no line."""
    write_short_sessions(tmp_path, [("cell-1", name) for name in NAMES[:3]])
    path = tmp_path / "caesura-1.sqlite"
    with journal_file(path) as file:
        file.execute("UPDATE outcomes SET snapshot = x'00' WHERE session_id = 2")
    monkeypatch.setattr(SqliteJournal, "_check_outcomes", lambda _self: (None for _ in ()))
    known_when_logged = list[bool]()
    with SqliteJournal(path) as journal:
        monkeypatch.setattr(
            sqlite_journal.logger,
            "log",
            lambda *_given: known_when_logged.append(journal._unreadable.has(("cell-1", "s01"))),
        )
        assert journal.outcome("cell-1", "s01") is None
        assert journal._unreadable.has(("cell-1", "s01"))
    assert known_when_logged == [False]


class FailingDisk:
    """A connection to a journal on a disk with a bad sector, under the outcome of one session."""

    def __init__(self, file: sqlite3.Connection, session: str) -> None:
        self._file, self._session = file, session

    def execute(self, statement: str, given: Sequence[str] = ()) -> sqlite3.Cursor:
        if statement == SELECT_OUTCOME and self._session in given:
            error = sqlite3.OperationalError("disk I/O error")
            error.sqlite_errorname = "SQLITE_IOERR_READ"
            raise error
        return self._file.execute(statement, given)

    def close(self) -> None:
        self._file.close()


def test_a_bad_sector_under_one_session_leaves_the_others_listed(tmp_path: Path, monkeypatch):
    """Its page was refused, and the check of all sessions ended there."""
    write_short_sessions(tmp_path, [("cell-1", name) for name in NAMES[:4]])
    path = tmp_path / "caesura-1.sqlite"
    with journal_file(path) as file:
        file.execute("UPDATE outcomes SET snapshot = x'00' WHERE session_id = 4")
    opened = sqlite_journal.open_for_reading
    monkeypatch.setattr(
        sqlite_journal,
        "open_for_reading",
        contextmanager(lambda *given: _with_bad_sector(opened(*given))),
    )
    with SqliteJournal(path) as journal:
        journal._reader = FailingDisk(journal._reader, "s01")
        stored = StoredSessions(journal, lambda: INDEX, lambda _station: True)
        assert names([*stored.page(lambda _key: True, StoredPage())]) == ["s02", "s00"]
        eventually(lambda: len(journal._unreadable._found) == 2)
        report = journal._unreadable.report((), {("cell-1", name) for name in NAMES[:4]})
        assert [one.session for one in report.listed] == ["s03", "s01"]
        assert "cannot be read, the disk fails: look after it" in report.listed[1].why
        with pytest.raises(JournalUnreadableError):
            stored.program("cell-1", "s01")


def _with_bad_sector(opening: AbstractContextManager[sqlite3.Connection]) -> Iterator[FailingDisk]:
    with opening as file:
        yield FailingDisk(file, "s01")


@pytest.fixture
def damaged(tmp_path: Path) -> Iterator[Caesura]:
    """A service on a journal of 36 sessions, of which the results of four cannot be read.

    The service holds s30, and rebuilds it.
    """
    for name in NAMES:
        written(tmp_path, taught(2.0), session=name, closed=ended("motion", t=2.0, session=name))
    path = tmp_path / "caesura-1.sqlite"
    with journal_file(path) as file:
        file.execute("UPDATE outcomes SET snapshot = CAST(snapshot AS TEXT) WHERE session_id = 4")
        file.execute("UPDATE outcomes SET snapshot = substr(snapshot, 1, 100) WHERE session_id = 6")
        file.execute("DELETE FROM outcomes WHERE session_id = 8")
        file.execute("UPDATE outcomes SET last_seq = last_seq + 1 WHERE session_id = 31")
    network = MemoryNetwork()
    config = ServiceConfig(instance="caesura-1", preset="fake", journal=tmp_path)
    with Service(config, pipeline_factory=make_fake_pipeline, join=in_memory(network)):
        yield Caesura(network.transport())


def test_a_stored_session_with_damaged_results_is_reported_and_its_samples_can_be_read(
    damaged: Caesura, caplog
):
    """It was in no list: the page left it out, and nothing named it until a client queried it."""
    found = list[query.SessionInfo]()

    def reported() -> bool:
        found[:] = query.damaged_sessions(damaged.transport)
        return len(found) >= 3

    eventually(reported)
    assert [(one.session, one.state) for one in found] == [
        (name, "damaged") for name in ("s07", "s05", "s03")
    ]
    why = (
        "its results were not stored before the service ended",
        "its results are damaged",
        "is damaged, or its disk",
    )
    for one, reason in zip(found, why, strict=True):
        assert reason in str(one.damage)
        assert f"`caesura sessions export {one.session} --station cell-1` writes its samples" in str(
            one.damage
        )
    assert query.damaged_sessions(damaged.transport, "cell-2") == []
    records = (*caplog.get_records("setup"), *caplog.get_records("call"))  # the check begins with the service
    logged = "\n".join(one.getMessage() for one in records)
    for name in ("s03", "s05"):
        assert logged.count(f"the outcome of cell-1/{name} cannot be read, ") == 1
    for name in ("s03", "s05", "s07"):
        samples = query.samples(damaged.transport, "cell-1", name, SampleRange(0.0, 2.0, 1000))
        assert samples.counts[0] == 200
    pages = [names(query.stored_snapshots(damaged.transport, skip=skip)) for skip in (0, 16)]
    assert sorted(pages[0] + pages[1]) == sorted({*STORED} - {"s03", "s05", "s07"})
    assert names(query.snapshots(damaged.transport, "cell-1", "s30")) == ["s30"]


@pytest.mark.parametrize("checked", [True, False])
def test_a_page_skips_no_session_whose_results_cannot_be_read(tmp_path: Path, monkeypatch, checked: bool):
    """They counted as skipped: the second page repeated sessions of the first one."""
    write_short_sessions(tmp_path, [("cell-1", name) for name in NAMES])
    path = tmp_path / "caesura-1.sqlite"
    with journal_file(path) as file:
        file.execute("UPDATE outcomes SET snapshot = x'00' WHERE session_id % 3 = 0")
    if not checked:
        monkeypatch.setattr(SqliteJournal, "_check_outcomes", lambda _self: (None for _ in ()))
    with SqliteJournal(path) as journal:
        eventually(lambda: not checked or len(journal._unreadable._found) == 12)
        stored = StoredSessions(journal, lambda: INDEX, lambda _station: True)
        pages = [names([*stored.page(lambda _key: True, StoredPage(8, skip))]) for skip in (0, 8, 16, 24)]
    whole = [name for number, name in enumerate(NAMES, 1) if number % 3]
    assert pages == [whole[:-9:-1], whole[-9:-17:-1], whole[-17::-1], []]


def test_the_dashboard_lists_damaged_sessions_below_the_others(damaged: Caesura):
    with NetworkFollower(damaged.transport, refresh_s=0.2) as follower:
        eventually(lambda: len(damaged_lines(follower.world)) == 3)
        first = damaged_lines(follower.world)[0]
    assert first.startswith("cell-1/s07, taught ")
    assert "its results were not stored" in first


def test_a_deleted_session_is_no_longer_reported_as_damaged(damaged: Caesura, tmp_path: Path):
    eventually(lambda: len(query.damaged_sessions(damaged.transport)) == 3)
    with SqliteJournal(tmp_path / "caesura-1.sqlite", alone=False) as beside:
        beside.delete("cell-1", "s05")
    eventually(lambda: [one.session for one in query.damaged_sessions(damaged.transport)] == ["s07", "s03"])


def test_sessions_without_an_outcome_do_not_fill_a_page(tmp_path: Path):
    for i in range(6):
        name = f"s{i}"
        result = ended("motion", t=1.0, session=name) if i in {0, 3} else None
        written(tmp_path, taught(1.0), session=name, closed=result)
    with SqliteJournal(tmp_path / "caesura-1.sqlite") as journal:
        stored = StoredSessions(journal, lambda: INDEX, lambda _station: True)
        pages = [names([*stored.page(lambda _key: True, StoredPage(1, skip))]) for skip in range(3)]
        assert pages == [["s3"], ["s0"], []]
        with journal_file(journal.path) as file:
            file.execute("UPDATE outcomes SET snapshot = x'00' WHERE session_id = 4")
        assert names([*stored.page(lambda _key: True, StoredPage(1))]) == ["s0"], (
            "one that is damaged neither"
        )


def test_the_thread_that_lists_stored_sessions_rests_four_fifths_of_the_time():
    now = 0.0
    pace = Pace(LISTING_RATE, clock=lambda: now)
    assert pace.rest_s(0.05) == 0.0  # one page
    worked_s = 0.05
    for _ in range(100):
        now += 0.01 + pace.rest_s(0.01)
        worked_s += 0.01
    assert worked_s == pytest.approx(LISTING_RATE.burst + LISTING_RATE.per_s * now, rel=0.05)


def test_a_flood_of_lists_takes_a_bounded_share_of_the_interpreter(two_stations: Caesura):
    """It took all that it could get: results of other stations were 0.4 s late."""
    threads = [one.ident for one in threading.enumerate() if one.name == "caesura-stored"]
    clocks = [time.pthread_getcpuclockid(ident) for ident in threads if ident is not None]
    began, worked_s = time.monotonic(), sum(map(time.clock_gettime, clocks))
    over = began + 1.5
    key, page = session_key("*", "*", "snapshot"), stored_parameters(StoredPage())
    answers = list[bool]()

    def flood() -> None:
        while time.monotonic() < over:
            replies, _ = two_stations.transport.query(key, parameters=page)
            answers.append(bool(replies))

    with ThreadPoolExecutor(8) as clients:
        for one in [clients.submit(flood) for _ in range(8)]:
            one.result(DEADLINE_S)
    worked_s, lasted_s = sum(map(time.clock_gettime, clocks)) - worked_s, time.monotonic() - began
    assert any(answers)
    granted_s = LISTING_RATE.burst + LISTING_RATE.per_s * lasted_s
    assert worked_s < 1.25 * granted_s + 0.05, "refusals and the last step are beyond what is granted"
    assert worked_s < lasted_s / 2, "of all that it could get"


def test_a_list_that_has_waited_too_long_is_refused_with_a_time(tmp_path: Path):
    write_short_sessions(tmp_path, [("cell-1", "s1")])
    now, queries = 100.0, [MemoryQuestion(session_key("*", "*", "snapshot"), "", None) for _ in range(2)]
    with SqliteJournal(tmp_path / "caesura-1.sqlite") as journal:
        stored = StoredSessions(journal, lambda: INDEX, lambda _station: True)
        server = StoredSessionServer(stored, "caesura-1", clock=lambda: now)
        assert server.enqueue(queries[0], "?", StoredPage()) is None
        now += PATIENCE_S + 1.5
        assert server.enqueue(queries[1], "?", StoredPage()) is None
        with server:
            for one in queries:
                assert one.ended.wait(DEADLINE_S)
        (why,), (listed,) = queries[0].refusals, queries[1].replies
    assert (why.code, why.value, why.limit) == ("overloaded", 6.5, PATIENCE_S)
    assert "ask again in 7 s" in why.message
    assert listed.key == session_key("cell-1", "s1", "snapshot")


def test_a_lane_without_room_says_when_to_ask_again(tmp_path: Path):
    with SqliteJournal(tmp_path / "caesura-1.sqlite") as journal:
        server = StoredSessionServer(
            StoredSessions(journal, lambda: INDEX, lambda _station: True), "caesura-1"
        )
        key = session_key("*", "*", "snapshot")
        refused = [server.enqueue(MemoryQuestion(key, "", None), "?", StoredPage()) for _ in range(QUERIES)]
        other = server.enqueue(MemoryQuestion(key, "", None), "cell-1", StoredPage())
    assert refused[: QUERIES // 4] == [None] * (QUERIES // 4)
    assert "ask again in 1 s" in str(refused[-1])
    assert other is None


def test_a_query_with_an_endless_key_is_refused_unread(caesura: Caesura):
    """It was compared with the key of each session: 6 s beside 5,000 of them."""
    key = f"caesura/v1/session/*/{'s$*' * 2000}/snapshot"
    with pytest.raises(ProtocolError) as refused:
        query.decoded(caesura.transport.query(key, parameters=stored_parameters(StoredPage())), Snapshot)
    assert refused.value.code == "too_large"
