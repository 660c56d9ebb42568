"""A session: ordering, results, refusals and its end. Its bridges: `test_bridge_epochs.py`."""

from __future__ import annotations

import numpy as np
import pytest

from caesura_protocol.codec import pack_samples
from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import MAX_GAPS, Ack, Changepoints, Posterior, Program, Segments, SessionStatus
from caesura_service.publishing.events import BatchRejected, Output, ReplayEnded, Reply, SessionFailed
from caesura_service.publishing.session_state import snapshot_of, status_of
from caesura_service.sessions.limits import Limits
from caesura_service.sessions.restored_outcome import state_from_snapshot
from caesura_service.sessions.session import Session
from harness.sessions import (
    COLUMNS,
    OWNER,
    Ring,
    answer,
    asked,
    batch,
    batch_of,
    batches,
    closing,
    demonstration,
    heartbeat,
    open_session,
    opening,
    published,
)


def run(session: Session, count: int) -> list[Output]:
    return [out for made in batches(count) for out in session.receive(made, 0.0)]


# --- results --------------------------------------------------------------------------------------------


def test_a_session_says_at_once_what_it_is_and_every_stream_begins_at_zero():
    session, said = open_session()
    assert answer(said) == Ack(session="s1", next_seq=0, state="open")
    assert [message.seq for message in published(said, Changepoints | Segments | SessionStatus)] == [0, 0, 0]
    assert published(said, Program)[0].version == 0
    assert published(said, SessionStatus)[0].state == "open"
    assert session.state.is_open


def test_results_carry_their_owner_and_number_without_holes():
    session, said = open_session()
    said += run(session, 20)
    for kind in (Changepoints, Segments, Posterior, SessionStatus):
        stream = published(said, kind)
        assert [message.seq for message in stream] == list(range(len(stream)))
        assert {(m.station, m.session, m.instance, m.epoch) for m in stream} == {
            ("cell-1", "s1", "test-1", 1)
        }


def test_following_the_changes_gives_the_same_as_asking_for_everything():
    session, said = open_session()
    said += run(session, 30)
    changepoints: tuple = ()
    for message in published(said, Changepoints):
        changepoints = changepoints[: message.first] + message.changepoints
    segments: tuple = ()
    for message in published(said, Segments):
        segments = segments[: message.first] + message.segments
    snapshot = snapshot_of(session.state)
    assert (changepoints, segments) == (snapshot.changepoints.changepoints, snapshot.segments.segments)
    assert len(changepoints) == 6
    assert snapshot.changepoints.seq == published(said, Changepoints)[-1].seq


def test_what_does_not_change_is_not_published():
    session, _ = open_session()
    said = run(session, 4)
    assert not published(said, Changepoints)
    assert not published(said, Program)


def test_the_posterior_is_published_when_there_is_an_observation():
    session, _ = open_session()
    rows = demonstration(10)
    half = pack_samples(rows[:5], COLUMNS, session="s1", epoch=0, seq=0)
    rest = pack_samples(rows[5:], COLUMNS, session="s1", epoch=0, seq=1)
    assert not published(session.receive(half, 0.0), Posterior)
    assert len(published(session.receive(rest, 0.0), Posterior)) == 1


def test_the_program_gets_a_version_for_every_change_and_the_last_one_is_complete():
    session, said = open_session()
    said += run(session, 20)
    said += session.receive(closing(19), 0.0)
    programs = published(said, Program)
    assert [program.version for program in programs] == list(range(len(programs)))
    assert [program.complete for program in programs] == [False] * (len(programs) - 1) + [True]


def test_a_status_comes_once_a_second_of_session_time():
    session, _ = open_session()
    times = [status.t for status in published(run(session, 50), SessionStatus)]
    assert len(times) == 9
    assert min(np.diff(times)) >= 1.0


def test_a_snapshot_before_the_first_observation_is_complete_and_has_no_posterior():
    session, _ = open_session()
    snapshot = snapshot_of(session.state)
    assert snapshot.posterior is None
    assert snapshot.status.t == 0.0


# --- ordering and replay --------------------------------------------------------------------------------


def test_a_batch_that_comes_twice_is_counted_and_ignored():
    session, _ = open_session()
    session.receive(batch(0), 0.0)
    before = session.state.view
    assert session.receive(batch(0), 0.0) == []
    assert session.state.view == before
    assert session.state.counters.duplicates == 1


def test_a_hole_is_asked_for_once_and_filled_in_order():
    session, _ = open_session()
    session.receive(batch(0), 0.0)
    assert asked(session.receive(batch(3), 0.0)) == [(1, 2)]
    assert asked(session.receive(batch(4), 0.1)) == []
    assert session.state.waiting_for == 1
    session.receive(batch(2), 0.2)
    session.receive(batch(1), 0.2)
    assert session.next_seq == 5
    assert session.state.waiting_for is None
    assert session.state.view.samples == 100


