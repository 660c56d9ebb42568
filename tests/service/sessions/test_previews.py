"""A preview states what an edit would change, and changes nothing."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from caesura_clients.refusal_words import refusal_words
from caesura_protocol.codec import pack_samples
from caesura_protocol.errors import ProtocolError
from caesura_protocol.formats.read import load_recording
from caesura_protocol.messages import (
    Ack,
    AppReference,
    ChangeApp,
    Close,
    EditEffect,
    EditProgram,
    Insert,
    LimitForce,
    Move,
    NamePhase,
    Preview,
    Relabel,
    Remove,
    Since,
    TakeBack,
    Undo,
)
from caesura_service.journal import AppliedEdit, MemoryJournal
from caesura_service.offline_segmentation import batches as batches_of
from caesura_service.offline_segmentation import opening_of
from caesura_service.publishing.events import Output
from caesura_service.publishing.session_state import program_of, snapshot_of
from harness.sessions import (
    NAME,
    STATION,
    answer,
)
from service.sessions.edits import RealSession, compared, edit

DATA = Path(__file__).parents[3] / "data"


class Previewed(RealSession):
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


@pytest.mark.slow
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


def test_what_corrections_have_changed_since_one_is_that_of_the_later_ones_alone():
    real = Previewed(MemoryJournal(), asks=False)
    real.open()
    real.feed(0, real.count)
    real.registry.handle_command(STATION, Close(session=NAME, last_seq=real.count - 1), 9.0)
    inferred = snapshot_of(real.standing)
    first, second = (real.edit(one) for one in (Insert(t=1.0), Insert(t=0.5)))
    assert isinstance(first, Ack)
    assert isinstance(second, Ack)
    corrected = snapshot_of(real.standing)
    one, none, every = (real.preview(Since(number=number)) for number in (1, 2, 0))
    assert isinstance(one, Ack)
    assert one.effect == second.effect
    rows = corrected.segments.segments, corrected.program.apps, corrected.segments.phases
    counts = dict(zip(("first_segment", "first_app", "first_phase"), map(len, rows), strict=True))
    assert none.effect == EditEffect(**counts), "nothing differs"
    assert every.effect is not None
    for rows, snapshot in (
        (every.effect.segments_before, inferred),
        (every.effect.segments_after, corrected),
    ):
        begin = every.effect.first_segment
        shown = snapshot.segments.segments[begin : begin + len(rows)]
        assert [*map(outlined, rows)] == [*map(outlined, shown)] != []
    refused = real.preview(Since(number=3))
    assert isinstance(refused, ProtocolError)
    assert (refused.value, refused.limit) == (3, 2)
    words = "the session has no such correction: 3, at most 2"
    assert refusal_words(refused, Since(number=3)) == words
    assert snapshot_of(real.standing) == corrected


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


class Pressed(RealSession):
    """Two presses of 20 N."""

    recording = load_recording(DATA / "dispenser.npz")
    opening = opening_of(recording, "default").model_copy(update={"session": NAME})
    count = 350


def test_a_force_limit_is_stated_and_holds_where_an_edit_of_the_program_set_another_force():
    real = Pressed(MemoryJournal())
    real.open()
    real.feed(0, real.count)
    pressing = next(one for one in program_of(real.standing).apps if one.kind == "apply_force")
    middle = 0.5 * (pressing.t0 + pressing.tn)
    named = AppReference(kind=pressing.kind, t0=pressing.t0, tn=pressing.tn)
    harder = ChangeApp(app=named, force_n=9.0)
    command = EditProgram(session=NAME, revision=0, author="Ann", action=harder)
    assert isinstance(answer(real.registry.handle_command(STATION, command, 1.0)), Ack)
    limit = LimitForce(t=middle, newton=4.0)
    previewed = Preview(session=NAME, revision=0, action=limit)
    effect = answer(real.registry.handle_command(STATION, previewed, 1.0)).effect
    assert effect == real.edit(limit).effect
    forces = [
        [math.hypot(*(one.force or ())) for one in rows] for rows in (effect.apps_before, effect.apps_after)
    ]
    assert forces == [[pytest.approx(9.0)], [pytest.approx(4.0)]]
    assert math.hypot(*(program_of(real.standing).apps[1].force or ())) == pytest.approx(4.0)
