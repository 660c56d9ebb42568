"""Connects pages, access control and web server.

NiceGUI has one application per process, so this runs once.
"""

from __future__ import annotations

import asyncio
import gc
import socket
from collections.abc import Iterable
from dataclasses import dataclass, field
from urllib.parse import urlsplit

from fastapi import HTTPException, Request, Response
from fastapi.exception_handlers import http_exception_handler
from fastapi.responses import PlainTextResponse, RedirectResponse
from nicegui import Client, app, background_tasks, core, ui
from starlette.exceptions import HTTPException as StarletteHTTPException

from caesura_clients.dashboard.access import LOOPBACK, AccessMiddleware
from caesura_clients.dashboard.compression import FileCompression, compressed
from caesura_clients.dashboard.dataset_download import MOST_SESSIONS, zipped_dataset
from caesura_clients.dashboard.log_throttle import bound_logs
from caesura_clients.dashboard.pages import error_pages, overview, recording_upload, session_list_and_system
from caesura_clients.dashboard.pages.compare import ComparePage
from caesura_clients.dashboard.pages.layout import ASSETS, Site
from caesura_clients.dashboard.pages.session import SessionPage
from caesura_clients.dashboard.proxies import Proxies
from caesura_clients.dashboard.signal_ring import as_bytes
from caesura_clients.dashboard.silent_connections import BoundedProtocol
from caesura_clients.dashboard.web_components import PACKAGE, WEB
from caesura_clients.refusal_words import refusal_words
from caesura_protocol.command_line_advice import on_page
from caesura_protocol.errors import CaesuraError, NotFound, ProtocolError
from caesura_protocol.keys import check_name, parse_samples_parameters
from caesura_protocol.programs.document import document
from caesura_protocol.programs.export_formats import WRITERS
from caesura_protocol.programs.program_gripper import with_gripper

DATASETS = "/datasets"
PROGRAMS = "/programs"
SAMPLES = "/samples"  # of sessions, for plots; the pages of sessions ask for them
REFUSED = {"malformed": 400, "unknown_session": 404, "forbidden": 403}  # others: try again
PREPARED = "/station/none"  # built before a browser asks: it has everything that a session's page has
FIRST_S = 1.0  # that a page waits for its sessions; after 3 s NiceGUI shows an error in its place
LOOK_S = 0.02  # between two looks whether the socket is bound
# A page that answers no ping for this long is dropped and loads itself again: what was typed into it is gone.
# The 2 s of NiceGUI are a short pause of a tablet.
STALL_S = 30.0
FAVICON = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 16 16"><rect width="16" height="16" rx="3" '
    'fill="#0b57a4"/><path d="M5 3v10M11 3v10" stroke="#fff" stroke-width="2.4"/></svg>'
)


@dataclass(frozen=True)
class Address:
    """The address at which the dashboard listens, and the hosts and visitors that it accepts.

    names: further host names, of a proxy for example. proxies: trusted to state the visitor's address.
    """

    host: str = "127.0.0.1"
    port: int = 8080
    names: tuple[str, ...] = ()
    password: str | None = None
    proxies: Proxies = field(default_factory=Proxies)

    @property
    def is_local(self) -> bool:
        """Return whether only this machine can reach the address."""
        return self.host in LOOPBACK

    @property
    def known_as(self) -> Iterable[str] | None:
        """Return the accepted hosts of requests; None for any, for a public address without `names`."""
        return (*LOOPBACK, self.host, *self.names) if self.is_local or self.names else None

    def url(self) -> str:
        """Return the URL of the dashboard for a browser on this machine."""
        host = {"0.0.0.0": "127.0.0.1", "::": "[::1]", "::1": "[::1]"}.get(self.host, self.host)
        return f"http://{host}:{self.port}/"


def check_free(address: Address) -> None:
    """Raise CaesuraError if the address cannot be bound, mostly because another process listens there."""
    family = socket.AF_INET6 if ":" in address.host else socket.AF_INET
    with socket.socket(family) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((address.host, address.port))
        except OSError as error:
            where = f"{address.host}:{address.port}"
            raise CaesuraError(f"{where}: {error.strerror or error}; choose another with --port") from error


def serve(site: Site, address: Address) -> None:
    """Serve the dashboard until the process is asked to end."""
    declare(site)
    run(address, prepared=PREPARED)


