"""A name of a phase, in the journal and in the groups of a program of which a part is taught again."""

from __future__ import annotations

from pathlib import Path

import pytest

from caesura_protocol.codec import pack_samples
from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import (
    Ack,
    AppReference,
    Close,
    Command,
    Edit,
    EditProgram,
    NamePhase,
    ReplacePart,
    Snapshot,
)
from caesura_protocol.programs.document import document
from caesura_service.journal import JournalSettings, SqliteJournal
from caesura_service.ownership.registry import Registry
from caesura_service.publishing.session_state import snapshot_of
from caesura_service.segmentation.pipeline import make_pipeline
from caesura_service.sessions.limits import Limits
from harness.sessions import OWNER, STATION, answer
from service.segmentation.corrected import taught

BEGAN = 1_700_000_000.0


def registry_on(journal: SqliteJournal) -> Registry:
    registry = Registry(
        owner=OWNER,
        pipeline_factory=make_pipeline,
        default_preset="default",
        journal=journal,
        limits=Limits(),
    )
    assert registry.restore() == []
    return registry


def teach(registry: Registry, session: str, *, close: bool) -> None:
    """Wipe, as in the recording of that name."""
    opening, blocks = taught("wiping")
    opening = opening.model_copy(update={"session": session})
    asked(registry, opening)
    for seq, rows in enumerate(blocks):
        batch = pack_samples(rows, opening.columns, session=session, epoch=0, seq=seq)
        registry.handle_samples(STATION, batch, BEGAN)
    if close:
        asked(registry, Close(session=session, last_seq=len(blocks) - 1))


def asked(registry: Registry, command: Command) -> None:
    while isinstance(reply := answer(registry.handle_command(STATION, command, BEGAN)), ProtocolError):
        assert reply.code == "overloaded", reply
        registry.rebuild_step(STATION)
    assert isinstance(reply, Ack)


def snapshot(registry: Registry) -> Snapshot:
    (state,) = [one for one in registry.index.all_states() if one.session == "s1"]
    return snapshot_of(state)


def groups(registry: Registry) -> list[str]:
    shown = snapshot(registry)
    return [one.name for one in document(shown.program, phases=shown.segments.phases).groups]


@pytest.mark.slow
@pytest.mark.parametrize("is_closed", [False, True])
def test_a_phase_that_is_taught_again_keeps_its_name_also_after_a_replay(tmp_path: Path, is_closed: bool):
    with SqliteJournal(tmp_path / "a.sqlite", JournalSettings()) as journal:
        registry = registry_on(journal)
        teach(registry, "s1", close=is_closed)
        phases = snapshot(registry).segments.phases
        (wipe,) = [one for one in phases if one.kind == "contact"]
        name = NamePhase(t=wipe.t0 + 0.1, name="wipe the table")
        asked(registry, Edit(session="s1", revision=0, author="Ann", action=name))
        teach(registry, "s2", close=True)
        apps = [one for one in snapshot(registry).program.apps if wipe.t0 - 0.05 <= one.t0 < wipe.tn - 0.05]
        first, last = (AppReference(kind=one.kind, t0=one.t0, tn=one.tn) for one in (apps[0], apps[-1]))
        part = ReplacePart(first=first, last=last, session="s2")
        asked(registry, EditProgram(session="s1", revision=0, author="Ann", action=part))
        found = groups(registry)
        assert found == ["free 1", "wipe the table", "free 2"]
    with SqliteJournal(tmp_path / "a.sqlite", JournalSettings()) as journal:
        assert groups(registry_on(journal)) == found
