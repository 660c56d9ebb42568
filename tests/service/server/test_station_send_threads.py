"""Answers are sent beside the worker, also by a process that lacks memory for another thread."""

from __future__ import annotations

import threading

import pytest

from caesura_service.server.station_send_threads import StationSendThreads

DEADLINE_S = 10.0


def refuse(_thread: threading.Thread) -> None:
    """As `Thread.start` raises where the system gives none."""
    raise RuntimeError("can't start new thread")


def test_answers_are_sent_while_no_further_thread_can_be_started(monkeypatch):
    answered = [threading.Event() for _ in range(3)]
    with StationSendThreads() as lanes:
        monkeypatch.setattr(threading.Thread, "start", refuse)
        for number, event in enumerate(answered):
            assert lanes.submit(f"cell-{number}", event.set)
        assert all(event.wait(DEADLINE_S) for event in answered)


@pytest.mark.parametrize("again", ["cell-1", "cell-2"])
def test_a_station_whose_thread_could_not_be_started_is_answered_once_one_can(monkeypatch, again):
    blocked, first, second = threading.Event(), threading.Event(), threading.Event()
    with StationSendThreads() as lanes:
        try:
            assert lanes.submit("slow", lambda: blocked.wait(DEADLINE_S) and None)
            with monkeypatch.context() as without_memory:
                without_memory.setattr(threading.Thread, "start", refuse)
                assert lanes.submit("cell-1", first.set)
            assert lanes.submit(again, second.set)
            assert first.wait(DEADLINE_S)
            assert second.wait(DEADLINE_S)
        finally:
            blocked.set()
