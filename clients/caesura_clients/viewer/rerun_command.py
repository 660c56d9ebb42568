"""`caesura rerun`. The SDK is imported when the command runs, so that other commands start fast."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from caesura_clients.cli.connection_options import Config, Connect, OnlyStation
from caesura_clients.cli.options import connected, named, only_station, reported
from caesura_clients.cli.wait_diagnosis import print_wait_reason
from caesura_clients.viewer.wait_for_interrupt import wait_for_the_end
from caesura_protocol.package_version_and_extras import import_extra
from caesura_protocol.transport.transport_interface import QUERY_TIMEOUT_S

VIEWER = "rerun+http://127.0.0.1:9876/proxy"  # where `rerun` listens


def show_in_rerun(
    station: OnlyStation = None,
    viewer: Annotated[str, typer.Option(metavar="URL", help="Address of a running Rerun viewer.")] = VIEWER,
    save: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write an rrd file instead of showing the station in a viewer."),
    ] = None,
    endpoint: Connect = None,
    config: Config = None,
) -> None:
    """Show a station live in Rerun: signals, segments, changepoints, phases, program and path."""
    with reported():
        named(station)
        with import_extra("rerun", "caesura rerun"):
            from caesura_clients.viewer.feed import StationFeed  # noqa: PLC0415
            from caesura_clients.viewer.rerun_sink import RerunSink  # noqa: PLC0415
        with connected(endpoint, config, patient=True) as caesura:
            shown = only_station(caesura, station)
            print_wait_reason(caesura, shown)
            name = f"caesura {shown}"
            sink = RerunSink(name, file=save) if save is not None else RerunSink(name, viewer=viewer)
            with sink, StationFeed(caesura.transport, shown, sink) as feed:
                feed.wait_until_following(QUERY_TIMEOUT_S)
                typer.echo(f"{shown}: {save or viewer}; Ctrl-C ends it")
                wait_for_the_end()
