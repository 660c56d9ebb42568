"""Forces on what is held, other than its weight: a carry exerts none, and its load is an average."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from caesura_protocol.app_contacts import is_resisted
from caesura_protocol.app_kinds import APP_KINDS
from caesura_protocol.messages import App, Vector
from caesura_protocol.number_words import fixed, interval
from caesura_protocol.up_direction import UP
from caesura_service.constants import GRAVITY
from caesura_service.program.program_segment import UNLIKE_N, MomentAt, observed

PULLED_OBSERVATIONS = 5  # in a row, half a second: what is lifted or set down touches for less


def unreproduced_pulls_note(apps: Iterable[App], moment_at: MomentAt, up: Vector = UP) -> str | None:
    """Return a note on the forces of carries that their loads do not explain; None without one.

    up: away from gravity, base frame.
    """
    said = "; ".join(_pulls(apps, moment_at, up))
    return f"Forces that no app exerts, because apps that carry exert none: {said}." if said else None


def _pulls(apps: Iterable[App], moment_at: MomentAt, up: Vector) -> Iterator[str]:
    """Yield text on each force that differed from the weight for `PULLED_OBSERVATIONS` in a row.

    What moves against a resistance states its own force.
    """
    for app in apps:
        if app.load_kg is None or not APP_KINDS[app.kind].carries or is_resisted(app):
            continue
        felt = [force for t in observed(app.t0, app.tn) if (force := moment_at(t).force) is not None]
        if len(felt) < PULLED_OBSERVATIONS:
            continue
        apart = np.linalg.norm(np.array(felt) + GRAVITY * app.load_kg * np.array(up), axis=1)
        held_n = float(sliding_window_view(apart, PULLED_OBSERVATIONS).min(axis=1).max())
        if held_n >= UNLIKE_N:
            weight = f"the weight of {fixed(app.load_kg, 2)} kg"
            yield f"a force of {fixed(held_n, 1)} N beside {weight} at {interval(app.t0, app.tn, 1)} s"