def run(address: Address, *, prepared: str | None = None) -> None:
    """Serve the declared pages behind the access control, until the process is asked to end.

    prepared: path of a page that is built before a browser asks.
    """
    bound_logs()
    modules = [(PACKAGE, path.relative_to(WEB).as_posix()) for path in WEB.rglob("*.js")]
    app.add_middleware(
        FileCompression, paths=(f"{ASSETS}/", "/_nicegui/"), prepared=prepared, modules=modules
    )
    app.add_middleware(
        AccessMiddleware, names=address.known_as, password=address.password, proxies=address.proxies
    )
    app.on_startup(lambda: setattr(core.sio.eio, "ping_timeout", STALL_S))
    app.on_startup(gc.freeze)  # looking through what is loaded by now would hold up every page
    app.on_startup(lambda: background_tasks.create(_announce(address), name="announce"))
    ui.run(
        host=address.host,
        port=address.port,
        title="Caesura",
        favicon=FAVICON,
        language="en-US",
        dark=False,
        reload=False,
        show=False,
        tailwind=False,
        show_welcome_message=False,
        gzip_middleware_factory=None,  # see FileCompression
        message_history_length=0,
        reconnect_timeout=5.0,
        proxy_headers=False,  # uvicorn trusts all of this machine: see Proxies
        http=BoundedProtocol,
    )


async def _announce(address: Address) -> None:
    """Print the URL once the socket is bound, which is after the application's start."""
    url = urlsplit(address.url())
    while True:
        try:
            _, writer = await asyncio.open_connection(url.hostname, url.port)
        except OSError:
            await asyncio.sleep(LOOK_S)
        else:
            writer.close()
            print(f"ready: {address.url()}", flush=True)
            return


def declare(site: Site) -> None:
    """Declare every page by its path, and the files that pages load."""
    app.add_static_files(ASSETS, WEB)
    app.add_exception_handler(404, _not_found)
    declare_files(site)

    @ui.page("/")
    def _overview() -> None:
        overview.build(site)

    @ui.page("/station/{station}")
    def _station(station: str) -> None:
        SessionPage(site, _checked(station, "station"), None)

    @ui.page("/sessions")
    def _sessions() -> None:
        session_list_and_system.build_sessions(site)

    @ui.page("/sessions/{station}/{session}")
    async def _session(station: str, session: str) -> None:
        was_read = await _read_at_first(site, _names(station, session))
        SessionPage(site, station, session, was_read=was_read)

    @ui.page("/compare")
    async def _compare(first: str = "", second: str = "") -> RedirectResponse | None:
        if not (first and second):
            return RedirectResponse("/sessions")  # where both are chosen
        named = _named(first), _named(second)
        await _read_at_first(site, *named)
        ComparePage(site, *named)
        return None

    @ui.page("/recordings")
    def _recordings() -> None:
        recording_upload.build(site)

    @ui.page("/system")
    def _system() -> None:
        session_list_and_system.build_system(site)


def declare_files(site: Site) -> None:
    """Declare the routes that pages read and send beside their content.

    They are samples, programs as files, data sets and recordings.
    """

    @app.get(f"{SAMPLES}/{{station}}/{{session}}")
    async def _samples(station: str, session: str, request: Request) -> Response:
        wanted = ";".join(f"{key}={value}" for key, value in request.query_params.items())
        named, is_exact = _names(station, session), "exact" in request.query_params
        accepted = request.headers.get("accept-encoding", "")
        return await asyncio.to_thread(lambda: compressed(_signals(site, *named, wanted, is_exact), accepted))

    @app.get(f"{PROGRAMS}/{{station}}/{{session}}/{{name}}")
    async def _program(
        station: str, session: str, name: str, request: Request, gripper: str | None = None
    ) -> Response:
        named = _names(station, session)
        answer = await asyncio.to_thread(_exported, site, *named, name, gripper)
        return _shown(request, answer, f"/sessions/{station}/{session}")

    @app.get(DATASETS)
    async def _dataset(request: Request) -> Response:
        named = [_named(one) for one in request.query_params.getlist("session")]
        await _read(site, *named)
        return _shown(request, await asyncio.to_thread(_zip_file, site, named), "/sessions")

    @app.put(f"{recording_upload.UPLOADS}/{{upload}}/{{name:path}}")
    async def _upload(upload: str, name: str, request: Request) -> Response:
        return await recording_upload.received(site, upload, name, request)


