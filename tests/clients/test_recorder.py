"""Recording a live session: nothing lost that anybody still has, and what is lost is said."""

from __future__ import annotations

import itertools
import threading
import tracemalloc
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from caesura_clients.bridge import Bridge, BridgeSettings
from caesura_clients.recorder import ATTEMPTS, RecordedSession, Recorder, record
from caesura_protocol.codec import encode, pack_samples
from caesura_protocol.errors import CaesuraError
from caesura_protocol.keys import ReplayRange, session_key, station_key
from caesura_protocol.messages import MAX_BATCHES_AHEAD, SampleBatch
from caesura_protocol.programs.safety import CellSettings
from caesura_protocol.recording import ASSUMED_ORDER
from clients.answering import Answering
from clients.examples import LiveSource, samples, snapshot
from clients.fake_service import FakeService, eventually

QUICK = BridgeSettings(heartbeat_s=0.05, retry_s=0.05)
COLUMNS = LiveSource.columns


def batch(seq: int, session: str = "s1") -> SampleBatch:
    return pack_samples(samples(20, t0=seq * 0.02), COLUMNS, session=session, epoch=0, seq=seq)


@given(st.lists(st.integers(0, 30), max_size=60), st.integers(-1, 30), st.integers(0, 12))
def test_what_is_missing_is_asked_for_until_it_is_here_or_gone(arrivals, beat, oldest):
    recorder = Recorder("s1")
    for seq in arrivals:
        recorder.add_batch(batch(seq), now_s=1000.0 + seq * 0.02)
    recorder.announce_seq(beat)
    known = max([beat, *arrivals])
    for _ in range(100):
        wanted = recorder.missing()
        if wanted is None:
            break
        assert wanted.first not in recorder.batches
        if wanted.first < oldest:
            recorder.give_up_before(oldest)
        else:
            for seq in range(wanted.first, wanted.last + 1):
                recorder.add_batch(batch(seq))
    assert recorder.missing() is None
    gone = {seq for seq in range(min(oldest, known + 1)) if seq not in arrivals}
    assert recorder.lost == len(gone)
    if known >= 0 and len(gone) <= known:
        found = recorder.recording(None)
        expected = np.concatenate([samples(20, t0=n * 0.02) for n in range(known + 1) if n not in gone])
        np.testing.assert_allclose(found.matrix(), expected)


def test_what_is_missing_in_the_end_is_named_with_its_time():
    """Only the number of batches was named."""
    recorder = Recorder("s1")
    for seq in {*range(60)} - {5, 6, 10, 20, 30}:
        recorder.add_batch(batch(seq))
    recorded = RecordedSession(recorder.recording(None), snapshot(0), recorder, closed=True)
    times = "the newest at 0.20–0.22, 0.40–0.42, 0.60–0.62 s"
    assert recorded.missed.startswith(f"5 of 60 batches are missing: gaps {times}")
    lost = [(round(t0, 2), round(tn, 2)) for t0, tn in recorded.recording.lost]
    assert lost == [(0.1, 0.14), (0.2, 0.22), (0.4, 0.42), (0.6, 0.62)]
    late = Recorder("s1")
    late.add_batch(batch(3))
    recorded = RecordedSession(late.recording(None), snapshot(0), late, closed=True)
    assert "3 of 4 batches are missing: gaps before the first sample or after the last" in recorded.missed


def test_a_recording_opens_a_session_with_the_same_robot_and_limits():
    """They were left out: played again, its program had no robot and no limit of its forces."""
    recorder, found = Recorder("s1"), snapshot(0)
    recorder.add_batch(batch(0))
    program = found.program.model_copy(update={"robot": "ur5e", "force_limit_n": 12.0})
    wrench = found.status.wrench.model_copy(update={"up": (0.0, 0.0, -1.0)})
    status = found.status.model_copy(update={"wrench": wrench})
    setting = recorder.recording(found.model_copy(update={"program": program, "status": status})).setting
    assert setting == CellSettings(12.0, robot="ur5e", up=(0.0, 0.0, -1.0))


