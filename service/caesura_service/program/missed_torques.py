"""Torques held in a press that turns nothing: the robot presses with a force alone, and no app exerts them.

A force has no torque about its own direction, whatever its lever. So the torque along the force of a press is
that of a hand which twists what it presses on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.messages import App
from caesura_protocol.number_words import fixed, interval
from caesura_service.program.program_segment import length

Array = NDArray[np.float64]

HELD_S = 1.0  # in all
TWIST_NM = 0.5  # a tip of 2 cm that rubs under 40 N has as much


def missed_torques_note(apps: Sequence[App], torques_between: Callable[[float, float], Array]) -> str | None:
    """Return a note on the torques of presses without a way; None without one.

    torques_between: returns torques (n, 3) [Nm] of the environment about the flange, base frame, at even
    times between two times [s]; none where they are not measured.
    """
    said = "; ".join(_held(apps, torques_between))
    return f"Taught and exerted by no app, because nothing turned: {said}." if said else None


def _held(apps: Sequence[App], torques_between: Callable[[float, float], Array]) -> Iterator[str]:
    """Yield text on each torque that was held for `HELD_S` in all."""
    for app in apps:
        if app.kind != "apply_force" or app.path is not None or app.force_taught is None:
            continue
        torques, seconds = torques_between(app.t0, app.tn), app.tn - app.t0
        newton = length(app.force_taught)
        if not torques.size or seconds < HELD_S or newton <= 0.0:
            continue
        twists = np.abs(torques @ app.force_taught) / newton
        held_nm = float(np.quantile(twists, 1.0 - HELD_S / seconds))
        if held_nm >= TWIST_NM:
            yield f"a torque of {fixed(held_nm, 1)} Nm about the force at {interval(app.t0, app.tn, 1)} s"
