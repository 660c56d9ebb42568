"""Edits of a session, and a registry with the real pipeline that they are made in."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

from caesura_protocol.codec import pack_samples
from caesura_protocol.errors import ProtocolError
from caesura_protocol.formats.read import load_recording
from caesura_protocol.messages import (
    Ack,
    Edit,
    Insert,
    SampleBatch,
)
from caesura_service.journal import MemoryJournal
from caesura_service.offline_segmentation import batches as batches_of
from caesura_service.offline_segmentation import opening_of
from caesura_service.ownership.registry import Registry
from caesura_service.publishing.events import Output
from caesura_service.publishing.session_state import SessionState, program_of
from caesura_service.segmentation.pipeline import make_pipeline
from caesura_service.sessions.limits import Limits
from caesura_service.sessions.session import Session
from harness.sessions import (
    NAME,
    OWNER,
    STATION,
    answer,
    batches,
    unowned,
)

T = 1.235  # [s] where the fake has no jump of its own


def edit(revision: int = 0, action: Any = None, *, author: str = "Ann") -> Edit:
    return Edit(session=NAME, revision=revision, author=author, action=action or Insert(t=T))


def run(session: Session, count: int, first: int = 0) -> None:
    for made in batches(count)[first:]:
        session.receive(made, 0.0)


def acknowledged(said: list[Output]) -> Ack:
    """The acknowledgement, without the effect."""
    replied = answer(said)
    assert isinstance(replied, Ack)
    return replied.model_copy(update={"effect": None})


def refused(replied: Ack | ProtocolError) -> ProtocolError:
    assert isinstance(replied, ProtocolError)
    return replied


class RealSession:
    """A registry with the real pipeline, on the first seconds of a recording."""

    recording = load_recording(Path(__file__).parents[3] / "data" / "pick_and_place.npz")
    opening = opening_of(recording, "default").model_copy(update={"session": NAME})
    count = 300

    def __init__(self, journal: MemoryJournal) -> None:
        self.registry = Registry(
            owner=OWNER,
            pipeline_factory=make_pipeline,
            default_preset="default",
            journal=journal,
            limits=Limits(),
        )

    def open(self) -> None:
        self.registry.handle_command(STATION, self.opening, 0.0)

    def feed(self, first: int, stop: int) -> None:
        for batch in self.sent()[first:stop]:
            self.registry.handle_samples(STATION, batch, 0.01 * batch.seq)

    @classmethod
    @cache
    def sent(cls) -> list[SampleBatch]:
        """The batches of the recording."""
        return [
            pack_samples(samples, cls.opening.columns, session=NAME, epoch=0, seq=seq)
            for seq, samples in enumerate(batches_of(cls.recording))
        ]

    def edit(self, action: Any, at: float = 0.0) -> Ack | ProtocolError:
        made = edit(self.standing.revision, action).model_copy(update={"with_effect": True})
        return answer(self.registry.handle_command(STATION, made, at))

    @property
    def standing(self) -> SessionState:
        return self.registry.index.all_states()[0]


def compared(standing: SessionState) -> tuple[object, ...]:
    program = program_of(unowned(standing))
    return standing.view, program, standing.lifecycle, standing.revision, standing.undoable, standing.redoable


def stepped(registry: Registry) -> list[Output]:
    """Rebuild sessions to the end, and return what is said."""
    said = []
    while registry.rebuilding:
        for station in registry.rebuilding:
            said += registry.rebuild_step(station)
    return said
