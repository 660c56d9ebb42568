"""Measures how well a classifier distinguishes simulated from real demonstrations, on windows of 2 s.

    caesura evaluate --suite realism --data DIR

It is a logistic regression on measures of the speed, the path, the fit by smooth models and the force. It is
cross-validated by subject: all windows of a simulated person, or of a real recording, are on one side. It
runs once for ideal people and once for people with habits. An area under the ROC curve (AUC) of 0.5 is
chance. For comparison the same classifier separates each real set from the other real sets.

Everything is compared at 100 Hz, behind a Gaussian of 50 ms: noise of single samples belongs to a sensor.
Windows count where at least half of the time is motion: how long a pause is, the task decides.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import minimize
from scipy.special import expit
from scipy.stats import rankdata

from caesura_lab.evaluation.reports.grids import Grid, GridPage
from caesura_lab.ground_truth import TruthError
from caesura_lab.teacher.movement_statistics import (
    MOVING_M_PER_S,
    SMALL_M_PER_S,
    clear_dips,
    speed_peaks,
    velocity_on_grid,
)
from caesura_lab.teacher.scenarios import BASIC
from caesura_protocol.formats.read import load_recording
from caesura_protocol.messages import WrenchSource
from caesura_service.constants import GRID_HZ

Array = NDArray[np.float64]
Labels = NDArray[np.bool_]

WINDOW_S, STEP_S = 2.0, 1.0
LEAST_MOTION = 0.5  # share of a window
LEAST_RATE_HZ = 50.0  # slower recordings are left out
FOLDS = 5
PENALTY = 1.0  # of squared weights of the regression, per window's worth of evidence
RESAMPLES = 400
FORCE_BANDS_HZ = ((0.0, 1.0), (1.0, 5.0), (5.0, 12.0))
# Wrenches of the real sets have the hand in them, or are of a tool in contact.
SOURCES: tuple[WrenchSource, ...] = (
    "flange_sensor_with_hand",
    "joint_torque_estimate",
    "flange_sensor_with_hand",
    "flange_sensor",
)
GUIDED_SETS = ("delft", "modena")  # arms guided by hand, in free motion or lightly loaded
IDEAL, NATURAL = "ideal people", "people with habits"
SMALLEST = 1e-6  # added before a logarithm, in the unit of the measure

# Measure → its group. Each is a function of the window below.
GROUPS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "speed": ("mean speed", "peak to mean", "peaks", "clear dips", "ripple", "at rest", "creeping"),
        "path": ("bow", "turn a metre", "jerk"),
        "fit": ("cubic residual", "guided residual"),
        "force": (
            "mean force",
            *(f"force {a:g}-{b:g} Hz" for a, b in FORCE_BANDS_HZ),
            "force noise in motion",
        ),
    }
)
MEASURES: tuple[str, ...] = tuple(name for names in GROUPS.values() for name in names)


@dataclass(frozen=True)
class WindowMeasures:
    """Measures of all windows of one recording.

    set_name: where it comes from; values: (n, measures); guided: free motion with the hand in the wrench.
    person: whose recordings are never on both sides, "" for a recording that stands for itself.
    """

    set_name: str
    recording: str
    values: Array
    guided: bool = False
    person: str = ""

    @property
    def subject(self) -> str:
        """Return the person, or the recording where nothing else has the same."""
        return self.person or self.recording


@dataclass(frozen=True)
class RealCase:
    """A real recording that need not be annotated."""

    path: Path

    def load(self) -> WindowMeasures | None:
        """Compute its measures; None for a rate below 50 Hz."""
        recording = load_recording(self.path)
        if np.median(np.diff(recording.t)) > 1.0 / LEAST_RATE_HZ:
            return None
        name = self.path.stem
        signals = recording.signals
        values = measures(recording.t, signals["pos"], signals["force"])
        set_name = name.split("_")[0]
        return WindowMeasures(set_name, name, values, guided=set_name in GUIDED_SETS)


@dataclass(frozen=True)
class SimulatedCase:
    """One demonstration of the simulated teacher, by an ideal person or one with habits."""

    scenario: str
    seed: int
    natural: bool

    def load(self) -> WindowMeasures:
        """Simulate the demonstration and compute its measures."""
        # Pinocchio takes a second to load: only for who teaches.
        from caesura_lab.teacher.simulated_teaching import teach  # noqa: PLC0415

        source = SOURCES[(self.seed + list(BASIC).index(self.scenario)) % len(SOURCES)]
        recording = teach(self.scenario, seed=self.seed, wrench_source=source, natural=self.natural).recording
        signals = recording.signals
        values = measures(recording.t, signals["pos"], signals["force"])
        set_name, name = NATURAL if self.natural else IDEAL, f"{self.scenario}-{self.seed}"
        guided = source != "flange_sensor" and not BASIC[self.scenario].surfaces
        return WindowMeasures(set_name, name, values, guided=guided, person=f"person {self.seed}")


Case = RealCase | SimulatedCase


@dataclass(frozen=True)
class SetSeparation:
    """The separation of windows: AUC with its 95 % interval over subjects, and the accuracy."""

    auc: float
    low: float
    high: float
    accuracy: float


@dataclass(frozen=True)
class RealismReport:
    """Separation of simulated from real windows, by people and measures; of each real set from the others.

    counts: recordings and windows by set; guided: as simulated, of free guided motion alone.
    """

    counts: Mapping[str, tuple[int, int]]
    simulated: Mapping[str, Mapping[str, SetSeparation]]
    guided: Mapping[str, Mapping[str, SetSeparation]]
    real: Mapping[str, SetSeparation]


def cases(data: Path, seeds: Sequence[int]) -> list[Case]:
    """All real recordings of a directory, and every scenario by both kinds of people.

    Raises TruthError where the directory has no recording.
    """
    files = sorted(data.glob("*.npz"))
    if not files:
        raise TruthError(f"{data}: no recording (*.npz) to compare with; name the directory with --data")
    simulated = [SimulatedCase(s, seed, n) for n in (False, True) for s in BASIC for seed in seeds]
    return [*map(RealCase, files), *simulated]


def load(case: Case) -> WindowMeasures | None:
    """Compute the measures of one case; None if it cannot be measured."""
    return case.load()


def measures(t: Array, position: Array, force: Array) -> Array:
    """Compute the measures (n, measures) of every window with motion for at least half of its time.

    t: (m,) [s]; position: (m, 3) [m]; force: (m, 3) [N].
    """
    t, first = np.unique(t, return_index=True)
    grid, velocity = velocity_on_grid(t, position[first])
    felt = np.column_stack([np.interp(grid, t, axis) for axis in force[first].T])
    length, step = round(WINDOW_S * GRID_HZ), round(STEP_S * GRID_HZ)
    rows = []
    for begin in range(0, len(grid) - length + 1, step):
        part = slice(begin, begin + length)
        speed = np.linalg.norm(velocity[part], axis=1)
        if np.mean(speed > MOVING_M_PER_S) >= LEAST_MOTION and speed.max() > SMALL_M_PER_S:
            rows.append([*_of_motion(velocity[part]), *_of_force(velocity[part], felt[part])])
    return np.array(rows, dtype=np.float64).reshape(-1, len(MEASURES))


def _of_motion(velocity: Array) -> Iterator[float]:
    speed = np.linalg.norm(velocity, axis=1)
    slow = gaussian_filter1d(speed, 0.19 * GRID_HZ, mode="nearest")
    moving = speed > MOVING_M_PER_S
    yield _log(speed.mean())
    yield _log(speed.max() / speed.mean())
    yield float(speed_peaks(speed))
    yield float(len(clear_dips(speed)))
    yield _log(float(np.std((speed / slow)[moving])))
    yield float(np.mean(speed < 0.002))
    yield float(np.mean(~moving & (speed >= 0.002)))
    way = np.cumsum(velocity, axis=0) / GRID_HZ
    yield _log(_bow(way))
    yield _log(_turn(velocity))
    yield _log(_jerk(velocity, speed))
    yield _log(_cubic_residual(way) / max(speed.sum() / GRID_HZ, SMALLEST))
    yield _log(_guided_residual(way) / speed.mean())


def _of_force(velocity: Array, force: Array) -> Iterator[float]:
    yield _log(float(np.linalg.norm(force, axis=1).mean()))
    for band in FORCE_BANDS_HZ:
        yield _log(_band_size(force, band))
    speed = np.linalg.norm(velocity, axis=1)
    fast = force - gaussian_filter1d(force, 0.05 * GRID_HZ, axis=0, mode="nearest")
    yield _log(float(fast[speed > SMALL_M_PER_S].std()))


def _log(value: float) -> float:
    return float(np.log(value + SMALLEST))


def _bow(way: Array) -> float:
    """Return the largest distance from the chord, as a share of the length."""
    chord = way[-1] - way[0]
    along = chord / max(float(np.linalg.norm(chord)), SMALLEST)
    from_start = way - way[0]
    aside = from_start - np.outer(from_start @ along, along)
    length = np.linalg.norm(np.diff(way, axis=0), axis=1).sum()
    return float(np.linalg.norm(aside, axis=1).max() / max(length, SMALLEST))


def _turn(velocity: Array) -> float:
    """Return the change of direction [rad] per metre, where it moves."""
    speed = np.linalg.norm(velocity, axis=1)
    fast = (speed[1:] > SMALL_M_PER_S) & (speed[:-1] > SMALL_M_PER_S)
    cosine = np.sum(velocity[1:] * velocity[:-1], axis=1) / np.maximum(speed[1:] * speed[:-1], SMALLEST**2)
    angle = np.arccos(np.clip(cosine, -1.0, 1.0))[fast].sum()
    return float(angle / max(speed[1:][fast].sum() / GRID_HZ, SMALLEST))


def _jerk(velocity: Array, speed: Array) -> float:
    """Return the dimensionless jerk: mean square jerk · time⁴ / mean square speed."""
    jerk = np.diff(velocity, 2, axis=0) * GRID_HZ**2
    return float(np.mean(np.sum(jerk**2, axis=1)) * WINDOW_S**4 / max(np.mean(speed**2), SMALLEST**2))


def _cubic_residual(way: Array) -> float:
    """Return the root mean square distance [m] from the best polynomial of third degree in time."""
    basis = np.polynomial.chebyshev.chebvander(np.linspace(-1.0, 1.0, len(way)), 3)
    fitted = basis @ np.linalg.lstsq(basis, way, rcond=None)[0]
    return float(np.sqrt(np.mean(np.sum((way - fitted) ** 2, axis=1))))


def _guided_residual(way: Array) -> float:
    """Return the root mean square innovation [m/s] of a critically damped velocity with 0.5 s, at 10 Hz."""
    steps = np.diff(way[:: GRID_HZ // 10], axis=0) * 10.0
    keep = np.exp(-0.1 / 0.5)
    innovation = steps[2:] - 2.0 * keep * steps[1:-1] + keep**2 * steps[:-2]
    return float(np.sqrt(np.mean(np.sum(innovation**2, axis=1))))


def _band_size(force: Array, band: tuple[float, float]) -> float:
    """Return the root mean square force [N] in a band, without its mean."""
    window = np.hanning(len(force))[:, None]
    power = np.abs(np.fft.rfft((force - force.mean(axis=0)) * window, axis=0)) ** 2
    hertz = np.fft.rfftfreq(len(force), 1.0 / GRID_HZ)
    inside = (hertz > band[0]) & (hertz <= band[1])
    return float(np.sqrt(2.0 * power[inside].sum()) / len(force))


def summarise(loaded: Iterable[WindowMeasures | None]) -> RealismReport:
    """Separate simulated from real windows, by all measures and by each, and real sets from each other."""
    windows = sorted((w for w in loaded if w is not None and len(w.values)), key=lambda w: w.recording)
    real = [w for w in windows if w.set_name not in (IDEAL, NATURAL)]
    sets = sorted({w.set_name for w in real})
    simulated = {who: [w for w in windows if w.set_name == who] for who in (IDEAL, NATURAL)}
    return RealismReport(
        {name: _count([w for w in windows if w.set_name == name]) for name in (IDEAL, NATURAL, *sets)},
        {who: _by_measures([*real, *some], who) for who, some in simulated.items()},
        {who: _by_measures(_guided([*real, *some]), who) for who, some in simulated.items()},
        {name: separation(real, name) for name in sets},
    )


def _guided(windows: Sequence[WindowMeasures]) -> list[WindowMeasures]:
    return [w for w in windows if w.guided]


def _count(windows: Sequence[WindowMeasures]) -> tuple[int, int]:
    return len(windows), sum(len(w.values) for w in windows)


def _by_measures(windows: Sequence[WindowMeasures], who: str) -> dict[str, SetSeparation]:
    """Return separations of windows of some persons from the others: all, by group, by measure."""
    chosen = {"all": MEASURES, **GROUPS, **{name: (name,) for name in MEASURES}}
    return {
        name: separation(windows, who, [MEASURES.index(m) for m in names]) for name, names in chosen.items()
    }


def separation(
    windows: Sequence[WindowMeasures],
    set_name: str,
    columns: Sequence[int] = tuple(range(len(MEASURES))),
) -> SetSeparation:
    """Separate the recordings of a set from the others by a regression that was not trained on them."""
    positive = np.array([w.set_name == set_name for w in windows])
    subjects = _numbered([w.subject for w in windows], positive)
    scores: list[Array] = [np.zeros(0)] * len(windows)
    for fold in range(FOLDS):
        held = subjects % FOLDS == fold
        model = fit([w.values[:, columns] for w in _where(windows, ~held)], positive[~held])
        for index in np.flatnonzero(held).tolist():
            scores[index] = model(windows[index].values[:, columns])
    auc = _auc(scores, positive)
    low, high = _interval(scores, positive, subjects)
    return SetSeparation(auc, low, high, _accuracy(scores, positive))


def _numbered(subjects: Sequence[str], positive: Labels) -> NDArray[np.intp]:
    """Return the number (n,) of each recording's subject within its class, in the order of recordings."""
    keys = list(zip(positive.tolist(), subjects, strict=True))
    numbers: dict[tuple[bool, str], int] = {}
    for key in dict.fromkeys(keys):
        numbers[key] = sum(other[0] == key[0] for other in numbers)
    return np.array([numbers[key] for key in keys], dtype=np.intp)


