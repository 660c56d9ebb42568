"""Counters of each station since the start of the process.

The registry's thread counts, and any thread reads: a number is only replaced by a greater one. Counters are
updated in place, because they change fifty times a second for each station. The counters of a station that
this instance no longer has are dropped, so there are never more than the registry has stations.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import dataclass

from prometheus_client import Histogram

from caesura_protocol.messages import Gap, SampleBatch
from caesura_service.monitoring.registry_call_effects import Change, RegistryCall
from caesura_service.publishing.events import RequestReplay
from caesura_service.publishing.session_state import SessionCounters
from caesura_service.segmentation.pipeline_interface import PipelineView

BUCKETS_S = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5)


@dataclass(slots=True)
class StationCounters:
    """Counts of one station. received_s: time of arrival of its last batch [s, the counter's clock]."""

    batches: int = 0
    samples: int = 0
    observations: int = 0
    duplicates: int = 0
    repeats: int = 0
    gaps: int = 0
    gap_s: float = 0.0
    lost: int = 0  # batches
    dropped: int = 0  # batches
    replays: int = 0
    work_s: float = 0.0  # of the thread that does the work
    received_s: float | None = None

    def add(self, change: Change) -> None:
        """Add the difference of a change. A session taken over unchanged adds nothing."""
        before, after = change.before, change.after
        if before is None or after is None:
            return
        if after.counters is not before.counters:
            self._add_tally(before.counters, after.counters)
        if after.view is not before.view:
            self._add_view(before.view, after.view)

    def _add_tally(self, old: SessionCounters, new: SessionCounters) -> None:
        self.batches += _grown(old.batches, new.batches)
        if new[1:] != old[1:]:
            self.duplicates += _grown(old.duplicates, new.duplicates)
            self.lost += _grown(old.lost, new.lost)
            self.dropped += _grown(old.dropped, new.dropped)

    def _add_view(self, old: PipelineView, new: PipelineView) -> None:
        self.samples += _grown(old.samples, new.samples)
        self.repeats += _grown(old.repeats, new.repeats)
        self.observations += _grown(old.observations, new.observations)
        if new.gaps is not old.gaps:
            fresh = new.gaps[len(old.gaps) :]
            self.gaps += len(fresh)
            self.gap_s += _seconds(fresh)


class StationCounterSet:
    """Counts the calls of the registry by station."""

    def __init__(self, began: float) -> None:
        """began: start of the process [s]."""
        self.started_s = began
        self.stepped_s = began  # [s] when the registry's thread was last called
        self.durations = Histogram(
            "caesura_batch_seconds",
            "Work on a batch, from queue to results.",
            registry=None,
            buckets=BUCKETS_S,
        )
        self._of_station: dict[str, StationCounters] = {}

    @property
    def of_station(self) -> Mapping[str, StationCounters]:
        """The current counters of each station, by station."""
        return dict(self._of_station)

    def count_batch(self, station: str, stations: Container[str], duration_s: float, now: float) -> None:
        """Count a batch that changed only the number of batches. now: [s]."""
        self.stepped_s = now
        self.durations.observe(duration_s)
        self._counters(station, stations).received_s = now

    def add_work(self, station: str, stations: Container[str], seconds: float) -> None:
        """Add the work time [s] of a station."""
        if station in stations:
            self._counters(station, stations).work_s += seconds

    def count_call(self, call: RegistryCall, stations: Container[str], now: float) -> None:
        """Count a call. stations: those of the registry; now: [s]."""
        self.stepped_s = now
        if isinstance(call.message, SampleBatch):
            for _ in range(call.batches):
                self.durations.observe(call.duration_s / call.batches)
        for output in call.outputs:
            if isinstance(output, RequestReplay) and output.station in stations:
                self._counters(output.station, stations).replays += 1
        if call.station is not None and call.station in stations:
            self._count(call.station, call, stations, now)

    def _count(self, station: str, call: RegistryCall, stations: Container[str], now: float) -> None:
        counted = self._counters(station, stations)
        for change in call.changes:
            counted.add(change)
        if isinstance(call.message, SampleBatch) and not call.refused:
            counted.received_s = now

    def _counters(self, station: str, stations: Container[str]) -> StationCounters:
        """Return the counters of a station; a new station first removes those of stations that have left."""
        if station not in self._of_station:
            self._of_station = {name: one for name, one in self._of_station.items() if name in stations}
            self._of_station[station] = StationCounters()
        return self._of_station[station]


def _grown(before: int, after: int) -> int:
    return after - before if after > before else 0


def _seconds(gaps: tuple[Gap, ...]) -> float:
    return sum(gap.tn - gap.t0 for gap in gaps)
