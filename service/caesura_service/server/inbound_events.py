"""The events that the network's threads enqueue for the worker."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Literal, NamedTuple, Self

from caesura_protocol.codec import Encoded, decode_error
from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import ROOT, is_name, parse_station_key, station_key
from caesura_protocol.messages import MAX_MESSAGE_BYTES
from caesura_protocol.token_bucket import SENDERS
from caesura_protocol.transport.inbox import IncomingQuery
from caesura_service.publishing.events import ReplayEnded, RequestReplay
from caesura_service.server.network_interface import Payload
from caesura_service.sessions.same_layout_batches import BatchBlock

UNKNOWN = "?"  # the station of keys that name none
NETWORK = ""  # the lane of what no station causes: other instances, the own link
STATUS = "/status"  # the lane of queries for the status of services; no station's name
OCTETS = "application/octet-stream"
MAX_TEXT = 500  # characters of a key or an encoding; those of Caesura are shorter


class RawPayload(NamedTuple):
    """A received payload; empty if over the size limit, with its real `size` [bytes].

    Its key and encoding are cut to a greatest length.
    """

    key: str
    payload: bytes
    encoding: str
    size: int

    @classmethod
    def of(cls, key: str, payload: Payload, encoding: str) -> Self:
        """Copy a payload that was received on a key."""
        size = len(payload)
        whole = bytes(payload) if size <= MAX_MESSAGE_BYTES else b""
        return cls(key[:MAX_TEXT], whole, encoding[:MAX_TEXT], size)

    def check_size(self) -> None:
        """Check the size limit. Raises ProtocolError `too_large`."""
        if self.size > MAX_MESSAGE_BYTES:
            raise ProtocolError(
                "too_large", "message over the size limit", value=self.size, limit=MAX_MESSAGE_BYTES
            )


class SamplesReceived(NamedTuple):
    """A message on a station's `samples` key, or in a reply to a replay."""

    content: RawPayload
    station: str | None  # None: the key names none


class BatchesReceived(NamedTuple):
    """Consecutive batches on a station's `samples` key."""

    block: BatchBlock
    key: str
    station: str


@dataclass(frozen=True, slots=True)
class CommandReceived:
    """A query on a station's `control` key. The worker answers it."""

    content: RawPayload
    query: IncomingQuery


@dataclass(slots=True)
class PendingReplay:
    """A requested replay with its replies so far."""

    request: RequestReplay
    replies: int = 0
    dropped: int = 0  # replies for which there was no room
    refusal: Encoded | None = None
    _over: threading.Lock = field(default_factory=threading.Lock)  # held from its end on

    def end(self) -> bool:
        """End the replay; return False if it has ended before. Any thread may call it."""
        return self._over.acquire(blocking=False)

    def result(self) -> ReplayEnded:
        """Return the end of the replay.

        An error outside the protocol, like a timeout, counts as no answer.
        """
        error = self._error()
        known = error is not None and error.code in {"evicted", "unknown_session"}
        oldest = error.limit if error and known and isinstance(error.limit, int) else None
        return ReplayEnded(
            session=self.request.session,
            first=self.request.first,
            answered=self.replies > 0 and not self.dropped,
            evicted=known,
            oldest=oldest,
        )

    def _error(self) -> ProtocolError | None:
        if self.refusal is None:
            return None
        try:
            return decode_error(*self.refusal)
        except ProtocolError:
            return None


@dataclass(frozen=True, slots=True)
class ReplayFinished:
    """A replay is complete, or was not answered in time."""

    replay: PendingReplay


@dataclass(frozen=True, slots=True)
class LivelinessChanged:
    """A liveliness token was declared, existed already, or was removed."""

    kind: Literal["service", "station"]
    name: str
    alive: bool

    @property
    def lane(self) -> str:
        """The lane in which it is enqueued: its station's, or that of the network."""
        return self.name if self.kind == "station" else NETWORK


@dataclass(frozen=True, slots=True)
class RouterLinkChanged:
    """The link of this instance to the router was lost or restored."""

    up: bool


@dataclass(frozen=True, slots=True)
class Watching:
    """Marks the time from which changes of tokens are reported."""


@dataclass(frozen=True, slots=True)
class Unfinished:
    """Work that continues in its next slice. lane: the station, or the lane of the instance's own work."""

    lane: str


Arrival = (
    SamplesReceived
    | BatchesReceived
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
    """The source of a message on a station's key. All keys without a valid station are one source."""

    source: str
    station: str | None


@lru_cache(SENDERS)
def source_of_key(key: str) -> SourceId:
    """Return the source of messages on a key.

    >>> source_of_key("caesura/v1/station/cell-1/samples")
    SourceId(source='caesura/v1/station/cell-1/samples', station='cell-1')
    >>> source_of_key("caesura/v1/station/../samples")
    SourceId(source='?', station=None)
    """
    try:
        return SourceId(key, parse_station_key(key)[0])
    except ProtocolError:
        return SourceId(UNKNOWN, None)


def lane_of_query(key: str) -> str:
    """Return the lane of a query on stations; the key may contain wildcards.

    >>> lane_of_query("caesura/v1/station/cell-1/program"), lane_of_query("caesura/v1/session/a/*/samples")
    ('cell-1', 'a')
    >>> lane_of_query("caesura/v1/session/*/s1/snapshot"), lane_of_query("caesura/v1/service/*/status")
    ('?', '/status')
    """
    kind, _, rest = key.removeprefix(f"{ROOT}/").partition("/")
    name = rest.partition("/")[0]
    if kind == "service":
        return STATUS
    return name if kind in {"station", "session"} and is_name(name) else UNKNOWN


def session_of_query(key: str) -> str | None:
    """Return the session that a query on sessions names; None if it leaves the session open.

    >>> session_of_query("caesura/v1/session/*/s1/snapshot")
    's1'
    >>> session_of_query("caesura/v1/session/a/*/snapshot"), session_of_query("caesura/v1/session/**/s1/**")
    (None, None)
    """
    kind, *names = key.removeprefix(f"{ROOT}/").split("/")
    is_second = kind == "session" and len(names) == 3 and names[0] != "**"
    return names[1] if is_second and is_name(names[1]) else None


def station_of(source: str) -> str:
    """Return the station of a source, whose name may be invalid.

    >>> [station_of(source) for source in sources_of("cell-1")]
    ['cell-1', 'cell-1']
    """
    return source.split("/")[-2] if "/" in source else source  # of any key, valid or not: no parsing


def content_of_query(query: IncomingQuery) -> RawPayload:
    """Copy the payload of a query; one without a payload has an empty one."""
    return RawPayload.of(query.key, *(query.content or (b"", OCTETS)))
