"""Key expressions: how they are built and how they are read back, side by side.

A station, session or instance name is `[a-z0-9][a-z0-9_-]{0,63}`.

>>> session_key("cell-1", "s20260101-1", "segments")
'caesura/v1/session/cell-1/s20260101-1/segments'
>>> parse_session_key("caesura/v1/session/cell-1/s20260101-1/segments")
('cell-1', 's20260101-1', 'segments')
"""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Literal, NamedTuple, TypeVar, get_args

from caesura_protocol.errors import ProtocolError

ROOT = "caesura/v1"
NAME_PATTERN = r"^[a-z0-9][a-z0-9_-]{0,63}$"
T = TypeVar("T", bound=str)
_NAME = re.compile(NAME_PATTERN)
_COUNT = re.compile(r"[0-9]{1,15}")
MAX_PARAMETERS = 1000  # characters
_AT_HAND = 4096  # keys, which are asked for again with every message

StationPart = Literal["samples", "replay", "alive", "control", "program"]
SessionPart = Literal["changepoints", "segments", "posterior", "status", "snapshot"]
ServicePart = Literal["alive", "status"]


def is_name(text: str) -> bool:
    """Is it a valid name of a station, a session or an instance?"""
    return _NAME.fullmatch(text) is not None


def check_name(name: str, what: str) -> str:
    """The name itself. Raises ProtocolError `malformed` where it is not a valid name."""
    if not _NAME.fullmatch(name):
        raise ProtocolError("malformed", f"{what} is not a valid name", value=name, expected=NAME_PATTERN)
    return name


def _name_or_wildcard(name: str, what: str) -> str:
    return name if name == "*" else check_name(name, what)


@lru_cache(_AT_HAND)
def station_key(station: str, part: StationPart) -> str:
    """`caesura/v1/station/{station}/{part}`; station may be `*`."""
    return f"{ROOT}/station/{_name_or_wildcard(station, 'station')}/{part}"


def parse_station_key(key: str) -> tuple[str, StationPart]:
    """(station, part) of a station key. Raises ProtocolError `malformed`."""
    station, part = _split(key, "station", 2)
    return check_name(station, "station"), _part(part, get_args(StationPart))


@lru_cache(_AT_HAND)
def session_key(station: str, session: str, part: SessionPart) -> str:
    """`caesura/v1/session/{station}/{session}/{part}`; station and session may be `*`."""
    station, session = _name_or_wildcard(station, "station"), _name_or_wildcard(session, "session")
    return f"{ROOT}/session/{station}/{session}/{part}"


def parse_session_key(key: str) -> tuple[str, str, SessionPart]:
    """(station, session, part) of a session key. Raises ProtocolError `malformed`."""
    station, session, part = _split(key, "session", 3)
    return check_name(station, "station"), check_name(session, "session"), _part(part, get_args(SessionPart))


def service_key(instance: str, part: ServicePart) -> str:
    """`caesura/v1/service/{instance}/{part}`; instance may be `*`."""
    return f"{ROOT}/service/{_name_or_wildcard(instance, 'instance')}/{part}"


def parse_service_key(key: str) -> tuple[str, ServicePart]:
    """(instance, part) of a service key. Raises ProtocolError `malformed`."""
    instance, part = _split(key, "service", 2)
    return check_name(instance, "instance"), _part(part, get_args(ServicePart))


class ReplayRange(NamedTuple):
    """Which batches a `replay` query asks for: `first` to `last`, both included, at most `limit` of them.

    session: whose; "" for that which the bridge has.
    """

    first: int
    last: int
    limit: int
    session: str = ""


def replay_parameters(wanted: ReplayRange) -> str:
    """What follows the `?` of a `replay` query. Zenoh separates parameters by semicolons.

    >>> replay_parameters(ReplayRange(first=3, last=9, limit=100, session="s1"))
    'from=3;to=9;max=100;session=s1'
    """
    whose = f";session={wanted.session}" if wanted.session else ""
    return f"from={wanted.first};to={wanted.last};max={wanted.limit}{whose}"


def parse_replay_parameters(parameters: str) -> ReplayRange:
    """The range that `replay` parameters ask for; unknown ones are ignored. Raises ProtocolError `malformed`.

    >>> parse_replay_parameters("from=3;to=9;max=100")
    ReplayRange(first=3, last=9, limit=100, session='')
    """
    if len(parameters) > MAX_PARAMETERS:
        why = "replay: too many parameters"
        raise ProtocolError("malformed", why, value=len(parameters), limit=MAX_PARAMETERS)
    fields = dict(part.partition("=")[::2] for part in parameters.split(";"))
    first, last, limit = (_count(fields.get(name), name) for name in ("from", "to", "max"))
    wanted = ReplayRange(first, last, limit, fields.get("session", ""))
    if wanted.last < wanted.first:
        raise ProtocolError(
            "malformed", "replay ends before it begins", value=wanted.last, limit=wanted.first
        )
    return wanted


def _count(text: str | None, name: str) -> int:
    if text is None or not _COUNT.fullmatch(text):
        raise ProtocolError(
            "malformed", f"replay: {name} is not a count", value=text, expected=_COUNT.pattern
        )
    return int(text)


def _split(key: str, kind: str, count: int) -> list[str]:
    prefix = f"{ROOT}/{kind}/"
    parts = key.removeprefix(prefix).split("/")
    if not key.startswith(prefix) or len(parts) != count:
        raise ProtocolError("malformed", f"not a {kind} key", value=key, expected=f"{prefix}…, {count} parts")
    return parts


def _part(part: str, known: tuple[T, ...]) -> T:
    for name in known:
        if part == name:
            return name
    raise ProtocolError("malformed", "unknown last part of the key", value=part, expected=list(known))
