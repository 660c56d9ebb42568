"""Instances in one process on one router: who serves which station, and what happens when the router goes."""

from __future__ import annotations

import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import NOTHING_SAID, session_key, station_key
from caesura_protocol.messages import Ack, Close, Open, Posterior
from caesura_protocol.transport.transport_interface import NOTHING
from caesura_service.app import Service
from caesura_service.config import ServiceConfig
from caesura_service.journal import JournalError, SqliteJournal
from caesura_service.ownership.station_assignment import owner_of
from caesura_service.server import NetworkError
from clients.conftest import RouterNetwork
from harness.fake_pipeline import make_fake_pipeline
from harness.peer import DEADLINE_S, Peer
from harness.processes import eventually
from harness.sessions import batch, batches, closing, heartbeat, opening

RANGE = "from=0;to=1;bins=5"
BOTH = ("east", "west")
EASTS = [name for name in (f"cell-{number}" for number in range(20)) if owner_of(name, BOTH) == "east"]
WESTS = [name for name in (f"cell-{number}" for number in range(20)) if owner_of(name, BOTH) == "west"]


class SharingInstances:
    """A router, and instances on it with a directory in common."""

    def __init__(self, router: RouterNetwork, directory: Path) -> None:
        self.router, self.directory = router, directory

    @contextmanager
    def serving(self, instance: str, **options: object) -> Iterator[Service]:
        given = {"connect": self.router.endpoint, "preset": "fake", "journal": self.directory, **options}
        config = ServiceConfig(instance=instance, **given)  # type: ignore[arg-type]
        with Service(config, pipeline_factory=make_fake_pipeline) as running:
            yield running


@pytest.fixture
def router() -> Iterator[RouterNetwork]:
    with RouterNetwork() as network:
        yield network


@pytest.fixture
def floor(router: RouterNetwork, tmp_path: Path) -> SharingInstances:
    return SharingInstances(router, tmp_path)


@pytest.fixture
def peer(router: RouterNetwork) -> Iterator[Peer]:
    with Peer(router.endpoint) as connected:
        yield connected


@contextmanager
def bridge_at(peer: Peer, station: str) -> Iterator[None]:
    token = peer.network.liveliness().declare_token(station_key(station, "alive"))
    yield
    token.undeclare()


def reply_to(peer: Peer, command: Open | Close, station: str) -> Ack | None:
    """None where no instance answers, as while one has left and the other has not seen it."""
    try:
        return peer.command(command, station)
    except ValueError:
        return None


def asked(peer: Peer, command: Open | Close, station: str) -> Ack | None:
    """As a bridge does: no answer, or not now, is no answer."""
    try:
        return reply_to(peer, command, station)
    except ProtocolError as refusal:
        if refusal.code != "overloaded":
            raise
    return None


def accepted(peer: Peer, command: Open | Close, station: str) -> Ack:
    """As a bridge, which asks again after `overloaded`."""
    acks: list[Ack] = []
    eventually(lambda: bool(acks.extend(filter(None, [asked(peer, command, station)])) or acks))
    return acks[0]


def opens(peer: Peer, station: str) -> Ack:
    return accepted(peer, opening(), station)


def holds(service: Service, *stations: str) -> bool:
    return set(service.registry.index.sessions) == set(stations)


def test_alone_every_station_is_served_though_no_bridge_is_known(floor, peer):
    with floor.serving("east"):
        assert opens(peer, EASTS[0]).state == "open"
        assert opens(peer, WESTS[0]).state == "open"


def test_a_second_instance_takes_its_share_and_gives_it_back_when_it_leaves(floor, peer):
    stations = (EASTS[0], WESTS[0])
    with floor.serving("east") as east:
        for station in stations:
            opens(peer, station)
            for made in batches(5):
                peer.send(made, station)
        eventually(lambda: all(peer.snapshot(station=each).status.batches == 5 for each in stations))
        with floor.serving("west") as west:
            eventually(lambda: holds(east, EASTS[0]) and holds(west, WESTS[0]))
            for station in stations:
                eventually(lambda s=station: opens(peer, s).next_seq == 5)  # what was not yet written too
                peer.send(batch(5), station)
            eventually(lambda: all(peer.snapshot(station=each).status.batches == 6 for each in stations))
            assert peer.snapshot(station=WESTS[0]).status.instance == "west"
        eventually(lambda: holds(east, *stations))
        for station in stations:
            eventually(lambda s=station: opens(peer, s).next_seq == 6)
            assert peer.command(closing(5), station).state == "closed"
            status = peer.snapshot(station=station).status
            assert (status.instance, status.samples) == ("east", 120)


