"""What a ring gives a plot: samples of the station and nothing else, the newest minute of them."""

from __future__ import annotations

import json
import struct
import tracemalloc

import numpy as np
import pytest

from caesura_clients.dashboard.signal_ring import BIN_S, SPAN_S, SignalRing, as_bytes
from caesura_protocol.codec import pack_samples
from caesura_protocol.derived_columns import ROTATION
from caesura_protocol.keys import SampleRange
from caesura_protocol.messages import RecordedSamples
from caesura_protocol.minmax_decimation import unpack_points
from caesura_service.decimation import SampleReader
from caesura_service.decimation.reader import Owned
from caesura_service.journal import JournalBatches, MemoryJournal, Record
from harness.journals import TURNING_COLUMNS, turning
from harness.sessions import opening

COLUMNS = ("t", "px", "py", "pz", "fx", "fy", "fz")
ALL = SampleRange(-1e6, 1e6, 10)


def moving(seconds: float, *, t0: float = 0.0, rate_hz: float = 1000.0) -> np.ndarray:
    """A hand that moves along x at 0.2 m/s under noise of force."""
    t = t0 + np.arange(round(seconds * rate_hz)) / rate_hz
    force = np.random.default_rng(7).normal(0.0, 1.0, (t.size, 3))
    return np.column_stack([t, 0.2 * t, 0.0 * t, 0.0 * t, force])


def sent(ring: SignalRing, matrix: np.ndarray, *, session: str = "s1", first: int = 0, columns=COLUMNS):
    for seq, start in enumerate(range(0, len(matrix), 20), first):
        ring.receive(session, columns, seq, matrix[start : start + 20])


def read(ring: SignalRing, wanted: SampleRange = ALL, unit: str = "m") -> RecordedSamples:
    found = ring.read("cell-1", wanted, unit, "base")
    assert found is not None
    return found


@pytest.mark.parametrize("wanted", [ALL, SampleRange(0.3, 0.6, 100, ("fz", "px"))])
def test_every_point_is_a_sample_and_of_every_bin_both_extremes_are_there(wanted):
    ring, matrix = SignalRing(), moving(2.0)
    sent(ring, matrix)
    found = read(ring, wanted)
    samples = dict(zip(matrix[:, 0], matrix[:, 6], strict=True))
    points = unpack_points(found)["fz"]
    assert all(samples[t] == value for t, value in points)
    bins = np.floor(matrix[:, 0] / BIN_S + 1e-6)
    whole = matrix[bins == np.floor(0.4 / BIN_S + 1e-6), 6]
    assert {whole.min(), whole.max()} <= set(points[:, 1].tolist())
    assert found.columns == ((*COLUMNS[1:], "speed") if wanted is ALL else ("px", "fz"))


def test_the_speed_is_that_of_the_hand():
    ring = SignalRing()
    sent(ring, moving(1.0))
    assert unpack_points(read(ring))["speed"][5:, 1] == pytest.approx(0.2)


def test_joints_alone_have_a_speed_of_their_own():
    ring, t = SignalRing(), np.arange(1000) / 1000.0
    columns = ("t", *(f"q{i}" for i in range(1, 8)))
    sent(ring, np.column_stack([t, 0.5 * t, *np.zeros((6, t.size))]), columns=columns)
    assert unpack_points(read(ring))["speed"][5:, 1] == pytest.approx(0.5)


@pytest.mark.parametrize("measured", ["speed", ROTATION[0]])
def test_a_measured_column_with_the_name_of_a_derived_one_is_drawn_once(measured):
    """A station that no service let in may send any names; both were drawn, with the values of one."""
    ring, t = SignalRing(), np.arange(200) / 1000.0
    columns = ("t", "px", "py", "pz", "qx", "qy", "qz", "qw", measured)
    sent(ring, np.column_stack([t, *np.zeros((6, 200)), np.ones(200), 7.0 + t]), columns=columns)
    found = read(ring, unit="mm")
    assert len(set(found.available)) == len(found.available)
    assert set(found.available) >= {"px", "qw", measured}
    assert unpack_points(found)[measured][:, 1].min() >= 7.0


