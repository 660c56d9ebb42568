"""A round trip of a program: teach, segment, check, run, segment again, and compare the two programs.

It holds when the apps are the same in the same order, every target lies within 1 cm of its own, every press
has a force within 15 % of the one that the program asks for, as measured and segmented, and every path that
was run lies within 5 mm and 2° of the demonstrated one. Paths are compared app by app, as both were measured,
from every place of the demonstration to the nearest of the run, and back. One movement that the two programs
divide otherwise is the same if the motion is (`division_differences`).

Beside the measured forces it states the forces on the simulated surfaces: those of the run against those of
the program, and those of the program against those of the demonstration. Where only a measured one is off,
the error is that of the run's sensor.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_lab.evaluation.programs.division_differences import (
    AROUND_S,
    BothMotions,
    Difference,
    differences,
    movements_of,
)
from caesura_lab.evaluation.reports.grids import Grid, GridPage
from caesura_lab.path_distance import furthest
from caesura_lab.teacher.hand_motion_plan import TICKS_PER_S
from caesura_protocol.app_kinds import APP_KINDS, app_name, app_number, app_title, name_of_app
from caesura_protocol.messages import App, Vector
from caesura_protocol.programs.app_time_shifts import rest_newtons, rests_of, run_times
from caesura_protocol.programs.document import document_of_apps
from caesura_protocol.programs.document_timing import RunSpeed
from caesura_protocol.programs.safety import CellSettings, Safety
from caesura_protocol.recording import Recording
from caesura_service.program.forces.pressed_force import pressed_from
from caesura_service.program.program_segment import PUSHES_BACK_N

Array = NDArray[np.float64]
MotionDifference = Callable[[Difference], str | None]

LIMITS_N: Mapping[str, float] = MappingProxyType(  # of the simulated cell, by scenario
    {
        "pick_and_place": 10.0,
        "dispenser": 10.0,
        **dict.fromkeys(("screwing", "peg", "pouring", "circle", "contour", "peeling"), 20.0),
    }
)
SCENARIOS = tuple(LIMITS_N)
TARGET_M, FORCE_SHARE = 0.01, 0.15
PATH_M, PATH_RAD = 0.005, math.radians(2.0)
EVERY = 10  # ticks of 1 ms, of which one is compared
REST_N = 1e-6


@dataclass(frozen=True)
class RoundTripCase:
    """One person who teaches one scenario on one arm; the program runs as taught, or as fast as possible."""

    scenario: str
    seed: int
    robot: str = "panda"
    speed: RunSpeed = "taught"


@dataclass(frozen=True)
class RoundTripResult:
    """The outcome of one round trip.

    taught, executed: kinds of the apps; target_m: app by app, or movement by movement where one is divided
    otherwise; force: errors of presses, relative; path_m, path_rad: largest distance and angle between the
    demonstrated path and the one that was run, app by app that moves; exerted: errors of the forces on the
    simulated surfaces, relative; stated: errors of the program's forces, relative to those with which the
    hand pressed on the surfaces; why: the reason of a failure, None for a success.
    """

    case: RoundTripCase
    taught: tuple[str, ...]
    executed: tuple[str, ...]
    target_m: tuple[float, ...]
    force: tuple[float, ...]
    why: str | None
    path_m: tuple[float, ...] = ()
    path_rad: tuple[float, ...] = ()
    exerted: tuple[float, ...] = ()
    stated: tuple[float, ...] = ()


def run_round_trip(case: RoundTripCase) -> RoundTripResult:
    """Teach, segment, execute and segment again; compare the two programs and their paths."""
    # Pinocchio and the compiled filter take seconds to load: only in the processes that need them.
    from caesura_lab.execution.executor import SimulatedCell, execute  # noqa: PLC0415
    from caesura_lab.teacher.simulated_teaching import SimulatedTeaching, finish  # noqa: PLC0415
    from caesura_protocol.programs.checks.findings import RefusedError  # noqa: PLC0415
    from caesura_service.offline_segmentation import segment_recording  # noqa: PLC0415
    from caesura_service.robot import load_robot  # noqa: PLC0415

    robot = load_robot(case.robot)
    teaching = SimulatedTeaching(case.scenario, seed=case.seed, robot=robot)
    recording = finish(teaching, list(teaching.chunks(1.0))).recording
    limit_n = LIMITS_N[case.scenario]
    taught = segment_recording(recording, setting=CellSettings(force_limit_n=limit_n))
    simulated_cell = SimulatedCell(teaching.scenario, teaching.person, case.seed)
    safety = Safety(force_n=limit_n)
    run_apps: Sequence[App] = taught.apps
    if case.speed == "optimal":
        # Its extra need not be installed where programs run as taught.
        from caesura_lab.retiming import optimal  # noqa: PLC0415

        run_apps = optimal(document_of_apps(tuple(taught.apps), case.scenario, safety), robot=robot).apps
    try:
        done = execute(run_apps, simulated_cell, safety, robot=robot)
    except RefusedError as refused:
        return RoundTripResult(case, _kinds(taught.apps), (), (), (), f"refused: {refused.report.errors[0]}")
    again = segment_recording(done.recording).apps
    if done.stopped is not None:
        why = f"stopped in app {app_number(done.at or 0)}: {done.stopped}"
        return RoundTripResult(case, _kinds(taught.apps), _kinds(again), (), (), why)
    app_times = [run_times(app) for app in taught.apps]
    motions = BothMotions(recording, done.recording, app_times, done.spans, retimed=case.speed != "taught")
    result = compare_programs(case, run_apps, again, motions.difference_at)
    off = [
        path_distance(
            _app_poses(recording, app.path.start.t, app.path.tn),
            _app_poses(done.recording, *_without_rests(app, *span)),
        )
        for app, span in zip(taught.apps, done.spans, strict=True)
        if app.path is not None
    ]
    path_m, path_rad = tuple(one[0] for one in off), tuple(one[1] for one in off)
    exerted = tuple(exerted_errors(run_apps, done.spans, done.trace.contact))
    stated = tuple(stated_errors(taught.apps, teaching.contact))
    reason = result.why or _path_error(path_m, path_rad)
    return replace(result, path_m=path_m, path_rad=path_rad, exerted=exerted, stated=stated, why=reason)


def exerted_errors(
    apps: Sequence[App], spans: Sequence[tuple[float, float]], contact: Array
) -> Iterator[float]:
    """Yield the signed relative error of each force that a run exerted: in a rest, on a path, in a rest.

    It is the median over the second half of that time, in which the force has risen. spans: begin and end [s]
    of each app; contact: (n, 3) [N] at every tick.
    """
    for app, span in zip(apps, spans, strict=True):
        (before_n, after_n), newton = rest_newtons(app), _size(app.force)
        for (t0, tn), asked_n in zip(_pressed_times(app, span), (before_n, newton, after_n), strict=False):
            exerted_n = np.linalg.norm(contact[_ticks(0.5 * (t0 + tn), tn)], axis=1)
            if exerted_n.size:
                yield float(np.median(exerted_n)) / max(asked_n, REST_N) - 1.0


def stated_errors(apps: Sequence[App], contact: Array) -> Iterator[float]:
    """Yield the signed relative error of each force that a program states: in a rest, on a path, in a rest.

    The hand's force is the median while it pressed, as for the program: without the touch and the release.
    contact: (n, 3) [N] at every tick of the demonstration, on the simulated surfaces.
    """
    for app in apps:
        before, after = (
            None if rest is None else rest.newton_taught for rest in (app.rest_before, app.rest_after)
        )
        stated = ((before, False), (_size(app.force_taught), True), (after, False))
        for times, (stated_n, on_path) in zip(_pressed_times(app, run_times(app)), stated, strict=False):
            hand_n = np.linalg.norm(contact[_ticks(*times)], axis=1)
            least_n = max(pressed_from(hand_n) if on_path and hand_n.size else 0.0, PUSHES_BACK_N)
            pressed_n = hand_n[hand_n >= least_n]
            if stated_n is not None and pressed_n.size:
                yield stated_n / float(np.median(pressed_n)) - 1.0


def _pressed_times(app: App, span: tuple[float, float]) -> Sequence[tuple[float, float]]:
    """Return begin and end [s] of the rest, the path and the rest of an app over a span; () for no press."""
    if not APP_KINDS[app.kind].presses:
        return ()
    (begun, ended), (before_s, after_s) = span, rests_of(app)
    return tuple(pairwise((begun, begun + before_s, ended - after_s, ended)))


def _ticks(t0: float, tn: float) -> slice:
    return slice(round(TICKS_PER_S * t0), round(TICKS_PER_S * tn))


def path_distance(one: AppPoses, other: AppPoses) -> tuple[float, float]:
    """Return the largest distance [m] and angle [rad] from the poses of each path to the other."""
    pairs = [(here.inside[::EVERY], there.around) for here, there in ((one, other), (other, one))]
    return furthest(pairs, PATH_M, PATH_RAD)


class AppPoses(NamedTuple):
    """Flange poses (n, 7) of an app, and those (m, 7) from `AROUND_S` before to `AROUND_S` after it."""

    inside: Array
    around: Array


def _without_rests(app: App, begun: float, ended: float) -> tuple[float, float]:
    """Return the begin and end [s] of the path in an app's run from `begun` to `ended`: without its rests."""
    before_s, after_s = rests_of(app) if APP_KINDS[app.kind].presses else (0.0, 0.0)
    return begun + before_s, ended - after_s


