"""Joins the network: as a router to which robots connect, or as a client of an existing router.

Reasons of the settings (the numbers are measured): multicast and gossip are off, because a factory
network names its routers. Shared memory is off, because it raised the 99th percentile from 0.15 to 53 ms. The
lease is 2 s, because a frozen peer is otherwise detected after 9.5 s. There is no scouting delay, because a
router that searches for no peer would still wait half a second before it answers. The defragmentation limit
is twice the largest accepted message, because a peer could otherwise make the service assemble one of a
gigabyte. Many pending connections and a long handshake time are allowed, because silent connections otherwise
block others (security/zenoh_files). The queue is long, because an answer with samples otherwise fills it, and
its end is lost.

An endpoint that other machines reach must require credentials, unless `insecure` is set.
"""

from __future__ import annotations

import errno
import json
import logging
import os
import resource
import socket
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import zenoh

from caesura_protocol.transport.default_endpoint import DEFAULT_ENDPOINT, endpoint_error
from caesura_protocol.transport.diagnosis import diagnose_connection, pem_of
from caesura_protocol.transport.zenoh_transport import reason
from caesura_service.security import exposure
from caesura_service.security.certificates import SecurityError, expiry
from caesura_service.security.zenoh_files import (
    ACCEPT_PENDING,
    BLOCKED_US,
    QUEUED_BATCHES,
    ROUTER_MAX_BYTES,
    with_handshake_timeout,
)
from caesura_service.server.network_interface import Network, NetworkError
from caesura_service.server.zenoh_network import ZenohNetwork

logger = logging.getLogger(__name__)

QUERY_TIMEOUT_S = 2.0
SETTINGS: Mapping[str, Any] = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "scouting/delay": 0,
    "transport/shared_memory/enabled": False,
    "transport/link/tx/lease": 2000,
    "transport/link/rx/max_message_size": ROUTER_MAX_BYTES,
    "transport/link/tx/queue/size/data": QUEUED_BATCHES,
    "transport/unicast/accept_pending": ACCEPT_PENDING,
    "queries_default_timeout": int(QUERY_TIMEOUT_S * 1000),
    "connect/retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2},
}
# A link whose peer hangs is closed once its lease ends, and that holds one of zenoh's threads for 10 s
# (SO_LINGER; zenoh issues 1101, 2718). It has two that read: three frozen dashboards kept every client
# waiting. Those that read also wait for what there is to read: else another one does, and wakes them for each
# message.
RUNTIME = "(rx: (worker_threads: 64), acc: (handover: rx), app: (handover: rx))"
# One attempt to connect. Waiting inside the library ends at no signal and no deadline.
ATTEMPT_MS = 500
_TAKEN = os.strerror(errno.EADDRINUSE)
_FREE_PORT = ":0"
OPEN_FILES = 65536  # as deploy/systemd/caesura.service has it
_PATHS = (
    "transport/auth/usrpwd/dictionary_file",
    *(
        f"transport/link/tls/{name}"
        for name in (
            "root_ca_certificate",
            "listen_certificate",
            "listen_private_key",
            "connect_certificate",
            "connect_private_key",
        )
    ),
)


@dataclass(frozen=True)
class NetworkSettings:
    """The endpoint and the credentials with which the service joins the network.

    listen: endpoint of the embedded router; port 0 takes a free one; None: as config_file says, else
    DEFAULT_ENDPOINT. connect: a router to be client of instead. config_file: zenoh json5 with certificates,
    users and access rules. insecure: listen without credentials where other machines reach it.
    """

    listen: str | None = None
    connect: str | None = None
    config_file: Path | None = None
    connect_timeout_s: float | None = None  # None: until there is a router
    insecure: bool = False


def certificate_end(settings: NetworkSettings) -> float | None:
    """Return the time [s since 1970] at which the instance's certificate expires.

    None without a readable one. Raises NetworkError for an invalid configuration file.
    """
    if settings.config_file is None:
        return None
    shown = "listen_certificate" if settings.connect is None else "connect_certificate"
    try:
        pem = pem_of(_reader(_config(settings.config_file)), shown)
        return expiry(pem).timestamp() if pem else None
    except (OSError, ValueError, SecurityError):
        return None  # Zenoh refuses it, and says so


Join = Callable[[NetworkSettings, threading.Event], tuple[Network, str]]  # returns a session and its endpoint


def join(settings: NetworkSettings, stop: threading.Event) -> tuple[ZenohNetwork, str]:
    """Return a session and its endpoint. Raises NetworkError, also once `stop` is set."""
    os.environ.setdefault("ZENOH_RUNTIME", RUNTIME)  # read when a process opens its first session
    config = _config(settings.config_file)
    if settings.connect is not None:
        _check_endpoint(settings.connect)
        session = _join_as_client(config, settings.connect, settings, stop)
        return ZenohNetwork(session), settings.connect
    _check_is_for_a_router(config, settings.config_file)
    endpoints = [_with_port(_check_endpoint(endpoint)) for endpoint in _endpoints(config, settings)]
    _check_exposure(endpoints, config, insecure=settings.insecure)
    own = {
        "mode": "router",
        "listen/endpoints": [with_handshake_timeout(one) for one in endpoints],
        "transport/link/tx/queue/congestion_control/block/wait_before_close": BLOCKED_US,
    }
    _insert(config, own)
    _allow_open_files()
    session = _open_session(config, ", ".join(endpoints))
    return ZenohNetwork(session), endpoints[0].partition("#")[0]


