"""`caesura serve`: runs the service until a signal ends it."""

from __future__ import annotations

import logging
import sys
import threading
import time
from pathlib import Path
from typing import Annotated

import typer

from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import NAME_WORDS, check_name, is_name
from caesura_protocol.transport.default_endpoint import DEFAULT_ENDPOINT
from caesura_protocol.transport.diagnosis import CERTIFICATE_WARNS_S
from caesura_service.app import Service, run_service, stopping
from caesura_service.changepoint.presets import PRESETS
from caesura_service.commands.supervisor import (
    LEAVES_WITH_STDIN,
    SILENCE_S,
    InstanceError,
    beating,
    credentials_of,
    metrics_of,
    names_of,
    passed_on,
    run_instances,
)
from caesura_service.config import DEFAULT_INSTANCE, DEFAULT_PRESET, ServiceConfig, journal_directory
from caesura_service.journal import JournalError, JournalSettings
from caesura_service.journal.retention import DAY_S, GB
from caesura_service.monitoring.http_server import WebError
from caesura_service.monitoring.logs import LEVELS, LOG_FORMATS, UnknownOption, log_to
from caesura_service.server import NetworkError

logger = logging.getLogger(__name__)

IN_MEMORY = "memory"
ROUTER = "router"  # what starts several instances calls itself in the log
# Options that differ between instances, or that concern only the router.
OF_EACH = (
    "listen",
    "connect",
    "instance",
    "instances",
    "instance_silence_s",
    "insecure",
    "zenoh_config",
    "metrics",
)


def serve(
    context: typer.Context,
    listen: Annotated[
        str | None,
        typer.Option(
            help=f"Endpoint of the embedded router; by default that of --zenoh-config, or {DEFAULT_ENDPOINT}."
        ),
    ] = None,
    connect: Annotated[
        str | None, typer.Option(help="Connect to this router instead of embedding one.")
    ] = None,
    instance: Annotated[str, typer.Option(help="Name of this instance.")] = DEFAULT_INSTANCE,
    instances: Annotated[
        int,
        typer.Option(
            min=1,
            max=64,
            help="Number of processes that share the stations. They are named NAME-1, NAME-2, …; each has a "
            "service.NAME-1.json5 beside --zenoh-config, and its own --metrics port, from PORT on.",
        ),
    ] = 1,
    instance_silence_s: Annotated[
        float,
        typer.Option(
            min=5.0, help="Kill and restart an instance that has sent no heartbeat for so many seconds."
        ),
    ] = SILENCE_S,
    preset: Annotated[str, typer.Option(help="Preset of sessions that name none.")] = DEFAULT_PRESET,
    zenoh_config: Annotated[
        Path | None, typer.Option(help="Zenoh configuration (json5): certificates, users and access rules.")
    ] = None,
    insecure: Annotated[
        bool,
        typer.Option(
            "--insecure", help="Listen without credentials on an address that other machines reach."
        ),
    ] = False,
    journal: Annotated[
        str | None,
        typer.Option(
            metavar="DIR",
            help="Directory of the journal, by default caesura in the user's state directory. `memory` in "
            "its place keeps sessions only until the service ends.",
        ),
    ] = None,
    journal_commit_s: Annotated[
        float, typer.Option(min=0.0, max=10.0, help="Longest time \\[s] until a record is on disk.")
    ] = JournalSettings.commit_s,
    journal_days: Annotated[
        float,
        typer.Option(
            min=1.0,  # below it an open session would be deleted in a pause of the robot
            help="Days for which a session is kept after its last change. A pause of over a week without any "
            "record counts as a week.",
        ),
    ] = JournalSettings.age_s / DAY_S,
    journal_gb: Annotated[
        float,
        typer.Option(
            min=0.01,
            help="Size \\[GB] beyond which the oldest closed sessions are deleted. It also limits the open "
            "sessions of each station.",
        ),
    ] = JournalSettings.size_bytes / GB,
    metrics: Annotated[
        str | None,
        typer.Option(
            metavar="HOST:PORT",
            help="Address of /metrics for Prometheus, and of /healthz and /readyz; port 0: a free one.",
        ),
    ] = None,
    log_level: Annotated[
        str, typer.Option(help=f"Least severe level that is logged: {', '.join(LEVELS)}.")
    ] = "info",
    log_format: Annotated[str, typer.Option(help=f"Format of log lines: {', '.join(LOG_FORMATS)}.")] = "text",
    leave_with_stdin: Annotated[bool, typer.Option(LEAVES_WITH_STDIN, hidden=True)] = False,
) -> None:
    """Segment what bridges publish, until SIGINT or SIGTERM.

    Prints one line with the endpoint once the service can be found; logs go to stderr.
    """
    _log_to_stderr(log_level, log_format, instance if instances == 1 else ROUTER)
    if not is_name(instance):
        raise typer.BadParameter(f"{instance!r}, expected {NAME_WORDS}", param_hint="--instance")
    if preset not in PRESETS:
        raise typer.BadParameter(f"{preset!r}, known: {', '.join(sorted(PRESETS))}", param_hint="--preset")
    if listen is not None and connect is not None:
        why = f"{listen!r} beside --connect {connect!r}: a client listens nowhere, state one of them"
        raise typer.BadParameter(why, param_hint="--listen")
    try:
        config = ServiceConfig(
            instance=instance,
            listen=listen,
            connect=connect,
            insecure=insecure,
            preset=preset,
            zenoh_config=zenoh_config,
            journal=_directory(journal),
            metrics=metrics,
            journal_settings=JournalSettings(
                commit_s=journal_commit_s, age_s=journal_days * DAY_S, size_bytes=round(journal_gb * GB)
            ),
        )
        with stopping(with_stdin=leave_with_stdin) as over:
            if instances > 1:
                _run_instances(context, config, instances, over, instance_silence_s)
            elif leave_with_stdin:
                _run_one_of_several(config, over)
            else:
                run_service(config, ready=_announce, over=over)
    except (ProtocolError, NetworkError, JournalError, WebError, InstanceError) as error:
        typer.echo(f"caesura serve: {error}", err=True)
        raise typer.Exit(1) from error