def test_a_station_is_taken_over_once_the_journal_can_be_read(floor, peer, monkeypatch, caplog):
    """The takeover was given up with a traceback: the session was missing until a bridge opened it again."""
    station = WESTS[0]
    with floor.serving("east") as east:
        opens(peer, station)
        with floor.serving("west") as west:
            eventually(lambda: holds(west, station))
            assert opens(peer, station).state == "open"
            peer.send(batch(0), station)
            assert accepted(peer, closing(0), station).state == "closed"
            eventually(lambda: holds(east))
            monkeypatch.setattr(SqliteJournal, "copies", unreadable)
        eventually(lambda: f"{station} could not be taken over" in caplog.text)
        with pytest.raises(ProtocolError, match=r"(being taken over|cannot be read): try again"):
            eventually(lambda: bool(reply_to(peer, opening("s2"), station)))
        monkeypatch.undo()
        eventually(lambda: holds(east, station))
        assert peer.snapshot(station=station).status.samples == 20
    assert "Traceback" not in caplog.text


def unreadable(*_: object) -> None:
    raise JournalError("journal east.sqlite cannot be read")


def test_a_station_that_is_being_taken_over_is_not_said_to_have_nothing(floor, peer):
    """For a second after an instance froze, `program` and `sessions list` said that there was no session."""
    station, keys = WESTS[0], (session_key(WESTS[0], "*", "snapshot"), station_key(WESTS[0], "program"))
    with floor.serving("east") as east:
        east.registry.ownership.begin_takeover(station)
        keys = (*keys, session_key("*", "*", "snapshot"), f"{session_key(station, 's1', 'samples')}?{RANGE}")
        for key in keys:
            replies, (refusal,) = peer.get(key)
            assert (list(replies), refusal.code) == ([], "overloaded"), key
            assert f"east is taking {station} over" in refusal.message
        _, (nothing,) = peer.get(f"{session_key(EASTS[0], '*', 'snapshot')}?{NOTHING_SAID}")
        assert nothing.code == NOTHING
        opens(peer, EASTS[0])
        replies, (refusal,) = peer.get(session_key("*", "*", "snapshot"))
        assert len(list(replies)) == 1
        assert refusal.code == "overloaded"


def test_what_another_instance_has_served_since_is_not_answered_from_before(floor, peer):
    """As when an instance that was frozen goes on: its link is lost, and it takes its stations over again."""
    station = WESTS[0]
    key = session_key(station, "s1", "snapshot")
    with floor.serving("east") as east, floor.serving("west") as west, bridge_at(peer, station):
        opens(peer, station)
        eventually(lambda: holds(west, station))
        ownership = west.registry.ownership

        def is_refused() -> bool:
            """West takes it over at any moment by itself, and shows it then."""
            east.registry.ownership.acquire(station, time.time() + 60.0)
            replies, refusals = peer.get(key)
            return not list(replies) and f"west is taking {station} over" in refusals[0].message

        ownership.is_unlinked = True
        eventually(is_refused)
        ownership.is_unlinked = False
        ownership.begin_takeover(station)
        eventually(is_refused)
        ownership.end_takeover(station)
        eventually(lambda: len(list(peer.get(key)[0])) == 1)


def test_a_second_instance_of_a_name_does_not_start_beside_the_first(floor, tmp_path, monkeypatch):
    """Each would carry out every command, and publish every result."""
    monkeypatch.setattr("caesura_service.server.zenoh_server.NAMED_S", 0.3)
    with (
        floor.serving("east"),
        pytest.raises(NetworkError, match=r"an instance named east is at .* already: .*--instance"),
        floor.serving("east", journal=tmp_path / "another"),
    ):
        pass


def test_an_instance_waits_for_one_of_its_name_to_go(floor, peer, tmp_path, caplog):
    with ExitStack() as leaving, ThreadPoolExecutor(1) as pool:
        leaving.enter_context(floor.serving("east"))

        def follows() -> str:
            with floor.serving("east", journal=tmp_path / "another"):
                return opens(peer, "cell-1").state

        state = pool.submit(follows)
        eventually(lambda: "waiting for another instance named east to go" in caplog.text)
        leaving.close()
        assert state.result(DEADLINE_S) == "open"


def test_what_another_instance_has_acquired_is_taken_over_again_before_it_is_changed(floor, peer):
    """As after a freeze: the other one may have acknowledged what this one does not know."""
    station = WESTS[0]
    with floor.serving("east") as east, floor.serving("west") as west, bridge_at(peer, station):
        opens(peer, station)
        eventually(lambda: holds(west, station))
        between = east.registry.ownership.acquire(station, time.time() + 60.0)
        eventually(lambda: asked(peer, closing(-1), station) is not None)
        status = peer.snapshot(station=station).status
    assert (status.instance, status.state) == ("west", "closed")
    assert status.epoch > between.epoch


