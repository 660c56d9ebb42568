"""What the open sessions of a station may take of a journal, and that no other station pays for them."""

from __future__ import annotations

from dataclasses import replace

import pytest

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import (
    Ack,
    Describe,
    Description,
    Error,
    Undo,
)
from caesura_service.journal import (
    AppliedEdit,
    AppliedProgramEdit,
    JournalError,
    JournalSettings,
    JournalShareError,
    MemoryJournal,
    Record,
    SqliteJournal,
)
from caesura_service.journal.retention import StationUsage, excess, open_part, part_of
from caesura_service.journal.station_quota import ENDING_BYTES
from caesura_service.ownership.registry import Registry
from harness.journals import not_written
from harness.sessions import answer, batch, batches, closing, heartbeat, new_registry, opening

SIZE = 200_000  # [bytes] of a journal
NOTES = tuple(Description(note=letter * 1000, task=letter * 120) for letter in "ab")


def describing(number: int, session: str = "s1") -> Describe:
    """A change of the description that an earlier one undid: 2 kB."""
    before, after = NOTES[number % 2], NOTES[1 - number % 2]
    return Describe(session=session, author="x", before=before, description=after)


def editing(number: int, session: str = "s1") -> AppliedEdit:
    return AppliedEdit(session=session, revision=number, author="x" * 60, action=Undo(), version=number + 1)


def editing_program(number: int, session: str = "s1") -> AppliedProgramEdit:
    return AppliedProgramEdit(session=session, revision=number, author="x" * 60, action=Undo())


def batching(number: int, session: str = "s1"):
    return batch(number, session)


def filled(
    journal: SqliteJournal | MemoryJournal,
    make=describing,
    station: str = "hostile",
    session: str = "s1",
) -> int:
    """Fill the share of a station with records of an open session; return how many it took."""
    for number in range(5000):
        try:
            journal.append(Record(station, session, 0.0, make(number, session)), now=True)
        except JournalError:
            return number
    raise AssertionError("no record was refused")


def begun(journal: SqliteJournal | MemoryJournal, station: str = "hostile", session: str = "s1") -> None:
    journal.append(Record(station, session, 0.0, opening(session)), now=True)


def kept(journal: SqliteJournal, station: str, count: int, at: float = 0.0) -> None:
    """Closed sessions of a station, a description of 2 kB each."""
    for number in range(count):
        name = f"s{number}"
        for message in (opening(name), describing(0, name), closing(-1, name)):
            journal.append(Record(station, name, at + number, message), now=True)


def size_of(journal: SqliteJournal, station: str) -> int:
    return sum(copy.size for copy in journal.copies(station))


# --- the share of open sessions -------------------------------------------------------------------------


@pytest.mark.parametrize("make", [batching, describing, editing, editing_program])
def test_every_record_of_an_open_session_counts_for_the_share_of_its_station(path, make):
    """Batches alone were refused: descriptions and edits made an open session as long as they liked."""
    with SqliteJournal(path, JournalSettings(size_bytes=SIZE)) as journal:
        begun(journal)
        assert filled(journal, make) > 10
        for refused in (batching, describing, editing, editing_program):
            with pytest.raises(JournalShareError, match="open sessions of station hostile take") as caught:
                journal.append(Record("hostile", "s1", 0.0, refused(9999)), now=True)
            assert "close them, or raise --journal-gb" in str(caught.value)
            assert caught.value.limit == SIZE // 2 <= caught.value.taken < SIZE // 2 + 3000
        begun(journal, "other")
        journal.append(Record("other", "s1", 0.0, describing(0)), now=True)
        journal.append(Record("hostile", "s1", 0.0, closing(-1)), now=True)
        begun(journal, session="s2")
        journal.append(Record("hostile", "s2", 0.0, describing(0, "s2")), now=True)


def test_the_share_is_the_same_after_a_restart_and_at_every_look(path):
    settings = JournalSettings(size_bytes=SIZE)
    with SqliteJournal(path, settings) as journal:
        begun(journal)
        count = filled(journal)
        with not_written(journal):
            journal.enforce_retention(0.0)
        assert filled(journal) == 0
    with SqliteJournal(path, settings) as journal:
        assert filled(journal) == 0
        assert len(list(journal.replay("hostile", "s1"))) == count + 1


