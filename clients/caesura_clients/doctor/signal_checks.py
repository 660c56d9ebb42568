"""Checks of samples, live or recorded: rate, regularity, missing signals, the force at rest."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from caesura_clients.doctor.findings import CheckResult, graded
from caesura_protocol.messages import Quantity
from caesura_protocol.plausibility import METRES, implausible
from caesura_protocol.pose_update_rate import slow_pose
from caesura_protocol.recording import Recording, unit_remedy
from caesura_protocol.sample_limits import HOLE_S

Array = NDArray[np.float64]

FEWEST_HZ, MOST_HZ = 50.0, 1050.0  # the grid has 100 Hz; half of it is still interpolated well
UNEVEN = 0.5  # of the median interval; an interval off by more is irregular
UNEVEN_SHARE = 0.02
REST_M_PER_S, REST_RAD_PER_S = 0.005, 0.02
CELL_S = 0.1  # a movement is between means over cells: a tremor is none
REST_CELLS = 3  # the fewest that say something of noise
BIAS_LIMIT_N = 5.0  # sensors were measured with 1 to 5 N; more is a tool or a hand that was not tared
NOISE_LIMIT_N = 1.0
WITHOUT: Mapping[str, tuple[str, str]] = {  # a signal: what else has it, and what its absence means
    "force": ("tau", "contact and load cannot be found"),
    "quat": ("q", "apps have no orientation"),
    "gripper": ("gripper", "grasps are not detected"),
}


@dataclass(frozen=True)
class CheckedSamples:
    """Unvalidated samples, live or from a file. t: (n,) [s]; signals: name → (n, width)."""

    t: Array
    signals: Mapping[str, Array]
    length_unit: str = "m"
    declared_units: tuple[Quantity, ...] = ()


Samples = CheckedSamples | Recording


def check_samples(samples: Samples) -> Iterator[CheckResult]:
    """Yield the checks of rate, pose, signals and noise."""
    yield from check_rate(samples)
    yield from check_pose(samples)
    yield check_signals(samples)
    yield from check_noise(samples)


def check_pose(samples: Samples) -> Iterator[CheckResult]:
    """Yield a finding if the pose is read too seldom."""
    if (slow := slow_pose(samples.t, samples.signals)) is not None:
        yield CheckResult("warn", "pose", slow, "look at what the source reads the pose from")


def check_rate(samples: Samples) -> Iterator[CheckResult]:
    """Yield the checks of rate, regularity, pauses, and times that do not increase."""
    steps = np.diff(samples.t)
    advancing = steps[steps > 0]
    if advancing.size == 0:
        remedy = "check the robot's clock: `t` in seconds"
        yield CheckResult("warn", "rate", "time does not advance", remedy)
        return
    middle, pause = float(np.median(advancing)), float(advancing.max())
    rate, remedy = 1.0 / middle, f"expected {FEWEST_HZ:.0f} to 1000 Hz: is `t` in seconds?"
    yield graded("rate", f"{rate:.0f} Hz", (not FEWEST_HZ <= rate <= MOST_HZ, "warn", remedy))
    uneven = float(np.mean(np.abs(advancing - middle) > UNEVEN * middle))
    found = f"{100 * uneven:.1f} % of intervals off by more than half, longest {1000 * pause:.0f} ms"
    gap = f"a pause over {1000 * HOLE_S:.0f} ms is a gap in the results: check the source"
    late = "give samples the time at which they were measured, not at which they were sent"
    yield graded("regularity", found, (pause > HOLE_S, "warn", gap), (uneven > UNEVEN_SHARE, "warn", late))
    back = np.maximum.accumulate(samples.t)[:-1] - samples.t[1:]
    ignored = int(np.sum(back >= 0.0))
    if back.max() > HOLE_S:
        found = f"sample {int(back.argmax()) + 1}: time goes back by {back.max():.6g} s"
        yield CheckResult("bad", "clock", found, "it was set, or two recordings are one: divide them there")
    elif ignored:
        found = f"{ignored} of {samples.t.size} samples have a time that does not advance, and are ignored"
        yield CheckResult("warn", "repeats", found, "the source sends samples twice, or its clock steps back")


def check_signals(samples: Samples) -> CheckResult:
    """Return the check of the signals: those that are there, and the consequence of absent ones."""
    there = samples.signals
    nothing = not {"pos", "q"} & {*there}
    absent = (
        f"without {name} {what}" for name, (other, what) in WITHOUT.items() if not {name, other} & {*there}
    )
    meaning = "; ".join(absent)
    return graded(
        "signals",
        ", ".join(there) or "none",
        (nothing, "warn", "neither pos nor q: there is nothing to divide"),
        (meaning, "warn", f"{meaning}: send them if the robot has them"),
    )


def check_noise(samples: Samples) -> Iterator[CheckResult]:
    """Yield the check of the force's standard deviation while the robot rests."""
    force = samples.signals.get("force")
    rest = [] if force is None else cells_at_rest(samples)
    if force is None or len(rest) < REST_CELLS:
        return
    noise = float(np.median([force[cell].std(axis=0).max() for cell in rest]))
    found = f"{noise:.2f} N on the worst axis at rest, median of {len(rest)} tenths of a second"
    remedy = (
        f"over {NOISE_LIMIT_N:.0f} N: a hand in the force (state flange_sensor_with_hand), a loose cable, "
        "or no filter in the sensor"
    )
    yield graded("wrench noise", found, (noise > NOISE_LIMIT_N, "warn", remedy))


def check_bias(bias: Array | None) -> Iterator[CheckResult]:
    """Check the bias. bias: (3,) [N] reading while nothing touches the sensor; None where unknown."""
    if bias is None:
        return
    x, y, z = bias.tolist()
    size = float(np.linalg.norm(bias))
    remedy = (
        f"over {BIAS_LIMIT_N:.0f} N: tare the sensor, and let the robot compensate the weight of gripper "
        "and tool: its direction turns with the flange, and a tare is constant"
    )
    found = f"({x:.1f}, {y:.1f}, {z:.1f}) N, {size:.1f} N in all, subtracted"
    yield graded("wrench bias", found, (size > BIAS_LIMIT_N, "warn", remedy))


def check_units(samples: Samples) -> Iterator[CheckResult]:
    """Yield a failed check if times, positions, joints or forces contradict their stated units."""
    unit = samples.length_unit
    found = implausible(samples.t, samples.signals, length_unit=unit, declared=samples.declared_units)
    if found is not None:
        yield CheckResult("bad", "units", str(found), unit_remedy(found, unit))


def cells_at_rest(samples: Samples) -> list[slice]:
    """Return the cells of CELL_S in which the robot has not moved since the cell before; none after a gap."""
    name = "pos" if "pos" in samples.signals else "q"
    if name not in samples.signals or not len(samples.t):
        return []
    limit = REST_M_PER_S / METRES[samples.length_unit] if name == "pos" else REST_RAD_PER_S
    numbers = np.floor((samples.t - samples.t[0]) / CELL_S)
    edges = np.concatenate([[0], np.flatnonzero(np.diff(numbers)) + 1])  # the last cell is not whole
    if len(edges) < 3:
        return []
    cells = [slice(int(i), int(j)) for i, j in pairwise(edges)]
    means = np.array([samples.signals[name][cell].mean(axis=0) for cell in cells])
    moved = np.linalg.norm(np.diff(means, axis=0), axis=1)
    follows = np.diff(numbers[edges[:-1]]) == 1.0
    return [cells[i + 1] for i in np.flatnonzero((moved <= limit * CELL_S) & follows)]
