"""Forces of apps that a bias of the sensor explains, because they turn with the flange.

The tare subtracts the force at one orientation. A bias that is fixed in the axes of the flange, in a wrench
that was recorded in the axes of the base, returns as the flange turns: as a press in the air, or as a load. A
contact differs from it at its beginning and its end: its force changes there, and the flange does not turn.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.app_contacts import is_resisted
from caesura_protocol.app_force_limit import exerted_forces
from caesura_protocol.app_kinds import APP_KINDS
from caesura_protocol.messages import App
from caesura_protocol.number_words import fixed, interval
from caesura_service.constants import GRAVITY
from caesura_service.program.forces.held_forces import decimation
from caesura_service.program.notes.largest_parts import largest_parts
from caesura_service.program.program_segment import PUSHES_BACK_N, MomentAt, length, observed

AROUND_S, BESIDE_S = 2.0, 0.3  # of the air before and after an app; of that, what its touch or release lasts
LEAST_AIR = 5  # observations of the air on which a bias is judged, half a second
LEFT_SHARE = 0.25  # of the force, that a bias may leave: a contact at one orientation leaves half of it
LEFT_QUANTILE = 0.9  # of the observations of the air, and likewise of the apps, that leave no more
MOST_BIASES = 2.0  # of the force: a bias of this size turns by 29° to make it
NAMED = 5  # the strongest ones in a note

Array = NDArray[np.float64]
Found = tuple[float, float, float]  # begin and end [s], size [N]


def turned_biases_note(apps: Iterable[App], moment_at: MomentAt, began: float, ended: float) -> str | None:
    """Return a note on the forces of apps that turn with the flange as a bias does; None without one.

    began, ended: the first and the last observation of the demonstration [s].
    """
    found = list(_turned_biases(tuple(apps), moment_at, began, ended))
    if not found:
        return None
    said = "; ".join(largest_parts(found, lambda one: one[2], _in_words, NAMED, "weaker ones"))
    return (
        f"Forces that turn with the flange, as a bias of the sensor does: {said}. If nothing was touched "
        "there, correct these times to motion, and record the wrench in the axes of the flange (force_frame)."
    )


def _in_words(found: Found) -> str:
    t0, tn, newton = found
    return f"{fixed(newton, 1)} N at {interval(t0, tn, 1)} s"


def _turned_biases(apps: Sequence[App], moment_at: MomentAt, began: float, ended: float) -> Iterator[Found]:
    """Yield the runs of apps with a force or a load, whose forces a bias explains, as those of the air."""
    runs = [list(run) for _, run in groupby(apps, key=lambda app: _newton(app) > 0.0)]
    for place, run in enumerate(runs):
        if max(map(_newton, run)) < PUSHES_BACK_N:
            continue
        before = runs[place - 1] if place else []
        after = runs[place + 1] if place + 1 < len(runs) else []
        t0, tn = run[0].t0, run[-1].tn
        since = max(began, t0 - AROUND_S, before[0].t0 if before else began)
        until = min(ended, tn + AROUND_S, after[-1].tn if after else ended)
        air = [*_observation_times(since, t0 - BESIDE_S), *_observation_times(tn + BESIDE_S, until)]
        newton = _turned_n(air, _observation_times(t0, tn), moment_at)
        if newton >= PUSHES_BACK_N:
            yield t0, tn, newton


def _newton(app: App) -> float:
    """Return the largest force [N] of an app, exerted or met, or the weight of its load; 0 without one."""
    if APP_KINDS[app.kind].carries and not is_resisted(app):
        return GRAVITY * (app.load_kg or 0.0)
    taught = 0.0 if app.force_taught is None else length(app.force_taught)
    return max([taught, *(force.newton_taught for force in exerted_forces(app))])


def _observation_times(t0: float, tn: float) -> list[float]:
    """Return the times [s] of the observations between two times, evenly decimated."""
    times = observed(t0, tn) if tn > t0 else []
    return times[:: decimation(len(times))]


def _turned_n(air: Sequence[float], pressed: Sequence[float], moment_at: MomentAt) -> float:
    """Return by how much [N] the forces in apps differ from those of the air, if a bias explains both; or 0.

    That is one force in the axes of the flange, and one in those of the base. air, pressed: times [s] of
    observations before and after apps, and in them.
    """
    moments = [[moment_at(t) for t in times] for times in (air, pressed)]
    known = [[m for m in some if m.force is not None and m.orientation is not None] for some in moments]
    if len(known[0]) < LEAST_AIR or not known[1]:
        return 0.0
    both, count = [*known[0], *known[1]], len(known[0])
    rows = np.concatenate([np.hstack([one.axes, np.eye(3)]) for one in both])
    forces = np.array([one.force for one in both])
    newton = float(np.median(np.linalg.norm(forces[count:] - forces[:count].mean(axis=0), axis=1)))
    fitted = np.linalg.lstsq(rows, forces.ravel(), rcond=None)[0]
    left = np.linalg.norm(forces - (rows @ fitted).reshape(-1, 3), axis=1)
    is_left = any(
        np.quantile(part, LEFT_QUANTILE) > LEFT_SHARE * newton for part in (left[:count], left[count:])
    )
    return 0.0 if is_left or length(fitted[:3]) > MOST_BIASES * newton else newton