def _where(windows: Sequence[WindowMeasures], mask: Labels) -> list[WindowMeasures]:
    return [w for w, chosen in zip(windows, mask, strict=True) if chosen]


def fit(values: Sequence[Array], positive: Labels) -> Callable[[Array], Array]:
    """Fit a logistic regression with squares; either class and each recording within it weighs the same.

    values: one array (n, k) a recording. Returns the log odds (n,) of values (n, k).
    """
    together = np.concatenate(values)
    middle, spread = together.mean(axis=0), together.std(axis=0) + SMALLEST
    inputs = _terms((together - middle) / spread)
    labels = _labels_of_windows(values, positive)
    weights = np.concatenate([np.full(len(v), 1.0 / len(v)) for v in values])
    for label in (False, True):
        weights[labels == label] *= 0.5 * len(labels) / weights[labels == label].sum()
    sign = np.where(labels, 1.0, -1.0)

    def loss(w: Array) -> tuple[float, Array]:
        margin = sign * (inputs @ w)
        slope = -weights * sign * expit(-margin)
        value = float(weights @ np.logaddexp(0.0, -margin)) + 0.5 * PENALTY * float(w[1:] @ w[1:])
        return value, inputs.T @ slope + PENALTY * np.concatenate([[0.0], w[1:]])

    best = minimize(loss, np.zeros(inputs.shape[1]), jac=True, method="L-BFGS-B").x
    return lambda new: np.asarray(_terms((new - middle) / spread) @ best)


