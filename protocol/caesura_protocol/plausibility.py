"""Plausibility of units: whether samples in the declared units can come from a robot.

A table of checks. Each computes one number of a recording, or of the first second of a stream, and compares
it with a limit that no robot arm exceeds. Statistics are robust: a few outliers have no effect. Limits have a
margin: a value beyond one is probably in another unit. A declared unit is accepted; `doubts` reports its
values beyond a limit, or below those of any robot arm.

Recordings, bridge, service and doctor use the same table. A stated robot whose joints turn further has its
own limit.

>>> t = np.arange(100) / 100
>>> print(implausible(t, {"pos": np.tile([400.0, 0.0, 300.0], (100, 1))}))
positions are 500 m away from the base, at most 5 m are plausible: probably in mm
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.codec import signals_of
from caesura_protocol.messages import Quantity
from caesura_protocol.robots import RobotError, robot_description
from caesura_protocol.sample_limits import WIDEST_M

Array = NDArray[np.float64]

QUANTITIES: tuple[Quantity, ...] = get_args(Quantity)
TimeUnit = Literal["s", "ms", "us", "ns"]
AngleUnit = Literal["rad", "deg"]
ForceUnit = Literal["N", "kN", "mN", "gf"]

METRES: Mapping[str, float] = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}  # in one of a unit
RADIANS: Mapping[str, float] = {"rad": 1.0, "deg": math.pi / 180}
#: What one of a unit is in the first unit of its row, which is that of the wire.
UNITS: Mapping[Quantity, Mapping[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "length": METRES,
    "angle": RADIANS,
    "force": {"N": 1.0, "kN": 1e3, "mN": 1e-3, "gf": 9.80665e-3},
}
WIRE_UNIT: Mapping[Quantity, str] = {quantity: next(iter(units)) for quantity, units in UNITS.items()}

LEAST_SAMPLES = 10  # fewer say nothing
MOST_SAMPLES = 20_000  # of a recording, evenly chosen; one of a long session costs no more
CELL_S = 0.1  # speeds are between medians of cells
FIRST_S = 1.0  # of a stream that is checked
FIRST_SAMPLES = 2000  # at most
MORE_TIMES = 4  # as many samples of a stream, before it is checked again


class Implausible(NamedTuple):
    """A number that no robot reports, and the unit that would explain it."""

    quantity: Quantity
    what: str
    value: float  # in `unit`
    limit: float
    unit: str
    likely: str | None  # None where no known unit explains the value

    def __str__(self) -> str:
        guess = "no known unit explains it" if self.likely is None else f"probably in {self.likely}"
        text = self.what.format(value=f"{self.value:.4g} {self.unit}")
        return f"{text}, at most {self.limit:g} {self.unit} are plausible: {guess}"


class _Check(NamedTuple):
    quantity: Quantity
    what: str
    measure: Callable[[Array, Mapping[str, Array]], float | None]
    unit: str
    limit: float
    typical: float  # of the likely units that one is named which comes nearest to this


def _step(t: Array, signals: Mapping[str, Array]) -> float | None:
    steps = np.diff(t)
    steps = steps[steps > 0]
    return float(np.median(steps)) if steps.size >= LEAST_SAMPLES - 1 else None


def _distance(t: Array, signals: Mapping[str, Array]) -> float | None:
    return None if "pos" not in signals else float(np.median(np.linalg.norm(signals["pos"], axis=1)))


def _spread(t: Array, signals: Mapping[str, Array]) -> float | None:
    if "pos" not in signals:
        return None
    low, high = np.quantile(signals["pos"], (0.02, 0.98), axis=0)
    return float(np.linalg.norm(high - low))


def _reach(t: Array, signals: Mapping[str, Array]) -> float | None:
    """Return the larger of distance from the base and spread [m]: a resting flange has no spread.

    None without positions.
    """
    distance, spread = _distance(t, signals), _spread(t, signals)
    return None if distance is None or spread is None else max(distance, spread)


def _speed(t: Array, signals: Mapping[str, Array]) -> float | None:
    """Return the largest speed between the medians of neighbouring cells, or None.

    The largest twentieth is left out, because it may contain jumps.
    """
    span = float(t.max() - t.min())
    if "pos" not in signals or not 3 * CELL_S < span < CELL_S * 1e6 or (np.diff(t) < 0).any():
        return None
    cells = np.floor((t - t[0]) / CELL_S)
    starts = np.flatnonzero(np.diff(cells, prepend=-1.0))
    counts = np.diff(starts, append=t.size)
    places = np.column_stack(
        [axis[np.lexsort((axis, cells))][starts + counts // 2] for axis in signals["pos"].T]
    )
    times = np.add.reduceat(t - t[0], starts) / counts
    elapsed = np.maximum(np.diff(times), CELL_S)
    speeds = np.linalg.norm(np.diff(places, axis=0), axis=1) / elapsed
    return _most(speeds) if speeds.size > 2 else None


def _angle(t: Array, signals: Mapping[str, Array]) -> float | None:
    return None if "q" not in signals else _most(np.abs(signals["q"]).max(axis=1))


def _force(t: Array, signals: Mapping[str, Array]) -> float | None:
    return None if "force" not in signals else _most(np.linalg.norm(signals["force"], axis=1))


def _most(values: Array) -> float:
    """Return the largest value once the largest twentieth is left out."""
    place = int(0.95 * (values.size - 1))
    return float(np.partition(values, place)[place])


#: A robot samples faster than 2 Hz; a pause over 0.25 s is a gap. A Panda reaches 0.855 m, its flange moves
#: at 1.7 m/s, and no joint turns beyond 2π. A base may stand some metres from the origin of a motion capture.
CHECKS: tuple[_Check, ...] = (
    _Check("time", "samples are {value} apart", _step, "s", 0.5, 0.005),
    _Check("length", "positions are {value} away from the base", _distance, "m", 5.0, 0.3),
    _Check("length", "positions are spread over {value}", _spread, "m", 3.0, 0.3),
    _Check("length", "positions move at {value}", _speed, "m/s", 2.0, 0.2),
    _Check("angle", "joints turn to {value}", _angle, "rad", 6.3, 1.5),
    _Check("force", "forces reach {value}", _force, "N", 1000.0, 10.0),
)

#: The least of a robot arm: 5 kHz, a flange outside its own base, a bent joint, a sensor's bias and noise.
LEAST: tuple[_Check, ...] = (
    _Check("time", "samples are {value} apart", _step, "s", 2e-4, 0.005),
    _Check("length", "positions are within {value} of the base", _reach, "m", 0.02, 0.3),
    _Check("angle", "joints turn to {value}", _angle, "rad", 0.1, 1.5),
    _Check("force", "forces reach {value}", _force, "N", 0.2, 10.0),
)


def implausible(
    t: Array,
    signals: Mapping[str, Array],
    *,
    length_unit: str = "m",
    declared: Collection[str] = (),
    robot: str | None = None,
) -> Implausible | None:
    """Return the first implausible quantity of these samples, or None.

    t: (n,) [s]; signals: name → (n, width); positions in `length_unit`, joints [rad], forces [N]. declared:
    quantities whose unit was declared; they are not checked. robot: the stated arm, by its name.
    """
    checks = (check for check in _checks_of(robot) if check.quantity not in declared)
    for check, value in _measured(checks, t, signals, length_unit):
        if value > check.limit:
            stated = length_unit if check.quantity == "length" else WIRE_UNIT[check.quantity]
            likely = _likely(check, value, stated)
            if check.quantity == "length" and likely is not None and _is_too_near(t, signals, likely):
                likely = None
            return Implausible(check.quantity, check.what, value, check.limit, check.unit, likely)
    return None


def _checks_of(robot: str | None) -> Iterator[_Check]:
    """Yield the checks, with the limit of a robot that is known here where its joints turn further."""
    try:
        turn_rad = 0.0 if robot is None else robot_description(robot).most_turn_rad
    except RobotError:
        turn_rad = 0.0
    for check in CHECKS:
        further = check.quantity == "angle" and turn_rad > check.limit
        yield check._replace(limit=turn_rad) if further else check


def _is_too_near(t: Array, signals: Mapping[str, Array], unit: str) -> bool:
    """Whether positions in a unit are nearer to the base than any flange.

    Then they move too fast for another reason.
    """
    reach = next(check for check in LEAST if check.quantity == "length")
    return any(value < reach.limit for _, value in _measured([reach], t, signals, unit))


def doubts(
    t: Array,
    signals: Mapping[str, Array],
    *,
    length_unit: str,
    declared: Collection[str],
    clean_force: bool,
    robot: str | None = None,
) -> tuple[str, ...]:
    """Return a sentence on each contradiction to the stated units; the samples are segmented nevertheless.

    Arguments as in `implausible`. clean_force: whether the force is a flange sensor's: its bias alone exceeds
    the least plausible force.
    """

    def others(quantity: Quantity) -> set[Quantity]:
        return {*QUANTITIES} - {quantity}

    stated = {*declared, *(["length"] if length_unit != WIRE_UNIT["length"] else [])}
    found = [
        f"{str(one).rpartition(': ')[0]}: is the declared unit right?"
        for quantity in QUANTITIES
        if quantity in declared
        and (one := implausible(t, signals, length_unit=length_unit, declared=others(quantity), robot=robot))
    ]
    checks = (one for one in LEAST if one.quantity in stated or (clean_force and one.quantity == "force"))
    for check, value in _measured(checks, t, signals, length_unit):
        if 0.0 < value < check.limit:
            said = check.what.format(value=f"{value:.4g} {check.unit}")
            asked = "is the declared unit right?"
            if check.quantity not in stated:
                asked = "are they in kN? State --force-unit kN, or --force-unit N if the values are right"
            found.append(f"{said}, at least {check.limit:g} {check.unit} are plausible: {asked}")
    return tuple(found)


def _measured(
    checks: Iterable[_Check], t: Array, signals: Mapping[str, Array], length_unit: str
) -> Iterator[tuple[_Check, float]]:
    """Yield each check with its measured value; a check for which the samples have no value is left out."""
    if t.size < LEAST_SAMPLES:
        return
    every = -(-t.size // MOST_SAMPLES)
    thinned = {name: np.asarray(values[::every], np.float64) for name, values in signals.items()}
    if "pos" in thinned:
        thinned["pos"] = thinned["pos"] * UNITS["length"][length_unit]
    for check in checks:
        times = t if check.quantity == "time" else t[::every]
        value = check.measure(np.asarray(times, np.float64), thinned)
        if value is not None:
            yield check, value


def likely_time_unit(t: Array) -> str | None:
    """Return the unit in which these times would be those of a robot; None if they may be seconds."""
    value = _step(t, {})
    check = CHECKS[0]
    return None if value is None or value <= check.limit else _likely(check, value, "s")


def likely_length_unit(position: Sequence[float]) -> str | None:
    """Return the unit in which a position [m] would be within reach; None if it may be metres."""
    value, check = math.hypot(*position), CHECKS[1]
    return None if value <= check.limit else _likely(check, value, "m")


#: The widest that fingers open, in units other than metres. 15 cm are a wide gripper, 15 mm a narrow one.
WIDEST_OPENING: Mapping[str, float] = {"cm": 15.0, "mm": 200.0}


def likely_opening_unit(widest: float) -> str | None:
    """Return the likely unit of openings up to this one; None for metres, for a flag, and for counts.

    >>> [likely_opening_unit(widest) for widest in (0.08, 1.0, 8.0, 80.0, 255.0)]
    [None, None, 'cm', 'mm', None]
    """
    if widest <= WIDEST_M:
        return None
    return next((unit for unit, most in WIDEST_OPENING.items() if widest <= most), None)


def _likely(check: _Check, value: float, stated: str) -> str | None:
    """Return the unit in which a value is plausible and nearest to the typical one; None without one."""
    units = UNITS[check.quantity]
    values = {unit: value / units[stated] * factor for unit, factor in units.items() if unit != stated}
    plausible = {unit: abs(math.log(v / check.typical)) for unit, v in values.items() if v <= check.limit}
    return min(plausible, key=plausible.__getitem__) if plausible else None


class FirstSecond:
    """Checks the first second of a stream; a finding is kept.

    columns: of the stream, `t` first; length_unit, declared, robot: as in `implausible`.
    """

    def __init__(
        self, columns: Sequence[str], length_unit: str, declared: Collection[str], robot: str | None = None
    ) -> None:
        self._columns = tuple(columns)
        self._length_unit, self._declared, self._robot = length_unit, tuple(declared), robot
        self._rows: list[Array] = []
        self._count, self._next = 0, LEAST_SAMPLES
        self._found: Implausible | None = None
        self._over = False

    @property
    def is_over(self) -> bool:
        """Whether no further samples are checked."""
        return self._over

    @property
    def seen(self) -> int:
        """The number of samples received until the check ended."""
        return self._count

    def check(self, rows: NDArray[np.floating]) -> Implausible | None:
        """Check the next rows (k, columns). Return the implausible quantity of the stream so far, or None."""
        if self._over or not len(rows):
            return self._found
        self._rows.append(np.array(rows, np.float64))
        self._count += len(rows)
        span = self._rows[-1][-1, 0] - self._rows[0][0, 0]
        ends = self._count >= LEAST_SAMPLES and (span >= FIRST_S or self._count >= FIRST_SAMPLES)
        if self._count >= self._next or ends:
            self._next = MORE_TIMES * self._count
            matrix = np.concatenate(self._rows)
            self._found = implausible(
                matrix[:, 0],
                signals_of(self._columns, matrix),
                length_unit=self._length_unit,
                declared=self._declared,
                robot=self._robot,
            )
        if ends or self._found is not None:
            self._over, self._rows = True, []
        return self._found
