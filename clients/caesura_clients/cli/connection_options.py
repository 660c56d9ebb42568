"""Options of a connection, in a module of their own because the list of commands imports them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from caesura_protocol.transport.default_endpoint import DEFAULT_ENDPOINT, ENDPOINT_VARIABLE

Connect = Annotated[
    str | None,
    typer.Option(
        "--connect",
        envvar=ENDPOINT_VARIABLE,
        metavar="ENDPOINT",
        help=f"The service or its router; by default that of --zenoh-config, or {DEFAULT_ENDPOINT}.",
    ),
]
Config = Annotated[
    Path | None,
    typer.Option(
        "--zenoh-config",
        help="Zenoh configuration (json5): router, and certificates or a password.",
        exists=True,
        dir_okay=False,
    ),
]
Station = Annotated[str | None, typer.Option(help="Teaching station.")]
OnlyStation = Annotated[str | None, typer.Option(help="Teaching station; required if several have sessions.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]