def _app_poses(recording: Recording, t0: float, tn: float) -> AppPoses:
    return AppPoses(_poses(recording, t0, tn), _poses(recording, t0 - AROUND_S, tn + AROUND_S))


def _poses(recording: Recording, t0: float, tn: float) -> Array:
    """Return the measured flange poses (n, 7) between two times [s]."""
    inside = slice(*np.searchsorted(recording.t, (t0, tn)).tolist())
    return np.hstack([recording.signals["pos"][inside], recording.signals["quat"][inside]])


def _path_error(path_m: Sequence[float], path_rad: Sequence[float]) -> str | None:
    if max(path_m, default=0.0) > PATH_M:
        return f"a path is {1000 * max(path_m):.1f} mm off"
    if max(path_rad, default=0.0) > PATH_RAD:
        return f"a path is turned by {math.degrees(max(path_rad)):.1f}°"
    return None


def compare_programs(
    case: RoundTripCase,
    taught: Sequence[App],
    executed: Sequence[App],
    motion_difference: MotionDifference | None = None,
) -> RoundTripResult:
    """Compare a program with the one inferred from the recording of its run.

    motion_difference: how the motion differs at a division that only one program states; None where it is the
    same. Without it, every such division is a difference.
    """
    kinds = _kinds(taught), _kinds(executed)
    result = RoundTripResult(case, *kinds, (), (), None)
    if kinds[0] == kinds[1]:
        result = _compared(result, [*enumerate(taught)], executed)
    else:
        result = replace(result, why=_first_difference(*kinds))
    if result.why is None or motion_difference is None:
        return result
    mine, others = movements_of(taught), movements_of(executed)
    if [one.kind for one in mine] != [one.kind for one in others]:
        return result
    only = (one for pair in zip(mine, others, strict=True) for one in differences(*pair, TARGET_M))
    unlike = next(filter(None, map(motion_difference, only)), None)
    if unlike is not None:
        return replace(result, why=f"{result.why}: {unlike}")
    return _compared(result, [one.last for one in mine], [one.last[1] for one in others])


