"""Made-up demonstrations and a bridge's ring, as plain values."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.codec import pack_samples
from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import Ack, Close, Heartbeat, Open, SampleBatch
from caesura_service.journal import Journal, MemoryJournal, PeerJournals
from caesura_service.ownership.registry import Registry
from caesura_service.publishing.events import Output, Owner, Publish, ReplayEnded, Reply, RequestReplay
from caesura_service.publishing.session_state import SessionState
from caesura_service.sessions.limits import Limits
from caesura_service.sessions.session import Session
from harness.fake_pipeline import make_fake_pipeline

STATION = "cell-1"
NAME = "s1"
COLUMNS = ("t", "px")
OWNER = Owner("test-1", 1)
BATCH = 20
RATE_HZ = 100.0
M = TypeVar("M")


def opening(session: str = NAME, **fields: Any) -> Open:
    stated = {"session": session, "columns": COLUMNS, "preset": "fake", "wrench_source": "flange_sensor"}
    return Open(**(stated | fields))


def demonstration(samples: int = 400, level_length: int = 90, *, first: int = 0) -> NDArray[np.float64]:
    """(n, 2) at RATE_HZ whose value steps up after every `level_length` samples, behind the `first` ones."""
    index = np.arange(first, samples)
    return np.column_stack([index / RATE_HZ, (index // level_length).astype(float)])


def batch(seq: int, session: str = NAME, *, epoch: int = 0, **fields: Any) -> SampleBatch:
    """Batch `seq` of the demonstration; fields override."""
    rows = demonstration((seq + 1) * BATCH, first=seq * BATCH)
    made = pack_samples(rows, COLUMNS, session=session, epoch=epoch, seq=seq)
    return made.model_copy(update=fields)


def batch_of(rows: list[list[float]], seq: int, columns: tuple[str, ...] = COLUMNS) -> SampleBatch:
    return pack_samples(np.array(rows), columns, session=NAME, epoch=0, seq=seq)


def batches(count: int, session: str = NAME) -> list[SampleBatch]:
    return [batch(seq, session) for seq in range(count)]


def heartbeat(seq: int, session: str = NAME, epoch: int = 0) -> Heartbeat:
    return Heartbeat(session=session, epoch=epoch, seq=seq)


def closing(last_seq: int, session: str = NAME) -> Close:
    return Close(session=session, last_seq=last_seq)


def open_session(
    journal: Journal | None = None, limits: Limits | None = None, **fields: Any
) -> tuple[Session, list[Output]]:
    """A session with the fake pipeline, and its first words."""
    command = opening(**fields)
    session = Session(
        STATION,
        command,
        make_fake_pipeline(command, "fake"),
        owner=OWNER,
        journal=journal or MemoryJournal(),
        limits=limits or Limits(),
    )
    return session, session.begin(0.0)


def new_registry(
    journal: Journal | None = None, limits: Limits | None = None, peers: PeerJournals | None = None
) -> Registry:
    return Registry(
        owner=OWNER,
        pipeline_factory=make_fake_pipeline,
        default_preset="fake",
        journal=journal if journal is not None else MemoryJournal(),
        limits=limits or Limits(),
        peers=peers,
    )


def unowned(standing: SessionState) -> SessionState:
    """Whoever speaks, and under whatever epoch."""
    heading = standing.program_header.model_copy(update={"instance": OWNER.instance, "epoch": OWNER.epoch})
    return standing._replace(owner=OWNER, program_header=heading)


def published(outputs: Iterable[Output], kind: type[M]) -> list[M]:
    return [out.message for out in outputs if isinstance(out, Publish) and isinstance(out.message, kind)]


def asked(outputs: Iterable[Output]) -> list[tuple[int, int]]:
    return [(out.first, out.last) for out in outputs if isinstance(out, RequestReplay)]


def answer(outputs: Iterable[Output]) -> Ack | ProtocolError:
    (only,) = [out.reply for out in outputs if isinstance(out, Reply)]
    return only


@dataclass
class Ring:
    """A bridge that answers every question at once, with what it still has."""

    batches: list[SampleBatch]
    oldest: int = 0
    spoken: list[Output] = field(default_factory=list)

    def feed(self, session: Session, message: Any, now: float) -> list[Output]:
        """Deliver a message and answer every question that follows from it."""
        waiting = session.receive(message, now)
        said = list(waiting)
        while waiting:
            output = waiting.pop(0)
            if isinstance(output, RequestReplay):
                more = [out for reply in self.answer(output) for out in session.receive(reply, now)]
                waiting += more
                said += more
        return said

    def answer(self, ask: RequestReplay) -> Iterator[SampleBatch | ReplayEnded]:
        if ask.first < self.oldest:
            yield ReplayEnded(ask.session, ask.first, answered=False, evicted=True, oldest=self.oldest)
            return
        sent = self.batches[ask.first : ask.last + 1]
        yield from sent
        yield ReplayEnded(ask.session, ask.first, answered=bool(sent))