def test_what_waits_to_be_written_counts_at_a_look(path):
    with SqliteJournal(path, JournalSettings(size_bytes=SIZE, commit_s=3600.0)) as journal:
        begun(journal)
        for seq in range(1000):
            try:
                journal.append(Record("hostile", "s1", 0.0, batch(seq)))
            except JournalShareError:
                break
        with not_written(journal):
            journal.enforce_retention(0.0)
        with pytest.raises(JournalShareError):
            journal.append(Record("hostile", "s1", 0.0, batch(1000)))


def test_open_sessions_of_many_stations_stay_below_the_size_of_the_journal(path):
    with SqliteJournal(path, JournalSettings(size_bytes=SIZE)) as journal:
        for number in range(5):
            begun(journal, f"hostile-{number}")
            filled(journal, station=f"hostile-{number}")
        sizes = [size_of(journal, f"hostile-{number}") for number in range(5)]
        assert sizes == pytest.approx([SIZE / 2, SIZE / 4, SIZE / 8, SIZE / 16, SIZE / 32], abs=3000)
        assert sum(sizes) < SIZE + 3000


def test_a_session_can_end_at_its_share_and_no_record_passes_without_bound(path):
    """A resumed opening and a declared loss may be needed before the close."""
    with SqliteJournal(path, JournalSettings(size_bytes=SIZE)) as journal:
        begun(journal)
        filled(journal)
        lost = Error(code="evicted", message="x" * 4000, value=0, limit=5)
        journal.append(Record("hostile", "s1", 0.0, opening(epoch=1)), now=True)
        journal.append(Record("hostile", "s1", 0.0, lost), now=True)
        assert filled(journal, lambda *_: lost) < ENDING_BYTES / 4000
        with pytest.raises(JournalShareError):
            journal.append(Record("hostile", "s1", 0.0, opening(epoch=2)), now=True)
        begun(journal, session="s2")
        journal.append(Record("hostile", "s1", 0.0, closing(4)), now=True)
        assert journal.closed() == {("hostile", "s1")}


def test_a_closed_session_is_described_while_the_open_ones_have_their_share(path):
    with SqliteJournal(path, JournalSettings(size_bytes=SIZE)) as journal:
        kept(journal, "hostile", 1)
        begun(journal, session="open")
        assert filled(journal, session="open") > 10
        journal.append(Record("hostile", "s0", 0.0, describing(1, "s0")), now=True)


def test_a_record_that_could_not_be_written_does_not_count(path, monkeypatch):
    with SqliteJournal(path, JournalSettings(size_bytes=SIZE)) as journal:
        begun(journal)
        with monkeypatch.context() as broken:
            broken.setattr(journal, "_leave_room", lambda _: 1 / 0)
            for number in range(200):
                with pytest.raises(JournalError) as caught:
                    journal.append(Record("hostile", "s1", 0.0, describing(number)), now=True)
                assert not isinstance(caught.value, JournalShareError)
        journal.commit()
        assert filled(journal) > 10


def test_a_session_in_memory_gets_no_changes_past_the_capacity():
    """A description of 18 kB counted as 1 kB, and was never refused."""
    journal = MemoryJournal(capacity_bytes=SIZE)
    begun(journal, "other")
    begun(journal)
    count = filled(journal)
    assert count < SIZE / 2000
    journal.append(Record("hostile", "s1", 0.0, opening(epoch=1)))
    journal.append(Record("hostile", "s1", 0.0, closing(-1)))
    assert journal.closed() == {("hostile", "s1")}
    assert ("other", "s1") in journal.sessions()


# --- a station over its part ----------------------------------------------------------------------------


def usage(station: str, size: int, closed: int) -> StationUsage:
    return StationUsage(station, size, closed + 1, closed, 0.0)


@pytest.mark.parametrize(
    ("sizes", "part"),
    [
        ((), None),
        ((40, 60), None),
        ((40, 61), 60),
        ((10, 20, 90), 70),
        ((50, 50, 50), 33),
        ((0, 500), 100),
    ],
)
def test_the_part_of_a_station_is_what_the_largest_have_to_shrink_to(sizes, part):
    usages = [usage(str(number), size, 1) for number, size in enumerate(sizes)]
    assert part_of(usages, JournalSettings(size_bytes=100)) == part


