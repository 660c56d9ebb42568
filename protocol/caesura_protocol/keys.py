"""Key expressions: how they are built and how they are read back, side by side.

A station, session or instance name is `[a-z0-9][a-z0-9_-]{0,63}`.

>>> session_key("cell-1", "s20260101-1", "segments")
'caesura/v1/session/cell-1/s20260101-1/segments'
>>> parse_session_key("caesura/v1/session/cell-1/s20260101-1/segments")
('cell-1', 's20260101-1', 'segments')
"""

from __future__ import annotations

import re
from typing import Literal, TypeVar, get_args

from caesura_protocol.errors import ProtocolError

ROOT = "caesura/v1"
NAME_PATTERN = r"^[a-z0-9][a-z0-9_-]{0,63}$"
T = TypeVar("T", bound=str)
_NAME = re.compile(NAME_PATTERN)

StationPart = Literal["samples", "replay", "alive", "control", "program"]
SessionPart = Literal["changepoints", "segments", "posterior", "status", "snapshot"]
ServicePart = Literal["alive", "status"]


def check_name(name: str, what: str) -> str:
    """The name itself. Raises ProtocolError `malformed` where it is not a valid name."""
    if not _NAME.fullmatch(name):
        raise ProtocolError("malformed", f"{what} is not a valid name", value=name, expected=NAME_PATTERN)
    return name


def _name_or_wildcard(name: str, what: str) -> str:
    return name if name == "*" else check_name(name, what)


def station_key(station: str, part: StationPart) -> str:
    """`caesura/v1/station/{station}/{part}`; station may be `*`."""
    return f"{ROOT}/station/{_name_or_wildcard(station, 'station')}/{part}"


def parse_station_key(key: str) -> tuple[str, StationPart]:
    """(station, part) of a station key. Raises ProtocolError `malformed`."""
    station, part = _split(key, "station", 2)
    return check_name(station, "station"), _part(part, get_args(StationPart))


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
