"""Draws the path of an app as a small SVG: a top and a side view at one scale, with its via points.

Colours are those of the page: the line is `currentColor`; classes `via`, `start`, `target`, `tool` are for
its style sheet. If the tool turns, short strokes show the flange's x axis at the start, each via point, and
the target, so a turn in place is a fan.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.messages import App
from caesura_protocol.reproduced_path import NAMED_TURN_RAD, curve_of, knots_of, path_in_words, turn_of
from caesura_protocol.rotations import matrices_of

Array = NDArray[np.float64]

SIZE, MARGIN, GAP = 100.0, 12.0, 16.0  # [px] of a view; inside of it; between the two
LINE, WORDS = 16.0, 38.0  # [px] of a line of text below a view; of both lines
DRAWN = 12  # places of a leg
LEAST_SPAN_MM = 20.0  # what is smaller is not blown up
STROKE = 11.0  # [px] of such a stroke, in its plane
BARS_MM = (1000, 500, 200, 100, 50, 20, 10, 5)
BAR_SHARE = 0.6  # of a view's width, that the scale bar fills at most


class _View(NamedTuple):
    """A plane that is drawn: name, indices of the base's axes to the right and up, and its left edge [px]."""

    name: str
    right: int
    up: int
    left: float


def path_svg(app: App) -> str:
    """Return the drawing as an `svg` element without ids; empty for an app without a path."""
    if app.path is None or app.target is None:
        return ""
    way = 1000.0 * curve_of(app).sampled(DRAWN)[:, :3]
    _, poses, _ = knots_of(app)
    low, high = way.min(axis=0), way.max(axis=0)
    span = max(float((high - low).max()), LEAST_SPAN_MM)
    scale, middle = (SIZE - 2.0 * MARGIN) / span, 0.5 * (low + high)
    side = int(high[1] - low[1] > high[0] - low[0])
    views = (_View("top x, y", 0, 1, 0.0), _View(f"side {'xy'[side]}, z", side, 2, SIZE + GAP))
    turns = turn_of(app) >= NAMED_TURN_RAD
    parts = [_drawn(view, way, poses, scale, middle, turns=turns) for view in views]
    label = f"path of {path_in_words(app)}, from above and from the side"
    bar = next((mm for mm in BARS_MM if mm * scale <= BAR_SHARE * SIZE), BARS_MM[-1])
    return (
        f'<svg class="way" role="img" aria-label="{label}" viewBox="0 0 {2 * SIZE + GAP:g} {SIZE + WORDS:g}">'
        f"{''.join(parts)}{_bar(bar, scale)}</svg>"
    )


def _drawn(view: _View, way: Array, poses: Array, scale: float, middle: Array, *, turns: bool) -> str:
    """Return one view. way: (n, 3) [mm]; poses: (k, 3 or 7) [m] of the knots; middle: (3,) [mm]."""
    knots = 1000.0 * poses[:, :3]
    axes = [view.right, view.up]

    def placed(points: Array) -> Array:
        """Return the places (n, 2) [px] of points (n, 3) [mm]."""
        right, up = (scale * (points - middle)[:, axes]).T
        return np.column_stack([view.left + 0.5 * SIZE + right, 0.5 * SIZE - up])

    tools = _tool(poses, axes) if turns else []
    line = " ".join(f"{x:.1f},{y:.1f}" for x, y in placed(way))
    marks = [f'<circle class="via" cx="{x:.1f}" cy="{y:.1f}" r="2"/>' for x, y in placed(knots)[1:-1]]
    (x0, y0), (x1, y1) = placed(knots)[[0, -1]]
    marks += [
        f'<circle class="start" cx="{x0:.1f}" cy="{y0:.1f}" r="3.2" fill="none" stroke="currentColor"/>',
        f'<rect class="target" x="{x1 - 2.8:.1f}" y="{y1 - 2.8:.1f}" width="5.6" height="5.6"/>',
    ]
    strokes = [
        f'<line class="tool" x1="{x:.1f}" y1="{y:.1f}" x2="{x + dx:.1f}" y2="{y + dy:.1f}"/>'
        for (x, y), (dx, dy) in zip(placed(knots), tools, strict=False)
    ]
    return (
        f'<rect class="frame" x="{view.left:g}" y="0" width="{SIZE:g}" height="{SIZE:g}" rx="3" fill="none"/>'
        f'{"".join(strokes)}<polyline points="{line}" fill="none" stroke="currentColor"/>{"".join(marks)}'
        f'<text x="{view.left:g}" y="{SIZE + LINE:g}">{view.name}</text>'
    )


def _tool(poses: Array, axes: list[int]) -> list[tuple[float, float]]:
    """Return strokes [px] of the flange's x axis at each knot, in a plane."""
    ends = STROKE * matrices_of(poses[:, 3:])[:, :, 0]
    return [(float(right), float(-up)) for right, up in ends[:, axes]]


def _bar(millimetres: float, scale: float) -> str:
    """Return a scale bar under the drawing."""
    end, y = 2.0 * SIZE + GAP, SIZE + 2.0 * LINE - 1.0
    begin = end - millimetres * scale
    return (
        f'<path class="scale" d="M{begin:.1f} {y - 2:g}v4M{begin:.1f} {y:g}H{end:g}M{end:g} {y - 2:g}v4"/>'
        f'<text x="{begin - 4:.1f}" y="{y + 5:g}" text-anchor="end">{millimetres:g} mm</text>'
    )