def test_a_question_without_an_answer_is_a_gap_in_the_end():
    recorder = Recorder("s1")
    recorder.add_batch(batch(0))
    recorder.announce_seq(3)
    for _ in range(ATTEMPTS):
        assert recorder.missing() == ReplayRange(1, 3, 3, "s1")
        recorder.count_unanswered(ReplayRange(1, 3, 3, "s1"))
    assert recorder.missing() is None
    assert recorder.lost == 3
    recorder.add_batch(batch(2))  # late, but welcome
    assert recorder.lost == 2


def test_a_number_far_ahead_is_none():
    recorder = Recorder("s1")
    recorder.add_batch(batch(0))
    recorder.announce_seq((1 << 53) - 1)
    recorder.add_batch(batch(0).model_copy(update={"seq": 1 << 50}))
    assert (recorder.known, recorder.missing()) == (0, None)


def test_a_session_that_has_gone_on_for_hours_is_recorded_from_its_newest_batch_on():
    recorder = Recorder("s1")
    first = MAX_BATCHES_AHEAD + 5
    for seq in (first, first + 1):
        recorder.announce_seq(seq)
        recorder.add_batch(batch(seq))
    assert set(recorder.batches) == {first, first + 1}


def test_without_an_answer_at_all_an_hour_is_given_up_at_once():
    recorder = Recorder("s1")
    recorder.add_batch(batch(180_000))
    for _ in range(ATTEMPTS):
        recorder.count_unanswered(recorder.missing(), no_reply=True)
    assert recorder.missing() is None
    assert recorder.lost == 180_000


def test_a_number_that_leaps_to_a_billion_takes_no_memory():
    recorder = Recorder("s1")
    recorder.add_batch(batch(0))
    tracemalloc.start()
    for seq in range(1_000_000, 1_000_000_001, 1_000_000):
        recorder.announce_seq(seq)
    for _ in range(ATTEMPTS):
        recorder.count_unanswered(recorder.missing(), no_reply=True)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert (recorder.missing(), recorder.lost) == (None, 1_000_000_000)
    assert peak < 100_000
    recorder.add_batch(batch(500_000_000))
    assert recorder.lost == 999_999_999


def test_batches_that_cannot_be_read_are_not_asked_for_again():
    recorder = Recorder("s1")
    for seq in (2, 4):
        recorder.add_batch(batch(seq).model_copy(update={"samples": b"1234"}))
    assert recorder.missing() == ReplayRange(0, 4, 5, "s1")
    for seq in (0, 1, 3):
        recorder.add_batch(batch(seq))
    assert (recorder.missing(), recorder.lost) == (None, 2)


def test_a_correction_of_yesterdays_session_is_not_waited_for(memory):
    over = threading.Event()
    with ThreadPoolExecutor() as pool:
        found = pool.submit(record, memory.transport(), "cell-1", over=over)
        eventually(lambda: memory.subscribers)
        old = snapshot(1, "motion", session="yesterday", state="closed").status
        robot = memory.transport()
        robot.put(session_key("cell-1", "yesterday", "status"), encode(old))
        robot.put(station_key("cell-1", "samples"), encode(batch(0)))
        new = snapshot(2, "motion", session="s1", state="closed").status
        robot.put(session_key("cell-1", "s1", "status"), encode(new))
        assert found.result(20.0).recorder.session == "s1"


def test_a_batch_that_cannot_be_read_is_counted_and_not_kept():
    recorder = Recorder("s1")
    recorder.add_batch(batch(0).model_copy(update={"samples": b"1234"}))
    assert (recorder.spoiled, recorder.lost, recorder.missing()) == (1, 1, None)
    with pytest.raises(CaesuraError, match="s1: no samples came"):
        recorder.recording(None)


def test_the_zero_of_the_session_is_determined_by_the_batch_that_was_quickest():
    recorder = Recorder("s1")
    for seq, late_s in enumerate((0.3, 0.002, 0.1)):
        recorder.add_batch(batch(seq), now_s=500.0 + seq * 0.02 + 0.019 + late_s)
    assert recorder.began_s == pytest.approx(500.002)