@pytest.mark.parametrize(("pause_s", "skipped", "reason"), [(2.0, 0, "source"), (0.1, 3, "evicted")])
def test_a_hole_is_stated_and_has_no_speed_behind_it(pause_s, skipped, reason):
    ring = SignalRing()
    sent(ring, moving(1.0))
    sent(ring, moving(1.0, t0=1.0 + pause_s), first=50 + skipped)
    found = read(ring)
    assert [(hole.t0, hole.tn, hole.reason) for hole in found.holes] == [
        (0.999, pytest.approx(1.0 + pause_s), reason)
    ]
    times = unpack_points(found)["speed"][:, 0]
    assert not ((times > 0.999) & (times < 1.08 + pause_s)).any()


def recorded(matrix: np.ndarray, columns: tuple[str, ...]) -> RecordedSamples:
    """What a service answers for all samples, in the bins of a ring."""
    journal = MemoryJournal()
    journal.append(Record("cell-1", "s1", 1.0, opening(columns=columns)))
    for seq, start in enumerate(range(0, len(matrix), 20)):
        batch = pack_samples(matrix[start : start + 20], columns, session="s1", epoch=0, seq=seq)
        journal.append(Record("cell-1", "s1", 2.0, batch))
    wanted = SampleRange(0.0, 4096 * BIN_S, 4096, columns=("px", *ROTATION))
    return SampleReader(JournalBatches(journal)).read(Owned("cell-1", "s1", "caesura-1", 1, True), wanted)


def test_a_live_session_turns_as_its_journal_does():
    ring, matrix = SignalRing(), turning(30.0, 1000.0)
    sent(ring, matrix, columns=TURNING_COLUMNS)
    live, kept = read(ring), recorded(matrix, TURNING_COLUMNS)
    assert ring.covers("s1", 0.0, ROTATION)
    assert kept.bin_s == BIN_S
    for name in ("px", *ROTATION):
        assert np.array_equal(unpack_points(live)[name], unpack_points(kept)[name]), name


@pytest.mark.parametrize("value", [np.inf, np.nan, 1e200])
def test_a_first_quaternion_of_no_length_does_not_blank_the_rotations(value):
    """Of the ring the service has not refused it yet; one was the first orientation of the whole session."""
    ring, matrix = SignalRing(), turning(2.0, 1000.0)
    matrix[0, 4:8] = value
    with np.errstate(over="ignore", invalid="ignore"):
        sent(ring, matrix, columns=TURNING_COLUMNS)
    assert unpack_points(read(ring))["rotation_z"].size


def test_who_joins_late_has_rotations_once_the_first_orientation_is_known():
    ring, matrix = SignalRing(), turning(30.0, 1000.0)
    kept = recorded(matrix, TURNING_COLUMNS)
    sent(ring, matrix[10_000:15_010], first=500, columns=TURNING_COLUMNS)
    assert ring.covers("s1", 11.0, ("px",))
    assert not ring.covers("s1", 11.0, ROTATION)
    assert not ring.covers("s1", 11.0), "all columns"
    assert unpack_points(read(ring))["rotation_z"].size == 0
    ring.set_first_orientation("s2", kept.first_orientation)
    ring.set_first_orientation("s1", None)
    assert not ring.covers("s1", 16.0, ROTATION)
    ring.set_first_orientation("s1", kept.first_orientation)
    sent(ring, matrix[15_010:], first=751, columns=TURNING_COLUMNS)
    assert not ring.covers("s1", 15.0, ROTATION)
    assert ring.covers("s1", 15.06, ROTATION)
    live = unpack_points(read(ring, SampleRange(15.06, 30.0, 100, ROTATION)))
    for name in ROTATION:
        points = unpack_points(kept)[name]
        assert np.array_equal(live[name], points[points[:, 0] >= 15.04 - 1e-9]), name


def test_batches_that_did_not_arrive_are_not_covered_until_they_are_past():
    ring = SignalRing()
    sent(ring, moving(1.0))
    assert ring.covers("s1", 0.0)
    sent(ring, moving(1.0, t0=1.1), first=55)
    assert not ring.covers("s1", 0.0)
    assert ring.covers("s1", 1.2)


def test_what_comes_late_or_twice_is_no_point():
    ring, matrix = SignalRing(), moving(1.0)
    sent(ring, matrix)
    before = read(ring)
    sent(ring, matrix)
    assert read(ring).points == before.points


