"""A bridge in standby on a network in memory: a library that fails ends no bridge."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext

import numpy as np
import pytest

from caesura_clients import demonstration_control
from caesura_clients.bridge import BridgeSettings
from caesura_clients.bridge.sessions_on_demand import Standby
from caesura_clients.bridge.sources import Source
from caesura_protocol.codec import decode, encode
from caesura_protocol.errors import ProtocolError, Unreachable
from caesura_protocol.messages import BridgeStatus
from caesura_protocol.programs.safety import CellSettings
from caesura_protocol.transport.memory import MemoryNetwork
from clients.examples import LiveSource, samples
from clients.fake_service import FakeService, eventually

STATION = "cell-1"
DEADLINE_S = 30.0


class WaitingSource(LiveSource):
    """A live source that waits until the test is over."""

    def __init__(self, over: threading.Event, chunks: Callable[[], Iterator] | None = None) -> None:
        super().__init__()
        self._over, self._chunks = over, chunks

    def chunks(self) -> Iterator:
        if self._chunks is not None:
            return self._chunks()
        return self._waiting()

    def _waiting(self) -> Iterator:
        while not self._over.wait(0.01):
            yield samples(0, 1)


def broken() -> Iterator:
    raise RuntimeError("libfranka: no connection\n\x1b[2J")


@contextmanager
def standing_by(
    network: MemoryNetwork,
    open_source: Callable[[], AbstractContextManager[Source]],
    say: Callable[[BridgeStatus], None] | None = None,
    settings: BridgeSettings | None = None,
) -> Iterator[Standby]:
    standby = Standby(network.transport(), STATION, open_source, say=say, settings=settings)
    thread = threading.Thread(target=standby.run, daemon=True)
    with ExitStack() as stack:
        thread.start()
        stack.callback(thread.join, DEADLINE_S)
        stack.callback(standby.end)
        yield standby
        assert thread.is_alive(), "the bridge has ended"


@pytest.fixture
def over() -> Iterator[threading.Event]:
    event = threading.Event()
    yield event
    event.set()


@pytest.mark.filterwarnings("error::pytest.PytestUnhandledThreadExceptionWarning")
@pytest.mark.parametrize("where", ["opening", "reading"])
def test_a_library_that_raises_is_a_lost_source_which_is_opened_again(monkeypatch, over, where):
    monkeypatch.setattr("caesura_clients.bridge.sessions_on_demand.RECONNECT_S", 0.05)
    works = threading.Event()

    def open_source() -> AbstractContextManager[Source]:
        if works.is_set():
            return nullcontext(WaitingSource(over))
        if where == "opening":
            broken()
        return nullcontext(WaitingSource(over, broken))

    with standing_by(MemoryNetwork(), open_source) as standby:
        eventually(lambda: "RuntimeError: libfranka: no connection" in (standby.status.problem or ""))
        assert standby.status.state == "failed"
        assert decode(*encode(standby.status), BridgeStatus) == standby.status, "one line, whatever it was"
        works.set()
        eventually(lambda: standby.status.state == "ready")


def test_a_command_that_fails_is_refused_and_the_next_one_is_answered(monkeypatch, over):
    network = MemoryNetwork()

    def fail(*_: object) -> None:
        raise ValueError("not foreseen")

    with (
        FakeService(network.transport()),
        standing_by(network, lambda: nullcontext(WaitingSource(over))) as standby,
    ):
        eventually(lambda: standby.status.state == "ready")
        operator = network.transport()
        with monkeypatch.context() as broken_query:
            broken_query.setattr("caesura_clients.query.find_program", fail)
            with pytest.raises(ProtocolError) as refusal:
                demonstration_control.start(operator, STATION)
        assert (refusal.value.code, refusal.value.message) == ("internal", "ValueError: not foreseen")
        session = demonstration_control.start(operator, STATION).session
        assert demonstration_control.stop(operator, STATION).session == session


@pytest.mark.parametrize("command", [demonstration_control.start, demonstration_control.stop])
def test_without_bridge_and_service_a_command_states_that_the_connection_may_be_lost(command):
    """A router that hung took both away: it was stated that no bridge is connected."""
    with pytest.raises(Unreachable, match="neither a bridge of cell-1 nor a service is found at memory"):
        command(MemoryNetwork().transport(), STATION)


def test_a_start_that_the_journal_cannot_record_says_why(monkeypatch, over):
    monkeypatch.setattr("caesura_clients.bridge.sessions_on_demand.OPEN_S", 0.5)
    network = MemoryNetwork()
    with (
        FakeService(network.transport()) as service,
        standing_by(network, lambda: nullcontext(WaitingSource(over))) as standby,
    ):
        eventually(lambda: standby.status.state == "ready")
        service.refuse = ProtocolError("overloaded", "journal a.sqlite cannot be written: free some room")
        with pytest.raises(ProtocolError, match=r"nothing was taught, try again: .*free some room") as why:
            demonstration_control.start(network.transport(), STATION)
        assert why.value.code == "overloaded"


@pytest.mark.parametrize(("lost", "outcome"), [(0, "is stored"), (1, "is stored; 1 of 2 batches are lost")])
def test_a_stop_at_a_service_that_lacks_batches_ends_once_it_has_them(over, lost, outcome):
    """A close that was refused because batches were missing once ended the demonstration with an error.

    Lost ones were stated without a semicolon, and so not on the page of the station.
    """
    network, given = MemoryNetwork(), threading.Event()

    def one_chunk() -> Iterator:
        given.wait(DEADLINE_S)
        yield samples(40)
        over.wait(DEADLINE_S)

    at_once = BridgeSettings(close_timeout_s=0.0, retry_s=0.01)
    with (
        FakeService(network.transport()) as service,
        standing_by(
            network, lambda: nullcontext(WaitingSource(over, one_chunk)), settings=at_once
        ) as standby,
    ):
        eventually(lambda: standby.status.state == "ready")
        operator = network.transport()
        session = demonstration_control.start(operator, STATION).session
        service.hold, service.lost = True, lost
        given.set()
        eventually(lambda: service._held)
        with ThreadPoolExecutor(1) as pool:
            stopped = pool.submit(demonstration_control.stop, operator, STATION)
            eventually(lambda: "0 of 2 batches" in (standby.status.problem or ""))
            assert standby.status.state == "stopping"
            service.hold = False
            assert stopped.result(DEADLINE_S).session == session
        assert (service.state, service.next_seq) == ("closed", 2)
        assert standby.status.outcome == outcome
        over.set()


def test_the_status_says_that_the_service_ignores_which_way_is_up(over):
    network, hangs = MemoryNetwork(), BridgeSettings(setting=CellSettings(up=(0.0, 0.0, -1.0)))
    with (
        FakeService(network.transport()) as service,
        standing_by(network, lambda: nullcontext(WaitingSource(over)), settings=hangs) as standby,
    ):
        service.reads_up = False
        eventually(lambda: standby.status.state == "ready")
        operator = network.transport()
        demonstration_control.start(operator, STATION)
        eventually(lambda: "the service ignores that up is 0,0,-1" in (standby.status.problem or ""))
        assert standby.status.state == "teaching"
        demonstration_control.stop(operator, STATION)
        assert "; the service ignores that up is 0,0,-1" in standby.status.outcome
        assert standby.status.problem is None


def test_the_outcome_says_that_the_pose_is_read_seldom(over):
    network, given = MemoryNetwork(), threading.Event()
    t = np.arange(1000) / 100.0
    x = 0.1 * np.floor(t * 7.0) / 7.0

    def one_chunk() -> Iterator:
        given.wait(DEADLINE_S)
        yield np.column_stack([t, x, x, x])
        given.clear()
        over.wait(DEADLINE_S)

    with (
        FakeService(network.transport()) as service,
        standing_by(network, lambda: nullcontext(WaitingSource(over, one_chunk))) as standby,
    ):
        eventually(lambda: standby.status.state == "ready")
        operator = network.transport()
        demonstration_control.start(operator, STATION)
        given.set()
        eventually(lambda: service.batches)
        eventually(lambda: not given.is_set())
        demonstration_control.stop(operator, STATION)
        assert "; The pose is read about 7.1 times a second" in standby.status.outcome
        over.set()


def test_a_bridge_whose_terminal_is_gone_goes_on(over):
    def gone(_status: BridgeStatus) -> None:
        raise BrokenPipeError("its terminal is gone")

    with standing_by(MemoryNetwork(), lambda: nullcontext(WaitingSource(over)), gone) as standby:
        eventually(lambda: standby.status.state == "ready")


def test_a_client_that_sees_the_bridge_can_start_it(over, monkeypatch):
    """Its token came first: a client that waited for the station and started it had no answer."""
    network, declared = MemoryNetwork(), list[str]()
    memory = type(network.transport())
    for what in ("declare_token", "declare_queryable"):
        declare = getattr(memory, what)

        def noted(self, key, *given, what=what, declare=declare):
            declared.append(f"{what} {key.rpartition('/')[2]}")
            return declare(self, key, *given)

        monkeypatch.setattr(memory, what, noted)
    with standing_by(network, lambda: nullcontext(WaitingSource(over))) as standby:
        eventually(lambda: standby.status.state == "ready")
    assert declared == ["declare_queryable bridge_control", "declare_token alive"]


def test_a_bridge_that_ends_refuses_a_start(over):
    network = MemoryNetwork()
    with (
        FakeService(network.transport()),
        standing_by(network, lambda: nullcontext(WaitingSource(over))) as standby,
    ):
        eventually(lambda: standby.status.state == "ready")
        standby._over.set()
        with pytest.raises(ProtocolError, match="the bridge of cell-1 is ending") as refusal:
            standby._check_ready()
        assert refusal.value.code == "conflict"
