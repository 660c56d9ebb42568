"""Hostile and broken messages to a service: an error for the sender, nothing for the others."""

from __future__ import annotations

import math

import msgpack
import numpy as np
import pytest

from caesura_protocol.codec import encode, pack_samples
from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import station_key
from caesura_protocol.messages import (
    MAX_MESSAGE_BYTES,
    Control,
    Posterior,
    Program,
    SampleBatch,
    SessionStatus,
)
from caesura_service.app import Service
from caesura_service.journal import JournalError, MemoryJournal, Record
from caesura_service.server.memory_network import in_memory
from harness.fake_pipeline import make_fake_pipeline
from harness.heavy import array_of, message_with, nest_of
from harness.peer import MemoryPeer
from harness.sessions import batch, batch_of, batches, closing, opening

BATCH = "application/msgpack;caesura.SampleBatch.v1"
CONTROL = "application/msgpack;caesura.Control.v1"
SAMPLES = station_key("cell-1", "samples")


def nan_bearing() -> bytes:
    return encode(batch_of([[0.0, math.nan]], seq=0)).payload


def other_columns() -> bytes:
    return encode(pack_samples(np.zeros((1, 2)), ("t", "py"), session="s1", epoch=0, seq=0)).payload


def too_many_samples() -> bytes:
    return msgpack.packb({**batch(0).model_dump(), "n": 1001})


def text_for_samples() -> bytes:
    return msgpack.packb({**batch(0).model_dump(), "samples": "rubbish"})


def foreign_session() -> bytes:
    return encode(batch(0, "others")).payload


def a_megabyte_of_columns() -> bytes:
    return msgpack.packb({**batch(0).model_dump(), "columns": [1] * 1_000_000})


def deep() -> bytes:
    """A thousand levels, in a field that takes none."""
    return message_with(batch(0).model_dump(), "session", nest_of(b"\x91", 1001, 1000))


def deep_command() -> bytes:
    return message_with(
        {}, "command", message_with({"type": "open"}, "session", nest_of(b"\x91", 1001, 1000))
    )


