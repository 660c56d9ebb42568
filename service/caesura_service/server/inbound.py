"""What the network hands to the worker. Made in the network's threads, which do nothing else."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Literal, NamedTuple, Self

import zenoh

from caesura_protocol.codec import decode_error
from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import parse_station_key, station_key
from caesura_protocol.messages import MAX_MESSAGE_BYTES
from caesura_service.publishing.events import ReplayEnded, RequestReplay
from caesura_service.server.rates import SENDERS

UNKNOWN = "?"  # the station of keys that name none
OCTETS = "application/octet-stream"
MAX_TEXT = 500  # characters of a key or an encoding; those of Caesura are shorter


class RawPayload(NamedTuple):
    """A payload as it came; empty if it was over the size limit, which `size` shows. Its texts are cut."""

    key: str
    payload: bytes
    encoding: str
    size: int

    @classmethod
    def of(cls, key: str, payload: zenoh.ZBytes | None, encoding: str) -> Self:
        """What came on a key; nothing reads as an empty payload."""
        size = 0 if payload is None else len(payload)
        kept = payload is not None and size <= MAX_MESSAGE_BYTES
        whole = payload.to_bytes() if payload is not None and kept else b""
        return cls(key[:MAX_TEXT], whole, encoding[:MAX_TEXT], size)

    def check_size(self) -> None:
        """Raises ProtocolError `too_large`."""
        if self.size > MAX_MESSAGE_BYTES:
            raise ProtocolError(
                "too_large", "message over the size limit", value=self.size, limit=MAX_MESSAGE_BYTES
            )


class SamplesReceived(NamedTuple):
    """Something was put on a station's `samples` key, or came in answer to a question for such."""

    content: RawPayload
    station: str | None  # None: the key names none


@dataclass(frozen=True, slots=True)
class CommandReceived:
    """A query on a station's `control` key. The worker answers it."""

    content: RawPayload
    query: zenoh.Query


@dataclass(slots=True)
class PendingReplay:
    """A replay that was asked for, and what has come of it so far."""

    ask: RequestReplay
    replies: int = 0
    dropped: int = 0  # replies for which there was no room
    refusal: RawPayload | None = field(default=None)
    _over: threading.Lock = field(default_factory=threading.Lock)  # held from its end on

    def ends(self) -> bool:
        """End it. False where it has ended before; any thread may ask."""
        return self._over.acquire(blocking=False)

    def ended(self) -> ReplayEnded:
        """What it comes to. An answer that is no refusal of the protocol, like a timeout, counts as none."""
        error = self._error()
        known = error is not None and error.code in {"evicted", "unknown_session"}
        oldest = error.limit if error and known and isinstance(error.limit, int) else None
        return ReplayEnded(
            session=self.ask.session,
            first=self.ask.first,
            answered=self.replies > 0 and not self.dropped,
            evicted=known,
            oldest=oldest,
        )

    def _error(self) -> ProtocolError | None:
        if self.refusal is None:
            return None
        try:
            return decode_error(self.refusal.payload, self.refusal.encoding)
        except ProtocolError:
            return None


@dataclass(frozen=True, slots=True)
class ReplayFinished:
    """A replay is complete, or was not answered."""

    asked: PendingReplay


@dataclass(frozen=True, slots=True)
class LivelinessChanged:
    """A token came, was there, or is gone."""

    kind: Literal["service", "station"]
    name: str
    alive: bool


@dataclass(frozen=True, slots=True)
class RouterLinkChanged:
    """Our own link to the router was lost, or is back."""

    up: bool


@dataclass(frozen=True, slots=True)
class Watching:
    """From here on tokens that come and go are reported."""


@dataclass(frozen=True, slots=True)
class Unfinished:
    """Work whose slice was over: on what a station sent, or of our own. lane: whose turn it takes."""

    lane: str


Arrival = (
    SamplesReceived
    | CommandReceived
    | ReplayFinished
    | LivelinessChanged
    | RouterLinkChanged
    | Watching
    | Unfinished
)


def sources_of(station: str) -> tuple[str, str]:
    """Return a station's sources in the queue: its key for live samples, its name for replayed ones."""
    return station_key(station, "samples"), station


class SourceId(NamedTuple):
    """The source of a message on a station's key. All keys that name no station are one source."""

    source: str
    station: str | None


@lru_cache(SENDERS)
def sender_of(key: str) -> SourceId:
    """Who puts on a key.

    >>> sender_of("caesura/v1/station/cell-1/samples")
    Sender(source='caesura/v1/station/cell-1/samples', station='cell-1')
    >>> sender_of("caesura/v1/station/../samples")
    Sender(source='?', station=None)
    """
    try:
        return SourceId(key, parse_station_key(key)[0])
    except ProtocolError:
        return SourceId(UNKNOWN, None)


def station_of(source: str) -> str:
    """The station of a source, be it a valid name or not.

    >>> [station_of(source) for source in sources_of("cell-1")]
    ['cell-1', 'cell-1']
    """
    return source.split("/")[-2] if "/" in source else source  # of any key, valid or not: no parsing


def content_of(message: zenoh.Sample) -> RawPayload:
    """What was put or replied."""
    return RawPayload.of(str(message.key_expr), message.payload, str(message.encoding))


def content_of_query(query: zenoh.Query) -> RawPayload:
    """What came with a query."""
    return RawPayload.of(str(query.key_expr), query.payload, str(query.encoding or OCTETS))


def content_of_error(error: zenoh.ReplyError) -> RawPayload:
    """What a query was refused with."""
    return RawPayload.of("", error.payload, str(error.encoding))
