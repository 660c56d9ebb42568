"""The real bridge, the real mathematics and the service together, over loopback."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from caesura_clients.bridge import Bridge, BridgeSettings
from caesura_clients.bridge.sources.file import FileSource
from caesura_protocol.codec import pack_samples
from caesura_protocol.messages import Close, Open, SampleBatch, Snapshot
from caesura_protocol.recording import Recording
from caesura_protocol.rotations import upright_rotation
from caesura_protocol.transport.zenoh_transport import ZenohTransport
from caesura_service.app import Service
from caesura_service.config import ServiceConfig
from caesura_service.journal import MemoryJournal
from caesura_service.offline_segmentation import BATCH_SAMPLES, opening_of
from clients.conftest import FULL_S
from harness.demonstrations import guided
from harness.peer import Peer
from harness.tilted import tilted

FULL = BridgeSettings(max_latency_s=FULL_S)  # no batch goes before it is full, as those of `sent`
LOCAL = ServiceConfig(instance="test-1", listen="tcp/127.0.0.1:0")


def teach(endpoint: str, recording: Recording, station: str = "cell-1") -> Snapshot:
    """Play a recording without waiting and read the results back."""
    source = FileSource(recording, pace=math.inf)
    with (
        ZenohTransport(endpoint, timeout_s=20.0) as transport,
        Bridge(transport, station, source, session="s1", settings=FULL) as bridge,
    ):
        bridge.run()
    with Peer(endpoint) as peer:
        return peer.snapshot("s1", station)


def test_a_recording_that_is_played_to_the_service_comes_back_as_segments_and_a_program():
    recording = guided()
    with Service(LOCAL) as service:
        snapshot = teach(service.endpoint, recording)
    assert snapshot.status.state == "closed"
    assert snapshot.status.samples == len(recording.t)
    assert snapshot.status.refused == {}
    assert snapshot.program.complete
    assert snapshot.program.apps
    assert "contact" in {segment.kind for segment in snapshot.segments.segments}
    assert {segment.certainty for segment in snapshot.segments.segments} == {"final"}


def test_a_service_that_starts_again_with_its_journal_has_the_same_results():
    journal = MemoryJournal()
    with Service(LOCAL, journal=journal) as service:
        before = teach(service.endpoint, guided())
    with Service(LOCAL, journal=journal) as service, Peer(service.endpoint) as peer:
        after = peer.snapshot("s1")
    assert after.segments.segments == before.segments.segments
    assert after.changepoints.changepoints == before.changepoints.changepoints
    assert after.program.apps == before.program.apps
    assert after.status.epoch > before.status.epoch


@pytest.mark.parametrize("up", [None, (0.48, -0.6, 0.64)], ids=["upright", "tilted"])
def test_a_service_that_starts_again_on_its_journal_goes_on_where_it_was(tmp_path, up):
    taught = tilted(guided(), np.eye(3) if up is None else upright_rotation(up).T, up)
    config = replace(LOCAL, journal=tmp_path)
    with Service(config) as service:
        undisturbed = teach(service.endpoint, taught)
    with Service(config) as service, Peer(service.endpoint) as peer:
        opening, batches = sent(taught, "s2")
        peer.command(opening)
        for batch in batches[: len(batches) // 2]:
            peer.send(batch)
        peer.command(opening)  # behind the batches
    with Service(config) as service, Peer(service.endpoint) as peer:
        assert results(peer.snapshot("s1")) == results(undisturbed)
        assert peer.command(opening).next_seq == len(batches) // 2
        for batch in batches[len(batches) // 2 :]:
            peer.send(batch)
        peer.command(Close(session="s2", last_seq=len(batches) - 1))
        assert results(peer.snapshot("s2")) == results(undisturbed)


def sent(recording: Recording, session: str) -> tuple[Open, list[SampleBatch]]:
    """What a bridge would send."""
    matrix, columns = recording.matrix(), recording.columns
    opening = opening_of(recording).model_copy(update={"session": session})
    batches = [
        pack_samples(matrix[first : first + BATCH_SAMPLES], columns, session=session, epoch=0, seq=seq)
        for seq, first in enumerate(range(0, len(matrix), BATCH_SAMPLES))
    ]
    return opening, batches


def results(snapshot: Snapshot) -> tuple[object, ...]:
    """What must not depend on who told it, when, and under which name."""
    reported = {"session": "", "instance": "", "epoch": 0, "seq": 0}
    status = snapshot.status
    return (
        snapshot.segments.segments,
        snapshot.changepoints.changepoints,
        snapshot.program.model_copy(update=reported),
        snapshot.posterior.model_copy(update=reported) if snapshot.posterior else None,
        (status.state, status.batches, status.samples, status.observations, status.gaps, status.repeats),
    )
