"""`caesura serve`: the service, until it is told to stop."""

from __future__ import annotations

import logging
import sys
from pathlib import Path
from typing import Annotated

import typer

from caesura_protocol.errors import ProtocolError
from caesura_service.app import Service, run_service
from caesura_service.changepoint.presets import PRESETS
from caesura_service.config import DEFAULT_INSTANCE, DEFAULT_PRESET, ServiceConfig
from caesura_service.edge import NetworkError
from caesura_service.edge.network import DEFAULT_ENDPOINT


def serve(
    listen: Annotated[str, typer.Option(help="Endpoint of the embedded router.")] = DEFAULT_ENDPOINT,
    connect: Annotated[str | None, typer.Option(help="Be client of this router instead.")] = None,
    instance: Annotated[str, typer.Option(help="Name of this instance.")] = DEFAULT_INSTANCE,
    preset: Annotated[str, typer.Option(help="Model where a session names none.")] = DEFAULT_PRESET,
    zenoh_config: Annotated[
        Path | None, typer.Option(help="zenoh json5 with certificates, users and access rules.")
    ] = None,
    log_level: Annotated[str, typer.Option(help="debug, info, warning or error.")] = "info",
) -> None:
    """Segment what bridges publish, until SIGINT or SIGTERM.

    Prints one line with the endpoint once the service can be found; logs go to stderr.
    """
    _log_to_stderr(log_level)
    if preset not in PRESETS:
        raise typer.BadParameter(f"{preset!r}, known: {', '.join(sorted(PRESETS))}", param_hint="--preset")
    try:
        config = ServiceConfig(
            instance=instance, listen=listen, connect=connect, preset=preset, zenoh_config=zenoh_config
        )
        run_service(config, ready=_announce)
    except (ProtocolError, NetworkError) as error:
        typer.echo(f"caesura serve: {error}", err=True)
        raise typer.Exit(1) from error


def _announce(service: Service) -> None:
    print(f"caesura ready at {service.endpoint} as {service.config.instance}", flush=True)


def _log_to_stderr(level: str) -> None:
    levels = logging.getLevelNamesMapping()
    if level.upper() not in levels:
        raise typer.BadParameter(f"{level!r}, known: debug, info, warning, error", param_hint="--log-level")
    logging.basicConfig(
        stream=sys.stderr,
        level=levels[level.upper()],
        format="%(asctime)s %(levelname)s %(name)s: %(message)s",
    )