def _run_one_of_several(config: ServiceConfig, over: threading.Event) -> None:
    running: list[Service] = []

    def ready(service: Service) -> None:
        running.append(service)
        _announce(service)

    with beating(lambda: all(service.is_alive for service in running)):
        run_service(config, ready=ready, over=over)


def _run_instances(
    context: typer.Context, config: ServiceConfig, count: int, over: threading.Event, silence_s: float
) -> None:
    names = names_of(config.instance, count, DEFAULT_INSTANCE)
    same = passed_on(context, but=OF_EACH)

    def options(place: int, name: str) -> list[str]:
        return [*same, *credentials_of(config.zenoh_config, name), *metrics_of(config.metrics, place)]

    def ready(endpoint: str) -> None:
        print(f"caesura ready at {endpoint} as {', '.join(names)}", flush=True)

    for name in names:
        check_name(name, "instance")
    run_instances(names, config.network, options, over, ready, silence_s=silence_s)


def _directory(journal: str | None) -> Path | None:
    """Return the directory of the journal; None for a journal in memory."""
    if journal is None:
        return journal_directory()
    return None if journal == IN_MEMORY else Path(journal)


def _announce(service: Service) -> None:
    config = service.config
    if config.journal_path is None:
        logger.info("the journal is in memory: a restart loses earlier sessions")
    else:
        logger.info("journal %s, written every %g s", config.journal_path, config.journal_settings.commit_s)
    end = service.certificate_end
    if end is not None and end - time.time() < CERTIFICATE_WARNS_S:
        remedy = "renew it between demonstrations (caesura certs DIR --renew): every link ends with it"
        logger.warning("the certificate ends on %s: %s", time.strftime("%F", time.gmtime(end)), remedy)
    if service.web is not None:
        logger.info("metrics at %s/metrics", service.web.url)
    print(f"caesura ready at {service.endpoint} as {service.config.instance}", flush=True)


def _log_to_stderr(level: str, log_format: str, instance: str) -> None:
    try:
        log_to(sys.stderr, level=level, log_format=log_format, instance=instance)
    except UnknownOption as error:
        raise typer.BadParameter(str(error), param_hint=error.option) from error
