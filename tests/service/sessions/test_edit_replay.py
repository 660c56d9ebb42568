"""A replay of the journal gives the same edits, and filters no observation twice."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from caesura_protocol.codec import encode
from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import (
    Ack,
    Close,
    Insert,
    LimitForce,
    Move,
    Program,
    Redo,
    Relabel,
    Remove,
    TakeBack,
    Undo,
)
from caesura_service.cooperative_scheduler import Slices, give_way
from caesura_service.journal import AppliedEdit, MemoryJournal
from caesura_service.publishing.session_state import program_of, snapshot_of
from caesura_service.segmentation.corrections import ResolvedEdit, correction_of
from caesura_service.segmentation.pipeline import SegmentationPipeline
from caesura_service.sessions.restored_outcome import state_from_snapshot
from harness.fake_pipeline import FakePipeline
from harness.sessions import (
    NAME,
    OWNER,
    STATION,
    answer,
    batches,
    closing,
    new_registry,
    opening,
    published,
)
from service.sessions.edits import RealSession, compared, edit


def test_a_correction_without_a_place_is_listed_with_its_reason_also_when_the_session_is_stored():
    real = RealSession(MemoryJournal())
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


def test_an_edit_makes_what_is_shown_once(monkeypatch):
    """It was made three times: to resolve the edit, to tell its effect, and with the edit."""
    real, looks = RealSession(MemoryJournal()), list[int]()
    look = SegmentationPipeline._look

    def counted(pipeline: SegmentationPipeline, *given: Any, **options: Any) -> Any:
        looks.append(1)
        return look(pipeline, *given, **options)

    real.open()
    real.feed(0, real.count)
    real.edit(Insert(t=0.755))
    monkeypatch.setattr(SegmentationPipeline, "_look", counted)
    assert isinstance(real.edit(Insert(t=1.155)), Ack)
    assert len(looks) == 1


@pytest.mark.slow
@settings(max_examples=4, deadline=None, derandomize=True)
@given(st.integers(0, 2**32 - 1))
def test_a_replay_of_the_journal_gives_the_same_edits_bit_for_bit(seed: int):
    rng = np.random.default_rng(seed)
    journal = MemoryJournal()
    real = RealSession(journal)
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
    again = RealSession(journal)
    assert again.registry.restore() == []
    assert compared(again.standing) == compared(real.standing)


def test_a_refused_edit_changes_no_later_result_so_that_a_restart_gives_the_same():
    """No refused edit is in the journal."""
    journal = MemoryJournal()
    real, undisturbed = RealSession(journal), RealSession(MemoryJournal())
    for one in (real, undisturbed):
        one.open()
    for first in range(0, real.count, 17):
        for one in (real, undisturbed):
            one.feed(first, first + 17)
        assert program_of(real.standing) == program_of(undisturbed.standing)
        assert isinstance(real.edit(Remove(t=99.0)), ProtocolError)
    again = RealSession(journal)
    assert again.registry.restore() == []
    assert compared(again.standing) == compared(real.standing)


def test_an_edit_that_makes_no_sense_any_more_costs_neither_the_samples_nor_the_count():
    journal = MemoryJournal()
    real = RealSession(journal)
    real.open()
    real.feed(0, real.count)
    real.edit(Relabel(t=1.0, kind="contact"))
    real.edit(Insert(t=3.0))
    blind = RealSession(journal)
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


def edited_while_it_goes_on(journal: MemoryJournal) -> RealSession:
    real = RealSession(journal)
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
    again = RealSession(journal)
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
    again = RealSession(journal)
    assert again.registry.restore() == []
    assert counts == [real.standing.view.observations]
    divided = [[(one.t0, one.kind) for one in each.standing.view.segments] for each in (real, again)]
    assert divided[0] == divided[1]
    for one in (real, again):
        one.registry.handle_command(STATION, Close(session=NAME, last_seq=real.count - 1), 9.0)
    assert again.standing.view == real.standing.view


def test_no_outcome_is_stored_of_corrections_that_the_end_of_the_service_interrupts(monkeypatch):
    """It had their number, and the segments without them: the next start showed it."""
    registry = new_registry()
    registry.handle_command(STATION, opening(), 0.0)
    for batch in batches(3):
        registry.handle_samples(STATION, batch, 0.0)
    for command in (closing(2), edit(0, Insert(t=0.03))):
        assert isinstance(answer(registry.handle_command(STATION, command, 0.0)), Ack)
    _, *records = registry._journals.own_records(registry._journals.copies_of_station(STATION)[NAME].own)
    copy = MemoryJournal()
    session = new_registry(copy)._factory.new(STATION, opening(), OWNER, 0.0)
    session.begin(0.0)

    corrected = FakePipeline.corrected

    def slow(pipeline: FakePipeline, corrections: list[ResolvedEdit]) -> FakePipeline:
        give_way()
        return corrected(pipeline, corrections)

    def copying() -> None:
        for _ in session.apply_peer_records(records):
            pass

    monkeypatch.setattr(FakePipeline, "corrected", slow)
    slices = Slices(slice_s=0.0)
    assert not slices.begin("copying", copying)
    slices.stop()
    assert copy.outcome(STATION, NAME) is None


def test_the_edits_of_an_older_journal_are_resolved_at_their_place_which_log_and_program_say(caplog):
    journal = MemoryJournal()
    real = edited_while_it_goes_on(journal)
    records = journal._records[STATION, NAME]
    for place, record in enumerate(records):
        if isinstance(record.message, AppliedEdit):
            old = record.message.model_copy(update={"resolution": None, "version": None})
            records[place] = record._replace(message=old)
    again = RealSession(journal)
    assert again.registry.restore() == []
    *before, note = again.standing.program_header.notes
    assert tuple(before) == real.standing.program_header.notes
    assert "Resolved again at a restart, from a journal of an older version: 3 corrections." in note
    assert f"{STATION}/{NAME}: the journal has no result of the edit of revision 0" in caplog.messages[0]
    quiet = again.standing._replace(
        view=again.standing.view._replace(notes=tuple(before)),
        program_header=again.standing.program_header.model_copy(update={"notes": tuple(before)}),
    )
    assert compared(quiet) == compared(real.standing)


def test_what_an_edit_came_to_is_recorded_in_a_few_bytes_however_long_the_segment():
    correction = ResolvedEdit(
        none=(*range(5, 400_000), *range(400_010, 500_000)),
        starts=(4,),
        label=(7, "steady"),
        meant=4.15,
        placed=4.75,
    )
    recorded = correction.recorded()
    assert correction_of(recorded) == correction
    assert len(encode(recorded).payload) < 200
