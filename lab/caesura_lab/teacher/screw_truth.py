"""The strokes of a demonstration that drive a screw, with axis and pitch: truth for a found screw motion."""

from __future__ import annotations

from collections.abc import Sequence
from math import radians
from typing import Any

import numpy as np

from caesura_lab.teacher.contact_and_motion_spans import TrueState
from caesura_lab.teacher.level_surface_contact import Surface
from caesura_lab.teacher.shaped_surface_contact import UP, Screw

LEAST_RAD = radians(45.0)  # a shorter stroke leads too little for an advance to be read


def screws_of(
    surfaces: Sequence[Surface], state: TrueState, segments: Sequence[dict[str, Any]]
) -> list[dict[str, Any]]:
    """Return each stroke by 45° or more that drives a screw: t0, t1 [s], axis (base frame), pitch_m [m].

    The axis is the screw's own: it points where the screw goes. Turning back does not move a screw.
    """
    screw = next((surface for surface in surfaces if isinstance(surface, Screw)), None)
    if screw is None:
        return []
    down = -np.array(UP)
    driving = []
    for segment in segments:
        ticks = slice(*np.searchsorted(state.t, (segment["t0"], segment["t1"])))
        touching = state.normal[ticks] > 0.0
        turned = state.dt * float(state.rate[ticks][touching].sum(axis=0) @ down)
        if segment["cls"] == "turning" and turned >= LEAST_RAD:
            ends = {name: segment[name] for name in ("t0", "t1")}
            driving.append({**ends, "axis": down.tolist(), "pitch_m": screw.pitch_m})
    return driving
