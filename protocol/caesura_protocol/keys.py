"""Builds and parses key expressions.

A station, session or instance name is `[a-z0-9][a-z0-9_-]{0,63}`.

>>> session_key("cell-1", "s20260101-1", "segments")
'caesura/v1/session/cell-1/s20260101-1/segments'
>>> parse_session_key("caesura/v1/session/cell-1/s20260101-1/segments")
('cell-1', 's20260101-1', 'segments')
"""

from __future__ import annotations

import math
import re
from functools import lru_cache
from typing import Literal, NamedTuple, TypeVar, get_args

from caesura_protocol.errors import ProtocolError

ROOT = "caesura/v1"
NAME_PATTERN = r"^[a-z0-9][a-z0-9_-]{0,63}$"
NAME_WORDS = "1 to 64 of a to z, 0 to 9, - and _, and a letter or a digit first"
MAX_STORED = 16  # sessions of an answer
T = TypeVar("T", bound=str)
_NAME = re.compile(NAME_PATTERN)
_COUNT = re.compile(r"[0-9]{1,15}")
_NUMBER = re.compile(r"[+-]?[0-9]{1,15}(\.[0-9]{1,20})?(e[+-]?[0-9]{1,3})?")
_COLUMN = re.compile(r"[a-z][a-z0-9_]{0,31}")
MAX_PARAMETERS = 1000  # characters
MAX_BINS = 4096  # of the answer to a `samples` query
MIN_BIN_S = 1e-6
MAX_TIME_S = 1e10  # magnitude of a sample's time
_AT_HAND = 4096  # keys, which are asked for again with every message

StationPart = Literal["samples", "replay", "alive", "control", "program", "bridge_status", "bridge_control"]
SessionPart = Literal["changepoints", "segments", "posterior", "hints", "status", "snapshot", "samples"]
ServicePart = Literal["alive", "status"]


def is_name(text: str) -> bool:
    """Return whether a text is a valid name of a station, a session or an instance."""
    return _NAME.fullmatch(text) is not None


def check_name(name: str, what: str) -> str:
    """Return the name. Raises ProtocolError `malformed` if it is not valid; what: names it in the error."""
    if not _NAME.fullmatch(name):
        raise ProtocolError("malformed", f"{what} is not a valid name", value=name, expected=NAME_WORDS)
    return name


def _name_or_wildcard(name: str, what: str) -> str:
    return name if name == "*" else check_name(name, what)


@lru_cache(_AT_HAND)
def station_key(station: str, part: StationPart) -> str:
    """Return `caesura/v1/station/{station}/{part}`; station may be `*`."""
    return f"{ROOT}/station/{_name_or_wildcard(station, 'station')}/{part}"


def parse_station_key(key: str) -> tuple[str, StationPart]:
    """Return (station, part) of a station key. Raises ProtocolError `malformed`."""
    station, part = _split(key, "station", 2)
    return check_name(station, "station"), _part(part, get_args(StationPart))


@lru_cache(_AT_HAND)
def session_key(station: str, session: str, part: SessionPart) -> str:
    """Return `caesura/v1/session/{station}/{session}/{part}`; station and session may be `*`."""
    station, session = _name_or_wildcard(station, "station"), _name_or_wildcard(session, "session")
    return f"{ROOT}/session/{station}/{session}/{part}"


def parse_session_key(key: str) -> tuple[str, str, SessionPart]:
    """Return (station, session, part) of a session key. Raises ProtocolError `malformed`."""
    station, session, part = _split(key, "session", 3)
    return check_name(station, "station"), check_name(session, "session"), _part(part, get_args(SessionPart))


def service_key(instance: str, part: ServicePart) -> str:
    """Return `caesura/v1/service/{instance}/{part}`; instance may be `*`."""
    return f"{ROOT}/service/{_name_or_wildcard(instance, 'instance')}/{part}"


def parse_service_key(key: str) -> tuple[str, ServicePart]:
    """Return (instance, part) of a service key. Raises ProtocolError `malformed`."""
    instance, part = _split(key, "service", 2)
    return check_name(instance, "instance"), _part(part, get_args(ServicePart))