def recorded(network, bridge_settings=QUICK, *, before: int, after: int, lose=lambda batch: False):
    """A bridge that sends `before` batches before anybody records, and `after` ones then."""
    over, pool, received = threading.Event(), ThreadPoolExecutor(1), []
    recording_transport = network.transport()
    with (
        pool,
        FakeService(network.transport()),
        Bridge(network.transport(), "cell-1", LiveSource(), session="s1", settings=bridge_settings) as bridge,
    ):
        bridge.wait_open(30.0)
        bridge.send(samples(20 * before))
        eventually(lambda: bridge._sender._next_put == before)
        network.lose = lose
        future = pool.submit(record, recording_transport, "cell-1", over=over, on_message=received.append)
        try:
            eventually(lambda: any(key == station_key("cell-1", "samples") for key, _ in network.subscribers))
            eventually(lambda: len(network.subscribers) >= 3)
            bridge.send(samples(20 * after, t0=before * 0.02))
            eventually(lambda: received and received[-1].known == before + after - 1)
            eventually(lambda: received[-1].missing() is None)
        finally:
            over.set()
        return future.result(10.0)


def test_what_the_network_dropped_is_asked_of_the_bridge(memory):
    deliveries = itertools.count()

    def some(delivery):
        return next(deliveries) % 7 == 0

    found = recorded(memory, before=0, after=20, lose=some)
    assert found.recorder.lost == 0
    np.testing.assert_allclose(found.recording.matrix(), samples(400))
    assert "the session goes on" in found.missed


def test_a_recording_that_begins_late_has_what_the_ring_still_has(memory):
    found = recorded(memory, before=30, after=5)
    assert found.recorder.lost == 0
    np.testing.assert_allclose(found.recording.matrix(), samples(700))


def test_what_the_ring_has_lost_is_a_gap_and_is_said(memory):
    short = BridgeSettings(heartbeat_s=0.05, retry_s=0.05, ring_samples=100, window_batches=4)
    found = recorded(memory, short, before=30, after=3)
    kept = len(found.recorder.batches)
    assert 3 <= kept <= 8
    assert found.recorder.lost == 33 - kept
    assert found.missed.startswith(f"{33 - kept} of 33 batches are missing: gaps")
    np.testing.assert_allclose(found.recording.matrix(), samples(660)[-20 * kept :])


def test_another_session_of_the_station_is_not_mixed_in(memory):
    over = threading.Event()
    transport, sender = memory.transport(), memory.transport()
    with ThreadPoolExecutor(1) as pool:
        future = pool.submit(record, transport, "cell-1", "s2", over=over)
        eventually(lambda: len(memory.subscribers) == 2)
        for seq, session in ((0, "s1"), (0, "s2"), (1, "s1"), (1, "s2")):
            sender.put(station_key("cell-1", "samples"), encode(batch(seq, session)))
        over.set()
        found = future.result(10.0)
    assert found.recorder.session == "s2"
    assert found.recording.t.size == 40


def test_nothing_received_is_an_error_that_names_the_station(memory):
    over = threading.Event()
    over.set()
    with pytest.raises(CaesuraError, match="cell-1: no session s9 was received"):
        record(memory.transport(), "cell-1", "s9", over=over)


def test_a_word_of_the_end_that_was_lost_is_asked_for(memory, monkeypatch):
    monkeypatch.setattr("caesura_clients.recorder.SILENT_S", 0.0)
    reported = snapshot(0, station="cell-1", session="s1", state="closed")
    with Answering(memory.transport()) as service, ThreadPoolExecutor(1) as pool:
        service.snapshots = [reported]
        sender, over = memory.transport(), threading.Event()
        future = pool.submit(record, memory.transport(), "cell-1", over=over)
        try:
            eventually(lambda: any(key == station_key("cell-1", "samples") for key, _ in memory.subscribers))
            sender.put(station_key("cell-1", "samples"), encode(batch(0)))
            found = future.result(10.0)
        finally:
            over.set()
    assert found.closed
    assert found.snapshot == reported


def test_an_order_of_quaternions_that_the_bridge_assumed_is_not_stated_by_the_recording():
    found = snapshot(0)
    noted = found.model_copy(update={"program": found.program.model_copy(update={"notes": (ASSUMED_ORDER,)})})
    recorder = Recorder("s1")
    recorder.add_batch(batch(0))
    assert recorder.recording(noted).assumptions[:1] == ("quaternion_order",)
    assert "quaternion_order" not in recorder.recording(found).assumptions
