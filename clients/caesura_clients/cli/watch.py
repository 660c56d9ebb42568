"""`caesura watch`: prints the segments of one station or of all, as they are found."""

from __future__ import annotations

import sys
from contextlib import suppress
from typing import Annotated

import typer
from rich.console import Console, Group
from rich.live import Live

from caesura_clients.cli.connection_options import Config, Connect, Station
from caesura_clients.cli.options import (
    connected,
    ended_by_sigterm,
    named,
    reported,
)
from caesura_clients.cli.result_tables import clock_lines, segments_view
from caesura_clients.cli.service_availability_lines import AvailabilityLines
from caesura_clients.cli.wait_diagnosis import print_wait_reason, wait_reason, waiting_for
from caesura_clients.cli.watch_live_view import FinalLines, LiveView
from caesura_clients.client import Caesura
from caesura_clients.query import current_sessions, snapshots
from caesura_clients.session_follower import ServiceAvailability, events
from caesura_clients.session_state_reader import Update
from caesura_protocol.errors import CaesuraError, NotFound, ProtocolError
from caesura_protocol.session_time_display import clock_of


def watch(
    station: Station = None,
    once: Annotated[bool, typer.Option("--once", help="Show the current state, and end.")] = False,
    endpoint: Connect = None,
    config: Config = None,
) -> None:
    """Show segments as they are found; those marked ~ may still change. By default of all stations.

    In a file or a pipe each final segment is a line: station/session, number, from and to in s, kind, p, and
    force or load.
    """
    with reported():
        named(station)
        with connected(endpoint, config, patient=not once) as caesura:
            if once:
                _show_once(caesura, station)
            elif not sys.stdout.isatty():
                _write_lines(caesura, station)
            else:
                _show_live(caesura, station)


def _show_once(caesura: Caesura, station: str | None) -> None:
    found = snapshots(caesura.transport, station or "*")
    if not found:
        known = ", ".join(sorted({info.station for info in caesura.sessions()}))
        raise NotFound(f"no session at {station or 'any station'}; stations with sessions: {known or 'none'}")
    for one in found:
        found_hints = one.hints.hints if one.hints else ()
        segments, clock = one.segments.segments, clock_of(one.segments.segments)
        shown = segments_view(one.status, segments, clock, hints=found_hints)
        Console().print(Group(*clock_lines(clock), shown))


def _write_lines(caesura: Caesura, station: str | None) -> None:
    """Print each final segment at once, until Ctrl-C or SIGTERM."""
    final = FinalLines()
    print_wait_reason(caesura, station)
    say = AvailabilityLines(lambda: caesura.transport.has_router)
    with ended_by_sigterm(), suppress(KeyboardInterrupt):
        for event in events(caesura.transport, station or "*"):
            if isinstance(event, ServiceAvailability):
                say(event.state)
            elif isinstance(event, Update):
                for line in final.lines(event):
                    typer.echo(line)  # which flushes


def _show_live(caesura: Caesura, station: str | None) -> None:
    waiting = ", ".join(filter(None, (wait_reason(caesura, station), waiting_for(station))))
    view = LiveView(
        lambda: _current_sessions(caesura), waiting=waiting, has_router=lambda: caesura.transport.has_router
    )
    with ended_by_sigterm(), Live(view, refresh_per_second=10) as live, suppress(KeyboardInterrupt):
        for event in events(caesura.transport, station or "*"):
            view.receive(event)
            live.update(view)


def _current_sessions(caesura: Caesura) -> dict[str, str]:
    """Return the current session of each station, by station; empty if the service does not answer."""
    try:
        return current_sessions(caesura.transport)
    except (CaesuraError, ProtocolError):
        return {}