def expression_matches(expression: str, key: str) -> bool:
    """Return whether the key expression of a query includes a key of this protocol, with `*` any of the keys.

    The time is at most proportional to the product of both lengths. Zenoh's own comparison takes exponential
    time in the number of `$*`, and holds the interpreter's lock meanwhile.

    >>> expression_matches("caesura/**/s$*/snapshot", "caesura/v1/session/cell-1/s1/snapshot")
    True
    """
    wanted, parts = expression.split("/"), key.split("/")
    at = place = 0  # in wanted, in parts
    last, covered = -1, 0  # the last `**`, and the end of the parts that it covers
    while place < len(parts):
        if at < len(wanted) and wanted[at] == "**":
            last, covered, at = at, place, at + 1
        elif at < len(wanted) and _part_matches(wanted[at], parts[place]):
            at, place = at + 1, place + 1
        elif last >= 0:  # it covers one part more
            covered += 1
            at, place = last + 1, covered
        else:
            return False
    return all(part == "**" for part in wanted[at:])


def _part_matches(wanted: str, part: str) -> bool:
    """Return whether a part of a key expression includes a part of a key: `*` any, `$*` any letters."""
    if "*" in (wanted, part):
        return True
    first, *others = wanted.split("$*")
    if not others:
        return wanted == part
    *between, end = others
    if not part.startswith(first):
        return False
    at = len(first)
    for text in between:
        if (found := part.find(text, at)) < 0:
            return False
        at = found + len(text)
    return len(part) - at >= len(end) and part.endswith(end)


class ReplayRange(NamedTuple):
    """Batches that a `replay` query requests: `first` to `last`, both included, at most `limit` of them.

    session: name of their session; "" for the bridge's current one.
    """

    first: int
    last: int
    limit: int
    session: str = ""


def replay_parameters(wanted: ReplayRange) -> str:
    """Return the parameters of a `replay` query, after its `?`. Zenoh separates parameters by semicolons.

    >>> replay_parameters(ReplayRange(first=3, last=9, limit=100, session="s1"))
    'from=3;to=9;max=100;session=s1'
    """
    whose = f";session={wanted.session}" if wanted.session else ""
    return f"from={wanted.first};to={wanted.last};max={wanted.limit}{whose}"


def parse_replay_parameters(parameters: str) -> ReplayRange:
    """Return the range of `replay` parameters; unknown ones are ignored. Raises ProtocolError `malformed`.

    >>> parse_replay_parameters("from=3;to=9;max=100")
    ReplayRange(first=3, last=9, limit=100, session='')
    """
    fields = _fields(parameters, "replay")
    first, last, limit = (_count(fields.get(name), name) for name in ("from", "to", "max"))
    wanted = ReplayRange(first, last, limit, fields.get("session", ""))
    if wanted.last < wanted.first:
        raise ProtocolError(
            "malformed", "replay ends before it begins", value=wanted.last, limit=wanted.first
        )
    return wanted


class SampleRange(NamedTuple):
    """Samples that a `samples` query requests.

    t0, tn: session time [s]; bins: number of intervals of equal width between them, whose extremes are
    returned; columns: names, all if empty.
    """

    t0: float
    tn: float
    bins: int
    columns: tuple[str, ...] = ()


INFERRED_PROGRAM = "program=inferred"  # of a `snapshot` query: the program without the edits of people
NOTHING_SAID = "nothing=said"  # of a reader's query: an instance that has nothing says so


def with_nothing_said(parameters: str) -> str:
    """Add to a query's parameters the request that an instance also replies if it has no matching content.

    INFERRED_PROGRAM is unchanged, because an older service reads it only alone; a current one replies to it
    too.

    >>> with_nothing_said("stored=4;skip=0")
    'stored=4;skip=0;nothing=said'
    """
    if parameters == INFERRED_PROGRAM:
        return parameters
    return f"{parameters};{NOTHING_SAID}" if parameters else NOTHING_SAID


def requests_nothing_said(parameters: str) -> bool:
    """Return whether parameters request a reply without content, which would be an error to an older client.

    >>> requests_nothing_said("nothing=said"), requests_nothing_said("")
    (True, False)
    """
    return parameters == INFERRED_PROGRAM or NOTHING_SAID in parameters.split(";")


def edits_parameters(number: int) -> str:
    """Return the parameters of a `snapshot` query for a version of its program, after its `?`.

    The version has the effective edits up to that number; with 0 none. An older service returns the current
    program, with another `edit_revision`.

    >>> edits_parameters(3)
    'edits=3'
    """
    return f"edits={number}"


