"""The bridges of a session: the same one again, its successor by a higher epoch, and a second one."""

from __future__ import annotations

import pytest

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import Ack
from caesura_service.publishing.events import Reply
from harness.sessions import (
    answer,
    batch,
    closing,
    heartbeat,
    open_session,
    opening,
)

FIRST, SECOND = "robot-1-17-aaaa", "robot-2-18-bbbb"
ASSUMED = ("quaternion_order",)


def test_opening_twice_alike_is_no_error_and_says_how_far_it_is():
    session, _ = open_session()
    session.receive(batch(0), 0.0)
    assert session.receive(opening(), 0.0) == [Reply(Ack(session="s1", next_seq=1, state="open"))]


def test_opening_as_something_else_is_a_conflict():
    session, _ = open_session()
    with pytest.raises(ProtocolError, match="conflict"):
        session.receive(opening(columns=("t", "py")), 0.0)


def test_the_conflict_of_two_openings_names_what_differs_and_nothing_else():
    session, _ = open_session()
    with pytest.raises(ProtocolError) as refusal:
        session.receive(opening().model_copy(update={"robot": "ur5e"}), 0.0)
    assert refusal.value.message.endswith("open with another setting: robot")
    assert (refusal.value.value, refusal.value.expected) == ("robot 'ur5e'", "robot None")


@pytest.mark.parametrize("is_closed", [False, True])
def test_a_direction_that_an_older_service_left_out_of_its_journal_ends_no_session(is_closed):
    # The service was updated meanwhile: the bridge opens again as before, and the journal has no direction.
    stated = opening(bridge=FIRST, up=(0.0, 0.0, -1.0))
    session, _ = open_session(bridge=FIRST)
    if is_closed:
        session.receive(closing(-1), 0.0)
        assert isinstance(answer(session.receive(stated, 0.0)), ProtocolError)
        return
    assert answer(session.receive(stated, 0.0)) == Ack(session="s1", next_seq=0, state="open", up=None)
    for other in ({"bridge": SECOND, "epoch": 1}, {"epoch": 1}, {"robot": "ur5e"}):
        with pytest.raises(ProtocolError, match="conflict"):
            session.receive(stated.model_copy(update=other), 0.0)


@pytest.mark.parametrize(("first", "second"), [((), ASSUMED), (ASSUMED, ())], ids=["newer", "older"])
@pytest.mark.parametrize("epoch", [0, 1], ids=["the same bridge", "its successor"])
def test_a_bridge_of_another_release_continues_a_session_though_one_of_them_names_no_assumptions(
    first, second, epoch
):
    # A bridge before 2026-11-26 names none, and a service before it leaves them out of its journal.
    session, _ = open_session(bridge=FIRST, assumed=first)
    again = opening(bridge=FIRST, assumed=second, epoch=epoch)
    assert answer(session.receive(again, 0.0)) == Ack(session="s1", next_seq=0, state="open")
    session.receive(batch(0, bridge=FIRST, epoch=epoch), 0.0)
    assert answer(session.receive(again, 0.0)) == Ack(session="s1", next_seq=1, state="open")


def test_other_assumptions_than_those_of_the_session_are_a_conflict():
    session, _ = open_session(bridge=FIRST, assumed=ASSUMED)
    with pytest.raises(ProtocolError, match="open with another setting: assumed"):
        session.receive(opening(bridge=FIRST, assumed=("force_frame",)), 0.0)


def test_another_direction_than_that_of_the_session_is_a_conflict():
    session, first = open_session(bridge=FIRST, up=(0.0, 0.0, -1.0))
    assert answer(first).up == (0.0, 0.0, -1.0)
    for up in (None, (1.0, 0.0, 0.0)):
        with pytest.raises(ProtocolError, match="open with another setting: up"):
            session.receive(opening(bridge=FIRST, up=up), 0.0)


def test_a_restarted_bridge_opens_with_a_higher_epoch_and_continues_the_numbers():
    session, _ = open_session()
    session.receive(batch(0), 0.0)
    session.receive(batch(3), 0.0)
    ack = answer(session.receive(opening(epoch=2), 0.0))
    assert ack == Ack(session="s1", next_seq=4, state="open", lost=2)
    assert [gap.reason for gap in session.state.view.gaps] == ["evicted"]
    session.receive(batch(4, epoch=2), 0.0)
    assert session.next_seq == 5


def test_what_a_bridge_took_with_it_is_a_gap_though_it_was_unknown():
    session, _ = open_session()
    session.receive(batch(0), 0.0)
    session.receive(opening(epoch=1), 0.0)
    session.receive(batch(1, epoch=1), 0.0)
    (gap,) = session.state.view.gaps
    assert gap.reason == "evicted"


@pytest.mark.parametrize(
    "message",
    [
        opening(bridge=SECOND),
        batch(0, bridge=SECOND),
        batch(1, bridge=SECOND),
        heartbeat(5).model_copy(update={"bridge": SECOND}),
        closing(0).model_copy(update={"bridge": SECOND}),
    ],
    ids=["open", "batch again", "batch", "heartbeat", "close"],
)
def test_a_second_bridge_is_refused_with_the_name_of_the_first_and_changes_nothing(message):
    session, _ = open_session(bridge=FIRST)
    session.receive(batch(0, bridge=FIRST), 0.0)
    before = session.state
    with pytest.raises(
        ProtocolError, match=f"conflict.*bridge {FIRST} publishes this session, 1 batch so far"
    ) as no:
        session.receive(message, 0.0)
    assert (no.value.value, no.value.expected) == (SECOND, FIRST)
    assert session.state == before
    session.receive(batch(1, bridge=FIRST), 0.0)
    assert answer(session.receive(closing(1).model_copy(update={"bridge": FIRST}), 0.0)).state == "closed"


def test_another_bridge_takes_a_session_over_by_a_higher_epoch_and_one_without_a_name_is_let_in():
    session, _ = open_session(bridge=FIRST)
    session.receive(batch(0), 0.0)
    assert answer(session.receive(opening(bridge=SECOND, epoch=1), 0.0)).next_seq == 1
    session.receive(batch(1, epoch=1, bridge=SECOND), 0.0)
    with pytest.raises(ProtocolError, match=r"conflict.*newer epoch"):
        session.receive(batch(2, bridge=FIRST), 0.0)
    assert session.state.counters.batches == 2


@pytest.mark.parametrize("message", [batch(1, epoch=1), heartbeat(1, epoch=1), opening(epoch=1)])
def test_an_older_epoch_is_a_conflict(message):
    session, _ = open_session(epoch=2)
    with pytest.raises(ProtocolError, match=r"conflict.*newer epoch"):
        session.receive(message, 0.0)


def test_a_higher_epoch_that_has_not_opened_is_a_conflict():
    session, _ = open_session()
    with pytest.raises(ProtocolError, match=r"conflict.*opens the session"):
        session.receive(batch(0, epoch=1), 0.0)