@pytest.mark.parametrize(
    ("payload", "encoding", "code", "words"),
    [
        (b"\xc1rubbish", BATCH, "malformed", "not msgpack"),
        (b"", BATCH, "malformed", "not msgpack"),
        (msgpack.packb([1, 2]), BATCH, "malformed", "not a map"),
        (msgpack.packb({"session": "s1"}), BATCH, "malformed", "SampleBatch.epoch"),
        (text_for_samples(), BATCH, "malformed", "SampleBatch.samples"),
        (too_many_samples(), BATCH, "malformed", "1001"),
        (nan_bearing(), BATCH, "malformed", "px is not finite"),
        (other_columns(), BATCH, "malformed", "columns differ"),
        (b"\0" * (MAX_MESSAGE_BYTES + 1), BATCH, "too_large", f"limit {MAX_MESSAGE_BYTES}"),
        (encode(batch(0)).payload, BATCH.replace("v1", "v2"), "unsupported_version", "value 2; expected 1"),
        (encode(batch(0)).payload, "zenoh/bytes", "unsupported_version", "zenoh/bytes"),
        (encode(closing(0)).payload, BATCH.replace("SampleBatch", "Close"), "malformed", "Close"),
        (foreign_session(), BATCH, "forbidden", "another station"),
        (a_megabyte_of_columns(), BATCH, "too_large", "size limit of its type"),
        (deep(), BATCH, "malformed", "SampleBatch."),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_bad_samples_are_reported_in_the_session_status_and_the_service_goes_on(
    peer, payload, encoding, code, words
):
    peer.command(opening("others"), "cell-2")
    peer.command(opening("s1"))
    with peer.listening() as received:
        peer.put(SAMPLES, payload, encoding)
        status = received.until(SessionStatus, lambda status: bool(status.refused))
        assert (status.station, status.session, status.refused) == ("cell-1", "s1", {code: 1})
        assert status.last_refusal is not None
        assert words in status.last_refusal.message
        peer.send(batch(0, "others"), "cell-2")
        for seq in range(3):
            peer.send(batch(seq))
        received.until(Posterior, lambda posterior: posterior.session == "s1" and posterior.t > 0.5)
    assert peer.snapshot("others", "cell-2").status.refused == {}
    assert peer.service_status().refused == {code: 1}


def test_samples_of_an_unknown_session_are_reported_in_the_service_status(peer):
    peer.send(batch(0, "nobodys"))
    status = peer.until_service(lambda status: bool(status.refused))
    assert status.refused == {"unknown_session": 1}
    assert status.last_refusal is not None
    assert "'nobodys'" in status.last_refusal.message


@pytest.mark.parametrize("key", ["caesura/v1/station/Cell 1/samples", "caesura/v1/station/*/samples"])
def test_samples_on_a_key_that_is_no_station_are_reported_in_the_service_status(peer, key):
    peer.put(key, b"", BATCH)
    status = peer.until_service(lambda status: bool(status.refused))
    assert status.refused == {"malformed": 1}


def test_samples_after_the_close_are_reported_and_change_nothing(peer):
    peer.command(opening())
    peer.send(batch(0))
    while peer.snapshot().status.batches == 0:
        pass
    peer.command(closing(0))
    with peer.listening() as received:
        peer.send(batch(1))
        status = received.until(SessionStatus)
    assert (status.state, status.refused, status.batches) == ("closed", {"conflict": 1}, 1)


@pytest.mark.parametrize(
    ("payload", "encoding", "code"),
    [
        (b"\xc1", CONTROL, "malformed"),
        (None, None, "unsupported_version"),
        (msgpack.packb({"command": {"type": "reboot"}}), CONTROL, "malformed"),
        (deep_command(), CONTROL, "malformed"),
        (message_with({}, "command", array_of(b"\x01", 1_000_000)), CONTROL, "too_large"),
        (b"\0" * (MAX_MESSAGE_BYTES + 1), CONTROL, "too_large"),
        (encode(Control(command=opening())).payload, CONTROL.replace("v1", "v7"), "unsupported_version"),
        (encode(Control(command=closing(0, "s9"))).payload, CONTROL, "unknown_session"),
        (encode(Control(command=opening("s2", preset="unheard-of"))).payload, CONTROL, "malformed"),
    ],
)
def test_a_bad_command_is_refused_to_its_sender_and_the_service_goes_on(peer, payload, encoding, code):
    with pytest.raises(ProtocolError) as caught:
        peer.control(payload, encoding)
    assert caught.value.code == code
    assert peer.service_status().refused == {code: 1}
    assert peer.command(opening()).state == "open"


def test_a_refusal_names_the_value_and_the_limit(peer):
    with pytest.raises(ProtocolError) as caught:
        peer.control(b"\0" * (MAX_MESSAGE_BYTES + 1), CONTROL)
    assert (caught.value.value, caught.value.limit) == (MAX_MESSAGE_BYTES + 1, MAX_MESSAGE_BYTES)


def test_a_command_to_every_station_at_once_is_refused(peer):
    with pytest.raises(ProtocolError, match="malformed"):
        peer.control(*encode(Control(command=opening())), station="*")


def test_an_error_in_one_sessions_mathematics_leaves_the_others_alone(peer):
    peer.command(opening(preset="raising"))
    peer.command(opening(), "cell-2")
    with peer.listening() as received:
        peer.send(batch_of([[0.0, 13.0]], seq=0))
        assert "cannot stand 13" in received.until(Program, lambda program: bool(program.notes)).notes[0]
        status = received.until(SessionStatus, lambda status: status.state == "closed")
        assert "RuntimeError: cannot stand 13.0" in status.last_refusal.message
        peer.send(batch(0), "cell-2")
        received.until(Posterior, lambda posterior: posterior.station == "cell-2")


def test_a_replay_of_rubbish_is_given_up_as_a_gap(peer):
    """A bridge whose ring holds a batch that cannot be read would otherwise be asked for it for ever."""
    rotten = SampleBatch.model_construct(**{**batch(1).model_dump(), "n": -1})
    with peer.replaying([batch(0), rotten]), peer.listening() as received:
        peer.command(opening())
        peer.send(batch(0))
        peer.send(batch(2))
        status = received.until(SessionStatus, lambda status: bool(status.gaps))
    assert status.refused == {"malformed": 3}
    assert status.batches == 2


def test_a_flood_of_rubbish_from_one_station_costs_another_nothing(peer, network):
    peer.command(opening())
    with MemoryPeer(network) as hostile, peer.replaying(batches(20)):
        for _ in range(3000):
            hostile.put(station_key("cell-9", "samples"), b"\xc1", BATCH)
        for made in batches(20):
            peer.send(made)
        peer.until_service(lambda status: status.queue == 0)
        assert peer.command(closing(19)).next_seq == 20
    status = peer.snapshot().status
    assert (status.batches, status.refused, status.gaps) == (20, {}, ())


def test_internal_errors_that_a_station_causes_are_logged_once_in_a_while(peer, service, caplog, monkeypatch):
    def fail(*_: object) -> None:
        raise RecursionError("a mistake of ours")

    monkeypatch.setattr(service.registry, "handle_samples", fail)
    monkeypatch.setattr(service.registry, "reject", fail)
    for seq in range(200):
        peer.send(batch(seq))
    for _ in range(3):
        with pytest.raises(ProtocolError, match="internal: not carried out: RecursionError"):
            peer.control(b"\xc1", CONTROL)
    peer.until_service(lambda status: status.messages >= 203)
    assert [record.message for record in caplog.records if record.exc_info] == [
        "an event was lost to an error of the service"
    ] * 2  # of samples, and of commands


class BadJournal(MemoryJournal):
    """Takes nothing."""

    def __init__(self, error: Exception) -> None:
        super().__init__()
        self.error = error

    def append(self, record: Record, *, now: bool = False) -> None:
        raise self.error


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (OSError("a mistake of ours"), "internal: not carried out: OSError"),
        (
            JournalError("journal j cannot be written: free some room"),
            "overloaded: journal j cannot be written",
        ),
    ],
)
def test_an_opening_that_cannot_be_recorded_is_refused_with_the_reason(config, network, error, words):
    options = {"journal": BadJournal(error), "join": in_memory(network)}
    with Service(config, pipeline_factory=make_fake_pipeline, **options), MemoryPeer(network) as peer:
        with pytest.raises(ProtocolError, match=words):
            peer.command(opening())
        assert peer.service_status().sessions_open == 0