def lets_in(settings: NetworkSettings) -> bool:
    """Return whether the router accepts another session now, by one attempt. settings: of a client."""
    config = _config(settings.config_file)
    _insert(config, _as_client(settings.connect or DEFAULT_ENDPOINT))
    try:
        session = zenoh.open(config)
    except zenoh.ZError:
        return False
    session.close()  # type: ignore[no-untyped-call]
    return True


def _as_client(router: str) -> Mapping[str, Any]:
    return {
        "mode": "client",
        "connect/endpoints": [router],
        "connect/timeout_ms": ATTEMPT_MS,
        "connect/exit_on_failure": True,
    }


def _join_as_client(
    config: zenoh.Config, router: str, settings: NetworkSettings, stop: threading.Event
) -> zenoh.Session:
    _insert(config, _as_client(router))
    if not exposure.is_local(router) and exposure.presented_credentials(router, _reader(config)) == "nothing":
        logger.warning("%s is another machine, and no certificate or password is presented to it", router)
    return _connect(config, router, settings, stop)


def _config(file: Path | None) -> zenoh.Config:
    """Return the file's configuration with the service's settings.

    Relative paths are searched beside the file first.
    """
    try:
        config = zenoh.Config.from_file(file) if file else zenoh.Config()
        _insert(config, {**SETTINGS, **(_beside(file, _reader(config)) if file else {})})
    except zenoh.ZError as error:
        raise NetworkError(f"zenoh configuration {file or ''}: {reason(error)}") from error
    return config


def _insert(config: zenoh.Config, settings: Mapping[str, Any]) -> None:
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))


def _check_endpoint(endpoint: str) -> str:
    """Return the endpoint. Raises NetworkError if Zenoh can neither listen on it nor connect to it."""
    if (why := endpoint_error(endpoint)) is not None:
        raise NetworkError(why)
    return endpoint


def _reader(config: zenoh.Config) -> exposure.Read:
    def read(path: str) -> Any:
        try:
            return json.loads(config.get_json(path))
        except zenoh.ZError:
            return None  # not in this configuration

    return read


def _beside(file: Path, read: exposure.Read) -> dict[str, str]:
    found = {key: Path(read(key) or "") for key in _PATHS}
    return {
        key: str(file.parent / path)
        for key, path in found.items()
        if path.name and not path.is_absolute() and (file.parent / path).exists()
    }


def _check_is_for_a_router(config: zenoh.Config, file: Path | None) -> None:
    """Raise NetworkError for the file of a client, which does not state which clients may connect."""
    read = _reader(config)
    if read("mode") == "client":
        router = next(iter(read("connect/endpoints") or ()), "ENDPOINT")
        raise NetworkError(f"{file} is for a client: add --connect {router}, or take a router's file")


def _endpoints(config: zenoh.Config, settings: NetworkSettings) -> list[str]:
    """Return the endpoints to listen on: from the settings, else the file, else on this machine alone."""
    if settings.listen is not None:
        return [settings.listen]
    said, default = (_reader(one)("listen/endpoints") for one in (config, zenoh.Config()))
    if said == default:  # no file says anything
        return [DEFAULT_ENDPOINT]
    return (said.get("router") if isinstance(said, dict) else said) or [DEFAULT_ENDPOINT]


def _check_exposure(endpoints: Sequence[str], config: zenoh.Config, *, insecure: bool) -> None:
    """Raise NetworkError for an endpoint that would be open to every client, unless `insecure`."""
    read = _reader(config)
    for endpoint in endpoints:
        if exposure.is_local(endpoint):
            continue
        if exposure.required_credentials(endpoint, read) == "nothing" and not insecure:
            raise NetworkError(exposure.exposure_error(endpoint))
        for warning in exposure.exposure_warnings(endpoint, read):
            logger.warning("%s", warning)


def _open_session(config: zenoh.Config, endpoint: str) -> zenoh.Session:
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        why = _unreadable(config) or reason(error)
        advice = "; choose another, or end what uses it" if why == _TAKEN else ""
        raise NetworkError(f"{endpoint}: {why}{advice}") from error


def _unreadable(config: zenoh.Config) -> str | None:
    """Return the first file that cannot be read, with the reason: Zenoh does not name it."""
    for path in filter(None, map(_reader(config), _PATHS)):
        try:
            Path(path).read_bytes()
        except OSError as error:
            return f"{path}: {error.strerror}"
    return None


def _connect(
    config: zenoh.Config, endpoint: str, settings: NetworkSettings, stop: threading.Event
) -> zenoh.Session:
    """Connect to a router; retry until the time is over or `stop` is set."""
    patience_s = settings.connect_timeout_s
    deadline = float("inf") if patience_s is None else time.monotonic() + patience_s
    said = False
    while True:
        try:
            return _open_session(config, endpoint)
        except NetworkError as error:
            if stop.is_set():
                raise
            if time.monotonic() >= deadline:
                raise NetworkError(str(diagnose_connection(endpoint, _reader(config)))) from error
        if not said:
            logger.warning("%s; retrying until there is one", diagnose_connection(endpoint, _reader(config)))
            said = True


def _with_port(endpoint: str) -> str:
    """Return the endpoint with a free port instead of port 0."""
    place, mark, settings = endpoint.partition("#")
    if not place.endswith(_FREE_PORT):
        return endpoint
    host = place.removesuffix(_FREE_PORT).partition("/")[2]
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as probe:
        probe.bind((host.strip("[]"), 0))
        port: int = probe.getsockname()[1]
    return f"{place.removesuffix(_FREE_PORT)}:{port}{mark}{settings}"


def _allow_open_files() -> None:
    """Raise this process' limit of open files, to OPEN_FILES if it may: each silent connection uses one."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = OPEN_FILES if hard == resource.RLIM_INFINITY else min(hard, OPEN_FILES)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
