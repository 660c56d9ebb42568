"""The summary of each row over all demonstrations."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

from caesura_lab.evaluation.thesis.reference_segments import ROWS, ThesisRow
from caesura_lab.evaluation.thesis.suite import MAIN, Result
from caesura_lab.evaluation.thesis.table_row_comparison import RowOutcome

PASSES = 0.9  # of the seeds


@dataclass(frozen=True)
class Delay:
    """One boundary online: the share of seeds that show it, and the median delay [s], None if none does."""

    shown: float
    median_s: float | None


@dataclass(frozen=True)
class Summary:
    """One row in one setting.

    share: of the seeds, the row came out; segments: the median number; faults: what differs, with the number
    of seeds, the most frequent first; values: medians, as the row's; contact_s, others_s: pooled median
    delays of changes of contact and of all other boundaries.
    """

    row: ThesisRow
    seeds: int
    share: float
    segments: float
    faults: tuple[tuple[str, int], ...]
    values: tuple[float, ...]
    delays: tuple[Delay, ...]
    contact_s: float | None
    others_s: float | None
    cycle_ms: float | None

    @property
    def passes(self) -> bool:
        """Whether the row is reproduced: often enough, and soon enough where it is online."""
        row = self.row
        soon = (self.contact_s or 0.0) <= row.contact_within_s and (
            self.others_s or 0.0
        ) <= row.others_within_s
        return self.share >= PASSES and soon


Report = Mapping[str, Mapping[str, Summary]]  # by setting, by row


def summarise(results: Iterable[Result]) -> Report:
    """Summarise the results of all demonstrations, in any order."""
    outcomes: dict[str, dict[str, list[RowOutcome]]] = {}
    for result in results:
        for setting, some in result.items():
            for outcome in some:
                outcomes.setdefault(setting, {}).setdefault(outcome.row, []).append(outcome)
    return {
        setting: {row.name: _summary(row, by_row[row.name]) for row in ROWS if row.name in by_row}
        for setting, by_row in outcomes.items()
    }


def _summary(row: ThesisRow, outcomes: Sequence[RowOutcome]) -> Summary:
    faults = Counter(fault for outcome in outcomes for fault in outcome.faults)
    values = [outcome.values for outcome in outcomes if outcome.values]
    cycles = [outcome.cycle_ms for outcome in outcomes if outcome.cycle_ms is not None]
    boundaries = range(len(row.inner)) if row.online else range(0)
    at = [[o.delays_s[i] for o in outcomes] for i in boundaries]
    return Summary(
        row=row,
        seeds=len(outcomes),
        share=sum(outcome.came_out for outcome in outcomes) / len(outcomes),
        segments=median(outcome.segments for outcome in outcomes),
        faults=tuple(sorted(faults.items(), key=lambda item: (-item[1], item[0]))),
        values=tuple(median(column) for column in zip(*values, strict=True)),
        delays=tuple(Delay(_shown(some), _median(some)) for some in at),
        contact_s=_median([d for i in boundaries if row.is_contact(i) for d in at[i]]),
        others_s=_median([d for i in boundaries if not row.is_contact(i) for d in at[i]]),
        cycle_ms=_median(cycles),
    )


def _shown(delays: Sequence[float | None]) -> float:
    return sum(delay is not None for delay in delays) / len(delays)


def _median(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return median(known) if known else None


def as_json(report: Report) -> dict[str, Any]:
    """Return the whole report as plain values."""
    return {
        setting: {name: _plain(one) for name, one in by_row.items()} for setting, by_row in report.items()
    }


def _plain(one: Summary) -> dict[str, Any]:
    row = one.row
    return {
        "source": row.source,
        "scenario": row.scenario,
        "preset": row.preset,
        "seeds": one.seeds,
        "share": one.share,
        "passes": one.passes,
        "segments": {"thesis": row.segments, "median": one.segments},
        "faults": dict(one.faults),
        "values": [
            {"segment": v.segment + 1, "what": v.what, "thesis": v.thesis, "median": m}
            for v, m in zip(row.values, one.values or (None,) * len(row.values), strict=True)
        ],
        "online": [
            {"t": b.t, "thesis_s": b.seen_after_s, "shown": d.shown, "median_s": d.median_s}
            for b, d in zip(row.inner, one.delays, strict=bool(one.delays))
        ],
        "cycle_ms": {"thesis": row.cycle_ms, "median": one.cycle_ms},
    }


def main_settings(report: Report) -> list[str]:
    """Return the names of the main columns that have been measured."""
    return [setting.name for setting in MAIN if setting.name in report]
