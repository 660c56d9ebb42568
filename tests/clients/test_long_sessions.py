"""What is too long for one message is had all the same: by who asks, who follows, and after a restart."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from caesura_clients import Caesura, connect
from caesura_clients.bridge import BridgeSettings
from caesura_clients.query import PIECES_ATTEMPTS, QUERY_ATTEMPTS, decoded, snapshots
from caesura_clients.session_state_reader import Update
from caesura_protocol.codec import encode
from caesura_protocol.errors import ProtocolError
from caesura_protocol.fragments import fragment
from caesura_protocol.keys import session_key
from caesura_protocol.messages import MAX_MESSAGE_BYTES, MAX_WHOLE_BYTES, Open, Snapshot
from caesura_protocol.transport.inbox import ReceivedSample
from caesura_protocol.transport.transport_interface import QueryReplies, unanswered
from clients.examples import LiveSource, example, until_complete

pytest.importorskip("caesura_service.app")
from caesura_service.app import Service
from caesura_service.config import ServiceConfig
from harness.fake_pipeline import STRIDE, make_fake_pipeline

LONG, VERY_LONG = 2000, 5600  # segments: over 1 MiB with all that is told of them; with their program alone
BATCH = 1000


@pytest.fixture
def config(tmp_path: Path) -> ServiceConfig:
    return ServiceConfig(instance="test-1", listen="tcp/127.0.0.1:0", preset="fake", journal=tmp_path)


@pytest.fixture
def caesura(config: ServiceConfig) -> Iterator[Caesura]:
    with (
        Service(config, pipeline_factory=make_fake_pipeline) as service,
        connect(service.endpoint) as connected,
    ):
        yield connected


class Steps(LiveSource):
    """A segment at every observation of the fake."""

    can_wait = True

    def __init__(self, segments: int) -> None:
        index = np.arange(segments * STRIDE)
        samples = np.column_stack([index / 1000.0, index // STRIDE, index, index])
        super().__init__(np.array_split(samples, len(samples) // BATCH))


def teach(caesura: Caesura, segments: int) -> None:
    settings = BridgeSettings(batch_samples=BATCH, close_timeout_s=60.0)
    with caesura.bridge("cell-1", Steps(segments), session="s1", settings=settings) as bridge:
        bridge.run()


@pytest.mark.slow
def test_a_long_session_is_sent_whole(caesura: Caesura, config: ServiceConfig):
    updates: list[Update] = []

    def follow() -> None:
        updates.append(until_complete(caesura.results("cell-1", silence_s=20.0)))

    reader = threading.Thread(target=follow, daemon=True)
    reader.start()
    teach(caesura, VERY_LONG)
    reader.join(60.0)
    snapshot = caesura.snapshot("cell-1")
    assert len(snapshot.segments.segments) == VERY_LONG
    assert len(encode(snapshot, limit=MAX_WHOLE_BYTES).payload) > 2 * MAX_MESSAGE_BYTES
    assert caesura.program("cell-1") == snapshot.program
    assert len(encode(snapshot.program, limit=MAX_WHOLE_BYTES).payload) > MAX_MESSAGE_BYTES
    (update,) = updates
    assert (update.segments, update.program) == (snapshot.segments.segments, snapshot.program)


def test_after_a_restart_a_long_session_is_known_by_its_outcome(config: ServiceConfig):
    with Service(config, pipeline_factory=make_fake_pipeline) as service, connect(service.endpoint) as first:
        teach(first, LONG)
        before = first.snapshot("cell-1")
    assert len(encode(before, limit=MAX_WHOLE_BYTES).payload) > MAX_MESSAGE_BYTES
    with Service(config, pipeline_factory=no_pipeline) as service, connect(service.endpoint) as second:
        after = second.snapshot("cell-1")
    assert (after.segments.segments, after.program.apps) == (before.segments.segments, before.program.apps)


def no_pipeline(opening: Open, default_preset: str) -> None:
    """Only who folds records takes samples."""
    pipeline = make_fake_pipeline(opening, default_preset)
    pipeline.push = None
    return pipeline


def long_snapshot() -> Snapshot:
    short = example(Snapshot)
    segments = short.segments.model_copy(update={"segments": 9000 * short.segments.segments})
    return short.model_copy(update={"segments": segments})


def pieces_of(snapshot: Snapshot) -> list[ReceivedSample]:
    return [ReceivedSample(session_key("cell-1", "s1", "snapshot"), *part) for part in fragment(snapshot)]


def test_an_answer_that_lost_a_piece_is_an_error_and_no_silence():
    parts = pieces_of(long := long_snapshot())
    assert decoded(QueryReplies(tuple(parts), ()), Snapshot) == [long]
    with pytest.raises(ProtocolError, match="fragments of the answer were lost"):
        decoded(QueryReplies(tuple(parts[1:]), ()), Snapshot)


class Lossy:
    """A transport whose first answers are `spoilt`."""

    endpoint = "nowhere"

    def __init__(self, parts: list[ReceivedSample], spoilt: QueryReplies, losses: int) -> None:
        self.parts, self.spoilt, self.losses, self.asked = parts, spoilt, losses, 0

    def query(self, key: str, *, parameters: str = "", timeout_s: float = 5.0) -> QueryReplies:
        self.asked += 1
        return self.spoilt if self.asked <= self.losses else QueryReplies(tuple(self.parts), ())


@pytest.mark.parametrize("losses", [0, 1, QUERY_ATTEMPTS - 1])
@pytest.mark.parametrize("is_late", [False, True])
def test_an_answer_that_lost_a_piece_or_comes_too_late_is_asked_for_again(losses: int, is_late: bool):
    parts = pieces_of(long := long_snapshot())
    spoilt = QueryReplies((), (unanswered(2.0),)) if is_late else QueryReplies(tuple(parts[1:]), ())
    lossy = Lossy(parts, spoilt, losses)
    assert snapshots(lossy, "cell-1", "s1") == [long]
    assert lossy.asked == losses + 1


def test_what_the_service_refuses_as_overloaded_is_not_asked_again_at_once():
    refusal = ProtocolError("overloaded", "station cell-1 has used its questions of this second", limit=20)
    lossy = Lossy(pieces_of(long_snapshot()), QueryReplies((), (refusal,)), QUERY_ATTEMPTS)
    with pytest.raises(ProtocolError, match="has used its questions"):
        snapshots(lossy, "cell-1", "s1")
    assert lossy.asked == 1


@pytest.mark.parametrize("is_late", [False, True])
def test_where_pieces_come_the_service_is_asked_more_often_than_where_none_do(is_late: bool):
    """On a machine with nine processes a core, three attempts lost 5 of 16 snapshots of 4 MB."""
    parts = pieces_of(long := long_snapshot())
    late = (unanswered(2.0),) if is_late else ()
    lossy = Lossy(parts, QueryReplies(tuple(parts[1:]), late), PIECES_ATTEMPTS - 1)
    assert snapshots(lossy, "cell-1", "s1") == [long]
    lossy = Lossy(parts, QueryReplies((), (unanswered(2.0),)), PIECES_ATTEMPTS - 1)
    with pytest.raises(ProtocolError, match=f"asked {QUERY_ATTEMPTS} times: no answer in 2 s"):
        snapshots(lossy, "cell-1", "s1")
    assert lossy.asked == QUERY_ATTEMPTS


def test_an_answer_that_always_loses_a_piece_is_an_error():
    parts = pieces_of(long_snapshot())
    lossy = Lossy(parts, QueryReplies(tuple(parts[1:]), ()), PIECES_ATTEMPTS)
    with pytest.raises(ProtocolError, match="fragments of the answer were lost"):
        snapshots(lossy, "cell-1", "s1")
    assert lossy.asked == PIECES_ATTEMPTS
