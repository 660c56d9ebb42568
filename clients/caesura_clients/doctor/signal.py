"""Checks of samples, live or recorded: rate, regularity, missing signals, the force at rest."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from caesura_clients.doctor.findings import CheckResult, bad, ok, warn, warn_if
from caesura_protocol.messages import Quantity, WrenchSource
from caesura_protocol.plausibility import METRES, implausible
from caesura_protocol.recording import unit_remedy

Array = NDArray[np.float64]

FEWEST_HZ, MOST_HZ = 50.0, 1050.0  # the grid has 100 Hz; half of it is still interpolated well
PAUSE_LIMIT_S = 0.25  # a longer one is a gap in the results (conditioning)
UNEVEN = 0.5  # of the median interval; an interval off by more is irregular
UNEVEN_SHARE = 0.02
REST_M_PER_S, REST_RAD_PER_S = 0.005, 0.02
CELL_S = 0.1  # a movement is between means over cells: a tremor is none
REST_CELLS = 3  # the fewest that say something of noise
BIAS_LIMIT_N = 5.0  # sensors were measured with 1 to 5 N; more is a tool or a hand that was not tared
NOISE_LIMIT_N = 1.0
WHAT_FOR: Mapping[str, str] = {
    "force": "contact and load cannot be found",
    "quat": "apps have no orientation",
    "gripper": "grasps are not seen",
}


@dataclass(frozen=True)
class CheckedSamples:
    """t: (n,) [s] as they came; signals: name → (n, width)."""

    t: Array
    signals: Mapping[str, Array]
    wrench_source: WrenchSource | None = None
    length_unit: str = "m"
    declared_units: tuple[Quantity, ...] = ()


def check_rate(samples: CheckedSamples) -> Iterator[CheckResult]:
    """Rate, regularity, pauses, times that do not advance."""
    steps = np.diff(samples.t)
    advancing = steps[steps > 0]
    if advancing.size == 0:
        yield warn("rate", "time does not advance", "check the robot's clock: `t` in seconds")
        return
    middle = float(np.median(advancing))
    rate, remedy = 1.0 / middle, f"expected {FEWEST_HZ:.0f} to 1000 Hz: is `t` in seconds?"
    yield warn_if(not FEWEST_HZ <= rate <= MOST_HZ, "rate", f"{rate:.0f} Hz", remedy)
    yield _regularity(advancing, middle)
    back = np.maximum.accumulate(samples.t)[:-1] - samples.t[1:]
    if back.max() > PAUSE_LIMIT_S:
        row = int(back.argmax()) + 1
        found = f"sample {row}: time goes back by {back.max():.6g} s"
        yield bad("clock", found, "it was set, or two recordings are one: divide them there")
    elif advancing.size < steps.size:
        found = f"{steps.size - advancing.size} samples whose time does not advance, which are ignored"
        yield warn("repeats", found, "the source sends samples twice, or its clock steps back")


def _regularity(advancing: Array, middle: float) -> CheckResult:
    pause = float(advancing.max())
    uneven = float(np.mean(np.abs(advancing - middle) > UNEVEN * middle))
    found = f"{100 * uneven:.1f} % of intervals off by more than half, longest {1000 * pause:.0f} ms"
    if pause > PAUSE_LIMIT_S:
        remedy = f"a pause over {1000 * PAUSE_LIMIT_S:.0f} ms is a gap in the results: look at the source"
        return warn("regularity", found, remedy)
    if uneven > UNEVEN_SHARE:
        remedy = "give samples the time at which they were measured, not at which they were sent"
        return warn("regularity", found, remedy)
    return ok("regularity", found)


def check_signals(samples: CheckedSamples) -> Iterator[CheckResult]:
    """What is there, and what its absence means."""
    there = ", ".join(samples.signals)
    if "pos" not in samples.signals and "q" not in samples.signals:
        yield warn("signals", f"{there or 'none'}", "neither pos nor q: there is nothing to divide")
        return
    missing = [name for name in WHAT_FOR if not _has(samples, name)]
    if not missing:
        yield ok("signals", there)
        return
    meaning = "; ".join(f"without {name} {WHAT_FOR[name]}" for name in missing)
    yield warn("signals", there, f"{meaning}: send them if the robot has them")


def _has(samples: CheckedSamples, name: str) -> bool:
    if name == "quat" and "q" in samples.signals:
        return True  # the joints determine it
    if name == "force" and "tau" in samples.signals:
        return True  # an estimate of it
    return name in samples.signals


def check_noise(samples: CheckedSamples) -> Iterator[CheckResult]:
    """The force's scatter while the robot rests."""
    force = samples.signals.get("force")
    rest = [] if force is None else cells_at_rest(samples)
    if force is None or len(rest) < REST_CELLS:
        return
    noise = float(np.median([force[cell].std(axis=0).max() for cell in rest]))
    found = f"{noise:.2f} N on the worst axis at rest, median of {len(rest)} tenths of a second"
    remedy = (
        f"over {NOISE_LIMIT_N:.0f} N: a hand in the force (say flange_sensor_with_hand), a loose cable, "
        "or no filter in the sensor"
    )
    yield warn_if(noise > NOISE_LIMIT_N, "wrench noise", found, remedy)


