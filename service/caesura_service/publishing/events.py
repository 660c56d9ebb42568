"""Inputs of a session other than wire messages, and its outputs. Immutable values."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import (
    Ack,
    Changepoints,
    Close,
    Describe,
    Edit,
    EditProgram,
    Heartbeat,
    Hints,
    Open,
    Posterior,
    Preview,
    Program,
    SampleBatch,
    Segments,
    SessionStatus,
)
from caesura_service.segmentation.pipeline_interface import Pipeline

#: Builds the pipeline of a session from its opening and the service's default preset. Raises ProtocolError.
PipelineFactory = Callable[[Open, str], Pipeline]


@dataclass(frozen=True)
class Owner:
    """The instance and epoch that every result carries; readers keep the highest epoch."""

    instance: str
    epoch: int


@dataclass(frozen=True)
class ReplayEnded:
    """The bridge's answer to a RequestReplay is complete, or was not received."""

    session: str
    first: int  # the batch that was asked for
    answered: bool  # at least one batch came and none was dropped on the way
    evicted: bool = False  # the bridge said so
    oldest: int | None = None  # the oldest batch that it still has, where it said so


Incoming = Open | SampleBatch | Heartbeat | Close | Edit | Preview | Describe | EditProgram | ReplayEnded


@dataclass(frozen=True)
class Publish:
    """A result for all subscribers."""

    message: Changepoints | Segments | Posterior | Hints | SessionStatus | Program


@dataclass(frozen=True)
class RequestReplay:
    """Request of missing batches, `first` to `last`, both included."""

    station: str
    session: str
    first: int
    last: int


@dataclass(frozen=True)
class Reply:
    """The reply to a command; one for each."""

    reply: Ack | ProtocolError


@dataclass(frozen=True)
class BatchRejected:
    """A message was refused and counted; its sender gets no reply."""

    error: ProtocolError


@dataclass(frozen=True)
class SessionFailed:
    """The session ended by an internal error. It is only logged."""

    station: str
    session: str
    error: Exception


@dataclass(frozen=True)
class SessionDeleted:
    """The journal no longer has a session: it cannot be queried. It is only logged."""

    station: str
    session: str
    reason: str


@dataclass(frozen=True)
class TakeoverFailed:
    """A session was not taken over, or not with all its records. It is only logged."""

    station: str
    session: str
    error: Exception


@dataclass(frozen=True)
class StationTakenOver:
    """The own instance has taken over the station. It is only logged."""

    station: str
    epoch: int
    sessions: int
    open: int


Output = (
    Publish
    | RequestReplay
    | Reply
    | BatchRejected
    | SessionFailed
    | SessionDeleted
    | TakeoverFailed
    | StationTakenOver
)
