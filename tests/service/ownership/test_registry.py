"""Many sessions: routing, whose refusal it is, limits."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import Ack, Edit, Insert, SessionStatus
from caesura_service.journal import (
    JournalError,
    JournalSettings,
    JournalUnreadableError,
    MemoryJournal,
    Record,
    SqliteJournal,
)
from caesura_service.publishing.events import Output, ReplayEnded, TakeoverFailed
from caesura_service.publishing.session_state import status_of
from caesura_service.sessions.limits import Limits
from harness.journals import not_written
from harness.sessions import (
    STATION,
    answer,
    batch,
    batch_of,
    batches,
    closing,
    heartbeat,
    new_registry,
    opening,
    published,
)

OTHER = "cell-2"


def opened(registry, station, *names):
    for name in names:
        registry.handle_command(station, opening(name), 0.0)
    return registry


def names(registry, station):
    return [session.name for session in registry.index.sessions.get(station, ())]


def test_an_opening_without_preset_gets_the_services_and_replays_with_it():
    journal = MemoryJournal()
    new_registry(journal).handle_command(STATION, opening(preset=None), 0.0)
    (record,) = journal.replay(STATION, "s1")
    assert record.message.preset == "fake"


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"preset": "unheard-of"}, "unknown preset"),
        ({"columns": ("px", "t")}, "first column is not t"),
        ({"columns": ("t", "px", "px")}, "comes twice"),
        ({"path_tolerance_m": 2.0}, "path_tolerance_m is 2, expected a number above 0 and at most 1"),
        (
            {"path_tolerance_rad": 57.0},
            "path_tolerance_rad is 57, expected a number above 0 and at most 3.14",
        ),
    ],
)
def test_an_opening_that_cannot_be_served_is_refused_and_leaves_nothing(fields, words):
    registry = new_registry()
    refusal = answer(registry.handle_command(STATION, opening(**fields), 0.0))
    assert isinstance(refusal, ProtocolError)
    assert refusal.code == "malformed"
    assert words in refusal.message
    assert registry.index.sessions == {}
    assert registry.counters.refused == {"malformed": 1}


def test_a_session_stored_with_a_larger_tolerance_than_new_ones_may_have_goes_on(monkeypatch):
    # Its opening was accepted before the service had a limit.
    journal, command = MemoryJournal(), opening(path_tolerance_m=2.0)
    with monkeypatch.context() as before:
        before.setattr("caesura_service.ownership.registry.check_tolerances", lambda _: None)
        assert isinstance(answer(new_registry(journal).handle_command(STATION, command, 0.0)), Ack)
    registry = new_registry(journal)
    reply = answer(registry.handle_command(STATION, command, 1.0))
    assert isinstance(reply, Ack), reply
    assert names(registry, STATION) == ["s1"]


def test_a_pipeline_that_cannot_be_made_refuses_the_opening_only():
    registry = new_registry()
    registry._factory._pipeline_factory = lambda *_: 1 / 0
    refusal = answer(registry.handle_command(STATION, opening(), 0.0))
    assert isinstance(refusal, ProtocolError)
    assert "ZeroDivisionError" in refusal.message


def test_the_newest_session_of_a_station_is_its_current_one():
    registry = opened(opened(new_registry(), STATION, "s1", "s2"), OTHER, "s1")
    current = [(standing.station, standing.session) for standing in registry.index.newest_states()]
    assert current == [(STATION, "s2"), (OTHER, "s1")]


def test_stations_may_use_the_same_session_name():
    registry = opened(opened(new_registry(), STATION, "s1"), OTHER, "s1")
    registry.handle_samples(OTHER, batch(0), 0.0)
    samples = [standing.view.samples for standing in registry.index.all_states()]
    assert samples == [0, 20]


@pytest.mark.parametrize("message", [batch(0), heartbeat(0), ReplayEnded("s1", 0, answered=False)])
def test_samples_for_an_unknown_session_are_counted_by_the_service(message):
    registry = opened(new_registry(), STATION, "s2")
    assert registry.handle_samples(STATION, message, 0.0) == []
    assert registry.counters.refused == {"unknown_session": 1}
    assert registry.index.all_states()[0].counters.refused == {}
    assert registry.counters.last_refusal.message.endswith("value 's1'; expected ['s2']")


def test_of_a_station_without_a_session_none_is_expected():
    """As where a station moves to an instance that has none of its journals: "expected []" said nothing."""
    registry = new_registry()
    registry.handle_samples(STATION, batch(0), 0.0)
    assert registry.counters.last_refusal.message.endswith("no such session at this station; value 's1'")


def test_a_batch_for_another_stations_session_is_forbidden_and_shown_where_it_came_from():
    registry = opened(opened(new_registry(), STATION, "mine"), OTHER, "others")
    said = registry.handle_samples(STATION, batch(0, "others"), 0.0)
    (status,) = published(said, SessionStatus)
    assert (status.station, status.session, status.refused) == (STATION, "mine", {"forbidden": 1})
    mine, others = registry.index.all_states()
    assert others.view.samples == 0
    assert others.counters.refused == {}
    assert registry.counters.refused == {"forbidden": 1}
    assert mine.counters.last_refusal is not None


def test_closing_another_stations_session_is_forbidden():
    registry = opened(opened(new_registry(), STATION, "mine"), OTHER, "others")
    refusal = answer(registry.handle_command(STATION, closing(-1, "others"), 0.0))
    assert isinstance(refusal, ProtocolError)
    assert refusal.code == "forbidden"
    assert registry.index.all_states()[1].is_open


def test_closing_an_unknown_session_names_those_that_are_known():
    refusal = answer(opened(new_registry(), STATION, "s1").handle_command(STATION, closing(-1, "s9"), 0.0))
    assert isinstance(refusal, ProtocolError)
    assert (refusal.code, refusal.value, refusal.expected) == ("unknown_session", "s9", ["s1"])


def test_samples_after_the_close_are_a_conflict_in_the_sessions_status():
    registry = opened(new_registry(), STATION, "s1")
    registry.handle_command(STATION, closing(-1), 0.0)
    (status,) = published(registry.handle_samples(STATION, batch(0), 0.0), SessionStatus)
    assert (status.state, status.refused) == ("closed", {"conflict": 1})


def test_what_cannot_be_read_is_charged_to_the_stations_current_session_and_the_service():
    registry = opened(new_registry(), STATION, "s1", "s2")
    (status,) = published(registry.reject(STATION, ProtocolError("malformed", "rubbish")), SessionStatus)
    assert (status.session, status.refused) == ("s2", {"malformed": 1})
    assert registry.reject("nowhere", ProtocolError("too_large", "much")) == []
    assert registry.reject(None, ProtocolError("malformed", "no key")) == []
    assert registry.counters.refused == {"malformed": 2, "too_large": 1}


def test_refused_content_counts_for_the_service_too():
    registry = opened(new_registry(), STATION, "s1")
    registry.handle_samples(STATION, batch_of([[0.0, float("inf")]], seq=0), 0.0)
    assert registry.counters.refused == {"malformed": 1}


def test_one_more_open_session_closes_the_oldest_of_that_station_as_abandoned():
    registry = new_registry(limits=Limits(open_sessions=2))
    opened(registry, OTHER, "s1")
    opened(registry, STATION, "s1", "s2")
    registry.handle_samples(STATION, batch(0), 0.0)
    ack = answer(registry.handle_command(STATION, opening("s3"), 0.0))
    assert ack == Ack(session="s3", next_seq=0, state="open")
    states = {(s.station, s.session): s.is_open for s in registry.index.all_states()}
    assert states == {
        (OTHER, "s1"): True,
        (STATION, "s1"): False,
        (STATION, "s2"): True,
        (STATION, "s3"): True,
    }


def test_as_many_sessions_as_may_be_open_stay_open():
    # Opening the third of four once closed the first.
    registry = opened(new_registry(limits=Limits(open_sessions=4)), STATION, "s1", "s2", "s3", "s4")
    assert all(standing.is_open for standing in registry.index.all_states())


def test_closed_sessions_stay_to_be_asked_for_until_there_are_too_many():
    journal = MemoryJournal()
    registry = new_registry(journal, Limits(closed_sessions=2))
    for index in range(4):
        opened(registry, STATION, f"s{index}")
        registry.handle_command(STATION, closing(-1, f"s{index}"), 0.0)
    opened(registry, STATION, "s4")
    assert names(registry, STATION) == ["s2", "s3", "s4"]
    assert [name for _, name in journal.sessions()] == ["s2", "s3", "s4"]


def test_one_station_too_many_is_overloaded_where_each_has_an_open_session():
    registry = opened(new_registry(limits=Limits(stations=1)), STATION, "s1")
    refusal = answer(registry.handle_command(OTHER, opening(), 0.0))
    assert isinstance(refusal, ProtocolError)
    assert (refusal.code, refusal.limit) == ("overloaded", 1)
    assert names(registry, STATION) == ["s1"]


def test_one_station_too_many_takes_the_place_of_the_one_that_ended_and_was_opened_longest_ago():
    """256 names that were used once kept every further station out, for as long as the journal had them."""
    registry = new_registry(limits=Limits(stations=3))
    for now, station in enumerate(["open", "ended", "older", "ended"]):
        registry.handle_command(station, opening(f"s{now}"), float(now))
        if station != "open":
            registry.handle_command(station, closing(-1, f"s{now}"), float(now))
    assert isinstance(answer(registry.handle_command(OTHER, opening(), 4.0)), Ack)
    assert list(registry.index.sessions) == ["open", "ended", OTHER]
    assert isinstance(answer(registry.handle_command("older", opening("again"), 5.0)), Ack)
    assert list(registry.index.sessions) == ["open", OTHER, "older"]


def test_where_all_have_an_open_session_the_one_that_is_silent_for_longest_makes_room():
    """A bridge that was killed leaves its session open. 256 of them kept every further station out."""
    limits = Limits(stations=3, silent_s=600.0)
    journal = MemoryJournal()
    registry = new_registry(journal, limits)
    for station in ("silent", "teaching", "silent-later"):
        opened(registry, station, "s1")
    registry.handle_samples("silent-later", batch(0), 5.0)
    registry.handle_samples("teaching", heartbeat(0), 500.0)
    assert isinstance(answer(registry.handle_command(OTHER, opening(), 599.0)), ProtocolError)
    said = registry.handle_command(OTHER, opening(), 605.0)
    assert isinstance(answer(said), Ack)
    (closed,) = [one for one in published(said, SessionStatus) if one.station == "silent"]
    assert closed.state == "closed"
    assert list(registry.index.sessions) == ["teaching", "silent-later", OTHER]
    assert isinstance(answer(registry.handle_command("fourth", opening(), 605.0)), Ack)
    assert list(registry.index.sessions) == ["teaching", OTHER, "fourth"]


def test_a_station_whose_sessions_are_all_forgotten_counts_no_longer(tmp_path):
    with SqliteJournal(tmp_path / "a.sqlite", JournalSettings(age_s=100.0)) as journal:
        registry = opened(new_registry(journal, Limits(stations=1)), STATION, "s1")
        registry.handle_command(STATION, closing(-1), 0.0)
        with not_written(journal):
            registry.tick(1000.0)
        assert isinstance(answer(registry.handle_command(OTHER, opening(), 2000.0)), Ack)


def test_where_an_opening_cannot_be_recorded_no_room_was_made_for_it():
    class JournalFullForOneSession(MemoryJournal):
        def append(self, record, *, now=False):
            if record.session == "s2":
                raise JournalError("full")
            super().append(record, now=now)

    registry = opened(new_registry(JournalFullForOneSession(), Limits(open_sessions=1)), STATION, "s1")
    refusal = answer(registry.handle_command(STATION, opening("s2"), 0.0))
    assert isinstance(refusal, ProtocolError)
    assert refusal.code == "overloaded"
    assert [standing.is_open for standing in registry.index.all_states()] == [True]


def resumed(journal, batches_after, *, closed):
    """Batches 10 to 12 were lost with the bridge, which came again."""
    registry = opened(new_registry(journal), STATION, "s1")
    for seq in range(10):
        registry.handle_samples(STATION, batch(seq), 0.0)
    registry.handle_samples(STATION, heartbeat(12), 0.0)
    assert answer(registry.handle_command(STATION, opening(epoch=1), 1.0)).next_seq == 13
    for seq in range(13, 13 + batches_after):
        registry.handle_samples(STATION, batch(seq, epoch=1), 2.0)
    if closed:
        assert answer(registry.handle_command(STATION, closing(12 + batches_after), 3.0)).state == "closed"
    return registry


@pytest.mark.parametrize("closed", [False, True])
def test_what_a_restarted_bridge_gave_up_stays_given_up(closed):
    journal = MemoryJournal()
    (before,) = resumed(journal, Limits().held_batches + 50, closed=closed).index.all_states()
    journal._outcomes.clear()  # so that the closed one is folded too
    rebuilt = new_registry(journal)
    assert rebuilt.restore() == []
    (after,) = rebuilt.index.all_states()
    assert status_of(after).lost == 3
    assert (after.lifecycle, after.view, after.counters) == (before.lifecycle, before.view, before.counters)


def test_a_session_whose_bridge_was_restarted_can_be_corrected_later():
    journal = MemoryJournal()
    resumed(journal, Limits().held_batches + 50, closed=True)
    rebuilt = new_registry(journal)
    rebuilt.restore()
    edit = Edit(session="s1", revision=0, author="Ann", action=Insert(t=1.235))
    assert answer(rebuilt.handle_command(STATION, edit, 4.0)).code == "overloaded"  # it is folded first
    while rebuilt.rebuilding:
        assert not [out for out in rebuilt.rebuild_step(STATION) if isinstance(out, TakeoverFailed)]
    assert answer(rebuilt.handle_command(STATION, edit, 5.0)).revision == 1


def test_a_board_that_was_read_does_not_change_under_the_reader():
    registry = opened(new_registry(), STATION, "s1")
    board = registry.index
    standing = board.all_states()[0]
    registry.handle_samples(STATION, batch(0), 0.0)
    opened(registry, STATION, "s2")
    assert len(board.all_states()) == 1
    assert standing.view.samples == 0
    assert status_of(board.all_states()[0]).samples == 20


def test_ticks_reach_every_open_session():
    registry = opened(opened(new_registry(), STATION, "s1"), OTHER, "s1")
    registry.handle_samples(STATION, heartbeat(1), 0.0)
    registry.handle_samples(OTHER, heartbeat(1), 0.0)
    assert len([out for out in registry.tick(100.0) if not published([out], SessionStatus)]) == 2


def test_a_session_that_cannot_be_rebuilt_is_left_out_and_named():
    journal = MemoryJournal()
    opened(new_registry(journal), STATION, "s1", "s2")
    journal.append(Record(STATION, "s3", 0.0, opening("s3", preset="gone")))
    journal.append(Record(STATION, "s4", 0.0, batch(0, "s4")))
    rebuilt = new_registry(journal)
    failed = rebuilt.restore()
    assert [(each.session, type(each.error)) for each in failed] == [("s3", ProtocolError), ("s4", TypeError)]
    assert names(rebuilt, STATION) == ["s1", "s2"]


def test_an_open_session_that_cannot_be_rebuilt_is_reported_with_the_reason(tmp_path: Path):
    """One of a preset that an update has removed was in no list, and doctor found no fault."""
    with SqliteJournal(tmp_path / "caesura-1.sqlite") as journal:
        opened(new_registry(journal), STATION, "s1")
        journal.append(Record(STATION, "s3", 7.0, opening("s3", preset="gone")), now=True)
        rebuilt = new_registry(journal)
        assert [each.session for each in rebuilt.restore()] == ["s3"]
        journal.enforce_retention(8.0)
        (found,) = rebuilt.journal_report().damaged
        assert (found.session, found.opened, found.set_aside) == ("s3", 7.0, False)
        assert found.why == "it cannot be rebuilt: unknown preset; value 'gone'"
        refusal = answer(rebuilt.handle_command(STATION, opening("s3"), 9.0))
        assert isinstance(refusal, ProtocolError)
        assert "cannot be rebuilt (unknown preset; value 'gone')" in refusal.message
        assert names(rebuilt, STATION) == ["s1"], "others go on"


def test_a_session_that_the_disk_refuses_for_a_moment_is_not_reported_as_damaged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def refuse(station: str, session: str) -> Iterator[Record]:
        raise JournalUnreadableError("disk I/O error")

    with SqliteJournal(tmp_path / "caesura-1.sqlite") as journal:
        opened(new_registry(journal), STATION, "s1")
        rebuilt = new_registry(journal)
        with monkeypatch.context() as patch:
            patch.setattr(journal, "replay", refuse)
            assert [each.session for each in rebuilt.restore()] == ["s1"]
        journal.enforce_retention(8.0)
        assert rebuilt.journal_report().damaged == ()


# --- shouting -------------------------------------------------------------------------------------------


def statuses(said: list[Output]) -> list[SessionStatus]:
    return published(said, SessionStatus)


def test_a_sender_of_rubbish_makes_no_more_than_one_status_a_second_and_the_last_word_is_said():
    registry = new_registry()
    registry.handle_command("cell-1", opening(), 0.0)
    rubbish = ProtocolError("malformed", "not a map")
    said = [output for _ in range(1000) for output in registry.reject("cell-1", rubbish)]
    assert [status.refused for status in statuses(said)] == [{"malformed": 1}]
    assert statuses(registry.tick(0.1)) == statuses(registry.tick(1.0)) == []
    (last,) = statuses(registry.tick(1.2))
    assert last.refused == {"malformed": 1000}
    assert statuses(registry.tick(1.3)) == statuses(registry.tick(2.4)) == statuses(registry.tick(9.0)) == []
    assert len(statuses(registry.reject("cell-1", rubbish))) == 1


def test_what_was_refused_of_a_closed_session_is_said_too():
    registry = new_registry()
    registry.handle_command("cell-1", opening(), 0.0)
    registry.handle_command("cell-1", closing(-1), 0.0)
    for epoch in (1, 2, 3):
        registry.handle_samples("cell-1", batch(7, epoch=epoch), 0.0)
    registry.tick(0.0)
    assert [status.refused for status in statuses(registry.tick(1.1))] == [{"conflict": 3}]


def test_a_batch_that_is_refused_in_every_message_is_no_louder():
    registry = new_registry()
    said = registry.handle_command("cell-1", opening(), 0.0)
    for seq in range(100):
        said += registry.handle_samples("cell-1", batch(seq, columns=("t", "py")), 0.0)
    assert len(statuses(said)) == 2  # the first words, and the first refusal
    registry.tick(0.0)
    (last,) = statuses(registry.tick(1.1))
    assert (last.refused, last.lost) == ({"malformed": 100}, 100)


def test_a_session_that_is_as_long_as_one_may_be_is_closed_and_others_go_on():
    """What a session keeps in memory and in a file grew for as long as its station sent."""
    registry = new_registry(limits=Limits(observations=10))
    for name in ("s1", "s2"):
        registry.handle_command(STATION, opening(name), 0.0)
    long, short = registry.index.sessions[STATION]
    said: list[Output] = []
    for each in batches(9, "s1"):
        if long.is_open:
            said += registry.handle_samples(STATION, each, 0.0)
    assert (long.is_open, short.is_open) == (False, True)
    assert 10 <= long.state.view.observations < 15
    refusal = long.state.counters.last_refusal
    assert refusal is not None
    assert refusal.code == "too_large"
    assert "has reached its limit of 10 observations and is closed: open another" in refusal.message
    assert published(said, SessionStatus)[-1].state == "closed"
    registry.handle_samples(STATION, batches(1, "s2")[0], 0.0)
    assert short.state.counters.batches == 1


def test_of_long_closed_sessions_fewer_can_be_asked_for():
    registry = new_registry(limits=Limits(observations_held=25))
    for name in ("s1", "s2", "s3", "s4"):
        registry.handle_command(STATION, opening(name), 0.0)
        for each in batches(5, name):
            registry.handle_samples(STATION, each, 0.0)
        registry.handle_command(STATION, closing(4, name), 0.0)
    first, *_ = sessions = registry.index.sessions[STATION]
    assert first.state.view.observations == 10
    assert [session.name for session in sessions] == ["s2", "s3", "s4"]
