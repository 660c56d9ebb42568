"""The pages `/sessions` and `/system`: tables, updated once a second."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from nicegui import Client, run, ui
from nicegui.events import GenericEventArguments

from caesura_clients.dashboard.correction_requests import EditRefused, refusal
from caesura_clients.dashboard.pages.layout import SLOW_TICK_S, Site, page
from caesura_clients.dashboard.session_list_rows import damaged, sessions
from caesura_clients.dashboard.station_summary import DashboardState
from caesura_clients.dashboard.system import system
from caesura_clients.dashboard.web_components import SessionList, Tables, lags
from caesura_protocol.errors import CaesuraError, ProtocolError
from caesura_protocol.keys import check_name

INSTANCES = (
    ("instance", "instance"), ("state", "state"), ("since", "started"), ("sessions", "sessions"),
    ("rate", "messages"), ("queue", "queue"), ("dropped", "dropped"), ("refused", "refused"),
    ("journal", "journal"), ("version", "version"),
)  # fmt: skip
STATIONS = (
    ("station", "station"), ("owner", "owner"), ("since", "owned since"), ("bridge", "bridge"),
    ("session", "session"), ("samples", "samples"), ("gaps", "gaps"), ("lost", "batches lost"),
    ("dropped", "dropped"), ("hypotheses", "hypotheses"),
)  # fmt: skip
BROWSERS = (("viewers", "browsers"), ("median", "median lag"), ("worst", "99 % within"))
Columns = Sequence[tuple[str, str]]


def build_sessions(site: Site) -> None:
    """Build the page `/sessions`, with all sessions that the service holds."""

    async def older(event: GenericEventArguments) -> None:
        try:
            station = check_name(event.args, "station") if event.args else "*"
            found = await run.io_bound(site.gateway.read_stored, station)
        except (CaesuraError, ProtocolError) as error:
            listed.answered(refusal(error), failed=True)
        else:
            listed.answered(
                f"{found} older ones." if found else "The journal has no older one.", failed=False
            )

    async def describe(event: GenericEventArguments) -> None:
        """Delete or restore a session, without blocking other pages."""
        asked = event.args
        if site.desk is None or not isinstance(asked, dict) or not isinstance(asked.get("request"), dict):
            return
        try:
            station = check_name(str(asked.get("station")), "station")
            said = await run.io_bound(site.desk.carry_out, station, asked["request"])
        except ProtocolError as error:
            listed.described(refusal(error), failed=True)
        except EditRefused as refused:
            listed.described(str(refused), failed=True)
        else:
            listed.described(said or "", failed=False)

    with page("Sessions", "/sessions"):
        listed = SessionList(_sessions(site.gateway.world), older, describe, editable=site.desk is not None)
    ui.timer(SLOW_TICK_S, lambda: listed.show(_sessions(site.gateway.world)))


def build_system(site: Site) -> None:
    """Build the page `/system`: instances of the service, stations and browsers."""
    _build(site, "System", "/system", _system)


def _build(site: Site, title: str, path: str, shown: Callable[[DashboardState], dict[str, Any]]) -> None:
    with page(title, path):
        tables = Tables(shown(site.gateway.world))
    ui.timer(SLOW_TICK_S, lambda: tables.show(shown(site.gateway.world)))


def _sessions(world: DashboardState) -> dict[str, Any]:
    found = {"damaged": damaged(world), "sessions": sessions(world)}
    return {"warning": world.trouble, "answers": world.answers, **found}


def _system(world: DashboardState) -> dict[str, Any]:
    found = system(world)
    tables = [
        _table("Instances", INSTANCES, found.instances, "No instance answers."),
        _table("Stations", STATIONS, found.stations, "No station is known."),
        _table("This dashboard", BROWSERS, [_browsers()], ""),
    ]
    return {"warnings": list(found.warnings), "tables": tables}


def _table(title: str, columns: Columns, rows: list[dict[str, Any]], empty: str) -> dict[str, Any]:
    return {"title": title, "columns": columns, "rows": rows, "empty": empty}


def _browsers() -> dict[str, Any]:
    """Return the number of viewers, and median and 99th percentile of their acknowledgement delays."""
    measured = np.array(lags) * 1000.0
    if measured.size == 0:
        return {"viewers": str(len(Client.instances)), "median": "–", "worst": "–"}
    median, worst = np.percentile(measured, [50, 99])
    viewers = sum(one.has_socket_connection for one in Client.instances.values())
    return {"viewers": str(viewers), "median": f"{median:.0f} ms", "worst": f"{worst:.0f} ms"}