def test_a_bridge_that_comes_is_served_by_the_one_whose_station_it_is(floor, peer):
    with floor.serving("east") as east, floor.serving("west") as west, ExitStack() as stack:
        for station in (*EASTS[:2], *WESTS[:2]):
            stack.enter_context(bridge_at(peer, station))
            assert opens(peer, station).next_seq == 0
        assert holds(east, *EASTS[:2])
        assert holds(west, *WESTS[:2])


def test_a_bridge_that_came_while_one_instance_was_alone_is_served_once_there_are_two_again(floor, peer):
    with floor.serving("east") as east, ExitStack() as stack:
        for easts, wests in zip(EASTS[:2], WESTS[:2], strict=True):
            for station in (easts, wests):
                stack.enter_context(bridge_at(peer, station))
            with floor.serving("west") as west:
                eventually(lambda n=easts: n in (east.registry.ownership.served or ()))
                assert opens(peer, easts).state == opens(peer, wests).state == "open"
                eventually(lambda n=easts: n in east.registry.index.sessions)
                eventually(lambda west=west, n=wests: n in west.registry.index.sessions)
            eventually(lambda: east.registry.ownership.served is None)


def test_without_a_directory_in_common_the_bridges_ring_is_what_there_is(floor, peer, tmp_path):
    station = WESTS[0]
    sent = batches(20)
    with floor.serving("east", journal=tmp_path / "east") as east, bridge_at(peer, station):
        with floor.serving("west", journal=tmp_path / "west") as west:
            # Until east knows of west it opens the session itself, and gives up what west then cannot find.
            eventually(lambda: opens(peer, station).next_seq == 0 and holds(west, station))
            for made in sent[:10]:
                peer.send(made, station)
            eventually(lambda: peer.snapshot(station=station).status.batches == 10)
        assert opens(peer, station).next_seq == 0
        assert holds(east, station)
        with peer.replaying(sent, station=station):
            peer.send(heartbeat(19), station)
            eventually(lambda: peer.snapshot(station=station).status.batches == 20)
        assert peer.command(closing(19), station).state == "closed"
        status = peer.snapshot(station=station).status
        assert (status.instance, status.samples, status.gaps) == ("east", 400, ())


def test_who_listens_behind_a_router_that_came_back_receives_what_is_published_from_then_on(floor, router):
    station = EASTS[0]
    with floor.serving("east"):
        with Peer(router.endpoint) as peer:
            opens(peer, station)
            with peer.listening() as received:
                peer.send(batch(0), station)
                received.until(Posterior)
            peer.send(batch(1), station)  # nobody listens
            eventually(lambda: peer.snapshot(station=station).status.batches == 2)
            with peer.listening() as received:
                peer.send(batch(2), station)
                received.until(Posterior)
        router.stop()
        router.start()
        with Peer(router.endpoint) as peer, peer.listening() as received:
            assert opens(peer, station).next_seq == 3
            peer.send(batch(3), station)
            received.until(Posterior)


def test_without_its_router_an_instance_is_alive_and_not_ready(floor, router):
    """It was ready all the time: of a dead router on an idle floor no alert said a word."""
    with floor.serving("east", metrics="127.0.0.1:0") as east:
        answered(east, "readyz", 200)
        router.stop()
        answered(east, "readyz", 503)
        answered(east, "healthz", 200)
        assert "caesura_ready 0.0" in page(east, "metrics")[1]
        router.start()
        answered(east, "readyz", 200)


def answered(service: Service, path: str, status: int) -> None:
    eventually(lambda: page(service, path)[0] == status)


def page(service: Service, path: str) -> tuple[int, str]:
    assert service.web is not None
    try:
        with urllib.request.urlopen(f"{service.web.url}/{path}", timeout=DEADLINE_S) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, ""


def test_when_the_router_goes_and_comes_back_every_instance_keeps_what_it_has(floor, router):
    station = {"east": EASTS[0], "west": WESTS[0]}
    with floor.serving("east") as east, floor.serving("west") as west:
        with Peer(router.endpoint) as peer, ExitStack() as stack:
            for each in station.values():
                stack.enter_context(bridge_at(peer, each))
                assert opens(peer, each).next_seq == 0
        boards = (east.registry.index, west.registry.index)
        epochs = [board.newest_states()[0].owner.epoch for board in boards]
        router.stop()
        router.start()
        with Peer(router.endpoint) as peer:
            for each in station.values():
                assert opens(peer, each).next_seq == 0
        for service, before, epoch in zip((east, west), boards, epochs, strict=True):
            eventually(lambda s=service, e=epoch: s.registry.index.newest_states()[0].owner.epoch > e)
            # The very session, not one that somebody else had meanwhile.
            assert service.registry.index.sessions == before.sessions
