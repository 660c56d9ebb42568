"""Whatever is appended, committed and lost to crashes: what is there equals the fold over what was committed,
and with what the bridge still has the session ends like one that nothing ever happened to.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from caesura_service.journal import JournalSettings, MemoryJournal, SqliteJournal
from caesura_service.ownership.registry import Registry
from caesura_service.publishing.session_state import SessionState, snapshot_of
from harness.sessions import NAME, STATION, Ring, batches, closing, new_registry, opening, unowned

COUNT = 16
BATCHES = batches(COUNT)
NEVER = JournalSettings(commit_s=3600.0)

# A number: the bridge puts that batch, in time or out of turn. A word: what happens to the service.
steps = st.lists(
    st.one_of(st.integers(0, COUNT - 1), st.sampled_from(["commit", "crash", "restart"])), max_size=40
)


class Crashing:
    """A registry on a journal that can be killed, beside the records that are known to be safe."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.journal = SqliteJournal(path, NEVER).__enter__()
        self.registry = new_registry(self.journal)
        self.registry.handle_command(STATION, opening(), 0.0)
        self.safe = list(self.journal.replay(STATION, NAME))

    def commit(self) -> None:
        self.journal.commit()
        self.safe = list(self.journal.replay(STATION, NAME))

    def crash(self) -> None:
        self.journal._waiting.clear()  # which is all that a process takes with it
        self.journal._waiting_bytes = 0
        self.restart()

    def restart(self) -> None:
        self.journal.__exit__(None, None, None)
        self.journal = SqliteJournal(self.path, NEVER).__enter__()
        self.registry = new_registry(self.journal)
        assert self.registry.restore() == []


def of(registry: Registry) -> tuple[object, ...]:
    (standing,) = registry.index.all_states()
    return reported(standing), registry.index.sessions[STATION][0].next_seq


def reported(standing: SessionState) -> tuple[object, ...]:
    snapshot = snapshot_of(unowned(standing))
    return snapshot.segments, snapshot.changepoints, snapshot.posterior, snapshot.program, standing.view


def fold(records: list) -> Registry:
    journal = MemoryJournal()
    for record in records:
        journal.append(record)
    registry = new_registry(journal)
    registry.restore()
    return registry


def undisturbed() -> tuple[object, ...]:
    registry = new_registry()
    registry.handle_command(STATION, opening(), 0.0)
    for each in BATCHES:
        registry.handle_samples(STATION, each, 0.0)
    registry.handle_command(STATION, closing(COUNT - 1), 0.0)
    return of(registry)


EXPECTED = undisturbed()


@pytest.mark.slow
@settings(deadline=None, max_examples=40)
@given(steps)
def test_a_crash_leaves_the_fold_over_what_was_committed_and_the_ring_restores_the_rest(taken):
    with tempfile.TemporaryDirectory() as directory:
        service = Crashing(Path(directory) / "j.sqlite")
        try:
            for step in taken:
                match step:
                    case int():
                        service.registry.handle_samples(STATION, BATCHES[step], 0.0)
                    case "commit" | "restart":
                        service.commit()
                        if step == "restart":
                            service.restart()
                    case "crash":
                        service.crash()
                        assert of(service.registry) == of(fold(service.safe))
            session = service.registry.index.sessions[STATION][0]
            Ring(BATCHES).feed(session, closing(COUNT - 1), 1000.0)
            Ring(BATCHES).feed(session, closing(COUNT - 1), 2000.0)
            assert of(service.registry) == EXPECTED
            service.crash()
            assert of(service.registry) == EXPECTED
        finally:
            service.journal.__exit__(None, None, None)
