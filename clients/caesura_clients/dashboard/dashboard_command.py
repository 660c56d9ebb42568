"""`caesura dashboard`. NiceGUI is imported when the command runs, so that other commands start fast."""

from __future__ import annotations

import signal
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from caesura_clients.cli.connection_options import Config, Connect
from caesura_clients.cli.options import reported
from caesura_protocol.errors import CaesuraError

DEFAULT_PORT = 8080
PASSWORD_LENGTH = 8  # at least


def dashboard(
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port to listen on.")] = DEFAULT_PORT,
    name: Annotated[
        list[str] | None, typer.Option(help="Host name in the requests of a reverse proxy; may be repeated.")
    ] = None,
    proxy: Annotated[
        list[str] | None,
        typer.Option(
            help="Address or network of a reverse proxy that states the client's address; may be repeated."
        ),
    ] = None,
    password_file: Annotated[
        Path | None,
        typer.Option(
            help="File whose first line is the password to log in with.", exists=True, dir_okay=False
        ),
    ] = None,
    insecure: Annotated[
        bool, typer.Option("--insecure", help="Admit every browser that reaches --host, without a password.")
    ] = False,
    read_only: Annotated[
        bool, typer.Option("--read-only", help="Show everything, and refuse every change.")
    ] = False,
    bridge_config: Annotated[
        Path | None,
        typer.Option(
            help="Zenoh configuration of a bridge, to play recordings; by default --zenoh-config.",
            exists=True,
            dir_okay=False,
        ),
    ] = None,
    endpoint: Connect = None,
    config: Config = None,
) -> None:
    """Show stations in a browser, with signals, segments and programs, and correct the results."""
    from caesura_clients.dashboard.background_connection import BackgroundConnection  # noqa: PLC0415
    from caesura_clients.dashboard.correction_requests import corrector  # noqa: PLC0415
    from caesura_clients.dashboard.demonstration_requests import DemonstrationDesk  # noqa: PLC0415
    from caesura_clients.dashboard.network_follower import NetworkFollower  # noqa: PLC0415
    from caesura_clients.dashboard.pages.layout import Site  # noqa: PLC0415
    from caesura_clients.dashboard.program_simulation import Simulator  # noqa: PLC0415
    from caesura_clients.dashboard.proxies import Proxies  # noqa: PLC0415
    from caesura_clients.dashboard.recordings import RecordingDesk  # noqa: PLC0415
    from caesura_clients.dashboard.server import Address, check_free, serve  # noqa: PLC0415

    with reported():
        address = Address(host, port, tuple(name or ()), _password(password_file), Proxies(proxy or ()))
        if not address.is_local and address.password is None and not insecure:
            raise CaesuraError(
                f"--host {host}: other machines reach it, and any visitor could correct programs; add "
                "--password-file, or a reverse proxy before 127.0.0.1, or --insecure on a network you trust"
            )
        check_free(address)
        with (
            BackgroundConnection(endpoint, config) as transport,
            NetworkFollower(transport, unconnected=transport.why_unconnected) as gateway,
            RecordingDesk(endpoint, bridge_config or config) as recordings,
            Simulator() as simulator,
        ):
            signal.signal(signal.SIGTERM, _interrupt)  # as Ctrl-C: links are closed
            with suppress(KeyboardInterrupt):
                site = (
                    Site(gateway, None)
                    if read_only
                    else Site(
                        gateway, corrector(transport), DemonstrationDesk(transport), recordings, simulator
                    )
                )
                serve(site, address)


def _interrupt(_number: int, _frame: object) -> None:
    raise KeyboardInterrupt


def _password(file: Path | None) -> str | None:
    if file is None:
        return None
    lines = file.read_text(encoding="utf-8").splitlines()
    if not lines or len(lines[0]) < PASSWORD_LENGTH:
        found = len(lines[0]) if lines else 0
        raise CaesuraError(
            f"{file}: the first line has {found} characters, expected {PASSWORD_LENGTH} at least"
        )
    return lines[0]
