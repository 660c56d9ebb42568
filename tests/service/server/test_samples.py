"""Queries for samples, answered by a service from the journal that it finds."""

from __future__ import annotations

import errno
import os
import threading
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from caesura_clients import Caesura, query
from caesura_protocol.errors import NotFound, ProtocolError
from caesura_protocol.keys import SampleRange, session_key
from caesura_protocol.messages import Posterior, RecordedSamples
from caesura_protocol.transport.memory import MemoryNetwork, MemoryTransport
from caesura_service.app import Service
from caesura_service.config import ServiceConfig
from caesura_service.decimation import SampleReader
from caesura_service.decimation.reader import Owned
from caesura_service.journal import FileBatches, JournalError
from caesura_service.server.memory_network import in_memory
from harness.fake_pipeline import make_fake_pipeline
from harness.journals import COLUMNS, ended, taught, written
from harness.peer import MemoryPeer
from harness.processes import eventually
from harness.sessions import batch, batches, closing, opening
from service.decimation.oracle import check

HOUR_S = 3600.0


@pytest.fixture(scope="module")
def hour() -> np.ndarray:
    return taught(HOUR_S)


@pytest.fixture(scope="module")
def reader(tmp_path_factory: pytest.TempPathFactory, hour: np.ndarray) -> Iterator[Caesura]:
    """A client of a service that was started after the hour was taught."""
    folder: Path = tmp_path_factory.mktemp("journal")
    written(folder, hour, closed=ended("motion", t=HOUR_S), size=100)
    network = MemoryNetwork()
    config = ServiceConfig(instance="caesura-1", preset="fake", journal=folder)
    with Service(config, pipeline_factory=make_fake_pipeline, join=in_memory(network)):
        yield Caesura(network.transport())


def test_every_point_of_an_hour_is_a_sample_of_the_journal_after_a_restart(reader, hour):
    for t0, tn in ((0.0, HOUR_S), (1000.0, 1600.0), (1234.0, 1240.0)):
        recorded = query.samples(reader.transport, "cell-1", "s1", SampleRange(t0, tn, 1200))
        assert check(recorded, hour, COLUMNS) > 6 * 500
        assert (recorded.first, recorded.last) == (0.0, hour[-1, 0])


def test_the_api_gives_arrays_by_column(reader):
    found = reader.samples("cell-1", "s1", 10.0, 20.0, columns=("px", "speed"))
    assert set(found) == {"px", "speed"}
    assert found["px"].shape == (1001, 2)


@pytest.mark.parametrize(
    ("parameters", "named"),
    [
        ("from=3;to=2;bins=10", "the range ends before it begins"),
        ("from=0;to=9;bins=0", "number of bins"),
        ("from=0;to=9;bins=5000", "number of bins"),
        ("from=nan;to=9;bins=10", "from is not a finite number"),
        ("from=0;bins=10", "to is not a finite number"),
        ("from=-1e300;to=9;bins=10", "from is out of range"),
        ("from=1;to=1.000001;bins=1000", "narrower than a sample can be"),
        ("from=0;to=9;bins=10;columns=px,../etc", "not a column"),
        ("", "from is not a finite number"),
    ],
)
def test_a_range_that_makes_no_sense_is_refused_by_name(reader, parameters, named):
    key = session_key("cell-1", "s1", "samples")
    with pytest.raises(ProtocolError, match=named) as refused:
        query.decoded(reader.transport.query(key, parameters=parameters), RecordedSamples)
    assert refused.value.code == "malformed"


def test_all_sessions_at_once_are_refused(reader):
    key = session_key("*", "*", "samples")
    with pytest.raises(ProtocolError, match="not a valid name"):
        query.decoded(reader.transport.query(key, parameters="from=0;to=9;bins=10"), RecordedSamples)


def test_an_unknown_session_is_absent_and_those_that_are_there_are_named(reader):
    with pytest.raises(NotFound, match="cell-1"):
        query.samples(reader.transport, "cell-1", "s9", SampleRange(0.0, 1.0, 100))


def test_a_session_in_memory_is_answered_while_it_is_taught(peer: MemoryPeer, network: MemoryNetwork):
    peer.command(opening())
    for made in batches(20):
        peer.send(made)
    eventually(lambda: peer.snapshot().status.samples == 400)
    with network.transport() as transport:
        half = query.samples(transport, "cell-1", "s1", SampleRange(0.0, 10.0, 1000))
        for seq in range(20, 30):
            peer.send(batch(seq))
        peer.command(closing(29))
        whole = query.samples(transport, "cell-1", "s1", SampleRange(0.0, 10.0, 1000))
    assert (half.counts, whole.counts) == ((400,), (600,))
    assert (half.last, whole.last) == (3.99, 5.99)


def test_a_slow_read_holds_up_no_other_query_and_no_station(
    peer: MemoryPeer, network: MemoryNetwork, monkeypatch
):
    """The reader hangs for as long as the test wants; results of stations and snapshots go on."""
    over, reading = threading.Event(), threading.Event()

    def hanging(*_: object) -> None:
        reading.set()
        assert over.wait(30.0)
        raise ProtocolError("internal", "not today")

    monkeypatch.setattr(SampleReader, "read", hanging)
    peer.command(opening())
    with network.transport() as transport:
        asking = threading.Thread(target=_ask, args=(transport,))
        asking.start()
        try:
            assert reading.wait(30.0)
            with peer.listening() as received:
                for made in batches(20):
                    peer.send(made)
                received.until(Posterior, lambda posterior: posterior.t > 3.9)
            assert peer.snapshot().status.samples == 400
        finally:
            over.set()
            asking.join(30.0)


