"""Closing what a bridge that ended for good left open."""

from __future__ import annotations

from contextlib import nullcontext
from types import SimpleNamespace

import pytest

from caesura_clients import demonstration_control, query
from caesura_clients.bridge import sessions_on_demand
from caesura_protocol.errors import CaesuraError, ProtocolError
from caesura_protocol.messages import Ack
from caesura_protocol.transport.memory import MemoryNetwork, MemoryTransport

STATION = "cell-1"


@pytest.fixture
def closed(monkeypatch):
    """Two open sessions without a bridge; the sessions that are closed."""
    names: list[str] = []

    def close(_client, status, *, success=None):
        names.append(status.session)
        return Ack(session=status.session, next_seq=1, state="closed", revision=0)

    left = [SimpleNamespace(status=SimpleNamespace(session=name, state="open")) for name in ("s1", "s2")]
    monkeypatch.setattr(query, "snapshots", lambda *_asked, **_how: left)
    monkeypatch.setattr(query, "stations", lambda _transport: [])
    monkeypatch.setattr(demonstration_control.ControlClient, "close_left_open", close)
    return names


def test_a_bridge_that_comes_back_while_the_sessions_are_asked_for_keeps_its_own(closed, monkeypatch):
    """Its session was closed, and it was refused what it taught from then on."""
    there: list[str] = []
    asked = query.snapshots

    def snapshots(*words, **how):
        there.append(STATION)
        return asked(*words, **how)

    monkeypatch.setattr(query, "snapshots", snapshots)
    monkeypatch.setattr(query, "stations", lambda _transport: there)
    with pytest.raises(CaesuraError, match="a bridge is connected"):
        demonstration_control.close_left_open(MemoryTransport(MemoryNetwork()), STATION)
    assert closed == []


def test_whether_it_succeeded_is_said_of_one_demonstration(closed):
    """It was recorded of every session that was open."""
    transport = MemoryTransport(MemoryNetwork())
    with pytest.raises(CaesuraError, match="of s1, s2"):
        demonstration_control.close_left_open(transport, STATION, success=True)
    assert closed == []
    assert len(demonstration_control.close_left_open(transport, STATION)) == 2


@pytest.fixture
def refused(monkeypatch):
    """A session of which the service has one batch more than its status counts; the closes that come."""
    asked: list[int] = []

    def ask(_client, close):
        asked.append(close.last_seq)
        if close.last_seq != 5:
            raise ProtocolError("conflict", "the session has other batches than that", expected=5)
        return Ack(session=close.session, next_seq=6, state="closed", revision=0)

    left = [SimpleNamespace(status=SimpleNamespace(session="s1", state="open", batches=5, lost=0))]
    monkeypatch.setattr(query, "snapshots", lambda *_asked, **_how: left)
    monkeypatch.setattr(query, "stations", lambda _transport: [])
    monkeypatch.setattr(demonstration_control.ControlClient, "ask", ask)
    return asked


def test_a_session_whose_status_was_behind_is_closed_behind_its_last_batch(refused):
    demonstration_control.close_left_open(MemoryTransport(MemoryNetwork()), STATION)
    assert refused == [4, 5]


def test_a_bridge_that_comes_back_while_its_session_is_closed_keeps_it(refused, monkeypatch):
    """Its first batches refused the close, which was then repeated behind them."""
    monkeypatch.setattr(query, "stations", lambda _transport: [STATION] if refused else [])
    with pytest.raises(CaesuraError, match="a bridge is connected"):
        demonstration_control.close_left_open(MemoryTransport(MemoryNetwork()), STATION)
    assert refused == [4]


def test_a_bridge_in_standby_closes_no_session_to_which_another_one_sends(refused):
    """It looks again two seconds later."""
    (left,) = query.snapshots()
    client = demonstration_control.ControlClient(MemoryTransport(MemoryNetwork()), STATION)
    with pytest.raises(ProtocolError, match="other batches"):
        client.close_left_open(left.status)
    assert refused == [4]


@pytest.mark.parametrize(
    "first", [ProtocolError("conflict", "other batches"), None], ids=["refused", "silent"]
)
def test_a_bridge_in_standby_closes_what_was_left_open_as_soon_as_it_is_let(monkeypatch, first):
    """A service in a takeover asked it to try again, and the session stayed open for good."""
    status = SimpleNamespace(session="s1", state="open", batches=5, lost=0, opened=0.0)
    left, answers, asked = [SimpleNamespace(status=status)], [first], []

    def ask(_client, close):
        asked.append(close.last_seq)
        answer = answers.pop(0) if answers else Ack(session="s1", next_seq=5, state="closed", revision=0)
        if isinstance(answer, ProtocolError):
            raise answer
        return answer

    monkeypatch.setattr(query, "services", lambda _transport: ["one"])
    monkeypatch.setattr(query, "snapshots", lambda *_asked, **_how: left)
    monkeypatch.setattr(demonstration_control.ControlClient, "ask", ask)
    monkeypatch.setattr(sessions_on_demand, "TIDY_S", 0.0)
    bridge = sessions_on_demand.Standby(MemoryTransport(MemoryNetwork()), STATION, lambda: nullcontext(None))
    for _ in range(3):
        bridge._tidy()
    assert asked == [4, 4]
