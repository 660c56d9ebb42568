"""The path in space with its changepoints as red crosses, joined by a dotted line. Thesis Fig. 4.6, third."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import AbstractPathEffect, withStroke
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D  # type: ignore[import-untyped]
from numpy.typing import NDArray

from caesura_lab.report.figures import style
from caesura_lab.report.report_data import ReportData
from caesura_lab.report.tables import ranges
from caesura_protocol.reproduced_path import curve_of, knots_of

Array = NDArray[np.float64]

LEAST_SPAN_MM = 40.0  # what is smaller than this is not blown up to fill the page
LABEL_DISTANCE = 0.09  # of the span: points closer together share a label
LABEL_SIZE = (3.0, 0.8)  # width and height of a label over that distance
DRAWN = 12  # places of a leg of a reproduced path
MOST_PARTS = 2  # of a label
CAPTION = (
    "Numbers: the segments that begin at a changepoint. Thin line, dots: the program's path, its via points. "
    "Base frame, flange; equal scale on all axes."
)


def path_page(content: ReportData) -> Figure:
    """Draw the path in three dimensions, and in the two planes in which it is spread most."""
    figure = style.page(content, "Path in space", CAPTION)
    solid = figure.add_axes((0.01, 0.07, 0.56, 0.80), projection="3d")
    assert isinstance(solid, Axes3D)
    _solid(content, solid)
    for (a, b), bottom in zip(informative_planes(_path_mm(content)), (0.53, 0.09), strict=True):
        _plane(content, figure.add_axes((0.645, bottom, 0.31, 0.355)), a, b)
    _legend(content, figure, solid)
    return figure


def informative_planes(path: Array) -> list[tuple[int, int]]:
    """The two coordinate planes, as pairs of axes, in which a path (n, 3) is spread most."""
    variance = path.var(axis=0)
    planes = sorted(combinations(range(3), 2), key=lambda plane: -float(variance[list(plane)].sum()))
    return planes[:2]


def _path_mm(content: ReportData) -> Array:
    path: Array = 1000.0 * content.signals.position
    return path


def _changepoints_mm(content: ReportData) -> Array:
    """Return (c, 3) positions [mm] of the changepoints, with the path's two ends."""
    ends = content.view.segments
    path = [ends[0].position_start, *(one.position_start for one in ends[1:]), ends[-1].position_end]
    return 1000.0 * np.array(path)


def _pieces(content: ReportData) -> list[tuple[str, Array]]:
    """(kind, (n, 3) [mm]) of every segment, its first and last observation included."""
    t, path = content.signals.t, _path_mm(content)
    slack = 1e-6
    pieces: list[tuple[str, Array]] = []
    for one in content.view.segments:
        inside = (t >= one.t0 - slack) & (t <= one.tn + slack)
        pieces.append((one.kind, path[inside]))
    return pieces


def _solid(content: ReportData, axes: Axes3D) -> None:
    for kind, piece in _pieces(content):
        axes.plot(*piece.T, color=style.COLOUR_OF_KIND[kind], linewidth=2.4)
    points = _changepoints_mm(content)
    axes.plot(*points.T, color=style.RED, linestyle=":", linewidth=1.1)
    axes.plot(*points[1:-1].T, "x", color=style.RED, markersize=7, markeredgewidth=1.7)
    axes.plot(*points[:1].T, "o", color=style.INK, markersize=6)
    axes.plot(*points[-1:].T, "s", color=style.INK, markersize=6)
    for setter, (low, high) in zip(
        (axes.set_xlim, axes.set_ylim, axes.set_zlim), _limits(_path_mm(content)), strict=True
    ):
        setter(low, high)
    axes.set_box_aspect((1, 1, 1), zoom=0.92)
    axes.view_init(elev=24, azim=-58)
    axes.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.labelpad = 8.0
        axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
        axis.set_pane_color((0.5, 0.5, 0.5, 0.06))


def _limits(path: Array) -> list[tuple[float, float]]:
    """Limits of every axis, all as wide, so that a cube stays one."""
    low, high = path.min(axis=0), path.max(axis=0)
    half = 0.54 * max(float((high - low).max()), LEAST_SPAN_MM)
    return [(float(c - half), float(c + half)) for c in 0.5 * (low + high)]


