"""Diagnoses why a command that waits for a station receives no results."""

from __future__ import annotations

import typer

from caesura_clients.client import Caesura
from caesura_clients.query import services
from caesura_protocol.errors import AccessDenied, CaesuraError, ProtocolError


def print_wait_reason(caesura: Caesura, station: str | None) -> None:
    """Print on the error stream why no result may come, if the reason is known."""
    if why := wait_reason(caesura, station):
        typer.echo(f"{why}, {waiting_for(station)}", err=True)


def waiting_for(station: str | None) -> str:
    """Return text that names the awaited station; None: any station."""
    return f"waiting for {station or 'any station'}"


def wait_reason(caesura: Caesura, station: str | None) -> str:
    """Return why no result may come: no service, no answer, or no such station; empty if unknown."""
    if not services(caesura.transport):
        return "no service answers yet"
    try:
        known = {info.station for info in caesura.sessions()} | set(caesura.stations())
    except AccessDenied:
        return "a service is there, but answers nothing: are these a reader's credentials?"
    except (CaesuraError, ProtocolError):
        return ""  # it has no time to say, or has just gone
    if station is None or station in known:
        return ""
    return f"there is no station {station} yet; stations: {', '.join(sorted(known)) or 'none'}"
