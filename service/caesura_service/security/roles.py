"""The table of roles and their rights, from which access rules and their documentation are generated.

A role has only the rights in this table. An identity is a role with a name: `bridge.cell-1` may act only for
station cell-1, `service.caesura-1` only as instance caesura-1.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import SessionPart, check_name, service_key, session_key, station_key

Role = Literal["service", "bridge", "dashboard", "operator"]


@dataclass(frozen=True)
class Access:
    """Key expressions by verb; keys that they include are granted too."""

    put: tuple[str, ...] = ()
    subscribe: tuple[str, ...] = ()
    query: tuple[str, ...] = ()
    answer: tuple[str, ...] = ()  # queries of others
    asked: tuple[str, ...] = ()  # wider expressions that others ask with, and `answer` answers a part of
    hold: tuple[str, ...] = ()  # a liveliness token
    watch: tuple[str, ...] = ()  # liveliness tokens of others, by subscription or query


STREAMS: tuple[SessionPart, ...] = ("changepoints", "segments", "posterior", "hints", "status")
RESULTS = tuple(session_key("*", "*", part) for part in STREAMS)
PROGRAMS = station_key("*", "program")
SAMPLES = station_key("*", "samples")
SNAPSHOTS = session_key("*", "*", "snapshot")
SAMPLES_OF_SESSIONS = session_key("*", "*", "samples")
SERVICES_ALIVE = service_key("*", "alive")
STATIONS_ALIVE = station_key("*", "alive")
BRIDGE_STATUS = station_key("*", "bridge_status")


def _service(instance: str) -> Access:
    """Return the access of one instance, if the router is another process.

    Any instance may own any station.
    """
    return Access(
        put=(*RESULTS, PROGRAMS, service_key(instance, "status")),
        subscribe=(SAMPLES,),
        query=(station_key("*", "replay"),),
        answer=(
            station_key("*", "control"),
            PROGRAMS,
            SNAPSHOTS,
            SAMPLES_OF_SESSIONS,
            service_key(instance, "status"),
        ),
        asked=(service_key("*", "status"),),
        hold=(service_key(instance, "alive"),),
        watch=(SERVICES_ALIVE, STATIONS_ALIVE),
    )


def _bridge(station: str) -> Access:
    """Return the access of a station's robot.

    It queries its own sessions, and whether another bridge has its station. It may also send its own start
    and stop, so that a pedal at the robot needs no other credentials.
    """
    control = station_key(station, "bridge_control")
    return Access(
        put=(station_key(station, "samples"), station_key(station, "bridge_status")),
        query=(
            station_key(station, "control"),
            control,
            station_key(station, "program"),
            session_key(station, "*", "snapshot"),
        ),
        answer=(station_key(station, "replay"), control),
        hold=(station_key(station, "alive"),),
        watch=(SERVICES_ALIVE, station_key(station, "alive")),
    )


def _dashboard(_name: str) -> Access:
    """Return the access of a viewer: samples and results of every station, and no change."""
    return Access(
        subscribe=(*RESULTS, PROGRAMS, SAMPLES, BRIDGE_STATUS, service_key("*", "status")),
        query=(SNAPSHOTS, SAMPLES_OF_SESSIONS, PROGRAMS, service_key("*", "status")),
        watch=(SERVICES_ALIVE, STATIONS_ALIVE),
    )


def _operator(name: str) -> Access:
    """Return the access of a dashboard that may also command every station, and start and stop its bridge."""
    reader = _dashboard(name)
    return Access(
        subscribe=reader.subscribe,
        query=(*reader.query, station_key("*", "control"), station_key("*", "bridge_control")),
        watch=reader.watch,
    )


ROLES: Mapping[Role, Callable[[str], Access]] = {
    "service": _service,
    "bridge": _bridge,
    "dashboard": _dashboard,
    "operator": _operator,
}


class Identity(NamedTuple):
    """A holder of a role. The label is the user name, and begins the certificate's common name.

    >>> Identity("bridge", "cell-1").label
    'bridge.cell-1'
    """

    role: Role
    name: str

    @property
    def label(self) -> str:
        """Role and name; a name has no dot."""
        return f"{self.role}.{self.name}"

    @property
    def access(self) -> Access:
        """The rights of the identity."""
        return ROLES[self.role](self.name)


def parse_identity(label: str) -> Identity:
    """Parse a label. Raises ProtocolError `malformed`.

    >>> parse_identity("bridge.cell-1")
    Identity(role='bridge', name='cell-1')
    """
    prefix, _, name = label.partition(".")
    for role in get_args(Role):
        if role == prefix:
            return Identity(role, check_name(name, role))
    raise ProtocolError(
        "malformed", "no such role", value=label, expected=[f"{role}.NAME" for role in get_args(Role)]
    )