def test_a_heartbeat_shows_a_lost_tail():
    session, _ = open_session()
    session.receive(batch(0), 0.0)
    assert asked(session.receive(heartbeat(0), 0.0)) == []
    assert asked(session.receive(heartbeat(3), 0.0)) == [(1, 3)]


def test_an_unanswered_question_is_repeated_after_an_interval_and_shown():
    limits = Limits(replay_retry_s=0.5)
    session, _ = open_session(limits=limits)
    session.receive(heartbeat(3), 0.0)
    assert asked(session.receive(ReplayEnded("s1", 0, answered=False), 2.0)) == []
    assert session.request_missing(2.4) == []
    again = session.request_missing(2.5)
    assert asked(again) == [(0, 3)]
    assert published(again, SessionStatus)[0].waiting_for == 0


def test_a_question_whose_answer_never_ends_is_repeated_in_the_end():
    session, _ = open_session(limits=Limits(replay_timeout_s=5.0))
    session.receive(heartbeat(3), 0.0)
    assert session.request_missing(4.9) == []
    assert asked(session.request_missing(5.0)) == [(0, 3)]


def test_a_long_hole_is_asked_for_in_stretches_one_after_the_other():
    session, _ = open_session(limits=Limits(replay_batches=2))
    assert asked(session.receive(heartbeat(4), 0.0)) == [(0, 1)]
    assert asked(session.receive(batch(0), 0.1) + session.receive(batch(1), 0.1)) == []
    assert asked(session.receive(ReplayEnded("s1", 0, answered=True), 0.1)) == [(2, 3)]


def test_batches_beyond_what_can_be_held_are_asked_for_again():
    session, _ = open_session(limits=Limits(held_batches=2))
    ring = Ring(batches(10))
    for seq in (3, 4, 5, 6):
        session.receive(batch(seq), 0.0)
    assert session.state.counters.batches == 0
    session.receive(ReplayEnded("s1", 0, answered=False), 0.0)
    said = ring.feed(session, heartbeat(6), 10.0)
    assert asked(said)[-1] == (5, 6)
    assert session.next_seq == 7


def test_what_the_ring_no_longer_has_becomes_a_gap_and_the_session_goes_on():
    session, _ = open_session()
    ring = Ring(batches(10), oldest=4)
    session.receive(batch(0), 0.0)
    said = ring.feed(session, batch(8), 0.0)
    assert session.next_seq == 9
    assert [gap.reason for gap in published(said, SessionStatus)[-1].gaps] == ["evicted"]
    gap = session.state.view.gaps[0]
    assert (gap.t0, gap.tn) == (pytest.approx(0.19), pytest.approx(0.8))


def test_a_lost_beginning_is_skipped_and_reported():
    session, _ = open_session()
    Ring(batches(10), oldest=4).feed(session, batch(6), 0.0)
    assert session.next_seq == 7
    (gap,) = session.state.view.gaps
    assert gap.t0 == gap.tn == pytest.approx(0.8)
    assert status_of(session.state).lost == 4


def test_a_lost_end_is_reported():
    session, _ = open_session()
    session.receive(batch(0), 0.0)
    said = session.receive(closing(5), 0.0)
    said += session.receive(ReplayEnded("s1", 1, answered=False, evicted=True), 0.0)
    said += session.receive(closing(5), 1.0)
    status = published(said, SessionStatus)[-1]
    assert (status.state, status.batches, status.lost) == ("closed", 1, 5)
    assert [(gap.t0, gap.tn) for gap in status.gaps] == [(0.19, 0.19)]


def test_an_eviction_that_names_nothing_goes_on_with_what_is_held():
    session, _ = open_session()
    session.receive(batch(0), 0.0)
    session.receive(batch(5), 0.0)
    session.receive(ReplayEnded("s1", 1, answered=False, evicted=True), 0.0)
    assert session.next_seq == 6


def test_a_late_eviction_of_what_has_come_meanwhile_changes_nothing():
    session, _ = open_session()
    session.receive(batch(0), 0.0)
    session.receive(batch(2), 0.0)
    session.receive(batch(1), 0.0)
    session.receive(ReplayEnded("s1", 1, answered=False, evicted=True, oldest=2), 0.0)
    assert session.next_seq == 3
    assert session.state.view.gaps == ()


def test_a_batch_that_no_answer_brings_is_given_up_after_a_few():
    session, _ = open_session(limits=Limits(replay_misses=3))
    session.receive(batch(0), 0.0)
    session.receive(batch(2), 0.0)
    for attempt in range(3):
        assert session.next_seq == 1
        session.receive(ReplayEnded("s1", 1, answered=True), float(attempt))
    assert session.next_seq == 3
    assert len(session.state.view.gaps) == 1


