"""The system page: the state of the instances, the owner of each station, and losses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from caesura_protocol.messages import JournalReport, ServiceStatus

if TYPE_CHECKING:
    from caesura_clients.dashboard.station_summary import DashboardState
    from caesura_clients.session_state_reader import Update

Table = list[dict[str, Any]]


@dataclass(frozen=True)
class System:
    """Content of the system page: tables of instances and stations, and a short text on each fault."""

    instances: Table
    stations: Table
    warnings: tuple[str, ...]


def rates(
    before: Sequence[ServiceStatus], after: Sequence[ServiceStatus], seconds: float
) -> dict[str, float]:
    """Return the rate [messages/s] of each instance that both lists have, unless it was restarted.

    before, after: statuses that lie `seconds` apart.
    """
    counted = {(one.instance, one.epoch): one.messages for one in before}
    return {
        one.instance: (one.messages - counted[one.instance, one.epoch]) / seconds
        for one in after
        if (one.instance, one.epoch) in counted and seconds > 0.0
    }


def system(world: DashboardState) -> System:
    """Return the content of the page: instances, stations and warnings."""
    instances = [_instance(one, world.rates, one.instance in world.alive) for one in world.services]
    silent = world.alive - {one.instance for one in world.services}
    return System(instances, _stations(world), tuple(_warnings(world, silent)))


def _instance(status: ServiceStatus, known: Mapping[str, float], alive: bool) -> dict[str, Any]:
    return {
        "instance": status.instance,
        "state": "overloaded" if status.overloaded else "alive" if alive else "gone",
        "since": _time_of(status.epoch),
        "version": status.version,
        "sessions": f"{status.sessions_open} open, {status.sessions_closed} closed",
        "rate": f"{known[status.instance]:.0f}/s" if status.instance in known else "–",
        "queue": f"{status.queue} of {status.queue_capacity}",
        "dropped": str(status.dropped),
        "refused": ", ".join(f"{code} {count}" for code, count in status.refused.items()) or "0",
        "journal": _journal(status.journal),
    }


def _journal(report: JournalReport | None) -> str:
    if report is None:
        return "–"
    size = f"{report.kind}, {report.size / 1e6:.1f} MB of {report.size_limit / 1e9:.3g} GB"
    if report.disk_free is not None:
        size += f", {report.disk_free / 1e9:.3g} GB left on its disk"
    return f"{size}; {report.trouble}" if report.trouble else size


def _time_of(epoch: int) -> float:
    """Return the time of day [s] at which an epoch of the service began.

    An epoch is the clock's time then [ms], or a later number.
    """
    return epoch / 1000.0


def _stations(world: DashboardState) -> Table:
    rows: Table = []
    for station in world.stations():
        update = world.update(station)
        status = update.status if update else None
        rows.append(
            {
                "station": station,
                "owner": status.instance if status else "–",
                "since": _time_of(status.epoch) if status else None,
                "bridge": _bridge(world, station, update),
                "session": f"{status.session} ({status.state})" if status else "–",
                "samples": str(status.samples) if status else "0",
                "gaps": str(len(status.gaps) + status.gaps_before) if status else "0",
                "lost": str(status.lost) if status else "0",
                "dropped": str(status.dropped) if status else "0",
                "hypotheses": str(status.hypotheses) if status else "–",
            }
        )
    return rows


def _bridge(world: DashboardState, station: str, update: Update | None) -> str:
    """Return text on whether the bridge is connected; one that left after a normal end is not missing."""
    if station in world.bridges:
        return "connected"
    return "not connected" if update is None or update.closed else "gone"


def _warnings(world: DashboardState, silent: frozenset[str]) -> list[str]:
    said = [world.trouble] if world.trouble else []
    said += [f"instance {one.instance} is overloaded" for one in world.services if one.overloaded]
    said += [f"instance {name} is alive and does not answer" for name in sorted(silent)]
    for one in world.services:
        if one.journal is not None and one.journal.trouble:
            said.append(f"instance {one.instance} cannot write its journal: {one.journal.trouble}")
    return said
