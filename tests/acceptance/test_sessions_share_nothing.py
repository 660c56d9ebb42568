"""With the real mathematics, interleaved, rebuilt and disturbed sessions are bit for bit alike."""

from __future__ import annotations

import numpy as np
import pytest

from caesura_protocol.codec import pack_samples
from caesura_protocol.messages import Changepoints, Close, Open, Posterior, Program, SampleBatch, Segments
from caesura_service.app import segmenting_pipeline
from caesura_service.journal import MemoryJournal
from caesura_service.ownership.registry import Registry
from caesura_service.publishing.events import Output
from caesura_service.sessions.limits import Limits
from harness.demonstrations import guided
from harness.sessions import OWNER, published, unowned

STATIONS = ("cell-1", "cell-2")
BATCH = 20


def registry_of(journal: MemoryJournal) -> Registry:
    return Registry(
        owner=OWNER,
        pipeline_factory=segmenting_pipeline(),
        default_preset="default",
        journal=journal,
        limits=Limits(),
    )


def batches_of(seed: int) -> list[SampleBatch]:
    recording = guided(seed)
    pieces = np.split(recording.matrix(), range(BATCH, len(recording.t), BATCH))
    return [
        pack_samples(piece, recording.columns, session="s1", epoch=0, seq=seq)
        for seq, piece in enumerate(pieces)
    ]


def play(registry: Registry, order: list[tuple[str, SampleBatch]]) -> dict[str, list[Output]]:
    """Open, send in this order, close; what was said, by station."""
    said: dict[str, list[Output]] = {}
    last = {station: max(b.seq for s, b in order if s == station) for station in {s for s, _ in order}}
    for station, batch in order:
        if station not in said:
            said[station] = registry.handle_command(station, Open(session="s1", columns=batch.columns), 0.0)
        said[station] += registry.handle_samples(station, batch, 0.0)
    for station, seq in last.items():
        said[station] += registry.handle_command(station, Close(session="s1", last_seq=seq), 0.0)
    return said


def results(outputs: list[Output]) -> list[object]:
    return [m for kind in (Changepoints, Segments, Posterior, Program) for m in published(outputs, kind)]


@pytest.fixture(scope="module")
def alone() -> dict[str, list[Output]]:
    return {
        station: play(registry_of(MemoryJournal()), [(station, batch) for batch in batches_of(seed)])[station]
        for seed, station in enumerate(STATIONS)
    }


def test_two_interleaved_demonstrations_equal_the_same_two_alone(alone):
    pairs = zip(*(batches_of(seed) for seed in range(2)), strict=True)
    order = [(station, batch) for pair in pairs for station, batch in zip(STATIONS, pair, strict=True)]
    together = play(registry_of(MemoryJournal()), order)
    for station in STATIONS:
        assert results(together[station]) == results(alone[station])


def test_a_demonstration_in_any_order_and_twice_equals_the_undisturbed_one(alone):
    rng = np.random.default_rng(7)
    sent = [*batches_of(0), *batches_of(0)]
    shuffled = sorted(range(len(sent)), key=lambda index: sent[index].seq + rng.uniform(0, 8))
    disturbed = play(registry_of(MemoryJournal()), [("cell-1", sent[index]) for index in shuffled])
    assert results(disturbed["cell-1"]) == results(alone["cell-1"])


def test_a_demonstration_rebuilt_from_its_journal_equals_the_original():
    journal = MemoryJournal()
    original = registry_of(journal)
    play(original, [("cell-1", batch) for batch in batches_of(0)])
    rebuilt = registry_of(journal)
    rebuilt.restore()
    first, second = (tuple(map(unowned, each.index.all_states())) for each in (rebuilt, original))
    assert first == second
