"""Mutated programs: each must be refused by the check, or its run must stay within the limits.

A mutation changes a taught program by up to three of the operators below, without validation. A program that
passes the check is run in the simulated cell, and every tick is compared with the limits: speed, force,
workspace, joints and their speeds. Exceeding a limit is a violation, and so is a crash.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from caesura_lab.evaluation.programs.program_round_trip import LIMITS_N
from caesura_lab.evaluation.reports.grids import Grid, GridPage
from caesura_protocol.app_kinds import APP_KINDS
from caesura_protocol.messages import App
from caesura_protocol.programs.safety import CellSettings, Safety
from caesura_service.constants import JOINTS

TAUGHT_SEEDS = (500, 502)
MOST_OPERATORS = 3
SCENARIOS = ("pick_and_place", "dispenser")
CELLS = {name: Safety(force_n=LIMITS_N[name]) for name in SCENARIOS}
NUMBERS = ("t0", "tn", "load_kg", "gripper_width", "confidence")
VECTORS = ("target", "orientation", "joints", "force")
Outcome = Literal["refused", "done", "stopped", "violation"]
Apps = list[App]
Rng = np.random.Generator


@dataclass(frozen=True)
class MutationResult:
    """Outcome of one mutated program.

    operators: the applied ones; why: the first reason of a refusal or stop, or the first violation.
    """

    number: int
    operators: tuple[str, ...]
    outcome: Outcome
    why: str = ""


def run_mutation(number: int) -> MutationResult:
    """Mutate a program, check it, run it where it passes."""
    from caesura_lab.execution.executor import execute  # noqa: PLC0415
    from caesura_protocol.programs.checks.findings import RefusedError  # noqa: PLC0415

    rng = np.random.default_rng([number, 2])
    scenario = SCENARIOS[number % 2]
    cell, (apps, simulated_cell) = CELLS[scenario], _program_of(scenario, TAUGHT_SEEDS[number // 2 % 2])
    operators, mutated = mutate(apps, rng)
    try:
        done = execute(mutated, simulated_cell, cell)
    except RefusedError as refused:
        return MutationResult(number, operators, "refused", str(refused.report.errors[0]))
    except Exception as error:  # whatever it is, a spoilt program must not bring it about
        return MutationResult(number, operators, "violation", f"crashed: {error!r}")
    if broken := violations(done.trace, cell):
        return MutationResult(number, operators, "violation", broken[0])
    if done.stopped is not None:
        return MutationResult(number, operators, "stopped", done.stopped)
    return MutationResult(number, operators, "done")


def violations(trace: Any, safety: Safety) -> list[str]:
    """Return the limits that a run (a teacher's `SimulationTrace`) exceeded."""
    robot = _robot()
    positions, _ = robot.flange_poses(trace.q[::5])
    low, high = robot.lower_limits, robot.upper_limits
    speeds = robot.velocity_limits
    checks = (
        ("speed [m/s]", np.linalg.norm(trace.twist[:, :3], axis=1), 0.0, safety.speed_m_per_s),
        ("turn [rad/s]", np.linalg.norm(trace.twist[:, 3:], axis=1), 0.0, safety.turn_rad_per_s),
        ("force [N]", np.linalg.norm(trace.contact, axis=1), 0.0, safety.felt_force_n),
        ("position [m]", positions, np.array(safety.workspace_low), np.array(safety.workspace_high)),
        ("joints [rad]", trace.q, low, high),
        ("joint speeds [rad/s]", trace.v, -speeds, speeds),
    )
    return [
        f"{name} between {np.min(values):.3f} and {np.max(values):.3f}"
        for name, values, least, most in checks
        if not bool(((values >= least) & (values <= most)).all())
    ]


def mutate(apps: Sequence[App], rng: Rng) -> tuple[tuple[str, ...], Apps]:
    """Apply up to three operators to a program; return their names and the mutated apps."""
    names = tuple(str(n) for n in rng.choice(list(_OPERATORS), size=rng.integers(1, MOST_OPERATORS + 1)))
    mutated = list(apps)
    for name in names:
        if mutated:
            mutated = _OPERATORS[name](mutated, rng)
    return names, mutated


@cache
def _robot() -> Any:
    from caesura_service.robot import load_panda  # noqa: PLC0415

    return load_panda()


@cache
def _program_of(scenario: str, seed: int) -> tuple[tuple[App, ...], Any]:
    from caesura_lab.execution.executor import SimulatedCell  # noqa: PLC0415
    from caesura_lab.teacher.simulated_teaching import SimulatedTeaching, finish  # noqa: PLC0415
    from caesura_service.offline_segmentation import segment_recording  # noqa: PLC0415

    teaching = SimulatedTeaching(scenario, seed=seed)
    recording = finish(teaching, list(teaching.chunks(1.0))).recording
    apps = segment_recording(recording, setting=CellSettings(force_limit_n=LIMITS_N[scenario])).apps
    return tuple(apps), SimulatedCell(teaching.scenario, teaching.person, seed)


# --- operators ------------------------------------------------------------------------------------------


def _with_changes(apps: Apps, index: int, **changes: object) -> Apps:
    """Return the apps with one changed, without validation."""
    return [*apps[:index], apps[index].model_copy(update=changes), *apps[index + 1 :]]


def _pick_app(apps: Apps, rng: Rng, field: str | None = None) -> int:
    """Draw the index of an app, one that has the field if there is any."""
    having = [i for i, app in enumerate(apps) if field is None or getattr(app, field) is not None]
    return int(rng.choice(having or list(range(len(apps)))))


def _shift_target(apps: Apps, rng: Rng) -> Apps:
    index = _pick_app(apps, rng, "target")
    by = 10.0 ** rng.uniform(-3.0, 0.3) * rng.normal(size=3)
    target = np.add(apps[index].target or (0.0, 0.0, 0.0), by)
    changes: dict[str, object] = {"target": tuple(target.tolist())}
    if rng.random() < 0.7:
        changes["joints"] = None  # else it is refused for them alone
    return _with_changes(apps, index, **changes)


def _fuzz_force(apps: Apps, rng: Rng) -> Apps:
    index = _pick_app(apps, rng, "force")
    force = np.array(apps[index].force or (0.0, 0.0, -5.0)) * rng.choice(
        [-1.0, 0.0, 0.3, 0.8, 1.5, 10.0, 1e4]
    )
    return _with_changes(apps, index, force=tuple((force + rng.normal(size=3)).tolist()))


def _swap(apps: Apps, rng: Rng) -> Apps:
    order = np.arange(len(apps))
    a, b = rng.integers(len(apps), size=2)
    order[[a, b]] = order[[b, a]]
    return _with_new_times([apps[i] for i in order], rng)


def _shuffle(apps: Apps, rng: Rng) -> Apps:
    return _with_new_times([apps[i] for i in rng.permutation(len(apps))], rng)


def _drop_app(apps: Apps, rng: Rng) -> Apps:
    index = _pick_app(apps, rng)
    return _with_new_times([*apps[:index], *apps[index + 1 :]], rng)


def _repeat(apps: Apps, rng: Rng) -> Apps:
    index, where = _pick_app(apps, rng), int(rng.integers(len(apps) + 1))
    return _with_new_times([*apps[:where], apps[index], *apps[where:]], rng)


def _with_new_times(apps: Apps, rng: Rng) -> Apps:
    """Return the apps, in most cases with times in the new order.

    Otherwise the check would refuse most programs only for their times.
    """
    if rng.random() < 0.2:
        return apps
    t, timed = 0.5, []
    for app in apps:
        timed.append(app.model_copy(update={"t0": t, "tn": t + app.tn - app.t0}))
        t = timed[-1].tn
    return timed


def _non_finite(apps: Apps, rng: Rng) -> Apps:
    index = _pick_app(apps, rng)
    field, value = rng.choice([*NUMBERS, *VECTORS]), float(rng.choice([np.nan, np.inf, -np.inf, 1e300]))
    if field in NUMBERS:
        return _with_changes(apps, index, **{str(field): value})
    old = list(getattr(apps[index], str(field)) or (0.0, 0.0, 0.0))
    old[int(rng.integers(len(old)))] = value
    return _with_changes(apps, index, **{str(field): tuple(old)})


def _rescale_time(apps: Apps, rng: Rng) -> Apps:
    index = _pick_app(apps, rng)
    factor = 10.0 ** rng.uniform(-1.5, 1.0)
    longer = (factor - 1.0) * (apps[index].tn - apps[index].t0)
    later = [a.model_copy(update={"t0": a.t0 + longer, "tn": a.tn + longer}) for a in apps[index + 1 :]]
    return [*apps[:index], apps[index].model_copy(update={"tn": apps[index].tn + longer}), *later]


def _other_kind(apps: Apps, rng: Rng) -> Apps:
    return _with_changes(apps, _pick_app(apps, rng), kind=str(rng.choice(list(APP_KINDS))))


def _fuzz_gripper_width(apps: Apps, rng: Rng) -> Apps:
    return _with_changes(
        apps, _pick_app(apps, rng, "gripper_width"), gripper_width=float(rng.uniform(-0.05, 0.15))
    )


def _fuzz_load(apps: Apps, rng: Rng) -> Apps:
    return _with_changes(apps, _pick_app(apps, rng, "load_kg"), load_kg=float(rng.uniform(-1.0, 5.0)))


def _fuzz_orientation(apps: Apps, rng: Rng) -> Apps:
    index = _pick_app(apps, rng, "orientation")
    turned = np.add(
        apps[index].orientation or (1.0, 0.0, 0.0, 0.0), rng.uniform(0.0, 1.0) * rng.normal(size=4)
    )
    changes: dict[str, object] = {"joints": None} if rng.random() < 0.5 else {}
    return _with_changes(
        apps, index, orientation=tuple((turned / np.linalg.norm(turned)).tolist()), **changes
    )


def _fuzz_joints(apps: Apps, rng: Rng) -> Apps:
    index = _pick_app(apps, rng, "joints")
    size = 10.0 ** rng.uniform(-2.0, 0.5)
    joints = np.add(apps[index].joints or (0.0,) * JOINTS, size * rng.normal(size=JOINTS))
    return _with_changes(apps, index, joints=tuple(joints.tolist()))


def _drop_field(apps: Apps, rng: Rng) -> Apps:
    field = str(rng.choice([*VECTORS, "load_kg", "gripper_width"]))
    return _with_changes(apps, _pick_app(apps, rng, field), **{field: None})


_OPERATORS: Mapping[str, Callable[[Apps, Rng], Apps]] = MappingProxyType(
    {
        "target": _shift_target,
        "force": _fuzz_force,
        "swap": _swap,
        "shuffle": _shuffle,
        "leave out": _drop_app,
        "repeat": _repeat,
        "no number": _non_finite,
        "time": _rescale_time,
        "kind": _other_kind,
        "fingers": _fuzz_gripper_width,
        "load": _fuzz_load,
        "turn": _fuzz_orientation,
        "joints": _fuzz_joints,
        "forget": _drop_field,
    }
)


# --- what is printed ------------------------------------------------------------------------------------


def title(count: int) -> str:
    """Return the title: what was measured, and within which limits."""
    return f"{count} mutated programs: refused, or run within the limits"


def _grids(results: Iterable[MutationResult]) -> list[Grid]:
    ordered = sorted(results, key=lambda result: result.number)
    outcomes: tuple[Outcome, ...] = ("refused", "done", "stopped", "violation")
    rows = [("all", *_counts(ordered, outcomes))]
    for name in _OPERATORS:
        rows.append((name, *_counts([f for f in ordered if name in f.operators], outcomes)))
    grids = [Grid("mutated programs, by what was done to them", ("operator", "n", *outcomes), tuple(rows))]
    broken = tuple(
        (str(f.number), ", ".join(f.operators), f.why) for f in ordered if f.outcome == "violation"
    )
    return [*grids, Grid("violations", ("number", "operators", "what"), broken)] if broken else grids


def _counts(results: Sequence[MutationResult], outcomes: Sequence[Outcome]) -> tuple[str, ...]:
    return (str(len(results)), *(str(sum(f.outcome == one for f in results)) for one in outcomes))


def page(results: Sequence[MutationResult]) -> GridPage:
    """Return the tables of the results."""
    return GridPage(title(len(results)), _grids(results))


def as_json(results: Sequence[MutationResult]) -> dict[str, Any]:
    """Return every result as plain values."""
    return {"title": title(len(results)), "fates": [asdict(result) for result in results]}
