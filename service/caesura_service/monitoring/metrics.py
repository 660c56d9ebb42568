"""The metrics for Prometheus, read from immutable states at each scrape: nothing is stored twice.

Labels are bounded. `station` takes at most as many values as the registry has stations (`Limits.stations`,
256 by default), `code` as many as the protocol has codes; no session name is a label. docs/operations.md
lists every metric; a test compares both lists.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass

from prometheus_client import CollectorRegistry, GCCollector, PlatformCollector, ProcessCollector
from prometheus_client.metrics_core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    InfoMetricFamily,
    Metric,
)
from prometheus_client.registry import Collector

from caesura_protocol.keys import ROOT
from caesura_protocol.messages import Budget, JournalReport, ServiceStatus, StationBudgets
from caesura_service.monitoring.instrumented_registry import InstrumentedRegistry
from caesura_service.monitoring.station_counters import StationCounters
from caesura_service.ownership.session_index import SessionIndex
from caesura_service.publishing.session_state import SessionState

Family = CounterMetricFamily | GaugeMetricFamily


@dataclass(frozen=True)
class MetricsSource:
    """The sources of the numbers; any thread may read them."""

    registry: InstrumentedRegistry
    status: Callable[[], ServiceStatus]
    is_ready: Callable[[], bool]  # has it joined the network, and can it be found?
    budgets: Callable[[str], StationBudgets]  # of a station
    router_fault: Callable[[], str | None] = lambda: None  # why its router does not work

    certificate_end: float | None = None  # [s since 1970] of what it shows

    @property
    def can_be_found(self) -> bool:
        """Whether the service has joined the network, and its router works."""
        return self.is_ready() and self.router_fault() is None


# (metric, help text, getter), of each station
OF_STATION: tuple[tuple[str, str, Callable[[StationCounters], float]], ...] = (
    ("caesura_batches", "Batches processed.", lambda one: one.batches),
    ("caesura_samples", "Samples processed.", lambda one: one.samples),
    ("caesura_observations", "Observations on the segmentation grid.", lambda one: one.observations),
    ("caesura_duplicates", "Duplicate batches, which are ignored.", lambda one: one.duplicates),
    ("caesura_repeats", "Samples ignored because their time did not advance.", lambda one: one.repeats),
    ("caesura_gaps", "Gaps declared in results.", lambda one: one.gaps),
    ("caesura_gap_seconds", "Session time that lies in gaps.", lambda one: one.gap_s),
    ("caesura_lost", "Batches declared lost, or refused; each is in a gap.", lambda one: one.lost),
    (
        "caesura_station_dropped",
        "Batches dropped because the queue was full; they are requested again.",
        lambda one: one.dropped,
    ),
    (
        "caesura_station_work_seconds",
        "Worker time spent on messages of the station.",
        lambda one: one.work_s,
    ),
    ("caesura_replays", "Requests to the bridge for missing batches.", lambda one: one.replays),
)

# of each station's current session
OF_SESSION: tuple[tuple[str, str, Callable[[SessionState], float]], ...] = (
    ("caesura_session_open", "1 while the current session is open.", lambda one: one.is_open),
    ("caesura_session_hypotheses", "Hypotheses of the run-length filter.", lambda one: one.view.hypotheses),
    ("caesura_session_segments", "Segments found.", lambda one: len(one.view.segments)),
    (
        "caesura_session_waiting",
        "1 while a missing batch is requested.",
        lambda one: one.is_open and one.waiting_for is not None,
    ),
)

OF_INSTANCE: tuple[tuple[type[Family], str, str, Callable[[ServiceStatus], float]], ...] = (
    (CounterMetricFamily, "caesura_messages", "Messages taken from the queue.", lambda one: one.messages),
    (
        CounterMetricFamily,
        "caesura_dropped",
        "Batches dropped because the queue was full; they are requested again.",
        lambda one: one.dropped,
    ),
    (
        GaugeMetricFamily,
        "caesura_overloaded",
        "1 while the instance is overloaded; set before a message is dropped.",
        lambda one: one.overloaded,
    ),
    (GaugeMetricFamily, "caesura_queue_messages", "Messages in the queue.", lambda one: one.queue),
    (
        GaugeMetricFamily,
        "caesura_queue_capacity_messages",
        "Capacity of the queue.",
        lambda one: one.queue_capacity,
    ),
)

CERTIFICATE_END = "End of the certificate that it presents, since 1970; none without one."
DISK_FREE = "Free space on the disk of the journal; none for a journal in memory."
OF_JOURNAL: tuple[tuple[str, str, Callable[[JournalReport], float]], ...] = (
    ("caesura_journal_bytes", "Size of all sessions in the journal.", lambda one: one.size),
    (
        "caesura_journal_limit_bytes",
        "Size beyond which closed sessions are deleted.",
        lambda one: one.size_limit,
    ),
    ("caesura_journal_waiting_bytes", "Records not yet written.", lambda one: one.waiting),
    (
        "caesura_journal_damaged_sessions",
        "Sessions whose results cannot be read, or that are set aside.",
        lambda one: len(one.damaged) + one.damaged_before,
    ),
    (
        "caesura_journal_trouble",
        "1 while the journal cannot be written.",
        lambda one: one.trouble is not None,
    ),
)


class ServiceCollector(Collector):
    """Makes every metric of Caesura from the current state."""

    def __init__(self, source: MetricsSource, clock: Callable[[], float] = time.monotonic) -> None:
        """clock: that of the counters [s]."""
        self._observed = source
        self._clock = clock

    def collect(self) -> Iterable[Metric]:
        """Yield every family of metrics, once for each scrape."""
        status, index = self._observed.status(), self._observed.registry.index
        yield _info(status)
        yield GaugeMetricFamily(
            "caesura_ready",
            "1 while it has joined the network and can be found.",
            self._observed.can_be_found,
        )
        yield _certificate_end(self._observed.certificate_end)
        for kind, name, help_text, of_status in OF_INSTANCE:
            yield kind(name, help_text, of_status(status))
        if status.journal is not None:
            for name, help_text, of_journal in OF_JOURNAL:
                yield GaugeMetricFamily(name, help_text, of_journal(status.journal))
            yield _disk_free(status.journal)
        yield _refused(status)
        yield from _sessions(status, index)
        yield from self._stations(index)
        yield from self._budgets(index)
        yield self._durations()

    def _stations(self, index: SessionIndex) -> Iterator[Metric]:
        counters, now = self._observed.registry.station_counters, self._clock()
        counted = counters.of_station
        for name, help_text, of_station in OF_STATION:
            values = {
                station: of_station(counted.get(station, StationCounters())) for station in index.sessions
            }
            yield _labelled(CounterMetricFamily(name, help_text, labels=["station"]), values)
        current = {state.station: state for state in index.newest_states()}
        for name, help_text, of_session in OF_SESSION:
            values = {station: of_session(state) for station, state in current.items()}
            yield _labelled(GaugeMetricFamily(name, help_text, labels=["station"]), values)
        ages = {
            station: now - (counted.get(station, StationCounters()).received_s or counters.started_s)
            for station, state in current.items()
            if state.is_open
        }
        help_text = "Time since the last batch of the open session, or since the start; none without one."
        yield _labelled(
            GaugeMetricFamily("caesura_last_batch_age_seconds", help_text, labels=["station"]), ages
        )
        yield GaugeMetricFamily(
            "caesura_worker_age_seconds",
            "Time since the worker's last cycle.",
            now - counters.stepped_s,
        )

    def _budgets(self, index: SessionIndex) -> Iterator[Metric]:
        labels = ["station", "budget"]
        used = GaugeMetricFamily(
            "caesura_budget_used_ratio", "Share of a station's budget that is used now.", labels=labels
        )
        refused = CounterMetricFamily(
            "caesura_budget_refused", "Messages refused because a budget was used up.", labels=labels
        )
        for station in sorted(index.sessions):
            for use, budget in self._observed.budgets(station):
                if isinstance(budget, Budget):
                    used.add_metric([station, use], budget.used / budget.at_once)
                    refused.add_metric([station, use], budget.refused)
        yield from (used, refused)

    def _durations(self) -> Metric:
        (family,) = self._observed.registry.station_counters.durations.collect()
        family.samples = [sample for sample in family.samples if not sample.name.endswith("_created")]
        return family


def metrics_of(source: MetricsSource) -> CollectorRegistry:
    """Return Caesura's metrics and the process': memory, processor time, open files, garbage."""
    registry = CollectorRegistry(auto_describe=False)
    registry.register(ServiceCollector(source))
    ProcessCollector(registry=registry)
    PlatformCollector(registry=registry)
    GCCollector(registry=registry)
    return registry


def _info(status: ServiceStatus) -> Metric:
    labels = {
        "instance_name": status.instance,  # `instance` is Prometheus' own
        "version": status.version,
        "protocol": ROOT,
        "journal": status.journal.kind if status.journal else "none",
    }
    return InfoMetricFamily("caesura", "Name and version of the instance.", labels)


def _disk_free(journal: JournalReport) -> Metric:
    family = GaugeMetricFamily("caesura_journal_disk_free_bytes", DISK_FREE)
    if journal.disk_free is not None:
        family.add_metric([], journal.disk_free)
    return family


def _certificate_end(end: float | None) -> Metric:
    family = GaugeMetricFamily("caesura_certificate_end_timestamp_seconds", CERTIFICATE_END)
    if end is not None:
        family.add_metric([], end)
    return family


def _refused(status: ServiceStatus) -> Metric:
    family = CounterMetricFamily("caesura_refused", "Messages refused.", labels=["code"])
    return _labelled(family, dict(status.refused.items()))


def _sessions(status: ServiceStatus, index: SessionIndex) -> Iterator[Metric]:
    family = GaugeMetricFamily("caesura_sessions", "Sessions that can be queried.", labels=["state"])
    yield _labelled(family, {"open": status.sessions_open, "closed": status.sessions_closed})
    yield GaugeMetricFamily("caesura_stations", "Stations with sessions here.", len(index.sessions))


def _labelled(family: Family, values: Mapping[str, float]) -> Metric:
    for label, value in sorted(values.items()):
        family.add_metric([label], value)
    return family
