"""The Python API `Caesura`: one connection, with all queries, results and corrections."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ValidationError

from caesura_clients import describing, program_editing, query
from caesura_clients.bridge import Bridge, BridgeSettings, Source
from caesura_clients.editing import edit, preview
from caesura_clients.following import follow
from caesura_clients.query import SessionInfo
from caesura_clients.results import Update
from caesura_protocol.errors import CaesuraError, ProtocolError
from caesura_protocol.extremes import unpack_points
from caesura_protocol.keys import SampleRange
from caesura_protocol.messages import (
    COLUMNS_OF_SIGNAL,
    Ack,
    Action,
    BridgeAck,
    Description,
    EditEffect,
    Insert,
    Kind,
    LimitForce,
    Move,
    NamePhase,
    Program,
    ProgramAction,
    Redo,
    Relabel,
    Remove,
    ServiceStatus,
    Since,
    Snapshot,
    TakeBack,
    Undo,
)
from caesura_protocol.sample_runs import SPEED
from caesura_protocol.transport.endpoints import ENDPOINT_VARIABLE
from caesura_protocol.transport.network import Transport
from caesura_protocol.transport.zenoh_transport import ZenohTransport
from caesura_protocol.validation_words import first_finding

A = TypeVar("A", bound=BaseModel)
SAMPLED = (
    *(name for names in COLUMNS_OF_SIGNAL.values() for name in names),
    SPEED,
)  # what `samples` may have


class Caesura:
    """A connection with the service; a context manager, because an open session hangs the interpreter."""

    def __init__(self, transport: Transport) -> None:
        self.transport = transport

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Leave the network."""
        self.transport.close()

    def results(
        self, station: str = "*", session: str = "*", *, silence_s: float | None = None
    ) -> Iterator[Update]:
        """Updates of the sessions of a station as they happen, the state so far first (`results.follow`)."""
        return follow(self.transport, station, session, silence_s=silence_s)

    def program(self, station: str) -> Program:
        """The current task program of a station."""
        return query.program(self.transport, station)

    def snapshot(self, station: str, session: str | None = None) -> Snapshot:
        """Everything about one session; without a name the one that `program` speaks of."""
        return query.snapshot(self.transport, station, session)

    def samples(
        self,
        station: str,
        session: str,
        t0: float,
        tn: float,
        *,
        bins: int = 1000,
        columns: Sequence[str] = (),
    ) -> dict[str, NDArray[np.float64]]:
        """The samples of a session from t0 to tn [s] by column, each an array (n, 2) of times and values.

        Of each of `bins` bins the least and the greatest sample of every column. columns: such as `px`, `fz`,
        `speed`; all that the session has where none is named, and of those that are named, too.
        `query.samples` also states the holes. Raises CaesuraError for a name that no column has.
        """
        if unknown := [name for name in columns if name not in SAMPLED]:
            raise CaesuraError(f"unknown column {unknown[0]!r}, known: {', '.join(SAMPLED)}")
        wanted = SampleRange(t0, tn, bins, tuple(columns))
        return unpack_points(query.samples(self.transport, station, session, wanted))

    def insert(
        self, station: str, session: str, t: float, *, author: str, revision: int | None = None
    ) -> Ack:
        """End a segment at a time [s] and begin the next; for all of them see `editing.edit`."""
        return self._edit(station, session, _made(Insert, t=t), author, revision)

    def remove(
        self, station: str, session: str, t: float, *, author: str, revision: int | None = None
    ) -> Ack:
        """Make one segment of the two that meet in the changepoint near a time [s]."""
        return self._edit(station, session, _made(Remove, t=t), author, revision)

    def move(
        self, station: str, session: str, t: float, to: float, *, author: str, revision: int | None = None
    ) -> Ack:
        """Put the changepoint near a time [s] somewhere else."""
        return self._edit(station, session, _made(Move, t=t, to=to), author, revision)

    def relabel(
        self, station: str, session: str, t: float, kind: Kind, *, author: str, revision: int | None = None
    ) -> Ack:
        """Set the kind of the segment in which a time [s] lies."""
        return self._edit(station, session, _made(Relabel, t=t, kind=kind), author, revision)

    def limit_force(
        self,
        station: str,
        session: str,
        t: float,
        newton: float | None,
        *,
        author: str,
        revision: int | None = None,
    ) -> Ack:
        """Limit the force [N] of the app in whose time t [s] lies; None: only the cell's limit."""
        return self._edit(station, session, _made(LimitForce, t=t, newton=newton), author, revision)

    def name_phase(
        self, station: str, session: str, t: float, name: str, *, author: str, revision: int | None = None
    ) -> Ack:
        """Name the phase in which a time [s] lies; the program's group of its apps has that name."""
        return self._edit(station, session, _made(NamePhase, t=t, name=name), author, revision)

    def undo(
        self,
        station: str,
        session: str,
        *,
        author: str,
        number: int | None = None,
        revision: int | None = None,
    ) -> Ack:
        """Take a correction back; number: as `Program.corrections` lists it, by default the last one."""
        action = Undo() if number is None else _made(TakeBack, number=number)
        return self._edit(station, session, action, author, revision)

    def redo(self, station: str, session: str, *, author: str, revision: int | None = None) -> Ack:
        """Make the correction that was taken back last once more."""
        return self._edit(station, session, Redo(), author, revision)

    def preview(
        self, station: str, session: str, action: Action | Since, *, revision: int | None = None
    ) -> EditEffect:
        """Ask what a correction would change, or those since one have (`editing.preview`)."""
        return preview(self.transport, station, session, action, revision=revision)

    def start(self, station: str, description: Description | None = None) -> BridgeAck:
        """Start a demonstration at a bridge in standby (`describing.start`)."""
        return describing.start(self.transport, station, description)

    def stop(self, station: str, *, success: bool | None = None) -> BridgeAck:
        """Stop a station's demonstration, and state whether it succeeded (`describing.stop`)."""
        return describing.stop(self.transport, station, success=success)

    def describe(self, station: str, session: str, *, author: str, **changes: Any) -> Ack:
        """Change fields of a session's description, such as `task="wipe"` (`describing.describe`)."""
        return describing.describe(self.transport, station, session, author=author, **changes)

    def edit_program(
        self, station: str, session: str, action: ProgramAction, *, author: str, revision: int | None = None
    ) -> Ack:
        """Edit the program of a session (`program_editing.edit_program`); `reference` names its apps."""
        return program_editing.edit_program(
            self.transport, station, session, action, author=author, revision=revision
        )

    def _edit(self, station: str, session: str, action: Action, author: str, revision: int | None) -> Ack:
        return edit(self.transport, station, session, action, author=author, revision=revision)

    def sessions(self, station: str = "*") -> list[SessionInfo]:
        """Return all sessions that the service holds."""
        return query.sessions(self.transport, station)

    def stations(self) -> list[str]:
        """Return the stations whose bridge is connected now."""
        return query.stations(self.transport)

    def services(self) -> list[ServiceStatus]:
        """Return the status of every instance of the service."""
        return query.service_status(self.transport)

    def bridge(
        self,
        station: str,
        source: Source,
        *,
        session: str | None = None,
        epoch: int = 0,
        preset: str | None = None,
        settings: BridgeSettings | None = None,
        description: Description | None = None,
    ) -> Bridge:
        """A bridge from a source to the service; enter it, then `run`."""
        return Bridge(
            self.transport,
            station,
            source,
            session=session,
            epoch=epoch,
            preset=preset,
            settings=settings,
            description=description,
        )


def _made(action: type[A], **fields: Any) -> A:
    """An action with these fields. Raises ProtocolError `malformed` as the service does, for a wrong one."""
    try:
        return action(**fields)
    except ValidationError as error:
        raise ProtocolError("malformed", first_finding(error)) from error


def connect(
    endpoint: str | None = None, *, config_file: Path | None = None, timeout_s: float | None = 5.0
) -> Caesura:
    """Connect to the service.

    >>> with connect() as caesura:  # doctest: +SKIP
    ...     for update in caesura.results("cell-1"):
    ...         print(update.segments)

    endpoint: None, as CAESURA_CONNECT in the environment or the config_file says, or DEFAULT_ENDPOINT;
    config_file: zenoh json5 with the router, and certificates or a password; timeout_s: None tries for ever.
    Raises Unreachable, or CaesuraError where the endpoint or the file makes no sense.
    """
    endpoint = endpoint or os.environ.get(ENDPOINT_VARIABLE)
    return Caesura(ZenohTransport(endpoint, config_file=config_file, timeout_s=timeout_s))