def samples_parameters(wanted: SampleRange) -> str:
    """Return the parameters of a `samples` query, after its `?`.

    >>> samples_parameters(SampleRange(0.0, 60.0, bins=1200, columns=("px", "speed")))
    'from=0.0;to=60.0;bins=1200;columns=px,speed'
    """
    columns = f";columns={','.join(wanted.columns)}" if wanted.columns else ""
    return f"from={float(wanted.t0)!r};to={float(wanted.tn)!r};bins={wanted.bins}{columns}"


def parse_samples_parameters(parameters: str) -> SampleRange:
    """Return the range of `samples` parameters; unknown ones are ignored.

    Raises ProtocolError `malformed`.

    >>> parse_samples_parameters("from=0;to=60.5;bins=100")
    SampleRange(t0=0.0, tn=60.5, bins=100, columns=())
    """
    fields = _fields(parameters, "samples")
    t0, tn = (_number(fields.get(name), name) for name in ("from", "to"))
    bins = _count(fields.get("bins"), "bins", "samples")
    if not t0 < tn:
        raise ProtocolError("malformed", "samples: the range ends before it begins", value=tn, limit=t0)
    if not 1 <= bins <= MAX_BINS:
        raise ProtocolError("malformed", "samples: number of bins", value=bins, limit=MAX_BINS)
    if (tn - t0) / bins < MIN_BIN_S:
        why = "samples: the bins are narrower than a sample can be"
        raise ProtocolError("malformed", why, value=(tn - t0) / bins, limit=MIN_BIN_S)
    columns = tuple(fields["columns"].split(",")) if fields.get("columns") else ()
    for column in columns:
        if not _COLUMN.fullmatch(column):
            raise ProtocolError("malformed", "samples: not a column", value=column, expected=_COLUMN.pattern)
    return SampleRange(t0, tn, bins, columns)


class StoredPage(NamedTuple):
    """Sessions of the journal that a `snapshot` query requests: the newest `limit` after `skip` others.

    edits: the version of their programs, as in `edits_parameters`.
    """

    limit: int = MAX_STORED
    skip: int = 0
    edits: int | None = None


def stored_parameters(wanted: StoredPage) -> str:
    """Return the parameters of a `snapshot` query for stored sessions, after its `?`.

    >>> stored_parameters(StoredPage(16, skip=32))
    'stored=16;skip=32'
    """
    version = "" if wanted.edits is None else f";{edits_parameters(wanted.edits)}"
    return f"stored={wanted.limit};skip={wanted.skip}{version}"


def parse_snapshot_parameters(parameters: str) -> tuple[StoredPage | None, int | None]:
    """Return the stored sessions of `snapshot` parameters, and the version of their programs.

    None for stored sessions requests those in memory, None for the version the current program. Raises
    ProtocolError `malformed`.

    >>> parse_snapshot_parameters("stored=4;skip=0"), parse_snapshot_parameters("edits=3")
    ((StoredPage(limit=4, skip=0, edits=None), None), (None, 3))
    """
    fields = _fields(parameters, "snapshot")
    edits = _count(fields["edits"], "edits", "snapshot") if "edits" in fields else None
    if "stored" not in fields:
        return None, edits
    limit = _count(fields["stored"], "stored", "snapshot")
    if not 1 <= limit <= MAX_STORED:
        raise ProtocolError("malformed", "snapshot: number of stored sessions", value=limit, limit=MAX_STORED)
    skip = _count(fields.get("skip", "0"), "skip", "snapshot")
    return StoredPage(limit, skip, edits), edits


def _fields(parameters: str, query: str) -> dict[str, str]:
    if len(parameters) > MAX_PARAMETERS:
        why = f"{query}: too many parameters"
        raise ProtocolError("malformed", why, value=len(parameters), limit=MAX_PARAMETERS)
    return dict(part.partition("=")[::2] for part in parameters.split(";"))


def _number(text: str | None, name: str) -> float:
    if text is None or not _NUMBER.fullmatch(text) or not math.isfinite(float(text)):
        raise ProtocolError("malformed", f"samples: {name} is not a finite number", value=text)
    if abs(number := float(text)) > MAX_TIME_S:
        raise ProtocolError("malformed", f"samples: {name} is out of range", value=number, limit=MAX_TIME_S)
    return number


def _count(text: str | None, name: str, query: str = "replay") -> int:
    if text is None or not _COUNT.fullmatch(text):
        raise ProtocolError(
            "malformed", f"{query}: {name} is not a count", value=text, expected=_COUNT.pattern
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
