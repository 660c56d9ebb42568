"""What a journal on disk keeps, what it lets go, and what a service knows of it after a restart."""

from __future__ import annotations

from dataclasses import replace

import pytest

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import Ack
from caesura_service.journal import JournalError, JournalSettings, Record, SqliteJournal
from caesura_service.ownership.registry import Registry
from caesura_service.publishing.events import SessionDeleted
from caesura_service.publishing.session_state import snapshot_of
from caesura_service.sessions.limits import Limits
from harness.journals import not_written
from harness.sessions import (
    STATION,
    answer,
    batch,
    batches,
    closing,
    heartbeat,
    new_registry,
    opening,
    unowned,
)

DAY_S = 86400.0
COUNT = 6


def taught(registry: Registry, session: str, now: float = 0.0, *, closed: bool = True) -> None:
    assert isinstance(answer(registry.handle_command(STATION, opening(session), now)), Ack)
    for each in batches(COUNT, session):
        registry.handle_samples(STATION, each, now)
    if closed:
        assert isinstance(answer(registry.handle_command(STATION, closing(COUNT - 1, session), now)), Ack)


def names(registry: Registry) -> list[str]:
    return [session.name for session in registry.index.sessions.get(STATION, ())]


def forgotten(registry: Registry, now: float) -> list[tuple[str, str]]:
    with not_written(registry._journal):
        said = registry.tick(now)
    return [(output.session, output.reason) for output in said if isinstance(output, SessionDeleted)]


def restarted(journal: SqliteJournal, **how: object) -> Registry:
    registry = new_registry(journal, **how)  # type: ignore[arg-type]
    assert registry.restore() == []
    return registry


def unpreparable(*_: object) -> None:
    raise AssertionError("a closed session needs no mathematics")


# --- after a restart ------------------------------------------------------------------------------------


def test_a_closed_session_is_there_after_a_restart_as_it_was_without_being_replayed(path):
    with SqliteJournal(path) as journal:
        registry = new_registry(journal)
        taught(registry, "s1")
        before = snapshot_of(unowned(registry.index.all_states()[0]))
    with SqliteJournal(path) as journal:
        registry = new_registry(journal)
        registry._factory._pipeline_factory = unpreparable
        assert registry.restore() == []
        assert snapshot_of(unowned(registry.index.all_states()[0])) == before


def test_it_equals_the_one_that_is_replayed_where_its_end_was_not_kept(path):
    with SqliteJournal(path) as journal:
        taught(new_registry(journal), "s1")
        kept = restarted(journal)
        journal._database.execute("DELETE FROM outcomes")
        replayed = restarted(journal)
        first, second = (unowned(each.index.all_states()[0]) for each in (kept, replayed))
        assert snapshot_of(first) == snapshot_of(second)
        assert journal.outcome(STATION, "s1") is not None  # for the next time


def test_a_closed_session_takes_what_trails_behind_and_nothing_else(path):
    with SqliteJournal(path) as journal:
        taught(new_registry(journal), "s1")
        registry = restarted(journal)
        again = answer(registry.handle_command(STATION, closing(COUNT - 1, "s1"), 0.0))
        assert again == Ack(session="s1", next_seq=COUNT, state="closed")
        assert registry.handle_samples(STATION, heartbeat(COUNT - 1, "s1"), 0.0) == []
        more = batches(COUNT + 1, "s1")[-1]
        registry.handle_samples(STATION, more, 0.0)
        reopened = answer(registry.handle_command(STATION, opening("s1"), 0.0))
        assert isinstance(reopened, ProtocolError)
        (standing,) = registry.index.all_states()
        assert standing.counters.refused == {"conflict": 1}  # for the batch
        assert standing.view.samples == COUNT * 20


def test_open_and_closed_sessions_keep_their_order_and_the_last_one_is_the_current_one(path):
    with SqliteJournal(path) as journal:
        registry = new_registry(journal)
        taught(registry, "s1", closed=False)
        taught(registry, "s2")
        taught(registry, "s3", closed=False)
        taught(registry, "s4")
        again = restarted(journal)
    assert names(again) == ["s1", "s2", "s3", "s4"]
    assert [session.is_open for session in again.index.sessions[STATION]] == [True, False, True, False]


