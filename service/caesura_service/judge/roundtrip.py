"""Does a program do what was taught? Teach, segment, check, run, segment again, and compare the two programs.

It holds when the apps are the same in the same order, every target lies within 1 cm of its own, and every
press has a force within 15 % of the one that the program asks for, as measured and segmented.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

from caesura_clients.programs.safety import Safety, Setting
from caesura_protocol.messages import App
from caesura_service.judge.tables import Grid, markdown_grid, rich_grid

SCENARIOS = ("pick_and_place", "dispenser")
TARGET_M, FORCE_SHARE = 0.01, 0.15
FORCE_LIMIT_N = 10.0  # of the simulated cell
REST_N = 1e-6


@dataclass(frozen=True)
class Case:
    """One person who teaches one scenario."""

    scenario: str
    seed: int


@dataclass(frozen=True)
class Trip:
    """How one round trip went.

    taught, executed: kinds of the apps; target_m: app by app, where the apps are the same; force: errors of
    presses, relative; why: why it does not hold, None where it does.
    """

    case: Case
    taught: tuple[str, ...]
    executed: tuple[str, ...]
    target_m: tuple[float, ...]
    force: tuple[float, ...]
    why: str | None


def travel(case: Case) -> Trip:
    """Go round once."""
    # Pinocchio and the compiled filter take seconds to load: only in the processes that need them.
    from caesura_clients.bridge.teacher.teaching import Teaching, finish  # noqa: PLC0415
    from caesura_service.execution.executor import Place, execute  # noqa: PLC0415
    from caesura_service.execution.findings import RefusedError  # noqa: PLC0415
    from caesura_service.recordings import segment_recording  # noqa: PLC0415

    teaching = Teaching(case.scenario, seed=case.seed)
    recording = finish(teaching, list(teaching.chunks(1.0))).recording
    taught = segment_recording(recording, setting=Setting(force_limit_n=FORCE_LIMIT_N))
    place = Place(teaching.scenario, teaching.person, case.seed)
    try:
        done = execute(taught.apps, place, Safety(force_n=FORCE_LIMIT_N))
    except RefusedError as refused:
        return Trip(case, _kinds(taught.apps), (), (), (), f"refused: {refused.report.errors[0]}")
    again = segment_recording(done.recording).apps
    if done.stopped is not None:
        why = f"stopped in app {done.at}: {done.stopped}"
        return Trip(case, _kinds(taught.apps), _kinds(again), (), (), why)
    return compared(case, taught.apps, again)


def compared(case: Case, taught: Sequence[App], executed: Sequence[App]) -> Trip:
    """What is different between the program that was run and the one that its recording gives."""
    kinds = _kinds(taught), _kinds(executed)
    if kinds[0] != kinds[1]:
        return Trip(case, *kinds, (), (), _first_difference(*kinds))
    targets = tuple(_target_error(a, b) for a, b in zip(taught, executed, strict=True))
    forces = tuple(
        _force_error(a, b) for a, b in zip(taught, executed, strict=True) if a.kind == "apply_force"
    )
    return Trip(case, *kinds, targets, forces, _too_far(taught, targets, forces))


def _target_error(taught: App, executed: App) -> float:
    """[m]; nan where one of them has no target."""
    if taught.target is None or executed.target is None:
        return float("nan") if taught.target is not executed.target else 0.0
    return float(np.linalg.norm(np.subtract(executed.target, taught.target)))


def _force_error(asked: App, executed: App) -> float:
    """Of the force that was asked for; signed. What was measured is not yet scaled to a limit."""
    newtons = float(np.linalg.norm(asked.force or (0.0, 0.0, 0.0)))
    return float(np.linalg.norm(executed.force_taught or (0.0, 0.0, 0.0))) / max(newtons, REST_N) - 1.0


def _first_difference(taught: Sequence[str], executed: Sequence[str]) -> str:
    for index, (a, b) in enumerate(zip(taught, executed, strict=False)):
        if a != b:
            return f"app {index} is {b}, taught was {a}"
    if len(executed) < len(taught):
        return f"app {len(executed)} is missing, taught was {taught[len(executed)]}"
    return f"app {len(taught)} is one too many, {executed[len(taught)]}"


def _too_far(taught: Sequence[App], targets: Sequence[float], forces: Sequence[float]) -> str | None:
    for index, (app, error) in enumerate(zip(taught, targets, strict=True)):
        if not error <= TARGET_M:
            return f"target of app {index} ({app.kind}) is {1000 * error:.1f} mm off"
    for error in forces:
        if not abs(error) <= FORCE_SHARE:
            return f"a force is {100 * error:+.0f} % off"
    return None


def _kinds(apps: Iterable[App]) -> tuple[str, ...]:
    return tuple(app.kind for app in apps)


def cases(seeds: Sequence[int]) -> list[Case]:
    """Every scenario by every person."""
    return [Case(scenario, seed) for scenario in SCENARIOS for seed in seeds]


def summarise(trips: Iterable[Trip]) -> dict[str, list[Trip]]:
    """Trips by scenario, in the order of the seeds."""
    ordered = sorted(trips, key=lambda trip: (SCENARIOS.index(trip.case.scenario), trip.case.seed))
    return {name: [t for t in ordered if t.case.scenario == name] for name in SCENARIOS}


def title(seeds: Sequence[int]) -> str:
    """What was measured."""
    return (
        f"round trip: people {seeds[0]} to {seeds[-1]}; the same apps, targets within "
        f"{1000 * TARGET_M:.0f} mm, forces within {100 * FORCE_SHARE:.0f} %"
    )


def _grids(summary: Mapping[str, Sequence[Trip]]) -> list[Grid]:
    headings = ("scenario", "holds", "same apps", "target [mm]", "worst", "force [%]", "worst")
    held = Grid("what holds", headings, tuple(_row(name, trips) for name, trips in summary.items()))
    failed = tuple(
        (t.case.scenario, str(t.case.seed), t.why) for trips in summary.values() for t in trips if t.why
    )
    return [held, Grid("what does not", ("scenario", "seed", "why"), failed)] if failed else [held]


def _row(name: str, trips: Sequence[Trip]) -> tuple[str, ...]:
    holds = sum(trip.why is None for trip in trips)
    same = sum(trip.taught == trip.executed for trip in trips)
    return (
        name,
        f"{holds} of {len(trips)}",
        str(same),
        *_spread([1000 * error for trip in trips for error in trip.target_m]),
        *_spread([100 * abs(error) for trip in trips for error in trip.force]),
    )


def _spread(errors: Sequence[float]) -> tuple[str, str]:
    """Median and worst."""
    return (f"{np.median(errors):.1f}", f"{np.max(errors):.1f}") if errors else ("–", "–")


def as_text(summary: Mapping[str, Sequence[Trip]], heading: str) -> RenderableType:
    """For a terminal."""
    parts: list[RenderableType] = [Text(heading, style="bold")]
    for grid in _grids(summary):
        parts += rich_grid(grid)
    return Group(*parts)


def as_markdown(summary: Mapping[str, Sequence[Trip]], heading: str) -> str:
    """For a page."""
    return "\n\n".join([f"**{heading}**", *map(markdown_grid, _grids(summary))]) + "\n"


def as_json(summary: Mapping[str, Sequence[Trip]]) -> dict[str, Any]:
    """Every trip."""
    return {name: [asdict(trip) for trip in trips] for name, trips in summary.items()}
