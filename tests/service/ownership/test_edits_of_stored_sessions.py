"""Edits of a session that an instance took up from its outcome: it is rebuilt before."""

from __future__ import annotations

import dataclasses

from caesura_protocol.messages import (
    Ack,
    Changepoints,
    Edit,
    EditEffect,
    Insert,
    Preview,
    Program,
    Redo,
    Since,
    Undo,
)
from caesura_service.journal import MemoryJournal
from caesura_service.ownership.registry import Registry
from caesura_service.publishing.events import TakeoverFailed
from caesura_service.publishing.session_state import SessionState
from harness.sessions import (
    NAME,
    STATION,
    answer,
    closing,
    new_registry,
    opening,
    published,
)
from service.ownership.test_takeover import BATCHES, COUNT
from service.sessions.edits import T, acknowledged, compared, edit, refused, stepped


def closed_and_taken_up(journal: MemoryJournal) -> tuple[Registry, SessionState]:
    before = new_registry(journal)
    before.handle_command(STATION, opening(), 0.0)
    for each in BATCHES:
        before.handle_samples(STATION, each, 0.0)
    before.handle_command(STATION, closing(COUNT - 1), 0.0)
    before.handle_command(STATION, edit(), 3.0)
    registry = new_registry(journal)
    registry.restore()
    return registry, before.index.all_states()[0]


def test_what_was_taken_up_from_its_outcome_shows_its_revision():
    registry, before = closed_and_taken_up(MemoryJournal())
    assert compared(registry.index.all_states()[0]) == compared(before)


def test_what_was_taken_up_from_its_outcome_is_rebuilt_before_it_is_corrected():
    registry, before = closed_and_taken_up(MemoryJournal())
    assert refused(answer(registry.handle_command(STATION, edit(0, author="Bo"), 4.0))).limit == 1
    assert (registry.rebuilding, registry.counters.refused) == (set(), {"conflict": 1})
    reported = refused(answer(registry.handle_command(STATION, edit(1, Undo()), 4.0)))
    assert (reported.code, registry.counters.refused) == ("overloaded", {"conflict": 1})
    assert registry.rebuild_step(STATION) == []  # a record at a time: others are served meanwhile
    assert isinstance(answer(registry.handle_command("cell-2", opening(), 0.0)), Ack)
    assert refused(answer(registry.handle_command(STATION, edit(1, Undo()), 4.0))).code == "overloaded"
    assert stepped(registry) == []
    said = registry.handle_command(STATION, edit(1, Undo()), 4.0)
    undone = acknowledged(said)
    assert undone.correction is not None
    assert undone.correction.number == 1
    plain = undone.model_copy(update={"correction": None})
    assert plain == Ack(session=NAME, next_seq=COUNT, state="closed", revision=2)
    (standing, _) = registry.index.all_states()
    assert T not in [one.t for one in standing.view.changepoints]
    assert [one.seq for one in published(said, Changepoints)] == [before.last_seq["changepoints"] + 1]
    assert [one.version for one in published(said, Program)] == [before.program_header.version + 1]


def shown_by_another_version(journal: MemoryJournal) -> tuple[Registry, SessionState]:
    """A service with a closed session, whose stored outcome has another boundary than it infers itself."""
    closed_and_taken_up(journal)
    stored = journal.outcome(STATION, NAME)
    segments = stored.snapshot.segments.segments
    moved = (
        segments[0].model_copy(update={"tn": segments[0].tn - 0.05}),
        segments[1].model_copy(update={"t0": segments[1].t0 - 0.05}),
        *segments[2:],
    )
    listed = stored.snapshot.segments.model_copy(update={"segments": moved})
    snapshot = stored.snapshot.model_copy(update={"segments": listed})
    journal.store_outcome(STATION, dataclasses.replace(stored, snapshot=snapshot))
    registry = new_registry(journal)
    registry.restore()
    return registry, registry.index.all_states()[0]


def effect(registry: Registry, command: Edit | Preview) -> EditEffect:
    """Have a closed session rebuilt, and return the effect that a command has on it."""
    registry.handle_command(STATION, command, 4.0)
    stepped(registry)
    replied = answer(registry.handle_command(STATION, command, 4.0))
    assert isinstance(replied, Ack)
    assert replied.effect is not None
    return replied.effect


def test_an_edit_of_results_that_another_version_inferred_states_that_others_change(caplog):
    # An old release had found 12 segments; after an edit and its undo there were 13, and no text stated why.
    registry, shown = shown_by_another_version(MemoryJournal())
    preview = Preview(session=NAME, revision=1, action=Insert(t=2.035))
    assert effect(registry, preview).inferred_again
    assert effect(registry, Preview(session=NAME, revision=1, action=Since(number=0))).inferred_again
    assert registry.index.all_states()[0].view == shown.view, "a preview changes nothing"
    made = effect(registry, edit(1, Undo()).model_copy(update={"with_effect": True}))
    assert made.inferred_again
    assert "another version of the service had inferred its results" in caplog.text
    assert not effect(registry, edit(2, Redo()).model_copy(update={"with_effect": True})).inferred_again


def test_an_edit_of_results_that_this_version_inferred_changes_no_others(caplog):
    registry, _ = closed_and_taken_up(MemoryJournal())
    made = effect(registry, edit(1, Undo()).model_copy(update={"with_effect": True}))
    assert not made.inferred_again
    assert "another version" not in caplog.text


def test_where_the_records_are_gone_a_correction_says_so():
    journal = MemoryJournal()
    registry, _ = closed_and_taken_up(journal)
    journal.delete(STATION, NAME)
    reported = refused(answer(registry.handle_command(STATION, edit(1), 0.0)))
    assert (reported.code, registry.rebuilding) == ("conflict", set())
    assert "no longer has the session's samples" in str(reported)


def test_records_that_cannot_be_folded_are_named_once_and_to_each_further_reader():
    journal = MemoryJournal()
    registry, _ = closed_and_taken_up(journal)
    del journal._records[STATION, NAME][0]
    registry.handle_command(STATION, edit(1), 0.0)
    assert [type(said) for said in stepped(registry)] == [TakeoverFailed]
    reported = refused(answer(registry.handle_command(STATION, edit(1), 0.0)))
    assert reported.code == "conflict"
    assert "cannot be corrected" in str(reported)


def test_a_crash_between_an_edit_and_its_outcome_loses_nothing(monkeypatch):
    journal = MemoryJournal()
    registry = new_registry(journal)
    registry.handle_command(STATION, opening(), 0.0)
    for each in BATCHES:
        registry.handle_samples(STATION, each, 0.0)
    registry.handle_command(STATION, closing(COUNT - 1), 0.0)
    with monkeypatch.context() as crash:
        crash.setattr(journal, "store_outcome", lambda *_: None)
        registry.handle_command(STATION, edit(), 3.0)
    again = new_registry(journal)
    again.restore()
    assert compared(again.index.all_states()[0]) == compared(registry.index.all_states()[0])
    assert journal.outcome(STATION, NAME).snapshot.status.revision == 1