def _labels_of_windows(by_recording: Sequence[Array], positive: Labels) -> Labels:
    """Return the label of each window, from that of its recording."""
    return np.repeat(positive, [len(windows) for windows in by_recording])


def _terms(z: Array) -> Array:
    """Return one, values, squares and products of pairs."""
    first, second = np.triu_indices(z.shape[1])
    limited = np.clip(z, -4.0, 4.0)
    return np.column_stack([np.ones(len(z)), limited, limited[:, first] * limited[:, second]])


def _auc(scores: Sequence[Array], positive: Labels) -> float:
    """Return the probability that a window of the positive class has the higher score."""
    labels = _labels_of_windows(scores, positive)
    ranks = rankdata(np.concatenate(scores))
    ones, zeros = int(labels.sum()), int((~labels).sum())
    return float((ranks[labels].sum() - ones * (ones + 1) / 2) / (ones * zeros))


def _accuracy(scores: Sequence[Array], positive: Labels) -> float:
    """Return the mean share of correctly classified windows in either class."""
    labels = _labels_of_windows(scores, positive)
    right = (np.concatenate(scores) > 0.0) == labels
    return float(0.5 * (right[labels].mean() + right[~labels].mean()))


def _interval(scores: Sequence[Array], positive: Labels, subjects: NDArray[np.intp]) -> tuple[float, float]:
    """Return the 95 % interval of the AUC over subjects drawn with replacement, within either class."""
    rng = np.random.default_rng(0)
    of_class = [np.flatnonzero(positive == label) for label in (True, False)]
    every = [[rows[subjects[rows] == one] for one in np.unique(subjects[rows])] for rows in of_class]
    found = []
    for _ in range(RESAMPLES):
        drawn = np.concatenate([of[i] for of in every for i in rng.integers(len(of), size=len(of))])
        found.append(_auc([scores[i] for i in drawn], positive[drawn]))
    low, high = np.quantile(found, [0.025, 0.975])
    return float(low), float(high)


