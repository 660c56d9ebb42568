"""Joining the network: as a router that robots connect to, or as a client of one that is already there.

Why the settings are as they are (measured, see ARCHITECTURE.md): multicast and gossip off, because a factory
network names its routers; shared memory off, because it raised the 99th percentile from 0.15 to 53 ms; a
lease of 2 s, because a frozen peer is otherwise noticed after 9.5 s; no scouting delay, because a router
that looks for nobody would still wait half a second before it answers.
"""

from __future__ import annotations

import json
import logging
import socket
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import zenoh

logger = logging.getLogger(__name__)

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
QUERY_TIMEOUT_S = 2.0
SETTINGS: Mapping[str, Any] = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "scouting/delay": 0,
    "transport/shared_memory/enabled": False,
    "transport/link/tx/lease": 2000,
    "queries_default_timeout": int(QUERY_TIMEOUT_S * 1000),
    "connect/retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2},
}
# One attempt to connect. Waiting inside the library hears no signal and no deadline.
ATTEMPT_MS = 500
_FREE_PORT = ":0"


class NetworkError(Exception):
    """The network could not be joined, or was left."""


@dataclass(frozen=True)
class NetworkSettings:
    """Where the service is found.

    listen: endpoint of the embedded router; port 0 takes a free one. connect: a router to be client of
    instead. config_file: zenoh json5 with certificates, users and access rules.
    """

    listen: str = DEFAULT_ENDPOINT
    connect: str | None = None
    config_file: Path | None = None
    connect_timeout_s: float | None = None  # None: until there is a router


def join(settings: NetworkSettings, stop: threading.Event) -> tuple[zenoh.Session, str]:
    """A zenoh session and the endpoint that it is reached by. Raises NetworkError, also once told to stop."""
    if settings.connect is None:
        endpoint = _with_port(settings.listen)
        router = {"mode": "router", "listen/endpoints": [endpoint]}
        return _open(_config(settings.config_file, router), endpoint), endpoint
    client = {
        "mode": "client",
        "connect/endpoints": [settings.connect],
        "connect/timeout_ms": ATTEMPT_MS,
        "connect/exit_on_failure": True,
    }
    return _connect(_config(settings.config_file, client), settings, stop), settings.connect


def _config(config_file: Path | None, where: Mapping[str, Any]) -> zenoh.Config:
    try:
        config = zenoh.Config.from_file(config_file) if config_file else zenoh.Config()
        for key, value in {**SETTINGS, **where}.items():
            config.insert_json5(key, json.dumps(value))
    except zenoh.ZError as error:
        raise NetworkError(f"zenoh configuration: {error}") from error
    return config


def _open(config: zenoh.Config, endpoint: str) -> zenoh.Session:
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise NetworkError(f"{endpoint}: {error}") from error


def _connect(config: zenoh.Config, settings: NetworkSettings, stop: threading.Event) -> zenoh.Session:
    """Try until there is a router, the time is over, or somebody says stop."""
    endpoint, patience_s = str(settings.connect), settings.connect_timeout_s
    deadline = float("inf") if patience_s is None else time.monotonic() + patience_s
    said = False
    while True:
        try:
            return _open(config, endpoint)
        except NetworkError:
            if stop.is_set() or time.monotonic() >= deadline:
                raise
        if not said:
            logger.warning("no router at %s yet: trying until there is one", endpoint)
            said = True


def _with_port(endpoint: str) -> str:
    """The endpoint with a free port in place of port 0."""
    if not endpoint.endswith(_FREE_PORT):
        return endpoint
    host = endpoint.removesuffix(_FREE_PORT).partition("/")[2]
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as probe:
        probe.bind((host.strip("[]"), 0))
        port: int = probe.getsockname()[1]
    return f"{endpoint.removesuffix(_FREE_PORT)}:{port}"
