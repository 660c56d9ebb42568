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

from caesura_clients import demonstration_control, program_editing, query
from caesura_clients.bridge import Bridge, BridgeSettings, Source
from caesura_clients.query import SessionInfo
from caesura_clients.session_corrections import edit, preview
from caesura_clients.session_follower import follow
from caesura_clients.session_state_reader import Update
from caesura_protocol.derived_columns import DERIVED
from caesura_protocol.errors import CaesuraError, ProtocolError
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
from caesura_protocol.minmax_decimation import unpack_points
from caesura_protocol.transport.default_endpoint import ENDPOINT_VARIABLE
from caesura_protocol.transport.transport_interface import Transport
from caesura_protocol.transport.zenoh_transport import ZenohTransport
from caesura_protocol.validation_words import first_finding

A = TypeVar("A", bound=BaseModel)
SAMPLED = (
    *(name for names in COLUMNS_OF_SIGNAL.values() for name in names),
    *DERIVED,
)  # what `samples` may have


class Caesura:
    """A connection with the service.

    Use it as a context manager: an open session blocks the interpreter's exit.
    """

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
        """Yield updates of the sessions of a station, the current state first (`session_follower.follow`)."""
        return follow(self.transport, station, session, silence_s=silence_s)

    def program(self, station: str) -> Program:
        """Return the current task program of a station."""
        return query.program(self.transport, station)

    def snapshot(self, station: str, session: str | None = None) -> Snapshot:
        """Return the snapshot of one session, by default the station's current one."""
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
        """Return the samples of a session from t0 to tn [s]: by column an array (n, 2) of times and values.

        The range has `bins` bins, with the least and the greatest sample of every column in each. columns:
        names such as `px`, `fz`, `speed`; by default all columns of the session. A name that the session
        lacks is left out. `query.samples` also states the holes. Raises CaesuraError for a name that no
        column has.
        """
        if unknown := [name for name in columns if name not in SAMPLED]:
            raise CaesuraError(f"unknown column {unknown[0]!r}, known: {', '.join(SAMPLED)}")
        wanted = SampleRange(t0, tn, bins, tuple(columns))
        return unpack_points(query.samples(self.transport, station, session, wanted))

    def insert(
        self, station: str, session: str, t: float, *, author: str, revision: int | None = None
    ) -> Ack:
        """Insert a changepoint at a time [s]. For all corrections see `session_corrections.edit`."""
        return self._edit(station, session, _made(Insert, t=t), author, revision)

    def remove(
        self, station: str, session: str, t: float, *, author: str, revision: int | None = None
    ) -> Ack:
        """Remove the changepoint near a time [s]: its two segments become one."""
        return self._edit(station, session, _made(Remove, t=t), author, revision)

    def move(
        self, station: str, session: str, t: float, to: float, *, author: str, revision: int | None = None
    ) -> Ack:
        """Move the changepoint near `t` [s] to another time [s]."""
        return self._edit(station, session, _made(Move, t=t, to=to), author, revision)

    def relabel(
        self, station: str, session: str, t: float, kind: Kind, *, author: str, revision: int | None = None
    ) -> Ack:
        """Set the kind of the segment that contains a time [s]."""
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
        """Limit the force [N] of the app that contains the time t [s]; None: only the cell's limit."""
        return self._edit(station, session, _made(LimitForce, t=t, newton=newton), author, revision)

    def name_phase(
        self, station: str, session: str, t: float, name: str, *, author: str, revision: int | None = None
    ) -> Ack:
        """Name the phase that contains a time [s]; the group of its apps in the program gets that name."""
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
        """Undo a correction; number: as listed in `Program.corrections`, by default the last one."""
        action = Undo() if number is None else _made(TakeBack, number=number)
        return self._edit(station, session, action, author, revision)

    def redo(self, station: str, session: str, *, author: str, revision: int | None = None) -> Ack:
        """Redo the correction that was undone last."""
        return self._edit(station, session, Redo(), author, revision)

    def preview(
        self, station: str, session: str, action: Action | Since, *, revision: int | None = None
    ) -> EditEffect:
        """Return what a correction would change, or what those since one have changed.

        It changes nothing (`session_corrections.preview`).
        """
        return preview(self.transport, station, session, action, revision=revision)

    def start(self, station: str, description: Description | None = None) -> BridgeAck:
        """Start a demonstration at a bridge in standby (`demonstration_control.start`)."""
        return demonstration_control.start(self.transport, station, description)

    def stop(self, station: str, *, success: bool | None = None) -> BridgeAck:
        """Stop a station's demonstration, and state whether it succeeded (`demonstration_control.stop`)."""
        return demonstration_control.stop(self.transport, station, success=success)

    def describe(self, station: str, session: str, *, author: str, **changes: Any) -> Ack:
        """Change fields of a session's description, such as `task`: `demonstration_control.describe`."""
        return demonstration_control.describe(self.transport, station, session, author=author, **changes)

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
        """Return a bridge from a source to the service: enter its context, then call `run`."""
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
    """Return an action with these fields.

    Raises ProtocolError `malformed`, as the service does, if invalid.
    """
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

    endpoint: None: CAESURA_CONNECT of the environment, else the config_file's, else DEFAULT_ENDPOINT;
    config_file: zenoh json5 with the router, and certificates or a password; timeout_s: None: retry without
    limit. Raises Unreachable, or CaesuraError if the endpoint or the file is invalid.
    """
    endpoint = endpoint or os.environ.get(ENDPOINT_VARIABLE)
    return Caesura(ZenohTransport(endpoint, config_file=config_file, timeout_s=timeout_s))