def test_a_bridge_that_is_away_is_waited_for():
    session, _ = open_session(limits=Limits(replay_misses=3))
    session.receive(batch(1), 0.0)
    for attempt in range(10):
        session.receive(ReplayEnded("s1", 0, answered=False), float(attempt))
        session.request_missing(attempt + 0.9)
    assert session.next_seq == 0


# --- refusals -------------------------------------------------------------------------------------------

NAN = batch_of([[0.2, 0.0], [0.21, float("nan")]], seq=1)
ABSURD = batch_of([[1e11, 0.0]], seq=1)
FAR = batch_of([[0.2, 2e6]], seq=1)
LASTING = batch_of([[0.2, 0.0], [90.0, 0.0]], seq=1)
OTHER_COLUMNS = batch_of([[0.2, 0.0]], seq=1, columns=("t", "py"))
IMPOSSIBLE = batch_of([[0.2, -1.0]], seq=1)
CUT = batch(1, samples=b"\0" * 12)


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        (NAN, "not finite"),
        (ABSURD, "time in batch 1 is out of range"),
        (FAR, "px is out of range"),
        (LASTING, "lasts too long: the robot's clock was set within it; end this session and begin another"),
        (OTHER_COLUMNS, "columns differ"),
        (CUT, "do not fit"),
        (IMPOSSIBLE, "what a robot can send"),
    ],
)
def test_a_batch_with_refused_content_is_counted_reported_and_leaves_a_gap(bad, words):
    session, _ = open_session()
    session.receive(batch(0), 0.0)
    said = session.receive(bad, 0.0)
    refusals = [out.error for out in said if isinstance(out, BatchRejected)]
    assert [error.code for error in refusals] == ["malformed"]
    said += session.receive(batch(2), 0.0)
    status = published(said, SessionStatus)[-1]
    assert status.refused == {"malformed": 1}
    assert status.last_refusal is not None
    assert words in status.last_refusal.message
    assert session.next_seq == 3
    assert len(session.state.view.gaps) == 1


def test_refused_content_ahead_of_its_turn_leaves_its_gap_in_its_place():
    session, _ = open_session()
    session.receive(NAN, 0.0)
    session.receive(batch(2), 0.0)
    assert session.next_seq == 0
    session.receive(batch(0), 0.0)
    assert session.next_seq == 3
    assert [(gap.t0, gap.tn) for gap in session.state.view.gaps] == [(0.19, 0.4)]


@pytest.mark.parametrize("message", [batch(2_000_000), heartbeat(2_000_000), closing(2_000_000)])
def test_a_sequence_number_that_leaps_is_malformed_and_changes_nothing(message):
    session, _ = open_session()
    before = session.state
    with pytest.raises(ProtocolError, match=r"too far ahead.*limit 1000000"):
        session.receive(message, 0.0)
    assert session.state == before


def test_an_error_in_the_pipeline_closes_the_session_and_says_so():
    session, _ = open_session(preset="raising")
    session.receive(batch(0), 0.0)
    said = session.receive(batch_of([[0.2, 13.0]], seq=1), 0.0)
    assert [type(out.error) for out in said if isinstance(out, SessionFailed)] == [RuntimeError]
    status = published(said, SessionStatus)[-1]
    assert status.state == "closed"
    assert "cannot stand 13" in status.last_refusal.message
    assert "cannot stand 13" in published(said, Program)[-1].notes[0]
    with pytest.raises(ProtocolError, match="the session has failed"):
        session.receive(batch(2), 0.0)


@pytest.mark.parametrize("ending", [batch(1), closing(0)])
def test_a_view_that_cannot_be_published_closes_the_session_too(ending):
    session, _ = open_session(preset="unspeakable")
    session.receive(batch(0), 0.0)
    said = session.receive(ending, 0.0)
    assert [type(out.error).__name__ for out in said if isinstance(out, SessionFailed)] == ["ValidationError"]
    assert published(said, SessionStatus)[-1].state == "closed"


# --- close ----------------------------------------------------------------------------------------------


def test_closing_publishes_final_results_and_is_acknowledged():
    session, _ = open_session()
    run(session, 10)
    said = session.receive(closing(9), 0.0)
    assert answer(said) == Ack(session="s1", next_seq=10, state="closed")
    assert published(said, Changepoints)[-1].changepoints[-1].certainty == "final"
    assert published(said, SessionStatus)[-1].state == "closed"


