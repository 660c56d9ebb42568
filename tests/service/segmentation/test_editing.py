"""Edits of a session: recorded, numbered, told, replayed, and kept when a station changes hands."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from caesura_protocol.codec import encode, pack_samples
from caesura_protocol.errors import ProtocolError
from caesura_protocol.formats.read import load_recording
from caesura_protocol.messages import (
    Ack,
    Changepoints,
    Close,
    Edit,
    Insert,
    LimitForce,
    Move,
    NamePhase,
    Preview,
    Program,
    Redo,
    Relabel,
    Remove,
    Segments,
    SessionStatus,
    TakeBack,
    Undo,
)
from caesura_service.journal import AppliedEdit, JournalError, MemoryJournal
from caesura_service.offline_segmentation import batches as batches_of
from caesura_service.offline_segmentation import opening_of
from caesura_service.ownership.registry import Registry
from caesura_service.publishing.events import Output, TakeoverFailed
from caesura_service.publishing.session_state import SessionState, program_of, snapshot_of
from caesura_service.segmentation.corrections import EditHistory, ResolvedEdit, correction_of
from caesura_service.segmentation.pipeline import SegmentationPipeline, make_pipeline
from caesura_service.sessions.closed_pipeline import state_from_snapshot
from caesura_service.sessions.limits import Limits
from caesura_service.sessions.session import Session
from harness.sessions import (
    NAME,
    OWNER,
    STATION,
    answer,
    batches,
    closing,
    new_registry,
    open_session,
    opening,
    published,
    unowned,
)
from service.ownership.test_takeover import BATCHES, COUNT, Instance

T = 1.235  # [s] where the fake has no jump of its own


def edit(revision: int = 0, action: Any = None, *, author: str = "Ann") -> Edit:
    return Edit(session=NAME, revision=revision, author=author, action=action or Insert(t=T))


def run(session: Session, count: int, first: int = 0) -> None:
    for made in batches(count)[first:]:
        session.receive(made, 0.0)


def acknowledged(said: list[Output]) -> Ack:
    """The acknowledgement, without the effect."""
    replied = answer(said)
    assert isinstance(replied, Ack)
    return replied.model_copy(update={"effect": None})


def refused(replied: Ack | ProtocolError) -> ProtocolError:
    assert isinstance(replied, ProtocolError)
    return replied


# --- one session ----------------------------------------------------------------------------------------


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
    session.receive(edit(2, Redo()), 2.0)
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
    class Full(MemoryJournal):
        def append(self, record, *, now=False):
            if isinstance(record.message, Edit):
                assert now  # it is safe before it is processed
                raise JournalError("no room")
            super().append(record, now=now)

    session, _ = open_session(Full())
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
    with pytest.raises(ProtocolError, match="the session is failed: it takes no edit"):
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


# --- folded again ---------------------------------------------------------------------------------------


class Real:
    """A registry with the real pipeline, on the first seconds of a recording."""

    recording = load_recording(Path(__file__).parents[3] / "data" / "pick_and_place.npz")
    opening = opening_of(recording, "default").model_copy(update={"session": NAME})
    count = 300

    def __init__(self, journal: MemoryJournal) -> None:
        self.registry = Registry(
            owner=OWNER,
            pipeline_factory=make_pipeline,
            default_preset="default",
            journal=journal,
            limits=Limits(),
        )

    def open(self) -> None:
        self.registry.handle_command(STATION, self.opening, 0.0)

    def feed(self, first: int, stop: int) -> None:
        for seq, samples in enumerate(batches_of(self.recording)):
            if first <= seq < stop:
                batch = pack_samples(samples, self.opening.columns, session=NAME, epoch=0, seq=seq)
                self.registry.handle_samples(STATION, batch, 0.01 * seq)

    def edit(self, action: Any, at: float = 0.0) -> Ack | ProtocolError:
        made = edit(self.standing.revision, action).model_copy(update={"with_effect": True})
        return answer(self.registry.handle_command(STATION, made, at))

    @property
    def standing(self) -> SessionState:
        return self.registry.index.all_states()[0]


def compared(standing: SessionState) -> tuple[object, ...]:
    program = program_of(unowned(standing))
    return standing.view, program, standing.lifecycle, standing.revision, standing.undoable, standing.redoable


def test_a_correction_without_a_place_is_listed_with_its_reason_also_when_the_session_is_stored():
    real = Real(MemoryJournal())
    real.open()
    real.feed(0, real.count)
    t = real.standing.view.t + 1.0
    real.edit(Insert(t=t))
    assert program_of(real.standing).corrections[0].state == "applied"
    close = Close(session=NAME, last_seq=real.count - 1)
    said = real.registry.handle_command(STATION, close, 1.0)
    reason = f"the session ended before {t:.2f} s"
    (listed,) = published(said, Program)[-1].corrections
    assert (listed.state, listed.reason) == ("not_applied", reason)
    stored = state_from_snapshot(snapshot_of(real.standing), OWNER)
    assert program_of(stored) == program_of(real.standing)
    assert stored.view.unapplied == {1: reason}


@settings(max_examples=4, deadline=None, derandomize=True)
@given(st.integers(0, 2**32 - 1))
def test_a_replay_of_the_journal_gives_the_same_edits_bit_for_bit(seed: int):
    rng = np.random.default_rng(seed)
    journal = MemoryJournal()
    real = Real(journal)
    real.open()
    stops = [0, *sorted(rng.integers(20, real.count, 2).tolist()), real.count]
    for number, (first, stop) in enumerate(pairwise(stops)):
        real.feed(first, stop)
        t, to = rng.uniform(0.2, max(real.standing.view.t, 0.3), 2).tolist()
        actions = [Insert(t=t), Move(t=t, to=to), Remove(t=to), Relabel(t=to, kind="motion"), Undo(), Redo()]
        actions += [TakeBack(number=int(rng.integers(1, 8))), Redo()]
        for action in actions:
            real.edit(action, at=100.0 + number)
    close = Close(session=NAME, last_seq=real.count - 1)
    assert rng.integers(2) or isinstance(answer(real.registry.handle_command(STATION, close, 0.0)), Ack)
    real.edit(Insert(t=2.5))
    assert real.standing.revision > 3
    journal._outcomes.clear()
    again = Real(journal)
    assert again.registry.restore() == []
    assert compared(again.standing) == compared(real.standing)


def test_an_edit_that_makes_no_sense_any_more_costs_neither_the_samples_nor_the_count():
    journal = MemoryJournal()
    real = Real(journal)
    real.open()
    real.feed(0, real.count)
    real.edit(Relabel(t=1.0, kind="contact"))
    real.edit(Insert(t=3.0))
    blind = Real(journal)
    records = journal._records[STATION, NAME]
    first = records[0]
    changed = real.opening.model_copy(update={"wrench_source": "none"})
    records[0] = type(first)(first.station, first.session, first.at, changed)
    assert blind.registry.restore() == []
    assert blind.standing.revision == 2
    assert [one.corrected for one in blind.standing.view.changepoints].count(True) == 1
    assert "no such kind" in blind.standing.counters.last_refusal.message
    assert isinstance(blind.edit(LimitForce(t=1.0, newton=1.0)), ProtocolError)
    assert blind.edit(Undo()).revision == 3


def filtered(monkeypatch) -> list[int]:
    """How many observations were filtered anew, each time that it happened from here on."""
    counts: list[int] = []
    corrected = SegmentationPipeline.corrected

    def counted(pipeline: SegmentationPipeline, corrections: Any) -> SegmentationPipeline:
        counts.append(pipeline.view.observations)
        return corrected(pipeline, corrections)

    monkeypatch.setattr(SegmentationPipeline, "corrected", counted)
    return counts


def edited_while_it_goes_on(journal: MemoryJournal) -> Real:
    real = Real(journal)
    real.open()
    for number in range(1, 11):
        real.feed(26 * (number - 1), 26 * number)
        real.edit(
            [Insert(t=0.4 * number), Remove(t=0.4 * number), Undo(), Redo()][number % 4], at=float(number)
        )
    real.feed(260, real.count)
    assert real.standing.revision > 5
    return real


def test_a_restart_filters_no_observation_twice_however_many_edits_there_are(monkeypatch):
    journal = MemoryJournal()
    real = edited_while_it_goes_on(journal)
    counts = filtered(monkeypatch)
    again = Real(journal)
    assert again.registry.restore() == []
    assert sum(counts) == 0
    assert compared(again.standing) == compared(real.standing)
    for one in (real, again):
        one.registry.handle_command(STATION, Close(session=NAME, last_seq=real.count - 1), 9.0)
    assert compared(again.standing) == compared(real.standing)


def test_edits_that_were_not_known_beforehand_are_filtered_once_at_the_end(monkeypatch):
    journal = MemoryJournal()
    real = edited_while_it_goes_on(journal)
    monkeypatch.setattr(journal, "edits", lambda *_: ())
    counts = filtered(monkeypatch)
    again = Real(journal)
    assert again.registry.restore() == []
    assert counts == [real.standing.view.observations]
    divided = [[(one.t0, one.kind) for one in each.standing.view.segments] for each in (real, again)]
    assert divided[0] == divided[1]
    for one in (real, again):
        one.registry.handle_command(STATION, Close(session=NAME, last_seq=real.count - 1), 9.0)
    assert again.standing.view == real.standing.view


def test_the_edits_of_an_older_journal_are_resolved_at_their_place_which_log_and_program_say(caplog):
    journal = MemoryJournal()
    real = edited_while_it_goes_on(journal)
    records = journal._records[STATION, NAME]
    for place, record in enumerate(records):
        if isinstance(record.message, AppliedEdit):
            old = record.message.model_copy(update={"resolution": None, "version": None})
            records[place] = record._replace(message=old)
    again = Real(journal)
    assert again.registry.restore() == []
    *before, note = again.standing.program_header.notes
    assert tuple(before) == real.standing.program_header.notes
    assert "corrections were resolved anew at a restart, from a journal of an older version" in note
    assert f"{STATION}/{NAME}: the journal has no result of the edit of revision 0" in caplog.messages[0]
    quiet = again.standing._replace(
        view=again.standing.view._replace(notes=tuple(before)),
        program_header=again.standing.program_header.model_copy(update={"notes": tuple(before)}),
    )
    assert compared(quiet) == compared(real.standing)


def test_what_an_edit_came_to_is_recorded_in_a_few_bytes_however_long_the_segment():
    correction = ResolvedEdit(
        none=(*range(5, 400_000), *range(400_010, 500_000)), starts=(4,), label=(7, "steady")
    )
    recorded = correction.recorded()
    assert correction_of(recorded) == correction
    assert len(encode(recorded).payload) < 200


# --- previewed ------------------------------------------------------------------------------------------


class Previewed(Real):
    """Feeds batch by batch, and keeps everything that is said."""

    def __init__(self, journal: MemoryJournal, *, asks: bool) -> None:
        super().__init__(journal)
        self.asks, self.said = asks, list[Output]()

    def feed(self, first: int, stop: int) -> None:
        for seq, samples in enumerate(batches_of(self.recording)):
            if first <= seq < stop:
                batch = pack_samples(samples, self.opening.columns, session=NAME, epoch=0, seq=seq)
                self.said += self.registry.handle_samples(STATION, batch, 0.01 * seq)
                if self.asks and seq % 37 == 36:
                    self.preview(Insert(t=0.5 * self.standing.view.t))
                    self.preview(Remove(t=99.0))

    def preview(self, action: Any) -> Ack | ProtocolError:
        """Ask what an edit would change; nothing else is said."""
        asked = Preview(session=NAME, revision=self.standing.revision, action=action)
        said = self.registry.handle_command(STATION, asked, 0.0)
        assert len(said) == 1
        return answer(said)


def test_a_preview_is_neither_recorded_nor_published_and_changes_no_later_result():
    journals = MemoryJournal(), MemoryJournal()
    quiet, asking = (Previewed(one, asks=asks) for one, asks in zip(journals, (False, True), strict=True))
    for real in (quiet, asking):
        real.open()
        real.feed(0, real.count)
        close = Close(session=NAME, last_seq=real.count - 1)
        real.said += real.registry.handle_command(STATION, close, 9.0)
    assert asking.said == quiet.said
    assert journals[0]._records == journals[1]._records
    assert compared(asking.standing) == compared(quiet.standing)
    assert asking.registry.counters == quiet.registry.counters


@pytest.mark.parametrize(
    "action",
    [
        Insert(t=1.0),
        Remove(t=1.35),
        Move(t=1.35, to=1.6),
        Relabel(t=1.0, kind="sliding"),
        NamePhase(t=1.0, name="reach"),
        Undo(),
        TakeBack(number=1),
    ],
)
def test_the_effect_of_a_preview_is_that_of_the_edit_and_what_snapshots_differ_in(action: Any):
    real = Previewed(MemoryJournal(), asks=False)
    real.open()
    real.feed(0, real.count)
    real.registry.handle_command(STATION, Close(session=NAME, last_seq=real.count - 1), 9.0)
    if isinstance(action, Undo | TakeBack):
        real.edit(Insert(t=1.0))
    previewed = real.preview(action)
    assert isinstance(previewed, Ack), previewed
    before = snapshot_of(real.standing)
    done = real.edit(action)
    assert isinstance(done, Ack)
    after = snapshot_of(real.standing)
    assert previewed.revision == before.status.revision == done.revision - 1
    effect = done.effect
    assert effect is not None
    assert effect == previewed.effect
    rows = [(one.segments.segments, one.program.apps, one.segments.phases) for one in (before, after)]
    for old, new, first, gone, come in (
        (rows[0][0], rows[1][0], effect.first_segment, effect.segments_before, effect.segments_after),
        (rows[0][1], rows[1][1], effect.first_app, effect.apps_before, effect.apps_after),
        (rows[0][2], rows[1][2], effect.first_phase, effect.phases_before, effect.phases_after),
    ):
        behind = len(old) - first - len(gone)
        assert [*map(outlined, old)] != [*map(outlined, new)] or not (gone or come)
        assert [*map(outlined, new)] == [
            *map(outlined, old[:first]),
            *map(outlined, come),
            *map(outlined, old[len(old) - behind :]),
        ]
    assert effect.segments_before or effect.apps_before or effect.phases_before


def outlined(one: Any) -> tuple[object, ...]:
    own = (one.target, one.force) if hasattr(one, "target") else (getattr(one, "name", None),)
    return one.kind, one.t0, one.tn, *own


def test_the_effect_is_stated_only_where_it_is_requested_and_that_is_not_recorded():
    """An older editor refuses an acknowledgement of more than 256 items, after the edit was made."""
    journal = MemoryJournal()
    real = Previewed(journal, asks=False)
    real.open()
    real.feed(0, 100)
    plain = answer(real.registry.handle_command(STATION, edit(0, Insert(t=1.0)), 0.0))
    assert isinstance(plain, Ack)
    assert (plain.revision, plain.effect) == (1, None)
    wanted = real.edit(Undo())
    assert isinstance(wanted, Ack)
    assert wanted.effect is not None
    recorded = [one.message for one in journal._records[STATION, NAME]]
    assert [one.with_effect for one in recorded if isinstance(one, AppliedEdit)] == [False, False]


def test_a_preview_is_refused_as_the_edit_would_be():
    real = Previewed(MemoryJournal(), asks=False)
    real.open()
    real.feed(0, 100)
    assert "nothing to undo" in str(real.preview(Undo()))
    real.edit(Insert(t=1.0))
    stale = Preview(session=NAME, revision=0, action=Insert(t=1.5))
    assert "another operator" in str(answer(real.registry.handle_command(STATION, stale, 0.0)))


# --- taken up from its outcome --------------------------------------------------------------------------


def stepped(registry: Registry) -> list[Output]:
    said = []
    while registry.is_rebuilding:
        said += registry.rebuild_step()
    return said


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
    assert refused(answer(registry.handle_command(STATION, edit(0), 4.0))).limit == 1
    assert (registry.is_rebuilding, registry.counters.refused) == (False, {"conflict": 1})
    reported = refused(answer(registry.handle_command(STATION, edit(1, Undo()), 4.0)))
    assert (reported.code, registry.counters.refused) == ("overloaded", {"conflict": 1})
    assert registry.rebuild_step() == []  # a record at a time: others are served meanwhile
    assert isinstance(answer(registry.handle_command("cell-2", opening(), 0.0)), Ack)
    assert refused(answer(registry.handle_command(STATION, edit(1, Undo()), 4.0))).code == "overloaded"
    assert stepped(registry) == []
    said = registry.handle_command(STATION, edit(1, Undo()), 4.0)
    assert acknowledged(said) == Ack(session=NAME, next_seq=COUNT, state="closed", revision=2)
    (standing, _) = registry.index.all_states()
    assert T not in [one.t for one in standing.view.changepoints]
    assert [one.seq for one in published(said, Changepoints)] == [before.last_seq["changepoints"] + 1]
    assert [one.version for one in published(said, Program)] == [before.program_header.version + 1]


def test_where_the_records_are_gone_a_correction_says_so():
    journal = MemoryJournal()
    registry, _ = closed_and_taken_up(journal)
    journal.delete(STATION, NAME)
    reported = refused(answer(registry.handle_command(STATION, edit(1), 0.0)))
    assert (reported.code, registry.is_rebuilding) == ("conflict", False)
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


# --- two instances --------------------------------------------------------------------------------------


@pytest.fixture
def pair(tmp_path: Path) -> Iterator[tuple[Instance, Instance]]:
    with ExitStack() as stack:
        yield Instance(tmp_path, "a", stack), Instance(tmp_path, "b", stack)


def corrected(instance: Instance, revision: int = 0, action: Any = None) -> Ack | ProtocolError:
    return answer(instance.registry.handle_command(STATION, edit(revision, action), 9.0))


def test_an_instance_that_takes_a_station_over_has_its_corrections(pair):
    a, b = pair
    a.open()
    a.feed(*range(9))
    assert corrected(a).revision == 1
    a.kill()
    b.take()
    assert (b.standing.revision, b.standing.program_header.author) == (1, "Ann")
    b.feed(*range(9, COUNT))
    b.close()
    assert corrected(b, 1, Insert(t=0.5)).revision == 2
    a.take()
    assert compared(a.standing) == compared(b.standing)


def test_an_edit_of_a_session_that_only_another_instance_has_is_kept_here_with_all_of_it(pair):
    a, b = pair
    a.open()
    a.feed(*range(COUNT))
    a.close()
    a.registry.release(STATION)
    b.take()
    assert refused(corrected(b)).code == "overloaded"
    stepped(b.registry)
    assert corrected(b).revision == 1
    a.path.unlink()
    b.kill()
    b.take()
    assert (b.standing.revision, b.standing.lifecycle) == (1, "closed")
    assert T in [one.t for one in b.standing.view.changepoints]


def test_an_edit_of_a_closed_session_elsewhere_is_found_when_one_looks_again(pair):
    a, b = pair
    a.open()
    a.feed(*range(COUNT))
    a.close()
    b.take()
    stepped_back = b.standing
    assert corrected(a).revision == 1
    said = b.take(renew=False)
    assert [status.revision for status in published(said, SessionStatus)] == [1]
    assert stepped_back.revision == 0
    assert compared(b.standing) == compared(a.standing)


def test_an_edit_of_an_open_session_elsewhere_is_found_when_one_looks_again(pair):
    a, b = pair
    a.open()
    a.feed(*range(9))
    a.journal.commit()
    b.take()
    assert corrected(a).revision == 1
    b.take(renew=False)
    assert b.standing.revision == 1
    b.feed(*range(9, COUNT))
    a.registry.release(STATION)
    b.close()
    assert T in [one.t for one in b.standing.view.changepoints]


def test_a_reader_that_looks_again_and_again_has_each_edit_once(pair):
    a, b = pair
    a.open()
    a.feed(*range(9))
    a.journal.commit()
    b.take()
    for revision, t in enumerate((0.155, 0.525, 1.155)):
        assert corrected(a, revision, Insert(t=t)).revision == revision + 1
        b.take(renew=False)
        assert b.standing.revision == revision + 1
    b.kill()
    b.take()
    assert b.standing.revision == 3
    assert sum(isinstance(one.message, AppliedEdit) for one in b.journal.replay(STATION, NAME)) == 3


# What may happen: a batch, an edit, a close, the station changes hands, somebody is killed, somebody hangs.
steps = st.lists(
    st.one_of(
        st.integers(0, COUNT - 1),
        st.sampled_from(
            [Insert(t=0.155), Insert(t=0.525), Insert(t=1.155), Undo(), Redo(), TakeBack(number=1)]
        ),
        st.sampled_from(["commit", "hand", "kill", "freeze", "look", "close"]),
    ),
    max_size=30,
)


def edited(instance: Instance, action: Any) -> bool:
    """Was it acknowledged? A session that is known by its outcome is rebuilt first."""
    revision = instance.standing.revision
    reply = corrected(instance, revision, action)
    if isinstance(reply, ProtocolError) and reply.code == "overloaded":
        assert not [said for said in stepped(instance.registry) if isinstance(said, TakeoverFailed)]
        reply = corrected(instance, revision, action)
    return isinstance(reply, Ack)


@settings(deadline=None, max_examples=50)
@given(steps)
def test_whatever_happens_between_two_instances_no_acknowledged_edit_is_lost(steps: list[Any]):
    with tempfile.TemporaryDirectory() as directory, ExitStack() as stack:
        owner, other = (Instance(Path(directory), name, stack) for name in "ab")
        owner.open()
        model, expected = EditHistory(), 0
        for step in steps:
            match step:
                case int():
                    owner.feed(step)
                case "commit":
                    owner.journal.commit()
                case "look":
                    owner.take(renew=False)
                case "close":
                    close = closing(owner.next_seq - 1)
                    owner.registry.handle_command(STATION, close, 0.0)
                case str():
                    if step == "hand":
                        owner.registry.release(STATION)
                    elif step == "kill":
                        owner.kill()
                    owner, other = other, owner
                    owner.take()
                case action if edited(owner, action):
                    model = model.after(
                        edit(action=action), 0.0, lambda change: ResolvedEdit(inserted=change.t)
                    )
                    expected += 1
            assert owner.standing.revision == expected
            shown = {one.t for one in owner.standing.view.changepoints}
            assert {one.inserted for one in model.active} == shown & {0.155, 0.525, 1.155}
