"""How far the wrench of a recording can be used: a force that is frozen, one that is 0, one that has no zero.

A measured force scatters. One that stays the same number for number while the flange moves is repeated by a
dead driver, or simulated. It shows no contact and no load. Where that is more than MOST_SHARE of a
recording, contact and load are off, and the reason is stated; a shorter dropout is named. A sensor with
coarse steps repeats its values too, but throughout the recording. A simulation without noise is exactly 0
in free space and has forces elsewhere; it is used, and named. A unit of the force that was declared
(`--force-unit N`) is believed, and so are its values.

A recording that is shorter than the tare has a force without a zero: the bias of a sensor, up to 20 N on real
ones, would pass for a contact.

Pure.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.messages import WrenchSource
from caesura_protocol.plausibility import LEAST_SAMPLES, METRES
from caesura_protocol.sample_limits import TARE_S

Array = NDArray[np.float64]

FROZEN_S = 0.5  # the longest of 55 real recordings is 0.05 s, while the flange moved by 0.1 mm
USUAL_SHARE, MORE = 0.9, 10.0  # a dead driver repeats a force for so much longer than it usually stays
MOST_SHARE = 0.1  # of a recording, for which a force may be frozen while the rest of it is used
MOVED_M = 0.01  # by which the flange moves while its force is frozen
MOVED_RAD = 0.05  # likewise a joint, where no position is there
SHORTEST_S = 0.2  # shorter ones have no segment at all
SHOWN = 3  # runs that are listed
OFF = "contact and load are off"


class FrozenRun(NamedTuple):
    """Samples of one force while the flange moves. force: (3,) [N], or the joint torques [Nm]."""

    t0: float  # [s]
    tn: float
    moved: float  # [m], or [rad] without a position
    force: tuple[float, ...]

    @property
    def is_zero(self) -> bool:
        """Whether it is exactly 0 on every axis."""
        return not any(self.force)


class WrenchReading(NamedTuple):
    """The wrench source in use, and what was found, in a sentence each."""

    source: WrenchSource | None
    found: tuple[str, ...] = ()


def read_wrench(
    t: Array,
    signals: Mapping[str, Array],
    source: WrenchSource | None,
    *,
    length_unit: str = "m",
    believed: bool = False,
) -> WrenchReading:
    """The wrench source in use for these samples; believed: the force's unit was declared.

    t: (n,) [s]; signals: name → (n, width), as in a Recording; source: as it is stated.
    """
    wrench = [name for name in ("force", "torque") if name in signals] if "force" in signals else ["tau"]
    if source == "none" or not set(wrench) <= set(signals) or t.size < LEAST_SAMPLES:
        return WrenchReading(source)
    span = float(np.ptp(t))
    if SHORTEST_S <= span < TARE_S:
        return WrenchReading("none", (NOT_ZEROED.format(span=span),))
    runs = frozen_runs(t, signals, wrench, length_unit)
    if not runs:
        return WrenchReading(source)
    unused = None if believed else _unused(t, signals, wrench, runs)
    if unused is not None:
        return WrenchReading("none", (unused,))
    dead = any(not run.is_zero for run in runs)
    said = NOISE_FREE if not dead else DECLARED if believed else SHORT
    return WrenchReading(source, (f"{_named(runs, wrench, signals)}: {said}.",))


NOT_ZEROED = (
    f"The force is not zeroed, so contact and free space are not distinguished: the recording lasts "
    f"{{span:.3g}} s, and its first {TARE_S:g} s are needed; {OFF}."
)
DECLARED = "it is declared to be right"
SHORT = "contacts and loads of that time may be wrong"
NOISE_FREE = "it is taken as simulated without noise, where 0 is free space. A sensor never reads that"


def _unused(
    t: Array, signals: Mapping[str, Array], wrench: Sequence[str], runs: Sequence[FrozenRun]
) -> str | None:
    """Why the wrench is not used; None where it is used."""
    dead = [run for run in runs if not run.is_zero]
    if sum(run.tn - run.t0 for run in dead) > MOST_SHARE * np.ptp(t):
        return _dead(dead, t, wrench, signals)
    if any(np.any(signals[name]) for name in wrench):
        return None
    return f"Every force is 0 while the robot moves: it is read as no force; {OFF}."


def frozen_runs(
    t: Array, signals: Mapping[str, Array], wrench: Sequence[str], length_unit: str
) -> list[FrozenRun]:
    """Runs of samples in which no axis of the wrench changes for over FROZEN_S while the robot moves.

    Where a sensor has coarse steps, they last MORE times longer than usual.
    """
    place, least = ("pos", MOVED_M / METRES[length_unit]) if "pos" in signals else ("q", MOVED_RAD)
    values = np.column_stack([signals[name] for name in wrench])
    changes = np.flatnonzero((values[1:] != values[:-1]).any(axis=1))
    edges = np.concatenate([[0], changes + 1, [t.size]])
    lengths = t[edges[1:] - 1] - t[edges[:-1]]
    usual_s = _usual(np.diff(t[edges[:-1]], append=t[-1]))
    found = []
    for index in np.flatnonzero(lengths > max(FROZEN_S, MORE * usual_s)).tolist():
        start, stop = int(edges[index]), int(edges[index + 1])
        moved = float(np.linalg.norm(np.ptp(signals[place][start:stop], axis=0)))
        if moved > least:
            shown = moved * METRES[length_unit] if place == "pos" else moved
            force = tuple(signals[wrench[0]][start].tolist())
            found.append(FrozenRun(float(t[start]), float(t[stop - 1]), shown, force))
    return found


def _usual(seconds: Array) -> float:
    """How long runs last [s], of those that are not longer than FROZEN_S, in USUAL_SHARE of their time."""
    short = np.sort(seconds[(seconds > 0.0) & (seconds <= FROZEN_S)])
    if not short.size:
        return 0.0
    share = np.cumsum(short) / short.sum()
    return float(short[np.searchsorted(share, USUAL_SHARE)])


def _named(runs: Sequence[FrozenRun], wrench: Sequence[str], signals: Mapping[str, Array]) -> str:
    unit, name = ("Nm", "joint torques are") if wrench[0] == "tau" else ("N", "force is")
    moved = "m" if "pos" in signals else "rad"
    shown = [
        f"({', '.join(f'{value + 0.0:.4g}' for value in run.force)}) {unit} from {run.t0:.2f} s to "
        f"{run.tn:.2f} s, while the robot moves by {run.moved:.2g} {moved}"
        for run in runs[:SHOWN]
    ]
    more = f", and {len(runs) - SHOWN} more times" if len(runs) > SHOWN else ""
    return f"The {name} exactly {'; '.join(shown)}{more}, at most {FROZEN_S:g} s are plausible"


def _dead(runs: Sequence[FrozenRun], t: Array, wrench: Sequence[str], signals: Mapping[str, Array]) -> str:
    """Frozen runs, and what to do: the part without them can be used by itself."""
    whole = runs[0].t0 <= t[0] and runs[0].tn >= t[-1]
    remedies = [
        *([] if whole else ["divide the recording there to use the rest"]),
        *(["state --force-unit N if the values are right"] if wrench[0] == "force" else []),
    ]
    remedy = f": {', or '.join(remedies)}" if remedies else ""
    return f"{_named(runs, wrench, signals)}. It is not used; {OFF}{remedy}."
