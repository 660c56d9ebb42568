import pytest

from caesura_clients.bridge.replay_ring import EVICTED, ReplayRing, StoredBatch
from caesura_protocol.codec import Encoded
from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import ReplayRange


def filled(count, *, period_s=0.02, samples=20, acknowledged=0, **bounds):
    ring = ReplayRing(**bounds)
    ring.acknowledged = acknowledged
    for seq in range(count):
        ring.append(StoredBatch(seq, seq * period_s, samples, Encoded(b"%d" % seq, "x")))
    return ring


def kept(ring):
    return ring.entries_from(0, len(ring))


def numbers(entries):
    return [entry.seq for entry in entries]


@pytest.mark.parametrize("period_s", [0.001, 0.02, 1.0])
def test_at_least_the_span_is_kept_and_hardly_more(period_s):
    ring = filled(40_000, period_s=period_s, samples=1, acknowledged=40_000, span_s=30.0)
    kept_s = (39_999 - numbers(kept(ring))[0]) * period_s
    assert 30.0 <= kept_s <= 30.0 + 2 * period_s


def test_what_no_service_is_known_to_have_is_kept_beyond_the_span():
    """A service was away for longer than the span, and the ring evicted what only it had."""
    assert len(filled(100, period_s=60.0, span_s=30.0, acknowledged=36)) == 64


def test_what_a_service_has_at_last_is_evicted_bit_by_bit():
    """After ten minutes without a service a robot's loop waited 12 ms, in which all of it was evicted."""
    ring = filled(100, period_s=60.0, span_s=30.0)
    assert len(ring) == 100
    ring.acknowledged = 100
    for seq in range(100, 110):
        before = len(ring)
        ring.append(StoredBatch(seq, 60.0 * seq, 20, Encoded(b"", "x")))
        assert before - len(ring) < EVICTED
    assert numbers(kept(ring)) == [*range(78, 110)]  # a step counts for a second at most


def test_the_bound_on_samples_wins_over_the_span():
    assert len(filled(1000, samples=20, max_samples=200, span_s=1e9)) == 10
    assert len(filled(3, samples=1000, max_samples=200)) == 1


def test_a_clock_that_stands_still_fills_no_memory():
    assert len(filled(1000, period_s=0.0, samples=20, max_samples=2000)) == 100


def test_a_range_is_answered_in_order_and_within_its_limit():
    ring = filled(10)
    assert numbers(ring.sent_range(ReplayRange(2, 5, 100))) == [2, 3, 4, 5]
    assert numbers(ring.sent_range(ReplayRange(2, 5, 3))) == [2, 3, 4]
    assert numbers(ring.sent_range(ReplayRange(8, 20, 100))) == [8, 9]
    assert ring.sent_range(ReplayRange(10, 20, 100)) == []
    assert ring.sent_range(ReplayRange(0, 9, 0)) == []
    assert ReplayRing().sent_range(ReplayRange(0, 9, 100)) == []


def test_what_is_gone_is_refused_and_the_oldest_is_named():
    ring = filled(100, samples=20, max_samples=200)
    with pytest.raises(ProtocolError) as refused:
        ring.sent_range(ReplayRange(3, 99, 100))
    assert (refused.value.code, refused.value.value, refused.value.limit) == ("evicted", 3, 90)
    assert numbers(ring.sent_range(ReplayRange(90, 99, 100))) == list(range(90, 100))


def test_numbers_have_no_holes():
    ring = filled(3)
    with pytest.raises(ValueError, match="batch 4 after 2"):
        ring.append(StoredBatch(4, 1.0, 1, Encoded(b"", "x")))
    assert numbers(kept(ring)) == [0, 1, 2]


@pytest.mark.parametrize("jump_s", [3600.0, -3600.0])
def test_a_clock_that_jumps_evicts_nothing(jump_s):
    ring = ReplayRing(span_s=30.0)
    for seq in range(1000):
        ring.append(StoredBatch(seq, 0.02 * seq + jump_s * (seq > 500), 20, Encoded(b"", "x")))
    assert numbers(kept(ring)) == list(range(1000))


def test_what_comes_after_a_number_is_what_is_still_there():
    ring = filled(100, samples=20, max_samples=200)
    assert numbers(ring.entries_from(95, 3)) == [95, 96, 97]
    assert numbers(ring.entries_from(0, 3)) == [90, 91, 92]
    assert ring.entries_from(100, 3) == []
    assert ReplayRing().entries_from(0, 3) == []


def test_a_batch_becomes_bytes_when_they_are_needed_and_once():
    made = []
    entry = StoredBatch(0, 0.0, 1, lambda: made.append(1) or Encoded(b"7", "x"))
    assert made == []
    assert (entry.content, entry.content) == (Encoded(b"7", "x"),) * 2
    assert made == [1]