@pytest.mark.parametrize("t0", [1e308, -1e308, 1e300, 1e18])
def test_a_time_that_is_none_is_left_out(t0):
    ring = SignalRing()
    sent(ring, moving(1.0, t0=t0))
    assert ring.read("cell-1", ALL, "m", "base") is None
    sent(ring, moving(1.0))
    assert read(ring).last == 0.999


WIDE = ("t", *(f"c{number}" for number in range(1, 64)))
STILL, FAR = np.zeros(1000), np.full(1, 1e11)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("times", "columns", "batches", "most_mb"),
    [
        (lambda seq: STILL, COLUMNS, 100, 2),
        (lambda seq: FAR, COLUMNS, 10_000, 1),  # samples without a time, which no later one replaces
        (lambda seq: 60.0 * seq + 0.059 * np.arange(1000), WIDE, 30, 40),  # for each sample a bin
        (lambda seq: 0.1 * seq + 1e-3 * np.arange(100), COLUMNS, 2000, 3),
    ],
    ids=["the time stands still", "no time", "a minute in each batch", "as from a robot"],
)
@pytest.mark.parametrize("is_shown", [False, True])
def test_a_ring_is_bounded_whatever_comes_and_whether_a_page_reads_it(
    times, columns, batches, most_mb, is_shown
):
    ring = SignalRing()
    tracemalloc.start()
    for seq in range(batches):
        t = times(seq)
        ring.receive("s1", columns, seq, np.column_stack([t, np.zeros((len(t), len(columns) - 1))]))
        if is_shown and seq % 10 == 0:
            ring.read("cell-1", ALL, "m", "base")
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 1e6 * most_mb


@pytest.mark.parametrize("t0", [0.0, 20.0, 40.0])
def test_what_a_ring_says_it_covers_it_gives(t0):
    """A read dropped what was older than a minute, behind the answer that it was there."""
    ring = SignalRing()
    sent(ring, moving(90.0, rate_hz=100.0))
    if ring.covers("s1", t0):
        found = read(ring, SampleRange(t0, 90.0, 10_000))
        assert unpack_points(found)["px"][0, 0] == pytest.approx(t0, abs=BIN_S)
    else:
        assert t0 < 90.0 - SPAN_S


def test_a_ring_holds_a_minute_and_says_what_it_covers():
    ring = SignalRing()
    for t0 in range(80):
        sent(ring, moving(1.0, rate_hz=100.0, t0=float(t0)), first=5 * t0)
        assert ring.covers("s1", 0.0) == (t0 < SPAN_S + 5) or SPAN_S - 5 < t0 < SPAN_S + 25
    assert not ring.covers("s1", 0.0)
    assert ring.covers("s1", 80.0 - SPAN_S + 1.0)
    assert not ring.covers("s2", 79.0)
    found = read(ring)
    assert found.first is None, "its beginning is not here any more"
    assert found.last == 79.99


def test_who_joins_late_does_not_have_the_beginning():
    ring = SignalRing()
    sent(ring, moving(1.0, t0=5.0), first=250)
    assert not ring.covers("s1", 0.0)
    assert read(ring).first is None


def test_another_session_begins_anew_and_so_do_other_columns():
    ring = SignalRing()
    sent(ring, moving(1.0, t0=50.0))
    sent(ring, moving(1.0), session="s2")
    assert (read(ring).session, read(ring).last) == ("s2", 0.999)
    sent(ring, moving(1.0, t0=2.0)[:, :4], session="s2", columns=COLUMNS[:4])
    assert "fx" not in read(ring).available


def test_lengths_are_metres_whatever_the_bridge_sends():
    ring, matrix = SignalRing(), moving(1.0)
    matrix[:, 1:4] = matrix[:, 1:4] * 1000.0 + 250.0
    sent(ring, matrix)
    points = unpack_points(read(ring, unit="mm"))
    assert points["py"][:, 1] == pytest.approx(0.25)
    assert points["speed"][5:, 1] == pytest.approx(0.2)


def test_the_form_for_browsers_keeps_every_bit():
    ring = SignalRing()
    sent(ring, moving(1.0))
    found = read(ring)
    content = as_bytes(found)
    (length,) = struct.unpack_from("<I", content)
    header = json.loads(content[4 : 4 + length])
    assert (4 + length) % 8 == 0
    assert content[4 + length :] == found.points
    assert header["counts"] == list(found.counts)
    assert header["holes"] == []