def test_more_closed_sessions_are_kept_than_can_be_asked_for(path):
    limits = Limits(closed_sessions=2)
    with SqliteJournal(path) as journal:
        registry = new_registry(journal, limits)
        for index in range(4):
            taught(registry, f"s{index}")
        taught(registry, "s4", closed=False)
        assert names(registry) == ["s2", "s3", "s4"]
        assert [name for _, name in journal.sessions()] == ["s0", "s1", "s2", "s3", "s4"]
        assert names(restarted(journal, limits=limits)) == ["s2", "s3", "s4"]


def test_the_name_of_a_session_that_is_kept_is_taken(path):
    limits = Limits(closed_sessions=1)
    with SqliteJournal(path) as journal:
        registry = new_registry(journal, limits)
        for index in range(3):
            taught(registry, f"s{index}")
        refusal = answer(registry.handle_command(STATION, opening("s0"), 0.0))
    assert isinstance(refusal, ProtocolError)
    assert (refusal.code, refusal.value) == ("conflict", "s0")
    assert "choose another name" in refusal.message


# --- retention ------------------------------------------------------------------------------------------


def test_sessions_go_when_they_were_untouched_for_too_long_closed_ones_first(path):
    with SqliteJournal(path, JournalSettings(age_s=DAY_S)) as journal:
        registry = new_registry(journal)
        taught(registry, "open", 0.0, closed=False)
        taught(registry, "closed", 0.5 * DAY_S)
        taught(registry, "young", 2.0 * DAY_S)
        gone = [one for second in range(12) for one in forgotten(registry, 2.0 * DAY_S + second)]
        assert gone == [
            ("closed", "unchanged for 1.5 days; the limit is 1"),
            ("open", "unchanged for 2.0 days; the limit is 1"),
        ]
        assert names(registry) == ["young"]
        assert names(restarted(journal)) == ["young"]


@pytest.mark.parametrize("years", [0.17, 40])
def test_a_clock_that_is_years_ahead_at_a_start_costs_no_session(path, years):
    """A service on a machine whose clock was wrong deleted its whole journal within a second."""
    with SqliteJournal(path) as journal:
        registry = new_registry(journal)
        taught(registry, "open", 0.0, closed=False)
        for day in range(20):
            taught(registry, f"s{day}", day * DAY_S)
        wrong = years * 365 * DAY_S
        assert [one for second in range(12) for one in forgotten(registry, wrong + second)] == []
        taught(registry, "meanwhile", wrong)
        assert [one for second in range(12) for one in forgotten(registry, wrong + DAY_S + second)] == []


def test_after_a_pause_sessions_go_once_they_were_in_use_for_long_enough(path):
    with SqliteJournal(path, JournalSettings(age_s=10 * DAY_S)) as journal:
        registry = new_registry(journal)
        taught(registry, "before", 0.0)
        for day in range(100, 105):
            taught(registry, f"s{day}", day * DAY_S)
        gone = {day: said for day in range(100, 120, 1) if (said := forgotten(registry, day * DAY_S + 1.0))}
        assert gone[103] == [("before", "unchanged for 103.0 days; the limit is 10")]
        assert 111 not in gone  # the last one was seven days before: from there on the pause stands still
        assert set(gone) == {103, 110}


def test_a_clock_that_is_behind_the_journal_is_logged_once(path, caplog):
    with SqliteJournal(path) as journal:
        registry = new_registry(journal)
        taught(registry, "s1", 400 * DAY_S)
        for second in range(3):
            forgotten(registry, 399.5 * DAY_S + second)
        assert "clock" not in caplog.text
    with SqliteJournal(path) as journal:
        registry = restarted(journal)
        for second in range(3):
            forgotten(registry, 100.0 + second)
        (line,) = [record.message for record in caplog.records if "clock" in record.message]
        assert "its newest record is 400 days ahead of this machine's clock" in line


def test_past_its_size_the_oldest_closed_session_goes_and_never_an_open_one(path):
    with SqliteJournal(path) as journal:
        registry = new_registry(journal)
        taught(registry, "open", 0.0, closed=False)
        for index in range(3):
            taught(registry, f"s{index}", 1.0 + index)
        assert forgotten(registry, 10.0) == []
        size = journal.report().size
        assert size > 0
        journal.settings = replace(journal.settings, size_bytes=int(0.6 * size))
        gone = [name for second in range(11, 31) for name, _ in forgotten(registry, float(second))]
        assert gone == ["s0", "s1"]
        journal.settings = replace(journal.settings, size_bytes=0)
        gone = [name for second in range(31, 51) for name, _ in forgotten(registry, float(second))]
        assert gone == ["s2"]
        assert names(registry) == ["open"]


