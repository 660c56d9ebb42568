"""Hints on demonstrations with one injected fault each: recall and latency; and false hints without a fault.

    caesura evaluate --suite coaching

The simulated teacher demonstrates with habits. `injected_faults` injects the faults. A fault is found by a
hint of its kind that is published after the fault begins, and active at some time from its cause until
LATEST_S later. The time of publication is that of the last pushed sample: the latency includes conditioning
and batches, and not the network. The same demonstrations without a fault count false hints.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from caesura_lab.evaluation.hints.injected_faults import (
    INJECTED,
    JOINT_MARGIN_RAD,
    NEAR_TRUTH_S,
    SINGULAR,
    CleanDemonstration,
    Fault,
    NotInjectableError,
    first_unrecorded,
    least_singular_value,
)
from caesura_lab.evaluation.reports.grids import Grid, GridPage
from caesura_lab.teacher.scenarios import BASIC, SKILLS
from caesura_protocol.errors import CaesuraError, ProtocolError
from caesura_protocol.formats.read import load_recording
from caesura_protocol.messages import Hint, HintKind, WrenchSource
from caesura_protocol.recording import Recording
from caesura_service.offline_segmentation import views
from caesura_service.robot import load_robot

Array = NDArray[np.float64]

LATEST_S = 0.5  # after the cause
LEAST_RECALL, MOST_FALSE_A_MINUTE = 0.9, 1.0  # the bars, for simulated people
PANDA = "panda"


@dataclass(frozen=True)
class CoachingCase:
    """A demonstration, judged without a fault and with each of some faults."""

    scenario: str
    seed: int
    faults: tuple[str, ...]


@dataclass(frozen=True)
class PublishedHint:
    """A hint as first published, with the time at which it was cleared, and the time of publication [s]."""

    hint: Hint
    at: float


@dataclass(frozen=True)
class FaultResult:
    """Result of one fault. latency [s]: from its cause to the first hint, negative for an earlier hint.

    None: no hint.
    """

    fault: str
    scenario: str
    seed: int
    cause: float
    latency: float | None

    @property
    def found(self) -> bool:
        """Whether the hint was published in time."""
        return self.latency is not None and self.latency <= LATEST_S


@dataclass(frozen=True)
class CleanResult:
    """Hints of a demonstration without a fault; explained: those whose cause is in the truth."""

    group: str
    name: str
    seconds: float
    hints: tuple[HintKind, ...]
    explained: tuple[HintKind, ...] = ()


@dataclass(frozen=True)
class CoachingResult:
    """All results of a case."""

    clean: CleanResult
    faults: tuple[FaultResult, ...] = ()


EACH = 7  # faults that are tried in a demonstration

# --- hints of a recording ---------------------------------------------------------------------------------


def published(recording: Recording) -> list[PublishedHint]:
    """Return every hint of a recording, with the time at which a subscriber receives it [s].

    Raises as `views`.
    """
    first: dict[tuple[HintKind, float], PublishedHint] = {}
    until: dict[tuple[HintKind, float], float | None] = {}
    for view in views(recording):
        for hint in view.hints:
            key = hint.kind, hint.since
            first.setdefault(key, PublishedHint(hint, float(recording.t[view.samples - 1])))
            until[key] = hint.until
    return [
        replace(one, hint=one.hint.model_copy(update={"until": until[key]})) for key, one in first.items()
    ]


def run_case(case: CoachingCase) -> CoachingResult:
    """Teach a demonstration; judge it without and with faults."""
    # Pinocchio takes a second to load: only where a person teaches.
    from caesura_lab.teacher.simulated_teaching import teach  # noqa: PLC0415

    shown = teach(case.scenario, seed=case.seed, natural=True)

    def with_hand() -> Recording:
        source: WrenchSource = "flange_sensor_with_hand"
        return teach(case.scenario, seed=case.seed, natural=True, wrench_source=source).recording

    taught = CleanDemonstration(shown.recording, shown.truth, with_hand, load_robot(PANDA))
    hints = published(shown.recording)
    clean = CleanResult(
        group="simulated",
        name=f"{case.scenario}-{case.seed}",
        seconds=float(shown.recording.t[-1] - shown.recording.t[0]),
        hints=tuple(one.hint.kind for one in hints),
        explained=tuple(one.hint.kind for one in hints if _is_explained(one.hint, taught)),
    )
    faults = []
    for name in case.faults:
        rng = np.random.default_rng((case.seed, *name.encode()))
        try:
            fault = INJECTED[name].inject(taught, rng)
        except NotInjectableError:
            continue
        faults.append(judged(name, case, fault))
    return CoachingResult(clean, tuple(faults))


def judged(name: str, case: CoachingCase, fault: Fault) -> FaultResult:
    """Compare the hints of a fault with its cause."""
    hints = [one for one in published(fault.recording) if fault.is_named_by(one.hint)]
    times = [
        one.at
        for one in hints
        if one.at >= fault.begins and (one.hint.until is None or one.hint.until >= fault.cause)
    ]
    latency = min(times) - fault.cause if times else None
    return FaultResult(name, case.scenario, case.seed, fault.cause, latency)


def _is_explained(hint: Hint, taught: CleanDemonstration) -> bool:
    """Whether the truth has a cause for the hint, although no fault was injected."""
    t, truth = taught.recording.t, taught.truth
    near = int(np.searchsorted(t, hint.since))
    window = slice(max(near - 1000, 0), near + 1000)
    match hint.kind:
        case "uncertain_boundary":
            place = hint.since if hint.t0 is None else hint.t0
            optional = [one["t"] for one in truth["changepoints"] if one["level"] == "optional"]
            return any(abs(place - at) <= NEAR_TRUTH_S for at in optional)
        case "joint_limit":
            q = taught.recording.signals["q"][window]
            left = np.minimum(q - taught.robot.lower_limits, taught.robot.upper_limits - q)
            return bool(left.min() < JOINT_MARGIN_RAD)
        case "singularity":
            rows = taught.recording.signals["q"][window][::50]
            return min(least_singular_value(taught.robot, row) for row in rows) < SINGULAR
        case "too_fast":
            return first_unrecorded(t[window], taught.recording.signals["pos"][window]) is not None
    return False


@dataclass(frozen=True)
class RealRecording:
    """A real recording, assumed to have no fault."""

    path: Path

    def hints(self) -> CleanResult | None:
        """Return the hints of the recording; None if it cannot be read or segmented."""
        try:
            recording = load_recording(self.path)
            hints = published(recording)
        except (CaesuraError, ProtocolError, ValueError):
            return None
        seconds = float(recording.t[-1] - recording.t[0])
        group = self.path.stem.split("_")[0]
        return CleanResult(group, self.path.stem, seconds, tuple(one.hint.kind for one in hints))


Case = CoachingCase | RealRecording


def cases(seeds: Sequence[int], data: Path) -> list[Case]:
    """Return every scenario by every person with faults in turn, and the real recordings of a directory."""
    names = list(INJECTED)
    taught = [(scenario, seed) for seed in seeds for scenario in (*BASIC, *SKILLS)]
    simulated = [
        CoachingCase(*one, tuple(names[(EACH * number + k) % len(names)] for k in range(EACH)))
        for number, one in enumerate(taught)
    ]
    return [*simulated, *(RealRecording(path) for path in sorted(data.glob("*.npz")))]


def run(case: Case) -> CoachingResult | None:
    """Judge a case, in a separate process."""
    if isinstance(case, CoachingCase):
        return run_case(case)
    found = case.hints()
    return None if found is None else CoachingResult(found)


# --- results ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class CoachingSummary:
    """Faults by name, up to the wanted number, and demonstrations without a fault by set."""

    faults: Mapping[str, tuple[FaultResult, ...]]
    clean: Mapping[str, tuple[CleanResult, ...]]


def summarise(results: Iterable[CoachingResult | None]) -> CoachingSummary:
    """Summarise results in a fixed order, independent of their arrival."""
    known = [result for result in results if result is not None]
    known.sort(key=lambda result: result.clean.name)
    faults = {
        name: _spread([one for result in known for one in result.faults if one.fault == name], fault.judged)
        for name, fault in INJECTED.items()
    }
    groups = dict.fromkeys(["simulated", *(result.clean.group for result in known)])
    clean = {group: tuple(one.clean for one in known if one.clean.group == group) for group in groups}
    return CoachingSummary(faults, {group: some for group, some in clean.items() if some})


@dataclass(frozen=True)
class Bar:
    """A demand on the simulated demonstrations, and what was found; None where nothing was judged."""

    name: str
    wanted: str
    found: float | None
    is_met: bool

    def words(self) -> str:
        """Return the bar and what was found as text."""
        found = "nothing was judged" if self.found is None else f"{self.found:.2f}"
        return f"{self.name}: {found}, wanted {self.wanted}"


def bars(summary: CoachingSummary) -> tuple[Bar, Bar]:
    """Return the bars of recall and of false hints: both are exact, the tables are rounded."""
    faults = [one.found for some in summary.faults.values() for one in some]
    recall = sum(faults) / len(faults) if faults else None
    simulated = summary.clean.get("simulated", ())
    minutes = sum(one.seconds for one in simulated) / 60.0
    false = sum(len(one.hints) - len(one.explained) for one in simulated)
    rate = false / minutes if minutes else None
    return (
        Bar("recall", f"at least {LEAST_RECALL:g}", recall, recall is not None and recall >= LEAST_RECALL),
        Bar(
            "false hints a minute",
            f"at most {MOST_FALSE_A_MINUTE:g}",
            rate,
            rate is not None and rate <= MOST_FALSE_A_MINUTE,
        ),
    )


def unmet(summary: CoachingSummary) -> list[str]:
    """Return the bars that are not met, as text."""
    return [bar.words() for bar in bars(summary) if not bar.is_met]


def _spread(faults: Sequence[FaultResult], judged: int) -> tuple[FaultResult, ...]:
    """Return at most the given number of results, evenly from all demonstrations, found or not."""
    wanted = min(judged, len(faults))
    return tuple(faults[number * len(faults) // wanted] for number in range(wanted))


def title(seeds: Sequence[int]) -> str:
    """Return the title: what was measured, and within which time."""
    return (
        f"coaching: people {seeds[0]} to {seeds[-1]}; a hint is found up to {LATEST_S:g} s after its cause; "
        "latency to the sample with which it is published"
    )


def _grids(summary: CoachingSummary) -> list[Grid]:
    grids = [_bar_grid(summary), _fault_grid(summary), _clean_grid(summary)]
    missed = tuple(
        (one.fault, f"{one.scenario}-{one.seed}", f"{one.cause:.2f}", _late(one))
        for one in _every_fault(summary)
        if not one.found
    )
    if missed:
        grids.append(Grid("not found in time", ("fault", "demonstration", "cause [s]", "hint"), missed))
    return grids


def _every_fault(summary: CoachingSummary) -> tuple[FaultResult, ...]:
    return tuple(one for some in summary.faults.values() for one in some)


def _bar_grid(summary: CoachingSummary) -> Grid:
    rows = []
    for bar in bars(summary):
        found = "–" if bar.found is None else f"{bar.found:.2f}"
        rows.append((bar.name, bar.wanted, found, "yes" if bar.is_met else "no"))
    return Grid("bars, simulated people", ("bar", "wanted", "found", "met"), tuple(rows))


def _fault_grid(summary: CoachingSummary) -> Grid:
    rows = [_fault_row(name, some) for name, some in summary.faults.items()]
    headings = ("fault", "hint", "found", "recall", "median latency [s]", "worst found [s]")
    return Grid("injected faults", headings, (*rows, _fault_row("all", _every_fault(summary))))


def _clean_grid(summary: CoachingSummary) -> Grid:
    causes = ("hints", "a minute", "with a cause in the truth", "false a minute", "kinds")
    rows = tuple(_clean_row(group, some) for group, some in summary.clean.items())
    return Grid("hints without a fault", ("set", "recordings", "minutes", *causes), rows)


def _late(one: FaultResult) -> str:
    return "none" if one.latency is None else f"{one.latency:.2f} s late"


def _fault_row(name: str, faults: Sequence[FaultResult]) -> tuple[str, ...]:
    found = [one.latency for one in faults if one.found and one.latency is not None]
    if not faults:
        return (name, "–", "0 of 0", "–", "–", "–")
    median, worst = (f"{np.median(found):.2f}", f"{max(found):.2f}") if found else ("–", "–")
    return (
        name,
        INJECTED[name].hint if name in INJECTED else "",
        f"{len(found)} of {len(faults)}",
        f"{len(found) / len(faults):.2f}",
        median,
        worst,
    )


def _clean_row(group: str, some: Sequence[CleanResult]) -> tuple[str, ...]:
    minutes = sum(one.seconds for one in some) / 60.0
    count, explained = (sum(len(getattr(one, name)) for one in some) for name in ("hints", "explained"))
    kinds = Counter(kind for one in some for kind in one.hints)
    return (
        group,
        str(len(some)),
        f"{minutes:.1f}",
        str(count),
        f"{count / minutes:.2f}",
        str(explained) if group == "simulated" else "–",
        f"{(count - explained) / minutes:.2f}",
        ", ".join(f"{kind} {number}" for kind, number in kinds.most_common()),
    )


def page(summary: CoachingSummary, heading: str) -> GridPage:
    """Return the tables of the results."""
    return GridPage(heading, _grids(summary))


def as_json(summary: CoachingSummary) -> dict[str, Any]:
    """Return every result as plain values."""
    return {"bars": [asdict(bar) for bar in bars(summary)], **asdict(summary)}
