"""Torques held while nothing turns: the robot exerts none, and no app states them.

- In a press. A force has no torque about its own direction, whatever its lever. So the torque along the
  force is that of a hand which twists what it presses on.
- In a rest in the air, and in a hold. The weights of tool and load have a torque, too, and a load may change
  it once. So what lies between the torques before and after is that of weights.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.app_kinds import APP_KINDS
from caesura_protocol.messages import App
from caesura_protocol.number_words import fixed, interval
from caesura_protocol.screw_torque_and_text import TIGHT
from caesura_service.program.notes.parts_in_no_app import off_line
from caesura_service.program.program_segment import length

Array = NDArray[np.float64]

HELD_S = 1.0  # in all
TWIST_NM = 0.5  # a tip of 2 cm that rubs under 40 N has as much
BESIDE_S = 0.4  # before and after a rest, in which the torque is that of weights


def unreproduced_torques_note(
    apps: Iterable[App],
    torques_between: Callable[[float, float], Array],
    began: float = 0.0,
    ended: float = 0.0,
) -> str | None:
    """Return a note on the torques of presses, rests and holds in which nothing turns; None without one.

    torques_between: returns torques (n, 3) [Nm] of the environment about the flange, base frame, at even
    times between two times [s]; none where they are not measured. began, ended: of the demonstration [s].
    """
    said = "; ".join([*_in_presses(apps, torques_between), *_in_rests(apps, torques_between, began, ended)])
    return f"Torques that no app exerts, because nothing turned: {said}." if said else None


def _in_presses(apps: Iterable[App], torques_between: Callable[[float, float], Array]) -> Iterator[str]:
    """Yield text on each torque about the force of a press that was held for `HELD_S` in all."""
    for app in apps:
        if app.force_taught is None or not APP_KINDS[app.kind].presses:
            continue
        newton = length(app.force_taught)
        for t0, tn in _stands(app) if newton > 0.0 else ():
            held_nm = _held(np.abs(torques_between(t0, tn) @ app.force_taught) / newton, t0, tn)
            if held_nm is not None and held_nm > _most_turned_with(app):
                yield f"a torque of {fixed(held_nm, 1)} Nm about the force at {interval(t0, tn, 1)} s"


def _stands(app: App) -> Iterator[tuple[float, float]]:
    """Yield the times [s] at which a press stands: all of it without a path, or beside its turn.

    Not beside a stroke: there the friction leans the force.
    """
    if app.path is None:
        yield app.t0, app.tn
    elif app.screw is not None:
        yield app.t0, app.path.start.t
        yield app.path.tn, app.tn


def _most_turned_with(app: App) -> float:
    """Return the torque [Nm] at which the turn of an app ends at the latest; 0 if none is known."""
    return 0.0 if app.screw is None or app.screw.torque is None else TIGHT * length(app.screw.torque)


def _in_rests(
    apps: Iterable[App], torques_between: Callable[[float, float], Array], began: float, ended: float
) -> Iterator[str]:
    """Yield text on each torque of a rest or a hold that is not between the torques before and after it."""
    for t0, tn in _rests(apps, began, ended):
        if tn - t0 < HELD_S:
            continue
        before, torques, after = (
            torques_between(*span) for span in pairwise((t0 - BESIDE_S, t0, tn, tn + BESIDE_S))
        )
        if len(torques) and len(before) and len(after):
            points = np.vstack([np.median(before, axis=0), torques, np.median(after, axis=0)])
            twists = np.linalg.norm(off_line(points), axis=1)[1:-1]
            if held_nm := _held(twists, t0, tn):
                yield f"a torque of {fixed(held_nm, 1)} Nm at {interval(t0, tn, 1)} s"


def _rests(apps: Iterable[App], began: float, ended: float) -> Iterator[tuple[float, float]]:
    """Yield the times [s] of the rests between apps that touch nothing, and of the holds."""
    t, touches = began, False
    for app in apps:
        meets = APP_KINDS[app.kind].in_contact
        if not (touches or meets):
            yield t, app.t0
        if app.kind == "hold":
            yield app.t0, app.tn
        t, touches = app.tn, meets or app.kind == "move_to_contact"
    if not touches:
        yield t, ended


def _held(sizes: Array, t0: float, tn: float) -> float | None:
    """Return the torque [Nm] that sizes (n,) between two times [s] have for `HELD_S` in all.

    None if it is no twist.
    """
    seconds = tn - t0
    if not sizes.size or seconds < HELD_S:
        return None
    held_nm = float(np.quantile(sizes, 1.0 - HELD_S / seconds))
    return held_nm if held_nm >= TWIST_NM else None