def test_a_long_session_is_read_in_slices_between_which_other_stations_are_answered(
    peer: MemoryPeer, network: MemoryNetwork, monkeypatch
):
    """The overview of cell-1 is not complete before cell-2 has been answered."""
    read, is_answered, turns = SampleReader.read, threading.Event(), []

    def slow(reader: SampleReader, owned: Owned, *given) -> RecordedSamples | None:
        turns.append(owned.station)
        found = read(reader, owned, *given)
        return found if owned.station != "cell-1" or is_answered.is_set() else None

    monkeypatch.setattr(SampleReader, "read", slow)
    for station in ("cell-1", "cell-2"):
        peer.command(opening(), station)
        peer.send(batch(0), station)
    with network.transport() as transport:
        asking = threading.Thread(
            target=query.samples, args=(transport, "cell-1", "s1", SampleRange(0.0, 1.0, 10))
        )
        asking.start()
        try:
            eventually(lambda: turns.count("cell-1") > 1)
            other = query.samples(transport, "cell-2", "s1", SampleRange(0.0, 1.0, 10))
            assert other.station == "cell-2"
        finally:
            is_answered.set()
            asking.join(30.0)
    assert not asking.is_alive()


def _ask(transport: MemoryTransport) -> None:
    with pytest.raises(ProtocolError, match="not today"):
        query.samples(transport, "cell-1", "s1", SampleRange(0.0, 1.0, 100))


@pytest.mark.parametrize("error", [errno.EMFILE, errno.EACCES])
def test_a_directory_that_cannot_be_listed_is_named_and_the_next_query_is_answered(
    tmp_path, network, monkeypatch, caplog, error
):
    """Out of files, the thread that answers ended at the first session that was closed, for good.

    A new session was refused as `not carried out: OSError`, or opened beside one that another journal had.
    """
    config = ServiceConfig(instance="test-1", preset="fake", journal=tmp_path)
    service = Service(config, pipeline_factory=make_fake_pipeline, join=in_memory(network))
    wanted = "cell-1", "s1", SampleRange(0.0, 10.0, 1000)
    with service, MemoryPeer(network) as peer, network.transport() as transport:
        peer.command(opening())
        peer.send(batch(0))
        eventually(lambda: ("cell-1", "s1") in service._edge._samples._open)
        with monkeypatch.context() as patch:
            patch.setattr("os.listdir", partial(failing, error))
            peer.command(closing(0))
            eventually(lambda: "no overview of cell-1/s1: journal directory" in caplog.text)
            with pytest.raises(ProtocolError, match=f"directory {tmp_path} cannot be listed"):
                query.samples(transport, *wanted)
            with pytest.raises(ProtocolError, match="cannot be listed") as refused:
                peer.command(opening("s2"), "cell-2")
            assert refused.value.code == "overloaded"
        assert query.samples(transport, *wanted).counts == (20,)
        assert "Traceback" not in caplog.text


def failing(error: int, folder: object) -> None:
    raise OSError(error, os.strerror(error), folder)


def test_an_overview_that_fails_ends_no_thread(tmp_path, network, monkeypatch, caplog):
    """Whatever the reason: nothing of the query was sent, and no other one was answered."""
    config = ServiceConfig(instance="test-1", preset="fake", journal=tmp_path)
    service = Service(config, pipeline_factory=make_fake_pipeline, join=in_memory(network))
    with service, MemoryPeer(network) as peer, network.transport() as transport:
        peer.command(opening())
        peer.send(batch(0))
        eventually(lambda: ("cell-1", "s1") in service._edge._samples._open)
        with monkeypatch.context() as patch:
            patch.setattr(SampleReader, "advance", partial(failing, errno.EIO))
            peer.command(closing(0))
            eventually(lambda: "no overview of cell-1/s1" in caplog.text)
        assert query.samples(transport, "cell-1", "s1", SampleRange(0.0, 10.0, 1000)).counts == (20,)


def test_a_service_that_does_not_know_its_stations_does_not_start(tmp_path, network, monkeypatch):
    """It started without any session, as if the journal were empty."""
    config = ServiceConfig(instance="test-1", preset="fake", journal=tmp_path)
    service = Service(config, pipeline_factory=make_fake_pipeline, join=in_memory(network))
    monkeypatch.setattr("os.listdir", partial(failing, errno.EACCES))
    with pytest.raises(JournalError, match=f"{tmp_path} cannot be listed"), service:
        pass


def test_the_overview_of_a_session_is_made_when_it_ends(tmp_path, network):
    config = ServiceConfig(instance="test-1", preset="fake", journal=tmp_path)
    service = Service(config, pipeline_factory=make_fake_pipeline, join=in_memory(network))
    with service, MemoryPeer(network) as peer:
        peer.command(opening())
        for made in batches(20):
            peer.send(made)
        eventually(lambda: ("cell-1", "s1") in service._edge._samples._open)
        peer.command(closing(19))
        source = FileBatches(tmp_path)
        eventually(lambda: source.overview(source.find(("cell-1", "s1"))) is not None)