def test_a_station_within_its_part_loses_nothing_to_open_sessions_of_another():
    """The largest station with closed sessions lost them, however small it was."""
    settings = JournalSettings(size_bytes=100)
    usages = [usage("small", 30, 3), usage("smaller", 10, 1), usage("hostile", 90, 0)]
    assert excess(usages, settings) is None
    assert open_part(usages, settings) == 60
    greedy = [*usages, usage("greedy", 50, 5)]
    too_much = excess(greedy, settings)
    assert too_much is not None
    assert (too_much.station, too_much.size) == ("greedy", 20), "which brings it to its part"
    assert open_part(greedy, settings) is None, "while retention still makes room"


def test_past_the_size_a_station_with_open_sessions_alone_gets_no_more_than_its_part(path):
    with SqliteJournal(path) as journal:
        kept(journal, "victim", 20)
        begun(journal)
        for number in range(40):
            journal.append(Record("hostile", "s1", 0.0, describing(number)), now=True)
        victim, hostile = size_of(journal, "victim"), size_of(journal, "hostile")
        journal.settings = replace(journal.settings, size_bytes=victim + hostile - 10_000)
        assert victim < hostile - 10_000 < hostile < journal.settings.size_bytes
        with not_written(journal):
            assert journal.enforce_retention(1.0) == {}
        with pytest.raises(JournalShareError) as caught:
            journal.append(Record("hostile", "s1", 0.0, describing(40)), now=True)
        assert caught.value.limit <= hostile - 10_000
        kept(journal, "victim-2", 1)
        with not_written(journal):
            assert journal.enforce_retention(2.0) == {}
        journal.append(Record("hostile", "s1", 0.0, closing(-1)), now=True)
        with not_written(journal):
            assert set(journal.enforce_retention(3.0)) == {("hostile", "s1")}


def test_a_look_deletes_more_sessions_than_a_station_closes_until_the_next_one(path):
    """A look deleted 32. With a budget of 500 commands a second, a station closes 250."""
    with SqliteJournal(path) as journal:
        for number in range(300):
            for message in (opening(f"s{number}"), closing(-1, f"s{number}")):
                journal.append(Record("hostile", f"s{number}", float(number), message))
        journal.commit()
        journal.settings = replace(journal.settings, size_bytes=0)
        with not_written(journal):
            assert len(journal.enforce_retention(1000.0)) == 300


def test_a_hostile_open_session_costs_other_stations_nothing_and_can_be_closed(path):
    """Its descriptions grew without bound, and the closed sessions of every other station went."""

    def handled(message, station: str) -> Ack | ProtocolError:
        return answer(registry.handle_command(station, message, 0.0))

    with SqliteJournal(path, JournalSettings(size_bytes=SIZE)) as journal:
        registry: Registry = new_registry(journal)
        for station in ("victim1", "victim2"):
            for session in ("good0", "good1"):
                session += station
                assert isinstance(handled(opening(session), station), Ack)
                for each in batches(6, session):
                    registry.handle_samples(station, each, 0.0)
                assert isinstance(handled(closing(5, session), station), Ack)
        assert isinstance(handled(opening("atk", description=NOTES[0]), "hostile"), Ack)
        answers = [handled(describing(number, "atk"), "hostile") for number in range(200)]
        refusal = next(one for one in reversed(answers) if isinstance(one, ProtocolError))
        assert (refusal.code, refusal.limit) == ("overloaded", SIZE // 2)
        assert refusal.value >= SIZE // 2
        with not_written(journal):
            assert [out for second in range(20) for out in registry.tick(10.0 + second)] == []
        assert len(journal.closed()) == 4
        assert journal.report().size < SIZE
        assert registry.handle_samples("hostile", heartbeat(-1, "atk"), 30.0) == []
        assert isinstance(handled(opening("next"), "victim1"), Ack)
        assert isinstance(handled(closing(-1, "atk"), "hostile"), Ack)