async def _not_found(request: Request, error: Exception) -> Response:
    """Return a page with the menu; for other resources only the reason."""
    assert isinstance(error, StarletteHTTPException)
    if request.url.path.startswith((ASSETS, DATASETS, SAMPLES, PROGRAMS, recording_upload.UPLOADS)):
        return await http_exception_handler(request, error)
    with Client(ui.page(""), request=request) as client:
        error_pages.build(request.url.path, error.detail)
    return client.build_response(request, 404)


def _shown(request: Request, answer: Response, back: str) -> Response:
    """Return the response; for a browser a refusal becomes a page. back: the page to which it links."""
    if answer.status_code < 400 or "text/html" not in request.headers.get("accept", ""):
        return answer
    with Client(ui.page(""), request=request) as client:
        error_pages.build_refusal(bytes(answer.body).decode(), back)
    return client.build_response(request, answer.status_code)


def _signals(site: Site, station: str, session: str, parameters: str, is_exact: bool = False) -> Response:
    """Return the samples of a session for its plots; a refusal as text that states why.

    is_exact: from the journal, in bins of the requested width.
    """
    try:
        wanted = parse_samples_parameters(parameters)
        read = site.gateway.journal_samples if is_exact else site.gateway.samples
        content = as_bytes(read(station, session, wanted))
    except ProtocolError as error:
        return PlainTextResponse(str(error), status_code=REFUSED.get(error.code, 503))
    except CaesuraError as error:
        return PlainTextResponse(str(error), status_code=404 if isinstance(error, NotFound) else 503)
    return Response(content, media_type="application/octet-stream", headers={"cache-control": "no-store"})


def _exported(site: Site, station: str, session: str, name: str, gripper: str | None) -> Response:
    """Return the program of a session as a file in a format; a refusal as text that states why."""
    update = site.gateway.world.update(station, session)
    if update is None or name not in WRITERS:
        why = f"no program {station}/{session} in format {name!r}; formats: {', '.join(WRITERS)}"
        return PlainTextResponse(why, status_code=404)
    try:
        program = with_gripper(document(update.program, phases=update.phases), gripper)
        content = WRITERS[name].write(program)
    except (ValueError, CaesuraError) as error:
        why = on_page(str(error))
        return PlainTextResponse(f"{station}/{session} cannot be written: {why}", status_code=409)
    file = f'attachment; filename="{station}.{session}{WRITERS[name].suffix}"'
    return Response(content, media_type="text/plain; charset=utf-8", headers={"content-disposition": file})


def _zip_file(site: Site, named: list[tuple[str, str]]) -> Response:
    """Return sessions as a LeRobot dataset; a refusal as text that states why."""
    if not 1 <= len(named) <= MOST_SESSIONS:
        why = (
            f"{len(named)} sessions for a dataset, expected 1 to {MOST_SESSIONS}: filter the list of sessions"
        )
        return PlainTextResponse(why, status_code=409)
    try:
        content = zipped_dataset(site.gateway, named)
    except (CaesuraError, ProtocolError) as error:
        return PlainTextResponse(f"no dataset was written: {error}", status_code=409)
    name = ".".join(named[0]) if len(named) == 1 else f"{len(named)}-sessions"
    headers = {"content-disposition": f'attachment; filename="{name}-lerobot.zip"'}
    return Response(content, media_type="application/zip", headers=headers)


async def _read_at_first(site: Site, *named: tuple[str, str]) -> bool:
    """Read stored sessions for a page; return whether the service has answered.

    The page is built after FIRST_S in any case, and reads them again.
    """
    reading = background_tasks.create(_read(site, *named))
    await asyncio.wait([reading], timeout=FIRST_S)
    return reading.done() and reading.result()


async def _read(site: Site, *named: tuple[str, str]) -> bool:
    """Read stored sessions that are no longer in memory, such as that of a bookmark.

    Return whether the service has answered for each.
    """
    is_answered = True
    for station, session in named:
        if site.gateway.world.update(station, session) is None:
            try:
                await asyncio.to_thread(site.gateway.read_stored, station, session)
            except (CaesuraError, ProtocolError):
                is_answered = False
    return is_answered


def _named(session: str) -> tuple[str, str]:
    """Return the station and session of a text `station/session`."""
    station, _, name = session.partition("/")
    return _names(station, name)


def _names(station: str, session: str) -> tuple[str, str]:
    return _checked(station, "station"), _checked(session, "session")


def _checked(name: str, what: str) -> str:
    try:
        return check_name(name, what)
    except ProtocolError as error:
        raise HTTPException(404, refusal_words(error)) from error
