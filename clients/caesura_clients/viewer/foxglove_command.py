"""`caesura foxglove`. The SDK is imported when the command runs, so that other commands start fast."""

from __future__ import annotations

from importlib.resources import files
from ipaddress import ip_address
from pathlib import Path
from typing import Annotated

import typer

from caesura_clients.cli.connection_options import Config, Connect, OnlyStation
from caesura_clients.cli.options import connected, named, only_station, reported
from caesura_clients.cli.wait_diagnosis import print_wait_reason
from caesura_clients.viewer.wait_for_interrupt import wait_for_the_end
from caesura_protocol.errors import CaesuraError
from caesura_protocol.package_version_and_extras import import_extra
from caesura_protocol.transport.transport_interface import QUERY_TIMEOUT_S

DEFAULT_PORT = 8765  # Foxglove's own
LAYOUT = "foxglove_layout.json"


def serve_foxglove(
    station: OnlyStation = None,
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port; 0 chooses a free one.")] = DEFAULT_PORT,
    insecure: Annotated[
        bool, typer.Option("--insecure", help="Show the station to every viewer that reaches --host.")
    ] = False,
    layout: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the layout for Foxglove, and end.")
    ] = None,
    endpoint: Connect = None,
    config: Config = None,
) -> None:
    """Show a station live in Foxglove: signals, segments, changepoints, phases, program and path."""
    with reported():
        if layout is not None:
            _write_layout(layout)
            return
        named(station)
        if not insecure and not _is_local(host):
            raise CaesuraError(
                f"--host {host}: other machines reach it, and a viewer needs no password; add --insecure on "
                "a network you trust, or a tunnel to 127.0.0.1"
            )
        with import_extra("foxglove", "caesura foxglove"):
            from caesura_clients.viewer.feed import StationFeed  # noqa: PLC0415
            from caesura_clients.viewer.foxglove_server import FoxgloveServer  # noqa: PLC0415
        with connected(endpoint, config, patient=True) as caesura:
            shown = only_station(caesura, station)
            print_wait_reason(caesura, shown)
            server = FoxgloveServer(f"caesura {shown}", host, port)
            feed = StationFeed(caesura.transport, shown, server)
            server.on_subscribe = feed.subscribed
            with server, feed:
                feed.wait_until_following(QUERY_TIMEOUT_S)
                address = f"[{host}]" if ":" in host else host
                typer.echo(f"{shown}: ws://{address}:{server.port}; Ctrl-C ends it")
                wait_for_the_end()


def _is_local(host: str) -> bool:
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _write_layout(out: Path) -> None:
    content = files("caesura_clients.viewer").joinpath(LAYOUT).read_bytes()
    try:
        out.write_bytes(content)
    except OSError as error:
        raise CaesuraError(f"cannot write {out}: {error.strerror}") from error
    typer.echo(f"{out}: in Foxglove, Layouts, Import from file")