def _compared(
    result: RoundTripResult, taught: Sequence[tuple[int, App]], executed: Sequence[App]
) -> RoundTripResult:
    """Return the result with the errors of targets and forces, app by app. taught: with their indices."""
    pairs = [(app, other) for (_, app), other in zip(taught, executed, strict=True)]
    targets = tuple(_target_error(*pair) for pair in pairs)
    forces = tuple(error for pair in pairs for error in _force_errors(*pair))
    why = _target_or_force_error(taught, targets, forces)
    return replace(result, target_m=targets, force=forces, why=why)


def _target_error(taught: App, executed: App) -> float:
    """Return the distance [m] of two targets; nan where one app has none, 0 where neither has."""
    if taught.target is None or executed.target is None:
        return float("nan") if taught.target is not executed.target else 0.0
    return float(np.linalg.norm(np.subtract(executed.target, taught.target)))


def _force_errors(asked: App, executed: App) -> Iterator[float]:
    """Yield the signed relative error of each force asked for; the force of a rest where both state it.

    The measured force is the one before it is scaled to a limit.
    """
    if not APP_KINDS[asked.kind].presses:
        return
    yield _size(executed.force_taught) / max(_size(asked.force), REST_N) - 1.0
    for mine, other in ((asked.rest_before, executed.rest_before), (asked.rest_after, executed.rest_after)):
        if mine is not None and other is not None:
            yield other.newton_taught / max(mine.newton, REST_N) - 1.0