def test_closing_before_everything_is_there_asks_for_the_rest_and_is_no_refusal():
    session, _ = open_session()
    session.receive(batch(0), 0.0)
    said = session.receive(closing(3), 0.0)
    refusal = answer(said)
    assert isinstance(refusal, ProtocolError)
    assert (refusal.code, refusal.value) == ("conflict", 1)
    assert asked(said) == [(1, 3)]
    assert status_of(session.state).refused == {}
    for seq in (1, 2, 3):
        session.receive(batch(seq), 0.0)
    assert answer(session.receive(closing(3), 0.0)).state == "closed"


def test_closing_again_is_acknowledged_again_and_says_nothing_else():
    session, _ = open_session()
    run(session, 2)
    session.receive(closing(1), 0.0)
    assert session.receive(closing(1), 0.0) == [Reply(Ack(session="s1", next_seq=2, state="closed"))]


@pytest.mark.parametrize("last_seq", [0, 3])
def test_closing_a_closed_session_at_another_batch_is_a_conflict(last_seq):
    session, _ = open_session()
    run(session, 2)
    session.receive(closing(1), 0.0)
    with pytest.raises(ProtocolError, match="other batches"):
        session.receive(closing(last_seq), 0.0)


def test_closing_before_what_is_already_there_is_a_conflict():
    session, _ = open_session()
    run(session, 5)
    with pytest.raises(ProtocolError, match="other batches"):
        session.receive(closing(2), 0.0)


def test_an_empty_session_can_be_closed():
    session, _ = open_session()
    assert answer(session.receive(closing(-1), 0.0)) == Ack(session="s1", next_seq=0, state="closed")


def test_a_pipeline_that_cannot_finish_refuses_the_close_and_ends_the_session():
    session, _ = open_session(preset="raising-at-the-end")
    refusal = answer(session.receive(closing(-1), 0.0))
    assert isinstance(refusal, ProtocolError)
    assert "cannot finish" in refusal.message
    assert not session.is_open


@pytest.mark.parametrize("message", [batch(2), opening(epoch=1), opening(wrench_source="none")])
def test_a_closed_session_takes_nothing_and_stays_as_it_is(message):
    session, _ = open_session()
    run(session, 2)
    session.receive(closing(1), 0.0)
    before = session.state
    with pytest.raises(ProtocolError, match="conflict: the session is closed"):
        session.receive(message, 0.0)
    assert session.state == before


def test_a_batch_that_was_sent_again_may_trail_behind_the_close():
    # After a restart what was asked for again came behind the close, and was counted as refused.
    session, _ = open_session()
    run(session, 2)
    session.receive(closing(1), 0.0)
    assert session.receive(batch(1), 0.0) == []
    assert (session.state.counters.duplicates, session.state.counters.refused) == (1, {})


def test_the_same_opening_behind_the_close_is_refused_and_not_counted():
    # A bridge tells a service that came back its session again; the close once overtook that.
    session, _ = open_session()
    session.receive(closing(-1), 0.0)
    before = session.state
    refusal = answer(session.receive(opening(), 0.0))
    assert isinstance(refusal, ProtocolError)
    assert "the session is closed" in refusal.message
    assert session.state == before


def test_heartbeats_and_late_answers_after_the_close_are_harmless():
    session, _ = open_session()
    run(session, 2)
    session.receive(closing(1), 0.0)
    assert session.receive(heartbeat(5), 0.0) == []
    assert session.receive(ReplayEnded("s1", 2, answered=False), 0.0) == []


def test_what_is_held_is_bounded_in_bytes_too():
    size = 8 * 20 * 2  # of a batch in memory
    session, _ = open_session(limits=Limits(held_batches=100, held_bytes=3 * size))
    for seq in range(1, 6):
        session.receive(batch(seq), 0.0)
    session.receive(batch(0), 0.0)
    assert session.next_seq == 4
    for seq in (5, 6, 7):
        session.receive(batch(seq), 0.0)
    session.receive(batch(4), 0.0)
    assert session.next_seq == 8


def test_a_status_lists_the_newest_gaps_and_counts_the_others():
    """Each gap used to make the next status longer: whoever made many slowed everybody down."""
    session, _ = open_session()
    for seq in range(2 * MAX_GAPS):
        session.receive(batch_of([[2.0 * seq, 0.0], [2.0 * seq + 0.01, 0.0]], seq=2 * seq), 0.0)
        session.receive(batch_of([[2.0 * seq, float("nan")]], seq=2 * seq + 1), 0.0)
    session.receive(batch_of([[4.0 * MAX_GAPS, 0.0]], seq=4 * MAX_GAPS), 0.0)
    status = status_of(session.state)
    assert (len(status.gaps), status.gaps_before) == (MAX_GAPS, MAX_GAPS)
    assert status.gaps[-1].tn == 4.0 * MAX_GAPS
    ended = state_from_snapshot(snapshot_of(session.state), OWNER)
    assert (status_of(ended).gaps_before, status_of(ended).lost) == (MAX_GAPS, 2 * MAX_GAPS)
