"""Marks are made beside the robot's loop, and hold nobody up at the end."""

from __future__ import annotations

import threading

import pytest

from caesura_clients.bridge import marker_queue
from caesura_clients.bridge.marker_queue import CAPACITY, MarkerQueue
from caesura_protocol.errors import CaesuraError


def test_marks_are_made_in_order_and_those_that_wait_in_the_end_too():
    made: list[float] = []
    with MarkerQueue(made.append, "cell-1") as making:
        for t in (1.0, 2.0, 3.0):
            making.put(t)
    assert (made, making.made, making.failed) == ([1.0, 2.0, 3.0], 3, [])


@pytest.mark.parametrize("count", [3, CAPACITY + 1])
def test_marks_that_are_not_taken_do_not_hold_up_the_end(monkeypatch: pytest.MonkeyPatch, count: int):
    monkeypatch.setattr(marker_queue, "LAST_S", 0.05)
    asked, answered = threading.Event(), threading.Event()

    def make(t: float) -> None:
        asked.set()
        answered.wait(10.0)

    with MarkerQueue(make, "cell-1") as making:
        making.put(0.0)
        assert asked.wait(10.0)
        for t in range(1, count):
            making.put(float(t))
    assert making.failed == [
        f"mark at {t:.2f} s: no service accepted it within 0.05 s of the end" for t in range(1, count)
    ]
    answered.set()


def test_ending_the_demonstration_does_not_wait_for_marks():
    answered = threading.Event()

    def make(t: float) -> None:
        answered.wait(10.0)
        raise CaesuraError("no such session")

    def teach(making: MarkerQueue) -> None:
        for t in (1.0, 2.0):
            making.put(t)
        answered.set()
        raise KeyboardInterrupt

    making = MarkerQueue(make, "cell-1")
    with pytest.raises(KeyboardInterrupt), making:
        teach(making)
    assert len(making.failed) == 2
