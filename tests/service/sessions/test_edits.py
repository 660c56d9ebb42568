"""Edits of one session: numbered, acknowledged, published, undone, and refused."""

from __future__ import annotations

import pytest

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import (
    Ack,
    Changepoints,
    Edit,
    Insert,
    Program,
    Redo,
    Segments,
    SessionStatus,
    TakeBack,
    Undo,
)
from caesura_service.journal import JournalError, MemoryJournal
from caesura_service.publishing.session_state import program_of, snapshot_of
from caesura_service.sessions.session import Session
from harness.sessions import (
    NAME,
    STATION,
    answer,
    closing,
    new_registry,
    open_session,
    opening,
    published,
)
from service.sessions.edits import T, acknowledged, edit, refused, run


def test_an_edit_is_acknowledged_with_its_revision_and_published_from_the_first_difference_on():
    session, _ = open_session()
    run(session, 14)
    before = snapshot_of(session.state)
    said = session.receive(edit(), 77.5)
    assert acknowledged(said) == Ack(session=NAME, next_seq=14, state="open", revision=1)
    (changes,) = published(said, Changepoints)
    assert (changes.first, changes.seq) == (1, before.changepoints.seq + 1)
    assert T in [one.t for one in changes.changepoints]
    assert [one.first for one in published(said, Segments)] == [1]
    (program,) = published(said, Program)
    assert (program.version, program.revision) == (before.program.version + 1, 1)
    assert (program.author, program.edited) == ("Ann", 77.5)
    (status,) = published(said, SessionStatus)
    assert (status.revision, status.undoable, status.redoable) == (1, True, False)


def test_an_edit_that_changes_nothing_is_a_version_of_the_program_nevertheless():
    session, _ = open_session()
    run(session, 14)
    session.receive(edit(), 0.0)
    said = session.receive(edit(1), 0.0)
    assert not published(said, Changepoints | Segments)
    assert [program.revision for program in published(said, Program)] == [2]


def test_undo_and_redo_are_edits_too():
    session, _ = open_session()
    run(session, 14)
    plain = session.state.view
    session.receive(edit(), 0.0)
    corrected = session.state.view
    said = session.receive(edit(1, Undo(), author="Bob"), 1.0)
    assert session.state.view == plain
    (status,) = published(said, SessionStatus)
    assert (status.revision, status.undoable, status.redoable) == (2, False, True)
    assert published(said, Program)[0].author == "Bob"
    made = acknowledged(said).correction
    assert (made.number, made.author, made.action) == (1, "Ann", Insert(t=T)), "what was undone"
    assert acknowledged(session.receive(edit(2, Redo()), 2.0)).correction == made
    assert session.state.view == corrected


def corrections_of(session: Session) -> list[tuple[int, str, float, str]]:
    listed = program_of(session.state).corrections
    return [(one.number, one.author, one.at, one.state) for one in listed]


def test_the_program_lists_all_corrections_and_an_older_one_is_taken_back_by_an_edit_of_its_own():
    session, _ = open_session()
    run(session, 14)
    session.receive(edit(), 1.0)
    only = session.state.view.changepoints
    session.receive(edit(1, Insert(t=0.525), author="Bob"), 2.0)
    said = session.receive(edit(2, TakeBack(number=2), author="Cem"), 3.0)
    assert session.state.view.changepoints == only
    assert acknowledged(said).correction.number == 2
    session.receive(edit(3, Redo()), 4.0)
    said = session.receive(edit(4, TakeBack(number=1), author="Cem"), 5.0)
    assert corrections_of(session) == [(1, "Ann", 1.0, "undone"), (2, "Bob", 2.0, "applied")]
    (status,) = published(said, SessionStatus)
    assert (status.revision, status.undoable, status.redoable) == (5, True, True)
    assert published(said, Program)[0].corrections == program_of(session.state).corrections
    with pytest.raises(ProtocolError, match="taken back already"):
        session.receive(edit(5, TakeBack(number=1)), 6.0)


def test_of_two_editors_the_slower_one_is_refused_with_the_revision_that_there_is():
    session, _ = open_session()
    run(session, 14)
    session.receive(edit(), 0.0)
    standing = session.state
    with pytest.raises(ProtocolError) as caught:
        session.receive(edit(author="Bob"), 0.0)
    assert (caught.value.code, caught.value.value, caught.value.limit) == ("conflict", 0, 1)
    assert session.state is standing


def test_an_edit_that_makes_no_sense_is_neither_recorded_nor_counted():
    journal = MemoryJournal()
    session, _ = open_session(journal)
    run(session, 14)
    with pytest.raises(ProtocolError):
        session.receive(edit(action=Insert(t=99.0)), 0.0)
    assert session.revision == 0
    assert not [record for record in journal.replay(STATION, NAME) if isinstance(record.message, Edit)]


def test_what_cannot_be_recorded_is_not_corrected():
    class JournalFullForEdits(MemoryJournal):
        def append(self, record, *, now=False):
            if isinstance(record.message, Edit):
                assert now  # it is safe before it is processed
                raise JournalError("no room")
            super().append(record, now=now)

    session, _ = open_session(JournalFullForEdits())
    run(session, 14)
    standing = session.state
    with pytest.raises(JournalError):
        session.receive(edit(), 0.0)
    assert session.state is standing


def test_samples_go_on_under_the_corrections():
    session, _ = open_session()
    run(session, 14)
    session.receive(edit(), 0.0)
    run(session, 20, first=14)
    assert T in [one.t for one in session.state.view.changepoints]
    assert len(session.state.view.changepoints) > 3


def test_a_closed_session_is_corrected_and_its_outcome_kept_anew():
    journal = MemoryJournal()
    session, _ = open_session(journal)
    run(session, 14)
    session.receive(closing(13), 0.0)
    assert acknowledged(session.receive(edit(), 5.0)) == Ack(
        session=NAME, next_seq=14, state="closed", revision=1
    )
    assert journal.outcome(STATION, NAME).snapshot == snapshot_of(session.state)


def test_a_session_that_failed_takes_no_edit():
    session, _ = open_session(preset="raising-at-the-end")
    run(session, 14)
    session.receive(closing(13), 0.0)
    with pytest.raises(ProtocolError, match="the session has failed: it takes no corrections"):
        session.receive(edit(), 0.0)


def test_a_closed_session_whose_records_are_gone_is_not_corrected():
    journal = MemoryJournal()
    session, _ = open_session(journal)
    run(session, 14)
    session.receive(closing(13), 0.0)
    journal.delete(STATION, NAME)
    with pytest.raises(ProtocolError, match="the journal no longer has"):
        session.receive(edit(), 0.0)
    assert journal.sessions() == ()


def test_an_internal_error_changes_nothing_and_the_demonstration_goes_on(monkeypatch):
    session, _ = open_session()
    run(session, 14)
    standing = session.state
    pipeline = session._host._pipeline
    monkeypatch.setattr(type(pipeline), "corrected", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        session.receive(edit(), 0.0)
    assert session.state is standing
    run(session, 20, first=14)
    assert session.is_open


def test_a_refused_edit_is_returned_to_its_author_and_not_held_against_the_bridge():
    registry = new_registry()
    registry.handle_command(STATION, opening(), 0.0)
    said = registry.handle_command(STATION, edit(revision=7), 0.0)
    assert refused(answer(said)).code == "conflict"
    assert len(said) == 1
    assert registry.counters.refused == {"conflict": 1}
    assert registry.index.all_states()[0].counters.refused == {}
