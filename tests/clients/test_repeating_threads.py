"""A work that fails is repeated; the others go on, and all end with the context."""

from __future__ import annotations

import threading

from caesura_clients import repeating_threads
from caesura_clients.repeating_threads import RepeatingThreads

DEADLINE_S = 10.0


def test_a_work_is_repeated_after_an_error_which_is_reported_with_its_name(monkeypatch):
    monkeypatch.setattr(repeating_threads, "RETRY_S", 0.0)
    errors, attempts, repeated = [], [], threading.Event()

    def fail() -> None:
        attempts.append(len(attempts))
        if len(attempts) > 2:
            repeated.set()
            threads._over.wait(DEADLINE_S)
        elif attempts[-1]:
            raise OSError("the network is gone")
        else:
            raise KeyError

    works = {"one": fail, "other": lambda: threads._over.wait(DEADLINE_S)}
    threads = RepeatingThreads(works, lambda *error: errors.append(error))
    with threads:
        assert repeated.wait(DEADLINE_S)
        assert [thread.name for thread in threads._threads if thread.is_alive()] == ["one", "other"]
    assert errors == [("one", "KeyError"), ("one", "the network is gone")]
    assert not any(thread.is_alive() for thread in threads._threads)
