"""The real bridge, the real mathematics and the service together, over loopback."""

from __future__ import annotations

import math

from caesura_clients.bridge.bridge import Bridge
from caesura_clients.bridge.sources.file import FileSource
from caesura_clients.recording import Recording
from caesura_clients.transport import ZenohTransport
from caesura_protocol.messages import Snapshot
from caesura_service.app import Service
from caesura_service.config import ServiceConfig
from caesura_service.journal import MemoryJournal
from harness.demonstrations import guided
from harness.peer import Peer

LOCAL = ServiceConfig(instance="test-1", listen="tcp/127.0.0.1:0")


def teach(endpoint: str, recording: Recording, station: str = "cell-1") -> Snapshot:
    """Play a recording without waiting and read the results back."""
    source = FileSource(recording, pace=math.inf)
    with (
        ZenohTransport(endpoint, timeout_s=5.0) as transport,
        Bridge(transport, station, source, session="s1") as bridge,
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
