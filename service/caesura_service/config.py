"""Settings of an instance of the service. Each has a default that works on one host."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path

from caesura_protocol.keys import check_name
from caesura_protocol.transport.default_endpoint import endpoint_error
from caesura_service.journal import JournalSettings
from caesura_service.server.network_interface import NetworkError
from caesura_service.server.network_join import NetworkSettings
from caesura_service.server.rate_limit_settings import RateLimits
from caesura_service.server.work_queue import QueueSettings
from caesura_service.sessions.limits import Limits

DEFAULT_INSTANCE = "caesura-1"
DEFAULT_PRESET = "default"


def journal_directory() -> Path:
    """Return the default directory of journals: `$XDG_STATE_HOME/caesura`, or `~/.local/state/caesura`."""
    state = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(state) / "caesura"


def journal_path(directory: Path, instance: str) -> Path:
    """Return the file of an instance's journal."""
    return directory / f"{instance}.sqlite"


@dataclass(frozen=True)
class ServiceConfig:
    """The settings of an instance. Raises ProtocolError for an invalid name, NetworkError for an endpoint.

    journal: the directory of the instance's journal, which instances on one router and one machine share;
    None keeps it in memory.
    """

    instance: str = DEFAULT_INSTANCE
    listen: str | None = None  # port 0: a free one; None: as zenoh_config says, else on this machine
    connect: str | None = None  # a router to be client of, in place of being one
    insecure: bool = False  # listen without credentials where other machines reach it
    connect_timeout_s: float | None = None
    zenoh_config: Path | None = None  # json5 with certificates, users and access rules
    preset: str = DEFAULT_PRESET
    limits: Limits = field(default_factory=Limits)
    queue: QueueSettings = field(default_factory=QueueSettings)
    rates: RateLimits = field(default_factory=RateLimits)
    journal: Path | None = None
    journal_settings: JournalSettings = field(default_factory=JournalSettings)
    metrics: str | None = None  # host:port of the page for Prometheus and probes; port 0: a free one

    def __post_init__(self) -> None:
        check_name(self.instance, "instance")
        check_name(self.preset, "preset")
        for endpoint in (self.listen, self.connect):
            if endpoint is not None and (why := endpoint_error(endpoint)) is not None:
                raise NetworkError(why)

    @property
    def network(self) -> NetworkSettings:
        """The settings with which the service joins the network."""
        return NetworkSettings(
            listen=self.listen,
            connect=self.connect,
            config_file=self.zenoh_config,
            connect_timeout_s=self.connect_timeout_s,
            insecure=self.insecure,
        )

    @property
    def journal_path(self) -> Path | None:
        """The file of this instance's journal; None for a journal in memory."""
        return None if self.journal is None else journal_path(self.journal, self.instance)