def _reproduced_mm(content: ReportData) -> list[tuple[Array, Array]]:
    """The reproduced path (n, 3) of every app that has one, and its via points (v, 3)."""
    apps = [app for app in content.view.apps if app.path is not None and app.target is not None]
    ways = [(curve_of(app).sampled(DRAWN)[:, :3], knots_of(app)[1][1:-1, :3]) for app in apps]
    return [(1000.0 * way, 1000.0 * via) for way, via in ways]


def _plane(content: ReportData, axes: Axes, a: int, b: int) -> None:
    for kind, piece in _pieces(content):
        axes.plot(piece[:, a], piece[:, b], color=style.COLOUR_OF_KIND[kind], linewidth=2.4, zorder=1)
    for way, via in _reproduced_mm(content):
        axes.plot(way[:, a], way[:, b], color=style.INK, linewidth=0.7, zorder=2)
        axes.plot(via[:, a], via[:, b], ".", color=style.INK, markersize=3.5, zorder=3)
    points = _changepoints_mm(content)[:, (a, b)]
    axes.plot(*points.T, color=style.RED, linestyle=":", linewidth=1.1, zorder=1)
    axes.plot(*points[1:-1].T, "x", color=style.RED, markersize=6, markeredgewidth=1.6, zorder=4)
    axes.plot(*points[:1].T, "o", color=style.INK, markersize=5, zorder=4)
    axes.plot(*points[-1:].T, "s", color=style.INK, markersize=5, zorder=4)
    axes.margins(0.1)
    axes.xaxis.set_major_locator(MaxNLocator(6))
    axes.yaxis.set_major_locator(MaxNLocator(7))
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel=f"{'xyz'[a]} [mm]", ylabel=f"{'xyz'[b]} [mm]")
    axes.grid(color=style.FAINT, alpha=0.25, linewidth=0.5)
    _numbers(axes, points)


def _numbers(axes: Axes, points: Array) -> None:
    """Draw the numbers of the segments that begin at each position."""
    apart = LABEL_DISTANCE * max(float(np.ptp(points, axis=0).max()), LEAST_SPAN_MM)
    groups: list[tuple[Array, list[int]]] = []
    for number, point in enumerate(points[:-1], start=1):
        near = next((members for at, members in groups if np.linalg.norm(at - point) <= apart), None)
        if near is None:
            groups.append((point, [number]))
        else:
            near.append(number)
    halo: list[AbstractPathEffect] = [withStroke(linewidth=2.5, foreground=style.PAPER)]
    middle = 0.5 * float(points[:, 0].min() + points[:, 0].max())
    for i, (at, members) in enumerate(groups):
        left = float(at[0]) > middle
        crowded = any((np.abs(at - other) < apart * np.array(LABEL_SIZE)).all() for other, _ in groups[:i])
        label = axes.annotate(
            _shortened(ranges(members)),
            (float(at[0]), float(at[1])),
            (-5 if left else 5, -13 if crowded else 5),
            textcoords="offset points",
            ha="right" if left else "left",
            fontsize=8,
        )
        label.set_path_effects(halo)


def _shortened(numbers: str) -> str:
    """Return a label with a limited length, also for many visits to a position."""
    parts = numbers.split(", ")
    return numbers if len(parts) <= MOST_PARTS else f"{parts[0]}, …"


def _legend(content: ReportData, figure: Figure, axes: Axes3D) -> None:
    kinds = style.kind_patches(style.kinds_present(content), opacity=1.0)
    (cross,) = axes.plot([], [], [], "x", color=style.RED, markeredgewidth=1.7, label="changepoint")
    (chord,) = axes.plot([], [], [], ":", color=style.RED, label="from one to the next")
    (start,) = axes.plot([], [], [], "o", color=style.INK, label="start")
    (end,) = axes.plot([], [], [], "s", color=style.INK, label="end")
    figure.legend(
        handles=[*kinds, cross, chord, start, end],
        loc="center left",
        bbox_to_anchor=(style.LEFT - 0.01, style.TOP + 0.02),
        ncols=len(kinds) + 4,
        columnspacing=1.4,
    )
