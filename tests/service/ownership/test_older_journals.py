"""A journal that an older release has written, and the sessions in it after an upgrade.

`journal/older/2026-11-24.sqlite.gz` is a copy of a journal of commit 6d551ae2. Its release recorded the first
five seconds of data/button.npz at 100 Hz, with positions and forces. cell-1/closed was closed and has two
corrections, an edit of the program and a description. cell-2/open was open when the service was killed.
"""

from __future__ import annotations

import gzip
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from caesura_protocol.codec import pack_samples
from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import Ack, EditProgram, Open, Undo
from caesura_service.journal import SqliteJournal
from caesura_service.ownership.registry import Registry
from caesura_service.publishing.session_state import SessionState, program_of, status_of
from caesura_service.segmentation.pipeline import make_pipeline
from caesura_service.sessions.limits import Limits
from harness.sessions import OWNER, answer
from service.sessions.edits import edit, stepped

FILE = Path(__file__).parents[1] / "journal" / "older" / "2026-11-24.sqlite.gz"


@pytest.fixture
def journal(tmp_path: Path) -> Iterator[SqliteJournal]:
    path = tmp_path / "caesura-1.sqlite"
    path.write_bytes(gzip.decompress(FILE.read_bytes()))
    with SqliteJournal(path) as opened:
        yield opened


@pytest.fixture
def registry(journal: SqliteJournal) -> Registry:
    registry = Registry(
        owner=OWNER,
        pipeline_factory=make_pipeline,
        default_preset="default",
        journal=journal,
        limits=Limits(),
    )
    assert registry.restore() == []
    return registry


def state(registry: Registry, session: str) -> SessionState:
    (found,) = (one for one in registry.index.all_states() if one.session == session)
    return found


def test_every_session_is_there_and_a_closed_one_has_the_results_that_the_older_release_acknowledged(
    registry,
):
    found = [(one.station, one.session, one.lifecycle) for one in registry.index.all_states()]
    assert sorted(found) == [("cell-1", "closed", "closed"), ("cell-2", "open", "open")]
    closed = state(registry, "closed")
    segments = [(round(one.t0, 2), round(one.tn, 2), one.kind) for one in closed.view.segments]
    assert segments == [
        (0.1, 0.98, "steady"),
        (0.98, 1.55, "motion"),
        (1.55, 2.25, "motion"),
        (2.25, 3.15, "contact"),
        (3.15, 3.89, "motion"),
        (3.89, 4.85, "motion"),
        (4.85, 4.9, "contact"),
    ]
    program = program_of(closed)
    assert [(one.action.do, one.author, one.state) for one in program.corrections] == [
        ("insert", "Ann", "applied"),
        ("relabel", "Ann", "applied"),
    ]
    assert [one.kind for one in program.apps] == [
        "cartesian_motion",
        "move_to_contact",
        "apply_force",
        "cartesian_motion",
        "cartesian_motion",
    ]
    assert (program.apps[0].name, [one.state for one in program.edits]) == ("Alpha", ["applied"])
    assert (closed.description.task, closed.description.tags, closed.description.note) == (
        "press",
        ("left",),
        "old",
    )


def test_its_corrections_and_edits_can_be_undone(registry):
    undo = edit(2, Undo()).model_copy(update={"session": "closed"})
    assert answer(registry.handle_command("cell-1", undo, 0.0)).code == "overloaded", "it is rebuilt first"
    assert stepped(registry) == []
    assert answer(registry.handle_command("cell-1", undo, 0.0)).revision == 3
    again = undo.model_copy(update={"revision": 3})
    assert answer(registry.handle_command("cell-1", again, 0.0)).revision == 4
    assert not any(one.corrected for one in state(registry, "closed").view.segments)
    command = EditProgram(session="closed", revision=1, author="Bo", action=Undo())
    assert isinstance(answer(registry.handle_command("cell-1", command, 0.0)), Ack)
    assert all(one.name is None for one in program_of(state(registry, "closed")).apps)


def test_an_open_session_goes_on_with_a_bridge_of_this_release(registry, journal):
    first = next(iter(journal.replay("cell-2", "open"))).message
    assert isinstance(first, Open)
    assert not first.assumed, "the older release recorded none"
    reopening = first.model_copy(update={"epoch": 1, "bridge": None, "assumed": ("force_frame",)})
    ack = answer(registry.handle_command("cell-2", reopening, 0.0))
    assert not isinstance(ack, ProtocolError), ack
    before = status_of(state(registry, "open")).samples
    t = state(registry, "open").view.t + 0.1 + 0.01 * np.arange(20)
    samples = np.zeros((20, len(first.columns)))
    samples[:, first.columns.index("t")] = t
    batch = pack_samples(samples, first.columns, session="open", epoch=1, seq=ack.next_seq)
    registry.handle_samples("cell-2", batch, 0.0)
    after = status_of(state(registry, "open"))
    assert (after.samples, after.refused) == (before + 20, {})
