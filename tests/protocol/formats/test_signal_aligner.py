"""Signals at times of their own become rows: never from the future, never made up."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from caesura_protocol.formats import signal_aligner
from caesura_protocol.formats.signal_aligner import FOREVER, MAX_AGE_S, SignalAligner

MS = 10**6


def place(t_ms: int) -> tuple[float, ...]:
    return (float(t_ms), 0.0, 0.0)


times = st.lists(st.integers(0, 2000), max_size=40).map(sorted)


@given(times, times, st.data())
def test_a_row_holds_the_newest_of_each_signal_at_its_time(poses, forces, data):
    joiner = SignalAligner(("force", "pos"))
    both = [(t, {"pos": place(t)}) for t in poses] + [(t, {"force": place(t)}) for t in forces]
    late = data.draw(st.integers(0, 3000))  # forces may come after poses of a later time
    arrived = sorted(both, key=lambda one: one[0] + (late if "force" in one[1] else 0))
    rows = [row for t, values in arrived for row in joiner.push(t * MS, values)]
    rows += joiner.flush()
    newest = [(t, max((force for force in forces if force <= t), default=-(10**6))) for t in poses]
    expected = [(t, force) for t, force in newest if t - force <= MAX_AGE_S * 1000]
    assert [(row[1], row[4]) for row in rows] == [(float(t), float(force)) for t, force in expected]
    assert joiner.skipped == len(poses) - len(expected)


def test_time_counts_from_the_first_row():
    joiner = SignalAligner(("pos",))
    stamps = [1_773_480_413_000_000_000, 1_773_480_413_001_000_000]
    rows = [row for stamp in stamps for row in joiner.push(stamp, {"pos": (1.0, 2.0, 3.0)})]
    assert rows == [[0.0, 1.0, 2.0, 3.0], [0.001, 1.0, 2.0, 3.0]]


def test_live_a_row_waits_no_longer_than_the_patience_for_a_signal_that_lags():
    joiner = SignalAligner(("pos", "force"), patience_s=0.1)
    joiner.push(0, {"force": place(0)})
    rows = [row for t in range(0, 205, 5) for row in joiner.push(t * MS, {"pos": place(t)})]
    assert [row[1] for row in rows] == [float(t) for t in range(0, 100, 5)]
    assert {row[4] for row in rows} == {0.0}


def test_live_a_gripper_is_not_waited_for_and_never_too_old():
    joiner = SignalAligner(("pos", "gripper"), patience_s=0.1)
    joiner.push(0, {"gripper": (0.08,)})
    rows = [row for t in range(0, 5000, 100) for row in joiner.push(t * MS, {"pos": place(t)})]
    assert len(rows) == 50
    assert {row[4] for row in rows} == {0.08}


def test_joints_lead_where_there_is_no_pose():
    joiner = SignalAligner(("q", "force"))
    assert joiner.leader == "q"
    assert joiner.columns[:3] == ("t", "q1", "q2")


def test_live_what_waits_for_a_pose_that_never_comes_is_bounded(monkeypatch):
    monkeypatch.setattr(signal_aligner, "HELD", 10)
    live, offline = (
        SignalAligner(("pos", "force"), patience_s=0.1),
        SignalAligner(("pos", "force"), patience_s=FOREVER),
    )
    for t in range(100):
        for joiner in (live, offline):
            joiner.push(t * MS, {"force": place(t)})
    assert len(live._others["force"]) == 10
    assert len(offline._others["force"]) == 100
    (row,) = [*live.push(99 * MS, {"pos": place(99)}), *live.flush()]
    assert np.allclose(row, [0.0, 99, 0, 0, 99, 0, 0])
