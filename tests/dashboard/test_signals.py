"""Samples at any rate become few rows, each once, and the ring keeps the newest."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from caesura_clients.dashboard.signals import CAPACITY, RATE_HZ, CellMeans, Decimator, SignalRing, drawn

COLUMNS = ("t", "px", "py", "pz", "fx", "fy", "fz")


def moving(seconds: float, rate_hz: float = 1000.0, t0: float = 0.0) -> np.ndarray:
    """0.2 m/s along x, 3 N along z."""
    t = t0 + np.arange(round(seconds * rate_hz)) / rate_hz
    zero = np.zeros_like(t)
    return np.column_stack([t, 0.2 * t, zero, zero, zero, zero, zero + 3.0])


@pytest.mark.parametrize("cut", [1, 7, 20, 999])
def test_rows_do_not_depend_on_how_samples_are_cut(cut):
    whole, matrix = Decimator(), moving(2.0)
    expected = whole.receive(COLUMNS, matrix)
    cutting = Decimator()
    found = [row for i in range(0, len(matrix), cut) for row in cutting.receive(COLUMNS, matrix[i : i + cut])]
    assert len(found) == len(expected) == 2.0 * RATE_HZ - 1  # the last cell may still get samples
    for one, other in zip(found, expected, strict=True):
        assert one.t == other.t
        assert one.position == pytest.approx(other.position)


def test_while_time_stands_still_samples_take_no_memory():
    decimator, still = Decimator(), np.column_stack([np.zeros(1000), np.ones((1000, 6))])
    decimator.receive(COLUMNS, still)
    tracemalloc.start()
    for value in range(100):
        decimator.receive(COLUMNS, np.column_stack([np.zeros(1000), np.full((1000, 6), float(value % 2))]))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 500_000
    (row,) = decimator.receive(COLUMNS, moving(0.01, t0=1.0))
    assert row.position == pytest.approx((51 / 101,) * 3)


@pytest.mark.parametrize("t0", [1e308, -1e308, 1e300, 1e18])
def test_a_time_that_is_none_is_left_out(t0):
    decimator = Decimator()
    assert decimator.receive(COLUMNS, moving(1.0, t0=t0)) == []
    assert len(decimator.receive(COLUMNS, moving(1.0))) == RATE_HZ - 1


def test_a_row_is_the_mean_of_its_cell():
    rows = Decimator().receive(COLUMNS, moving(1.0))
    assert rows[5].t == pytest.approx(5.5 / RATE_HZ)
    assert rows[5].position == pytest.approx((0.2 * (rows[5].t - 0.0005), 0.0, 0.0))
    assert rows[5].force == pytest.approx((0.0, 0.0, 3.0))
    assert rows[0].speed is None
    assert rows[5].speed == pytest.approx(0.2)


def test_what_comes_late_or_twice_makes_no_second_row():
    decimator, matrix = Decimator(), moving(1.0)
    first = decimator.receive(COLUMNS, matrix)
    again = decimator.receive(COLUMNS, matrix)
    assert first
    assert again == []


def test_there_is_no_speed_across_a_hole():
    decimator = Decimator()
    decimator.receive(COLUMNS, moving(0.5))
    rows = decimator.receive(COLUMNS, moving(0.5, t0=3.0))
    assert [row.speed is None for row in rows if row.t > 2.0][:2] == [True, False]


def test_joints_alone_give_a_speed_and_no_position():
    t = np.arange(200) / 1000.0
    columns = ("t", *(f"q{i}" for i in range(1, 8)))
    matrix = np.column_stack([t, 0.5 * t, *np.zeros((6, t.size))])
    rows = Decimator().receive(columns, matrix)
    assert rows[2].position is None
    assert rows[2].force is None
    assert rows[2].speed == pytest.approx(0.5)


def test_a_ring_gives_what_somebody_has_not_seen():
    ring = SignalRing()
    ring.receive("s1", COLUMNS, moving(1.0))
    first = ring.after()
    ring.receive("s1", COLUMNS, moving(1.0, t0=1.0))
    second = ring.after(first.next)
    assert first.session == second.session == "s1"
    assert [row.t for row in (*first.rows, *second.rows)] == [row.t for row in ring.after().rows]
    assert ring.after(second.next).rows == ()


def test_a_ring_holds_a_minute_and_says_how_many_there_were():
    ring = SignalRing()
    for t0 in range(80):
        ring.receive("s1", COLUMNS, moving(1.0, rate_hz=100.0, t0=float(t0)))
    held = ring.after()
    assert len(held.rows) == CAPACITY
    assert held.next == 80 * RATE_HZ - 1
    assert held.rows[-1].t > 79.9


def test_who_has_seen_another_session_gets_all_of_this_one():
    ring = SignalRing()
    ring.receive("s1", COLUMNS, moving(2.0))
    seen = ring.after().next
    ring.receive("s2", COLUMNS, moving(1.0))
    assert ring.after(seen, "s1").rows == ring.after().rows != ()


def test_another_session_begins_anew():
    ring = SignalRing()
    ring.receive("s1", COLUMNS, moving(1.0, t0=50.0))
    ring.receive("s2", COLUMNS, moving(1.0))
    held = ring.after()
    assert held.session == "s2"
    assert held.rows[0].t < 0.1


def test_a_row_is_drawn_in_metres():
    row = CellMeans(1.0, (300.0, 0.0, 250.0), 120.0, (0.0, 1.0, 2.0))
    assert drawn(row, 0.001) == [1.0, 0.3, 0.0, 0.25, 0.12, 0.0, 1.0, 2.0]
    assert drawn(CellMeans(1.0, None, 0.4, None), 0.001) == [1.0, None, None, None, 0.4, None, None, None]