def test_a_station_that_fills_the_journal_loses_its_own(path):
    """It lost the oldest closed session, whosever that was."""
    with SqliteJournal(path) as journal:
        for number, station in enumerate(["small", "greedy", "greedy", "greedy"]):
            at = float(number)
            for seq in range(COUNT):
                journal.append(Record(station, f"s{number}", at, batches(COUNT)[seq]))
            journal.append(Record(station, f"s{number}", at, closing(COUNT - 1)))
        journal.commit()
        with not_written(journal):
            journal.enforce_retention(10.0)
        size = journal.report().size
        journal.settings = replace(journal.settings, size_bytes=int(0.6 * size))
        with not_written(journal):
            gone = [key for second in range(20) for key in journal.enforce_retention(11.0 + second)]
        assert gone == [("greedy", "s1"), ("greedy", "s2")]


@pytest.mark.parametrize("closes", [False, True])
def test_open_sessions_of_a_station_take_half_and_no_more_until_they_are_closed(path, closes):
    settings = JournalSettings(size_bytes=2000, waiting_bytes=1000, commit_s=0.0)
    with SqliteJournal(path, settings) as journal:
        for seq in range(3):
            journal.append(Record("greedy", "s1", 0.0, batch(seq)))
        with pytest.raises(JournalError, match="open sessions of station greedy take") as caught:
            journal.append(Record("greedy", "s1", 0.0, batch(3)))
        assert "close them, or raise --journal-gb" in str(caught.value)
        journal.append(Record("small", "s1", 0.0, batch(0)))
        if closes:
            journal.append(Record("greedy", "s1", 0.0, closing(2)), now=True)
            with not_written(journal):
                journal.enforce_retention(0.0)
            journal.append(Record("greedy", "s2", 0.0, batch(0)))
        else:
            with pytest.raises(JournalError):
                journal.append(Record("greedy", "s2", 0.0, batch(0)))


def test_a_station_has_so_many_sessions_and_the_oldest_closed_ones_go_several_at_once(path):
    """One at a look went, and 50,000 sessions held the worker for 250 ms every second."""
    with SqliteJournal(path, JournalSettings(sessions=3)) as journal:
        registry = new_registry(journal)
        taught(registry, "open", 0.0, closed=False)
        for index in range(6):
            taught(registry, f"s{index}", 1.0 + index)
        looks = [forgotten(registry, 10.0 + second) for second in range(20)]
        (gone,) = [look for look in looks if look]
        assert [name for name, _ in gone] == ["s0", "s1", "s2", "s3"]
        assert gone[0][1] == "the oldest closed one of 7 of the station; the limit is 3"
        assert names(restarted(journal)) == ["open", "s4", "s5"]


def test_a_look_at_a_journal_of_many_sessions_makes_nothing_of_each(path):
    with SqliteJournal(path) as journal:
        taught(new_registry(journal), "s1")
        columns = "station, session || ?, opened, touched, 1, 9, 2, damage, crc"
        insert = f"INSERT INTO sessions SELECT id + 10, {columns} FROM sessions"
        with journal._writing:
            for doubling in range(11):
                journal._database.execute(insert.replace("10", str(10 << doubling)), (f"-{doubling}",))
        made: list[object] = []
        journal._database.row_factory = lambda _, row: made.append(row) or row
        with not_written(journal):
            for second in range(11):
                journal.enforce_retention(float(second))
        assert journal.report().size > 2000 * 9
        assert len(made) < 50


def test_a_session_that_another_process_deletes_can_no_longer_be_asked_for(path):
    with SqliteJournal(path) as journal:
        registry = new_registry(journal)
        taught(registry, "s1")
        taught(registry, "s2")
        assert forgotten(registry, 1.0) == []
        with SqliteJournal(path, alone=False) as other:
            other.delete(STATION, "s1")
        gone = [one for second in range(2, 20) for one in forgotten(registry, float(second))]
        assert gone == [("s1", "deleted by another process")]
        assert names(registry) == ["s2"]


@pytest.mark.parametrize("name", ["commit_s", "age_s", "size_bytes", "waiting_bytes", "sessions"])
def test_a_setting_below_zero_is_refused(name):
    with pytest.raises(ValueError, match=f"{name} is -1, expected 0 or more"):
        JournalSettings(**{name: -1})
