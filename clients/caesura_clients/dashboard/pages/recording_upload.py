"""The page `/recordings`, on which an operator drops a recording and plays it as a session.

Before it is played the operator answers its open questions.
"""

from __future__ import annotations

import asyncio
from contextlib import suppress
from dataclasses import asdict
from datetime import datetime
from functools import partial
from typing import Any

from fastapi import Request, Response
from fastapi.responses import PlainTextResponse
from nicegui import run, ui
from nicegui.events import GenericEventArguments

from caesura_clients.dashboard.correction_requests import EditRefused
from caesura_clients.dashboard.demonstration_requests import read_only_reason
from caesura_clients.dashboard.network_follower import NetworkFollower
from caesura_clients.dashboard.pages.layout import Site, page, text
from caesura_clients.dashboard.recordings import BYTES, MEGABYTE, SUFFIXES, RecordingDesk
from caesura_clients.dashboard.station_summary import length_words
from caesura_clients.dashboard.web_components import RecordingDrop
from caesura_clients.dashboard.wrench_source_words import WRENCH_SOURCE_WORDS
from caesura_protocol.errors import CaesuraError, ProtocolError
from caesura_protocol.formats.csv_read_mapped import TURNS, UNITS
from caesura_protocol.messages import COLUMNS_OF_SIGNAL, FORCE_FRAMES, HANDS_ON_ROBOT
from caesura_protocol.plausibility import UNITS as UNITS_OF_QUANTITY
from caesura_protocol.robots import robot_names

UPLOADS = "/uploads"
TICK_S = 0.25
ONLY_READS = read_only_reason("playing a recording needs")
DEFAULT_STATION = "recordings"


def build(site: Site) -> None:
    """Build the page `/recordings`, for dropping and playing recordings."""
    with page("Recordings", "/recordings"):
        if site.recordings is None:
            text("p", ONLY_READS).classes("empty")
            return
        _Recordings(site, site.recordings)


def _columns() -> dict[str, list[str]]:
    """Return the columns of each signal in the order of the form; an orientation has three possible forms."""
    columns = {"t": ["t"]}
    for name, names in COLUMNS_OF_SIGNAL.items():
        columns[name] = list(names)
        if name == "quat":
            columns |= {turn: list(angles) for turn, angles in TURNS.items()}
    return columns


class _Recordings:
    """One browser's view of the played recordings."""

    def __init__(self, site: Site, desk: RecordingDesk) -> None:
        self._site, self._desk = site, desk
        self._drop = RecordingDrop(
            self._shown(),
            self._ask,
            suffixes=list(SUFFIXES),
            megabytes=BYTES // MEGABYTE,
            columns=_columns(),
            units={name: list(known) for name, known in UNITS.items()},
            quantities={name: list(known) for name, known in UNITS_OF_QUANTITY.items()},
            sources=dict(WRENCH_SOURCE_WORDS),
            hands=list(HANDS_ON_ROBOT),
            frames=list(FORCE_FRAMES),
            robots=list(robot_names()),
            station=DEFAULT_STATION,
        )
        ui.timer(TICK_S, lambda: self._drop.show(self._shown()))

    def _shown(self) -> dict[str, Any]:
        world = self._site.gateway.world
        plays = [asdict(one) for one in self._desk.plays]
        return {"plays": plays, "stations": world.stations(), "trouble": world.trouble}

    async def _ask(self, event: GenericEventArguments) -> None:
        """Inspect a recording, or play it, without blocking other pages."""
        asked = event.args
        if not isinstance(asked, dict):
            return
        try:
            if asked.get("do") == "look":
                await self._look(str(asked.get("upload")))
            elif asked.get("do") == "play":
                request = {key: value for key, value in asked.items() if key != "do"}
                gateway = self._site.gateway
                await run.io_bound(self._desk.play, request, gateway.world.bridges, partial(_named, gateway))
                self._drop.answered("", failed=False)
            elif asked.get("do") == "drop":
                self._desk.drop(str(asked.get("upload")))
        except EditRefused as refused:
            self._drop.answered(str(refused), failed=True)

    async def _look(self, upload: str) -> None:
        """Show the questions about a recording; one that is refused is deleted."""
        try:
            found = await run.io_bound(self._desk.look, upload)
        except EditRefused:
            self._desk.drop(upload)
            raise
        named = f"s{datetime.now():%Y%m%d-%H%M%S}"
        self._drop.show_questions({**(found or {}), "session": named, "upload": upload})


def _named(gateway: NetworkFollower, station: str, session: str) -> str:
    """Return the session of this name as text; empty if the service and its journal have none."""
    if gateway.world.update(station, session) is None:
        with suppress(CaesuraError, ProtocolError):  # the service refuses a name that its journal has
            gateway.read_stored(station, session)
    found = gateway.world.update(station, session)
    if found is None:
        return ""
    stated = found.status.description
    name = f" '{stated.task}'" if stated.task else ""
    by = f" of {stated.operator}" if stated.operator else ""
    state = "has ended" if found.closed else "goes on"
    return f"a demonstration{name}{by}, which {state} after {length_words(found)}"


async def received(site: Site, upload: str, name: str, request: Request) -> Response:
    """Store a file that a browser uploads; a refusal is text that states why."""
    if site.recordings is None:
        return PlainTextResponse(ONLY_READS, status_code=403)
    try:
        path = site.recordings.begin_file(upload, name)
    except EditRefused as refused:
        return PlainTextResponse(str(refused), status_code=413)
    except OSError as error:
        return _not_stored(error)
    is_whole = False
    try:
        with path.open("xb") as file:
            async for part in request.stream():
                site.recordings.count(upload, len(part))
                await asyncio.to_thread(file.write, part)
        is_whole = True
    except EditRefused as refused:
        return PlainTextResponse(str(refused), status_code=413)
    except OSError as error:
        return _not_stored(error)
    finally:
        if not is_whole:  # also where the browser has gone away: half a file is no recording
            site.recordings.drop(upload)
    return Response(status_code=204)


def _not_stored(error: OSError) -> Response:
    return PlainTextResponse(f"The file cannot be stored: {error.strerror}.", status_code=507)
