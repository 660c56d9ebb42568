"""Whatever the network does to batches, the results are those of an undisturbed run, bit for bit."""

from __future__ import annotations

from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from caesura_protocol.messages import (
    Ack,
    Changepoints,
    Posterior,
    Program,
    SampleBatch,
    Segments,
)
from caesura_service.journal import MemoryJournal
from caesura_service.publishing.events import Output
from caesura_service.publishing.session_state import SessionCounters, SessionState, snapshot_of
from caesura_service.sessions.limits import Limits
from harness.sessions import (
    BATCH,
    STATION,
    Ring,
    answer,
    batches,
    closing,
    heartbeat,
    new_registry,
    open_session,
    opening,
    published,
    unowned,
)

COUNT = 24
BATCHES = batches(COUNT)
RESULTS = (Changepoints, Segments, Posterior, Program)


def results(outputs: list[Output]) -> list[Any]:
    return [message for kind in RESULTS for message in published(outputs, kind)]


def undisturbed() -> list[Any]:
    session, said = open_session()
    for batch in BATCHES:
        said += session.receive(batch, 0.0)
    return results(said + session.receive(closing(COUNT - 1), 0.0))


EXPECTED = undisturbed()

# What happens to each batch: how often it is delivered (0: lost) and how far it is displaced.
fates = st.lists(st.tuples(st.integers(0, 3), st.integers(-6, 6)), min_size=COUNT, max_size=COUNT)


def delivered(fate: list[tuple[int, int]]) -> list[SampleBatch]:
    placed = [
        (index + shift * copy, batch)
        for index, (batch, (copies, shift)) in enumerate(zip(BATCHES, fate, strict=True))
        for copy in range(copies)
    ]
    return [batch for _, batch in sorted(placed, key=lambda place: place[0])]


@settings(deadline=None, max_examples=60)
@given(fates, st.integers(1, 8), st.integers(1, 6))
def test_duplication_reordering_and_loss_with_replay_change_no_result(fate, held, at_once):
    session, said = open_session(limits=Limits(held_batches=held, replay_batches=at_once))
    ring = Ring(BATCHES)
    for step, batch in enumerate(delivered(fate)):
        said += ring.feed(session, batch, float(step))
    said += ring.feed(session, heartbeat(COUNT - 1), 1000.0)
    closed = ring.feed(session, closing(COUNT - 1), 2000.0)
    assert answer(closed) == Ack(session="s1", next_seq=COUNT, state="closed")
    assert results(said + closed) == EXPECTED
    assert (session.state.view.samples, session.state.view.repeats) == (COUNT * BATCH, 0)


@settings(deadline=None, max_examples=60)
@given(fates, st.integers(0, COUNT))
def test_a_session_rebuilt_from_its_journal_equals_the_original(fate, oldest):
    journal = MemoryJournal()
    registry = new_registry(journal)
    registry.handle_command(STATION, opening(), 0.0)
    session = registry.index.sessions[STATION][0]
    ring = Ring(BATCHES, oldest=oldest)
    for step, batch in enumerate(delivered(fate)):
        ring.feed(session, batch, float(step))
    rebuilt = new_registry(journal)
    rebuilt.restore()
    (standing,) = rebuilt.index.all_states()
    assert uncounted(standing) == uncounted(session.state)
    assert rebuilt.index.sessions[STATION][0].next_seq == session.next_seq


def uncounted(standing: SessionState) -> SessionState:
    """Without what counts for the process: what came twice or was asked for, and how often it was said."""
    tally = SessionCounters(batches=standing.counters.batches)
    numbered = {**standing.last_seq, "status": 0}
    return unowned(standing)._replace(counters=tally, waiting_for=None, last_seq=numbered)


def test_a_rebuilt_session_goes_on_like_the_original():
    journal = MemoryJournal()
    registry = new_registry(journal)
    registry.handle_command(STATION, opening(), 0.0)
    for batch in BATCHES[:12]:
        registry.handle_samples(STATION, batch, 0.0)
    rebuilt = new_registry(journal)
    rebuilt.restore()
    for each in (registry, rebuilt):
        for batch in BATCHES[12:]:
            each.handle_samples(STATION, batch, 0.0)
        each.handle_command(STATION, closing(COUNT - 1), 0.0)
    first, second = (each.index.all_states()[0] for each in (registry, rebuilt))
    assert snapshot_of(unowned(first)) == snapshot_of(unowned(second))


@settings(deadline=None, max_examples=60)
@given(st.lists(st.booleans(), min_size=2 * COUNT, max_size=2 * COUNT))
def test_two_interleaved_sessions_equal_the_same_two_alone(turns):
    registry = new_registry()
    waiting = {name: batches(COUNT, name) for name in ("left", "right")}
    said: dict[str, list[Output]] = {
        name: registry.handle_command(STATION, opening(name), 0.0) for name in waiting
    }
    for left in turns:
        name = "left" if (left and waiting["left"]) or not waiting["right"] else "right"
        said[name] += registry.handle_samples(STATION, waiting[name].pop(0), 0.0)
    for name, outputs in said.items():
        outputs += registry.handle_command(STATION, closing(COUNT - 1, name), 0.0)
        renamed = [message.model_copy(update={"session": "s1"}) for message in results(outputs)]
        assert renamed == EXPECTED
