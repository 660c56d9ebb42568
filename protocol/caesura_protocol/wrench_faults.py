"""Finds faults of a recording's wrench, and decides its use: a force that is frozen, is 0, or has no zero.

A measured force has noise. If it does not change at all while the flange moves, a dead driver repeats it, or
it is simulated. It shows no contact and no load. If that is more than MOST_SHARE of a recording, contact and
load are off, and the reason is stated; a shorter dropout is reported. The same applies to a single axis, and
to the torque, which is then left out. A sensor with coarse steps repeats its values too, but throughout the
recording. A simulation without noise is exactly 0 in free space and has forces elsewhere, and so has a sensor
with a dead band; both are used and reported. With a declared unit of the force (`--force-unit N`) its values
are not questioned.

A recording that is shorter than the tare has a force without a zero: the bias of a sensor, up to 20 N on real
ones, would appear as a contact.

Pure.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.messages import WrenchSource
from caesura_protocol.plausibility import LEAST_SAMPLES, METRES
from caesura_protocol.sample_limits import HOLE_S, TARE_S
from caesura_protocol.up_direction import GRAVITY

Array = NDArray[np.float64]

FROZEN_S = 0.5  # the longest of 55 real recordings is 0.08 s, of an axis, while the flange moved by 0.1 mm
USUAL_SHARE, MORE = 0.9, 10.0  # a dead driver repeats a force for so much longer than it usually stays
MOST_SHARE = 0.1  # of a recording, for which a force may be frozen while the rest of it is used
MOVED_M = 0.01  # by which the flange moves while its force is frozen
MOVED_RAD = 0.05  # likewise a joint, where no position is there
SHORTEST_S = 0.2  # shorter ones have no segment at all
RECURS_SHARE = (
    0.01  # of the other samples, in which a step of a sensor recurs; a dead driver's value does not
)
REPEATS = 4  # as often as each value of a sensor with coarse steps occurs, or oftener
COARSE_N = 0.5  # steps from which on the error of a load exceeds what is stated; real sensors have 0.2 N
SHOWN = 3  # runs that are listed
OFF = "contact and load are off"


class FrozenRun(NamedTuple):
    """Samples of one value while the flange moves. value: of each axis, [N] or [Nm]."""

    t0: float  # [s]
    tn: float
    moved: str  # with its unit
    value: tuple[float, ...]

    @property
    def is_zero(self) -> bool:
        """Whether the value is exactly 0 on every axis."""
        return not any(self.value)

    @property
    def shown(self) -> str:
        """The value as text; of several axes in parentheses."""
        numbers = ", ".join(f"{value + 0.0:.4g}" for value in self.value)
        return numbers if len(self.value) == 1 else f"({numbers})"


class WrenchReading(NamedTuple):
    """The wrench source in use, the findings, a sentence each, and whether the torque is used."""

    source: WrenchSource | None
    found: tuple[str, ...] = ()
    uses_torque: bool = True


class _Finding(NamedTuple):
    text: str
    unused: Literal["nothing", "torque", "wrench"] = "nothing"


class _Force(NamedTuple):
    """The signal that shows contact and load."""

    signal: str  # its name in a Recording
    name: str
    unit: str
    remedy: str  # where a value that stays the same is right


_FORCE = _Force("force", "The force is", "N", "state its unit if the values are right")
_JOINT_TORQUES = _Force("tau", "The joint torques are", "Nm", "")


def read_wrench(
    t: Array,
    signals: Mapping[str, Array],
    source: WrenchSource | None,
    *,
    length_unit: str = "m",
    believed: bool = False,
) -> WrenchReading:
    """Return the wrench source to use for these samples, with the findings.

    t: (n,) [s]; signals: name → (n, width), as in a Recording; source: the stated one; believed: whether the
    force's unit was declared.
    """
    force = _FORCE if _FORCE.signal in signals else _JOINT_TORQUES
    if source == "none" or force.signal not in signals or t.size < LEAST_SAMPLES:
        return WrenchReading(source)
    samples = CheckedMotion.of(t, signals, length_unit)
    found = [*_of_force(samples, force, signals[force.signal], believed=believed)]
    if force is _FORCE and "torque" in signals:
        found += _of_torque(samples, signals["torque"])
    for one in found:
        if one.unused == "wrench":
            return WrenchReading("none", (one.text,))
    uses_torque = all(one.unused != "torque" for one in found)
    return WrenchReading(source, tuple(one.text for one in found), uses_torque)


def _of_force(samples: CheckedMotion, force: _Force, values: Array, *, believed: bool) -> Iterator[_Finding]:
    """Yield the findings on the signal that shows contact and load: values (n, k).

    believed: whether the signal's unit was declared.
    """
    if SHORTEST_S <= samples.span < TARE_S:
        yield _Finding(NOT_ZEROED.format(span=samples.span), "wrench")
        return
    runs = samples.frozen(values)
    dead = [run for run in runs if not run.is_zero]
    step = coarse_step(values[~samples.within(dead)]) if force is _FORCE else 0.0
    if runs and not values.any() and not believed:
        yield _Finding(f"{force.name} 0 in every sample: it is read as no force; {OFF}.", "wrench")
    elif samples.prevails(dead):
        yield _dead(f"{force.name} {_listed(dead, force.unit)}", dead, samples, force, believed=believed)
    elif step:
        yield _Finding(COARSE.format(step=step, error=step / (math.sqrt(12.0) * GRAVITY)))
        if dead:
            yield _Finding(f"{force.name} {_listed(dead, force.unit)}: {SHORT}.")
    elif runs:
        said = SHORT if dead else _noise_free(values, force.unit)
        yield _Finding(f"{force.name} {_listed(runs, force.unit)}: {said}.")
    elif force is _FORCE:
        yield from _of_axes(samples, values, believed=believed)


def _of_axes(samples: CheckedMotion, force: Array, *, believed: bool) -> Iterator[_Finding]:
    """Yield findings on axes of a force (n, 3) that do not change, while others do with every sample."""
    columns = dict(zip("xyz", force.T, strict=True))
    runs = {axis: samples.frozen(column[:, None]) for axis, column in columns.items()}
    stuck = {axis: found for axis, found in runs.items() if samples.prevails(found)}
    rows = np.flatnonzero(np.any(np.diff(force, axis=0) != 0.0, axis=1))  # a slower sensor repeats all axes
    changing = [
        np.count_nonzero(np.diff(columns[axis])[rows]) / max(rows.size, 1)
        for axis in columns
        if axis not in stuck
    ]
    if min(changing, default=0.0) < USUAL_SHARE:
        return  # the noise of this sensor is smaller than its steps
    for axis, found in stuck.items():
        listed = f"Axis {axis} of the force is {_listed(found, 'N')}"
        if any(not run.is_zero for run in found):
            yield _dead(listed, found, samples, _FORCE, believed=believed)
        else:
            yield _Finding(f"{listed}: contacts and loads along it are not seen.")


def _of_torque(samples: CheckedMotion, torque: Array) -> Iterator[_Finding]:
    """Yield a finding if the torque (n, 3) beside a force must be left out."""
    dead = [run for run in samples.frozen(torque) if not run.is_zero]
    if not torque.any():
        yield _Finding("The torque is 0 in every sample: it is left out.", "torque")
    elif samples.prevails(dead):
        yield _Finding(f"The torque is {_listed(dead, 'Nm')}: it is left out.", "torque")


class CheckedMotion(NamedTuple):
    """Times and positions of the robot. place: (n, d) [m], or the joints [rad] without a position."""

    t: Array  # [s]
    place: Array
    least: float  # by which it moves while a value is frozen
    unit: str

    @classmethod
    def of(cls, t: Array, signals: Mapping[str, Array], length_unit: str) -> CheckedMotion:
        """Return the motion in the signals of a recording."""
        if "pos" in signals:
            return cls(t, signals["pos"] * METRES[length_unit], MOVED_M, "m")
        return cls(t, signals["q"], MOVED_RAD, "rad")

    @property
    def span(self) -> float:
        """The time from the first to the last sample [s]."""
        return float(np.ptp(self.t))

    def prevails(self, runs: Sequence[FrozenRun]) -> bool:
        """Return whether runs cover more of the recording than a dropout does."""
        return sum(run.tn - run.t0 for run in runs) > MOST_SHARE * self.span

    def frozen(self, values: Array) -> list[FrozenRun]:
        """Return the runs in which no column of (n, k) changes for over FROZEN_S while the robot moves.

        For a sensor with steps, runs must last MORE times longer than usual, and their values must not recur.
        """
        breaks = (values[1:] != values[:-1]).any(axis=1) | (np.diff(self.t) > HOLE_S)
        edges = np.concatenate([[0], np.flatnonzero(breaks) + 1, [self.t.size]])
        lengths = self.t[edges[1:] - 1] - self.t[edges[:-1]]
        usual_s = _usual(np.diff(self.t[edges[:-1]], append=self.t[-1]))
        found = []
        for index in np.flatnonzero(lengths > max(FROZEN_S, MORE * usual_s)).tolist():
            start, stop = int(edges[index]), int(edges[index + 1])
            moved = float(np.linalg.norm(np.ptp(self.place[start:stop], axis=0)))
            if moved > self.least:
                t0, tn = float(self.t[start]), float(self.t[stop - 1])
                run = FrozenRun(t0, tn, f"{moved:.2g} {self.unit}", tuple(values[start].tolist()))
                found.append(run)
        beside = values[~self.within(found)]
        return [run for run in found if run.is_zero or not _recurs(run, beside)]

    def within(self, runs: Sequence[FrozenRun]) -> NDArray[np.bool_]:
        """Return (n,) whether each sample lies in one of the runs."""
        inside = np.zeros(self.t.size, dtype=np.bool_)
        for run in runs:
            inside |= (run.t0 <= self.t) & (self.t <= run.tn)
        return inside


def coarse_step(force: Array) -> float:
    """Return the step of a sensor [N] if it is at least COARSE_N on every axis that changes; else 0.

    force: (n, 3). A sensor has steps if each value occurs at least REPEATS times.

    >>> fine = np.random.default_rng(0).normal(scale=5.0, size=(1000, 3))
    >>> coarse_step(np.round(fine)), coarse_step(fine)
    (1.0, 0.0)
    """
    steps = []
    for known in map(np.unique, force.T):
        if known.size > 1:
            steps.append(float(np.median(np.diff(known))) if known.size * REPEATS <= len(force) else 0.0)
    least = min(steps, default=0.0)
    return least if least >= COARSE_N else 0.0


def _recurs(run: FrozenRun, beside: Array) -> bool:
    """Return whether a value is a step of the sensor: it also occurs at other times (m, k)."""
    return bool(beside.size) and float((beside == run.value).all(axis=1).mean()) > RECURS_SHARE


def _usual(seconds: Array) -> float:
    """Return the usual length [s] of runs; 0 without any.

    Of runs up to FROZEN_S, those up to this length cover USUAL_SHARE of the time.
    """
    short = np.sort(seconds[(seconds > 0.0) & (seconds <= FROZEN_S)])
    if not short.size:
        return 0.0
    share = np.cumsum(short) / short.sum()
    return float(short[np.searchsorted(share, USUAL_SHARE)])


NOT_ZEROED = (
    f"The force is not zeroed, so contact and free space are not distinguished: the recording lasts "
    f"{{span:.3g}} s, and its first {TARE_S:g} s are needed; {OFF}."
)
DECLARED = "it is used as it is, because its unit is declared"
SHORT = "contacts and loads of that time may be wrong"
NOISE_FREE = "0 is taken as free space, as in a simulation without noise"
DEAD_BAND = "the least that is not 0 is {least:.2g} {unit}, and contacts and loads below that are not seen"
COARSE = (
    "The force comes in steps of {step:.3g} N: a load is known to {error:.2g} kg at best, whatever its "
    "stated error, and smaller contacts are not seen."
)


def _noise_free(values: Array, unit: str) -> str:
    """Return text on the use of values (n, k) that are sometimes exactly 0, and on a dead band."""
    least = float(np.abs(values[values != 0.0]).min(initial=np.inf))
    if COARSE_N <= least < np.inf:
        return f"{NOISE_FREE}; {DEAD_BAND.format(least=least, unit=unit)}"
    return NOISE_FREE


def _dead(
    listed: str, runs: Sequence[FrozenRun], samples: CheckedMotion, force: _Force, *, believed: bool
) -> _Finding:
    """Return the finding on values that a dead driver repeats, with the remedy: use the part without them."""
    if believed:
        return _Finding(f"{listed}: {DECLARED}.")
    whole = runs[0].t0 <= samples.t[0] and runs[0].tn >= samples.t[-1]
    remedies = [
        *([] if whole else ["divide the recording there to use the rest"]),
        *([force.remedy] if force.remedy else []),
    ]
    remedy = f": {', or '.join(remedies)}" if remedies else ""
    return _Finding(f"{listed}. It is not used; {OFF}{remedy}.", "wrench")


def _listed(runs: Sequence[FrozenRun], unit: str) -> str:
    shown = [
        f"{run.shown} {unit} from {run.t0:.2f} s to {run.tn:.2f} s, while the robot moves by {run.moved}"
        for run in runs[:SHOWN]
    ]
    more = f", and {len(runs) - SHOWN} more times" if len(runs) > SHOWN else ""
    return f"exactly {'; '.join(shown)}{more}, at most {FROZEN_S:g} s are plausible"
