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
from caesura_service.config import DEFAULT_INSTANCE, DEFAULT_PRESET, ServiceConfig, journal_directory
from caesura_service.edge import NetworkError
from caesura_service.edge.network import DEFAULT_ENDPOINT
from caesura_service.journal import JournalError, JournalSettings
from caesura_service.journal.keeping import DAY_S, GB

logger = logging.getLogger(__name__)

IN_MEMORY = "memory"


def serve(
    listen: Annotated[str, typer.Option(help="Endpoint of the embedded router.")] = DEFAULT_ENDPOINT,
    connect: Annotated[str | None, typer.Option(help="Be client of this router instead.")] = None,
    instance: Annotated[str, typer.Option(help="Name of this instance.")] = DEFAULT_INSTANCE,
    preset: Annotated[str, typer.Option(help="Model where a session names none.")] = DEFAULT_PRESET,
    zenoh_config: Annotated[
        Path | None, typer.Option(help="zenoh json5 with certificates, users and access rules.")
    ] = None,
    journal: Annotated[
        str | None,
        typer.Option(
            metavar="DIR",
            help="Where sessions are kept, or memory: until the service ends. "
            "By default caesura in the user's state directory.",
        ),
    ] = None,
    journal_commit_s: Annotated[
        float, typer.Option(min=0.0, max=10.0, help="A record waits at most so long to be written.")
    ] = JournalSettings.commit_s,
    journal_days: Annotated[
        float, typer.Option(min=0.0, help="A session is kept so long after it was last touched.")
    ] = JournalSettings.age_s / DAY_S,
    journal_gb: Annotated[
        float, typer.Option(min=0.0, help="Past this size closed sessions go, oldest first.")
    ] = JournalSettings.size_bytes / GB,
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
            instance=instance,
            listen=listen,
            connect=connect,
            preset=preset,
            zenoh_config=zenoh_config,
            journal=_directory(journal),
            journal_settings=JournalSettings(
                commit_s=journal_commit_s, age_s=journal_days * DAY_S, size_bytes=round(journal_gb * GB)
            ),
        )
        run_service(config, ready=_announce)
    except (ProtocolError, NetworkError, JournalError) as error:
        typer.echo(f"caesura serve: {error}", err=True)
        raise typer.Exit(1) from error


def _directory(journal: str | None) -> Path | None:
    """None is in memory."""
    if journal is None:
        return journal_directory()
    return None if journal == IN_MEMORY else Path(journal)


def _announce(service: Service) -> None:
    config = service.config
    if config.journal_path is None:
        logger.info("the journal is in memory: a restart knows nothing of earlier sessions")
    else:
        logger.info("journal %s, written every %g s", config.journal_path, config.journal_settings.commit_s)
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