def _size(force: Vector | None) -> float:
    return math.hypot(*(force or (0.0, 0.0, 0.0)))


def _first_difference(taught: Sequence[str], executed: Sequence[str]) -> str:
    for index, (a, b) in enumerate(zip(taught, executed, strict=False)):
        if a != b:
            return f"{app_name(index, b)} was taught as {app_title(a)}"
    if len(executed) < len(taught):
        return f"{app_name(len(executed), taught[len(executed)])} is missing"
    return f"{app_name(len(taught), executed[len(taught)])} is one too many"


def _target_or_force_error(
    taught: Sequence[tuple[int, App]], targets: Sequence[float], forces: Sequence[float]
) -> str | None:
    for (index, app), error in zip(taught, targets, strict=True):
        if not error <= TARGET_M:
            return f"target of {name_of_app(index, app)} is {1000 * error:.1f} mm off"
    for error in forces:
        if not abs(error) <= FORCE_SHARE:
            return f"a force is {100 * error:+.0f} % off"
    return None


def _kinds(apps: Iterable[App]) -> tuple[str, ...]:
    return tuple(app.kind for app in apps)


def cases(seeds: Sequence[int], robot: str = "panda", speed: RunSpeed = "taught") -> list[RoundTripCase]:
    """Every scenario by every person, on one arm, at one speed."""
    return [RoundTripCase(scenario, seed, robot, speed) for scenario in SCENARIOS for seed in seeds]


def summarise(results: Iterable[RoundTripResult]) -> dict[str, list[RoundTripResult]]:
    """Return the round trips by scenario, in the order of the seeds."""
    ordered = sorted(results, key=lambda result: (SCENARIOS.index(result.case.scenario), result.case.seed))
    return {name: [t for t in ordered if t.case.scenario == name] for name in SCENARIOS}


def title(seeds: Sequence[int], robot: str = "panda", speed: RunSpeed = "taught") -> str:
    """Return the title: what was measured, and within which limits."""
    return (
        f"round trip on {robot}, speed {speed}: people {seeds[0]} to {seeds[-1]}; "
        "the same apps, or one movement divided otherwise, "
        f"targets within {1000 * TARGET_M:.0f} mm, forces within {100 * FORCE_SHARE:.0f} %, "
        f"paths within {1000 * PATH_M:.0f} mm and {math.degrees(PATH_RAD):.0f}°"
    )


def _grids(summary: Mapping[str, Sequence[RoundTripResult]]) -> list[Grid]:
    headings = (
        "scenario",
        "holds",
        "same apps",
        "target [mm]",
        "worst",
        "force [%]",
        "worst",
        "exerted [%]",
        "worst",
        "stated [%]",
        "worst",
        "path [mm]",
        "worst",
        "turn [°]",
        "worst",
    )
    held = Grid("what holds", headings, tuple(_row(name, results) for name, results in summary.items()))
    failed = tuple(
        (t.case.scenario, str(t.case.seed), t.why) for results in summary.values() for t in results if t.why
    )
    return [held, Grid("what does not", ("scenario", "seed", "why"), failed)] if failed else [held]


def _row(name: str, results: Sequence[RoundTripResult]) -> tuple[str, ...]:
    holds = sum(result.why is None for result in results)
    same = sum(result.taught == result.executed for result in results)
    return (
        name,
        f"{holds}/{len(results)}",
        str(same),
        *_spread([1000 * error for result in results for error in result.target_m]),
        *_spread([100 * abs(error) for result in results for error in result.force]),
        *_spread([100 * abs(error) for result in results for error in result.exerted]),
        *_spread([100 * abs(error) for result in results for error in result.stated]),
        *_spread([1000 * off for result in results for off in result.path_m]),
        *_spread([math.degrees(off) for result in results for off in result.path_rad]),
    )


def _spread(errors: Sequence[float]) -> tuple[str, str]:
    """Return the median and the worst error as text."""
    return (f"{np.median(errors):.1f}", f"{np.max(errors):.1f}") if errors else ("–", "–")


def page(summary: Mapping[str, Sequence[RoundTripResult]], heading: str) -> GridPage:
    """Return the tables of the results."""
    return GridPage(heading, _grids(summary))


def as_json(summary: Mapping[str, Sequence[RoundTripResult]]) -> dict[str, Any]:
    """Return every round trip as plain values, by scenario."""
    return {name: [asdict(result) for result in results] for name, results in summary.items()}