def title(seeds: Sequence[int]) -> str:
    """Return the title: the compared sets."""
    return (
        f"realism: windows of {WINDOW_S:g} s, people {seeds[0]} to {seeds[-1]} beside real recordings; "
        f"AUC 0.5 is chance; 95 % intervals over people, and real recordings"
    )


def _grids(result: RealismReport) -> list[Grid]:
    counts = tuple((name, str(n), str(k)) for name, (n, k) in result.counts.items())
    sets = tuple((name, *_cells(separate)) for name, separate in result.real.items())
    return [
        _compared("simulated from real, free guided motion", result.guided),
        _compared("simulated from real, all", result.simulated),
        Grid("a real set from the other real sets, all measures", ("set", "AUC", "right"), sets),
        Grid("what was compared", ("set", "recordings", "windows"), counts),
    ]


def _compared(heading: str, by_people: Mapping[str, Mapping[str, SetSeparation]]) -> Grid:
    before, after = by_people[IDEAL], by_people[NATURAL]
    rows = tuple((name, *_cells(before[name]), *_cells(after[name])) for name in before)
    return Grid(heading, ("measures", IDEAL, "right", NATURAL, "right"), rows)


def _cells(found: SetSeparation) -> tuple[str, str]:
    return f"{found.auc:.2f} ({found.low:.2f}–{found.high:.2f})", f"{100 * found.accuracy:.0f} %"


def page(result: RealismReport, heading: str) -> GridPage:
    """Return the tables of the results."""
    return GridPage(heading, _grids(result))


def as_json(result: RealismReport) -> dict[str, Any]:
    """Return every figure as plain values."""
    return {
        "counts": dict(result.counts),
        "simulated": {who: _plain(found) for who, found in result.simulated.items()},
        "guided": {who: _plain(found) for who, found in result.guided.items()},
        "real": _plain(result.real),
    }


def _plain(separations: Mapping[str, SetSeparation]) -> dict[str, dict[str, float]]:
    return {name: vars(found) for name, found in separations.items()}