def check_bias(bias: Array | None) -> Iterator[CheckResult]:
    """Check the bias. bias: (3,) [N] reading while nothing touches the sensor; None where unknown."""
    if bias is None:
        return
    x, y, z = bias.tolist()
    size = float(np.linalg.norm(bias))
    found = f"({x:.1f}, {y:.1f}, {z:.1f}) N, {size:.1f} N in all, taken off"
    remedy = (
        f"over {BIAS_LIMIT_N:.0f} N: tare the sensor, and let the robot take off the weight of hand and "
        "tool: it turns with the flange, and what is taken off once does not follow"
    )
    yield warn_if(size > BIAS_LIMIT_N, "wrench bias", found, remedy)


def check_units(samples: CheckedSamples) -> Iterator[CheckResult]:
    """Are times, positions, joints and forces in the units that they are said to have?"""
    found = implausible(
        samples.t, samples.signals, length_unit=samples.length_unit, declared=samples.declared_units
    )
    if found is not None:
        yield bad("units", str(found), unit_remedy(found, samples.length_unit))


def cells_at_rest(samples: CheckedSamples) -> list[slice]:
    """Cells of CELL_S in which the robot stayed where it was in the cell before."""
    is_place = "pos" in samples.signals
    limit = REST_M_PER_S / METRES[samples.length_unit] if is_place else REST_RAD_PER_S
    return [cell for cell, moved in _cells(samples) if moved <= limit * CELL_S]


def _cells(samples: CheckedSamples) -> list[tuple[slice, float]]:
    """Cells of CELL_S, each with how far its mean lies from that of the cell before [length_unit or rad].

    Without those that follow a hole.
    """
    name = "pos" if "pos" in samples.signals else "q"
    if name not in samples.signals or not len(samples.t):
        return []
    numbers = np.floor((samples.t - samples.t[0]) / CELL_S)
    starts = np.concatenate([[0], np.flatnonzero(np.diff(numbers)) + 1])
    starts, ends = starts[:-1], starts[1:]  # the last cell is not whole
    if len(starts) < 2:
        return []
    values = samples.signals[name]
    means = np.array([values[i:j].mean(axis=0) for i, j in zip(starts, ends, strict=True)])
    moved = np.linalg.norm(np.diff(means, axis=0), axis=1)
    follows = np.diff(numbers[starts]) == 1.0
    cells = [slice(int(i), int(j)) for i, j in zip(starts[1:], ends[1:], strict=True)]
    return [one for one, near in zip(zip(cells, moved.tolist(), strict=True), follows, strict=True) if near]
