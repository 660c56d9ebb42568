"""The service over a real network, from the opening of a session to its close."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace

import pytest

from caesura_protocol.codec import decode_error
from caesura_protocol.keys import NOTHING_SAID, service_key, session_key, station_key, with_nothing_said
from caesura_protocol.messages import (
    Ack,
    Changepoints,
    Posterior,
    Program,
    Segments,
    SessionStatus,
    Snapshot,
)
from caesura_protocol.transport.transport_interface import NOTHING
from caesura_service.app import Service
from caesura_service.config import ServiceConfig
from caesura_service.server import NetworkError
from caesura_service.server.query_server import QUERY_BYTES
from caesura_service.sessions.limits import Limits
from harness.fake_pipeline import make_fake_pipeline
from harness.peer import DEADLINE_S, Peer
from harness.sessions import batch, batches, closing, heartbeat, opening


@pytest.fixture
def config() -> ServiceConfig:
    return ServiceConfig(instance="test-1", listen="tcp/127.0.0.1:0", preset="fake")


@pytest.fixture
def service(config: ServiceConfig) -> Iterator[Service]:
    with Service(config, pipeline_factory=make_fake_pipeline) as running:
        yield running


@pytest.fixture
def peer(service: Service) -> Iterator[Peer]:
    with Peer(service.endpoint) as connected:
        yield connected


def test_a_demonstration_is_followed_from_its_opening_to_its_close(peer):
    with peer.listening() as received:
        assert peer.command(opening()) == Ack(session="s1", next_seq=0, state="open")
        for made in batches(20):
            peer.send(made)
        received.until(Posterior, lambda posterior: posterior.t > 3.9)
        assert peer.command(closing(19)) == Ack(session="s1", next_seq=20, state="closed")
        received.until(SessionStatus, lambda status: status.state == "closed")
    snapshot = peer.snapshot()
    assert snapshot.status.samples == 400
    assert [message for message in received.all if isinstance(message, Program)][-1] == snapshot.program
    for kind in (Changepoints, Segments, Posterior, SessionStatus):
        numbers = [message.seq for message in received.all if isinstance(message, kind)]
        assert numbers == list(range(len(numbers)))
    assert peer.ask(station_key("cell-1", "program"), Program) == {
        station_key("cell-1", "program"): snapshot.program
    }


def test_a_query_for_all_snapshots_lists_every_session_on_its_own_key(peer):
    for station, session in (("cell-1", "s1"), ("cell-1", "s2"), ("cell-2", "s1")):
        peer.command(opening(session), station)
    listed = peer.ask(session_key("*", "*", "snapshot"), Snapshot)
    assert set(listed) == {
        session_key("cell-1", "s1", "snapshot"),
        session_key("cell-1", "s2", "snapshot"),
        session_key("cell-2", "s1", "snapshot"),
    }
    assert all(snapshot.status.state == "open" for snapshot in listed.values())
    assert len(peer.ask(session_key("cell-1", "*", "snapshot"), Snapshot)) == 2
    programs = peer.ask(station_key("*", "program"), Program)
    assert {key: program.session for key, program in programs.items()} == {
        station_key("cell-1", "program"): "s2",
        station_key("cell-2", "program"): "s1",
    }


@pytest.mark.parametrize(
    ("key", "parameters"),
    [
        (session_key("cell-1", "s1", "snapshot"), ""),
        (session_key("*", "*", "snapshot"), ""),
        (session_key("*", "*", "snapshot"), "stored=16"),
        (session_key("cell-1", "s1", "samples"), "from=0;to=1;bins=5"),
        (station_key("cell-1", "program"), ""),
    ],
)
def test_of_what_is_not_there_the_service_says_so(peer, key, parameters):
    """A query that ended without a word was taken for that, and so was one whose long answer was lost."""
    replies, refusals = peer.get(f"{key}?{with_nothing_said(parameters)}")
    assert not list(replies)
    assert [(refusal.code, refusal.value) for refusal in refusals] == [(NOTHING, "test-1")]


def test_the_end_of_an_answer_has_the_number_of_its_replies(peer):
    """A busy network lost some of them, and the others were taken for all."""
    for session in ("s1", "s2"):
        peer.command(opening(session=session))
    replies, (end,) = peer.get(f"{session_key('*', '*', 'snapshot')}?{NOTHING_SAID}")
    assert (len(list(replies)), end.code, end.value, end.limit) == (2, NOTHING, "test-1", 2)


@pytest.mark.parametrize("key", [session_key("cell-1", "*", "snapshot"), station_key("cell-1", "program")])
@pytest.mark.parametrize("long", ["payload", "attachment", "parameters"])
def test_a_query_that_brings_more_than_it_needs_does_not_wait_with_it(peer, key, long):
    """256 of them in a lane, of 1.9 MB each, took 0.9 GB."""
    given = {long: bytes(QUERY_BYTES + 1)} if long != "parameters" else {}
    asked = f"{key}?{'a' * (QUERY_BYTES + 1)}" if long == "parameters" else key
    (reply,) = peer.network.get(asked, timeout=DEADLINE_S, **given)
    refusal = decode_error(reply.err.payload.to_bytes(), str(reply.err.encoding))
    assert (refusal.code, refusal.value, refusal.limit) == ("too_large", QUERY_BYTES + 1, QUERY_BYTES)


def test_to_an_older_client_it_says_so_without_a_word(peer):
    """`unknown_session` was an error to one: `watch` ended where no station had been taught yet."""
    for key in (session_key("*", "*", "snapshot"), station_key("cell-1", "program")):
        replies, refusals = peer.get(key)
        assert (list(replies), list(refusals)) == ([], [])


def test_a_query_that_fails_is_refused_and_the_next_one_is_answered(service, peer, monkeypatch):
    peer.command(opening())
    with monkeypatch.context() as broken:
        broken.setattr("caesura_service.server.query_server.program_of", lambda _: 1 / 0)
        replies, refusals = peer.get(station_key("cell-1", "program"))
    assert (list(replies), [refusal.code for refusal in refusals]) == ([], ["internal"])
    assert peer.ask(station_key("cell-1", "program"), Program)


def test_lost_batches_are_replayed_and_change_no_result(service, peer):
    sent = batches(20)
    with peer.replaying(sent, station="cell-2") as ranges:
        peer.command(opening(), "cell-1")
        peer.command(opening(), "cell-2")
        for made in sent:
            peer.send(made, "cell-1")
            if made.seq not in {5, 6, 11, 18, 19}:
                peer.send(made, "cell-2")
        peer.send(heartbeat(19), "cell-2")
        closed = peer.until_closed(19, "cell-2")
    assert closed.next_seq == 20
    assert ranges[0][:2] == (5, 6)
    peer.until_closed(19, "cell-1")
    whole, mended = peer.snapshot(station="cell-1"), peer.snapshot(station="cell-2")
    assert mended.changepoints.changepoints == whole.changepoints.changepoints
    assert mended.segments.segments == whole.segments.segments
    assert mended.program.apps == whole.program.apps
    assert mended.status.gaps == ()


def test_an_outage_of_many_stations_is_made_good(peer):
    stations = [f"cell-{index}" for index in range(20)]
    sent = batches(40)
    with ExitStack() as stack:
        for station in stations:
            stack.enter_context(peer.replaying(sent, station=station))
            peer.command(opening(), station)
        for station in stations:
            peer.send(heartbeat(39), station)
        for station in stations:
            assert peer.until_closed(39, station).next_seq == 40
    snapshots = peer.ask(session_key("*", "*", "snapshot"), Snapshot).values()
    assert {snapshot.status.samples for snapshot in snapshots} == {800}
    assert peer.service_status().dropped == 0


def test_what_the_bridge_no_longer_has_is_a_gap(peer):
    with peer.replaying(batches(20), oldest=10), peer.listening() as received:
        peer.command(opening())
        peer.send(batch(0))
        peer.send(heartbeat(15))
        status = received.until(SessionStatus, lambda status: bool(status.gaps))
        assert status.gaps[0].reason == "evicted"
        assert peer.until_closed(15).next_seq == 16
    assert peer.snapshot().status.batches == 7


def test_a_bridge_that_comes_back_is_asked_again(peer):
    with peer.listening() as received:
        peer.command(opening())
        peer.send(heartbeat(3))
        received.until(SessionStatus, lambda status: status.waiting_for == 0)
        with peer.replaying(batches(4)):
            received.until(Posterior, lambda posterior: posterior.t > 0.7)


def test_the_service_is_seen_while_it_lives(config):
    with Service(config, pipeline_factory=make_fake_pipeline) as service, Peer(service.endpoint) as peer:
        tokens = peer.network.liveliness().get(service_key("*", "alive"), timeout=DEADLINE_S)
        assert [str(token.ok.key_expr) for token in tokens] == [service_key("test-1", "alive")]


def test_the_service_reports_how_it_is_doing(peer):
    peer.command(opening("s1"))
    peer.command(opening("s2"))
    peer.command(closing(-1, "s2"))
    status = peer.service_status()
    assert (status.sessions_open, status.sessions_closed, status.messages) == (1, 1, 3)
    assert status.queue_capacity == 4096
    assert status.epoch > 1_700_000_000_000


def test_a_service_that_is_client_of_a_router_is_found_through_it(service, config):
    second = ServiceConfig(instance="test-2", connect=service.endpoint, preset="fake")
    with Service(second, pipeline_factory=make_fake_pipeline), Peer(service.endpoint) as peer:
        assert peer.service_status("test-2").instance == "test-2"


def test_a_router_that_is_not_there_is_an_error_after_the_timeout():
    config = ServiceConfig(connect="tcp/127.0.0.1:9", connect_timeout_s=0.0)
    service = Service(config, pipeline_factory=make_fake_pipeline)
    with pytest.raises(NetworkError, match=r"127\.0\.0\.1:9"), service:
        pass


def test_an_endpoint_that_is_taken_is_an_error(service):
    second = Service(ServiceConfig(listen=service.endpoint), pipeline_factory=make_fake_pipeline)
    with pytest.raises(NetworkError) as refused, second:
        pass
    what = "Address already in use; choose another, or end what uses it"
    assert str(refused.value) == f"{service.endpoint}: {what}"


def test_the_service_leaves_without_waiting_for_batches_and_leaves_no_thread(config):
    before = set(threading.enumerate())
    config = replace(config, limits=Limits(replay_timeout_s=1000.0))  # longer than a test may take
    with Service(config, pipeline_factory=make_fake_pipeline) as service, Peer(service.endpoint) as peer:
        peer.command(opening())
        peer.send(heartbeat(100))
        peer.until_service(lambda status: status.messages >= 2)
        service.__exit__(None, None, None)
    assert [thread for thread in threading.enumerate() if "caesura" in thread.name] == []
    assert set(threading.enumerate()) - before == set()
