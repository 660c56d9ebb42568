"""What came of a fault: one row, and whether it meets its bar."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from caesura_clients.bridge import BridgeSettings
from faults.suite.stations import (
    PACE,
    SECONDS,
    SETTINGS,
    STATIONS,
    StationResults,
    TaughtStation,
    Watched,
    found,
    teaching,
    watching,
)

# exact: nothing lost, nothing doubled, results of an undisturbed run. gap: what is lost lies in gaps that are
# declared, nothing doubled, and the session closes. own: the fault says itself.
Bar = Literal["exact", "gap", "own"]


@dataclass(frozen=True)
class Row:
    """What `make faults` prints of a fault."""

    sessions: int
    sent: int
    lost: int
    duplicated: int
    equal: str  # yes, no, or – where it cannot be
    recovery_s: float | None
    note: str
    met: bool


@dataclass(frozen=True)
class FaultCase:
    """One of them: how it is done, under which name."""

    name: str
    run: Callable[[Path], Row | list[Row]]


@dataclass
class Disturbance:
    """What a fault did: when it was over, and what is to be said of it."""

    over: list[float] = field(default_factory=list)  # monotonic [s], each time
    note: str = ""

    def is_over(self) -> None:
        self.over.append(time.monotonic())


@dataclass(frozen=True)
class Played:
    """The stations at their end, and what was seen on the way."""

    found: list[StationResults]
    watched: Watched
    disturbance: Disturbance

    @property
    def recovery_s(self) -> float | None:
        """From the end of a fault to a new result: the worst station, the worst time."""
        return max(self.recoveries_s, default=None)

    @property
    def recoveries_s(self) -> list[float]:
        """Of every time, the worst station."""
        names = [one.station.name for one in self.found]
        return [self.watched.recovery_s(names, over) for over in self.disturbance.over]

    def row(
        self, bar: Bar = "exact", *, note: str = "", met: bool = True, ignoring: Collection[str] = ()
    ) -> Row:
        """met: of what the fault itself asks for beyond the bar."""
        different = {one.station.name: one.difference(ignoring) for one in self.found}
        differences = {name: field for name, field in different.items() if field}
        lost = sum(one.lost for one in self.found)
        duplicated = sum(one.duplicated for one in self.found)
        undeclared = {one.station.name: one.undeclared_t for one in self.found if one.undeclared_t}
        closed = all(one.ack is not None and one.ack.state == "closed" for one in self.found)
        holds = {
            "exact": not differences and not lost,
            "gap": not undeclared and any(one.snapshot.status.gaps for one in self.found),
            "own": True,
        }[bar]
        notes = [self.disturbance.note, note]
        notes += [
            f"{name}: {len(t)} samples from {t[0]:g} to {t[-1]:g} s lost in no declared gap"
            for name, t in undeclared.items()
        ]
        notes += [f"differ: {differences}"] if differences and bar == "exact" else []
        return Row(
            sessions=len(self.found),
            sent=sum(len(one.station.recording.t) for one in self.found),
            lost=lost,
            duplicated=duplicated,
            equal="no" if differences else "yes",
            recovery_s=self.recovery_s,
            note="; ".join(part for part in notes if part),
            met=holds and met and closed and not duplicated,
        )


@dataclass(frozen=True)
class Scale:
    """How much is taught."""

    stations: int = STATIONS
    seconds: float = SECONDS  # of a demonstration
    pace: float = PACE


FULL = Scale()


def played(
    endpoint: str,
    journal: Path,
    disturb: Callable[[list[TaughtStation], Disturbance], None],
    *,
    through: str | None = None,
    scale: Scale = FULL,
    settings: BridgeSettings = SETTINGS,
) -> Played:
    """Teach at all stations, do something to them, and look at what came of it.

    endpoint: where the service is found; through: where bridges find it, if not there.
    """
    disturbance = Disturbance()
    where = through or endpoint
    with (
        watching(endpoint) as watched,
        teaching(
            where,
            numbers=range(scale.stations),
            seconds=scale.seconds,
            pace=scale.pace,
            settings=settings,
        ) as stations,
    ):
        disturb(stations, disturbance)
        return Played(found(endpoint, stations, journal), watched, disturbance)
