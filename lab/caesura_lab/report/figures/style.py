"""The common style of all pages: paper, ink, colours of kinds and axes.

Colour is never the only distinction: kinds also have their names, and axes their dashes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from caesura_lab.report.report_data import STEP_S, ReportData
from caesura_protocol.number_words import counted

A4_LANDSCAPE = (11.69, 8.27)  # [inch]
DPI = 150
LEFT, RIGHT, TOP, BOTTOM = 0.075, 0.955, 0.885, 0.07  # of the page

Array = NDArray[np.float64]
Window = tuple[float, float]  # [s]
LEAST_SEEN = 0.002  # of a probability axis
LONGEST_S = 25.0  # on one page, with segments of a second or two

INK = "#1b1d1f"
FAINT = "#6d7278"
PAPER = "#fefefe"
RED = "#d01c1f"
BLUE = "#0072b2"
WINE = "#882255"
# Okabe and Ito's palette, which colour-blind readers can distinguish.
COLOUR_OF_KIND = {
    "motion": "#56b4e9",
    "steady": "#bbbbbb",
    "contact": "#d55e00",
    "sliding": "#e69f00",
    "transport": "#009e73",
    "hold": "#cc79a7",
    "turning": "#f0e442",
}
# A phase has the colour of this kind.
KIND_OF_PHASE = {"free": "motion", "contact": "contact", "transport": "transport", "cycle": "motion"}
SHADE = 0.30  # opacity of a segment behind signals
# x, y, z: apart from the kinds, from each other in lightness, and by their dashes in black and white.
AXIS_LINES: tuple[dict[str, Any], ...] = (
    {"label": "x", "color": INK, "linestyle": "-"},
    {"label": "y", "color": BLUE, "linestyle": (0, (6, 1.2))},
    {"label": "z", "color": WINE, "linestyle": (0, (3, 1, 1, 1))},
)

RC: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.labelsize": 9.0,
    "axes.titlesize": 10.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.facecolor": "none",
    "axes.linewidth": 0.8,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.frameon": False,
    "lines.linewidth": 1.3,
    "savefig.facecolor": "auto",
    "svg.fonttype": "path",
    "svg.hashsalt": "caesura",
    "pdf.fonttype": 42,
}


HEADING = "heading"  # marks what names the page, for a writer that names it otherwise


def page(content: ReportData, title: str, caption: str = "") -> Figure:
    """Return an empty A4 page with its heading and a caption."""
    figure = Figure(figsize=A4_LANDSCAPE, facecolor="white", label=title)
    figure.text(LEFT, 0.965, title, fontsize=13, fontweight="bold", va="center", gid=HEADING)
    figure.text(RIGHT, 0.965, heading(content), color=FAINT, ha="right", va="center", gid=HEADING)
    figure.text(LEFT, 0.937, caption, fontsize=7.5, color=FAINT, va="center", gid=HEADING)
    return figure


def heading(content: ReportData) -> str:
    """Return a line with the recording's name, preset, duration, number of segments and wrench source."""
    t, segments = content.signals.t, counted(len(content.view.segments), "segment")
    wrench = content.view.wrench
    source = f"wrench {wrench.source}{'' if wrench.stated else ' (assumed)'}"
    return f"{content.name} · preset {content.preset} · {t[-1] - t[0]:.1f} s · {segments} · {source}"


def kinds_present(content: ReportData) -> list[str]:
    """Return the kinds that occur, found or true, in the order of the palette."""
    found = {one.kind for one in content.view.segments}
    true = {one.kind for one in content.truth.spans} if content.truth else set()
    return [kind for kind in COLOUR_OF_KIND if kind in found | true]


def kind_patches(kinds: Iterable[str], opacity: float = 2 * SHADE) -> list[Patch]:
    """Return legend entries of kinds."""
    return [Patch(facecolor=COLOUR_OF_KIND[kind], alpha=opacity, label=kind) for kind in kinds]


def is_seen(axes: Axes, t0: float, tn: float) -> bool:
    """Return whether a part of the time between two times [s] lies within the window of some axes."""
    first, last = axes.get_xlim()
    return t0 <= last and tn >= first


def upright_lines(axes: Axes, times: Iterable[float], top: float = 1.0, **look: Any) -> None:
    """Draw a line at those of the times [s] that are seen, from below up to a share of the height."""
    lines = [((t, 0.0), (t, top)) for t in times if is_seen(axes, t, t)]
    axes.add_collection(LineCollection(lines, transform=axes.get_xaxis_transform(), **look), autolim=False)


def shade(content: ReportData, axes: Axes) -> None:
    """Draw segments as bands behind the signals, gaps hatched."""
    for one in content.view.segments:
        if is_seen(axes, one.t0, one.tn):
            axes.axvspan(one.t0, one.tn, facecolor=COLOUR_OF_KIND[one.kind], alpha=SHADE, linewidth=0)
    upright_lines(axes, (one.t0 for one in content.view.segments), color=INK, linewidth=0.5, alpha=0.45)
    for gap in content.view.gaps:
        if is_seen(axes, gap.t0, gap.tn):
            axes.axvspan(gap.t0, gap.tn, facecolor="none", edgecolor=FAINT, hatch="////", linewidth=0)


def mark_truth(content: ReportData, axes: Axes, optional: float = 0.07, counted: float = 0.16) -> None:
    """Draw true boundaries as dashed ticks from below, up to these shares of the height."""
    points = content.truth.points if content.truth else ()
    for top, width, is_optional in ((optional, 1.1, True), (counted, 1.6, False)):
        times = (one.t for one in points if one.optional == is_optional)
        upright_lines(axes, times, top, color=INK, linestyle=(0, (2.5, 1.2)), linewidth=width)


def mark_changepoints(content: ReportData, axes: Axes) -> None:
    """Draw the changepoints as thin red lines behind the signals."""
    times = (one.t for one in content.view.changepoints)
    upright_lines(axes, times, color=RED, linewidth=0.6, alpha=0.5, zorder=-1)


def bars(axes: Axes, t: Array, probability: Array, colour: str = INK, **options: Any) -> None:
    """Draw a probability (n,) per observation, upwards or, negated, downwards.

    Invisible ones are left out. The axes have limits already.
    """
    first, last = axes.get_xlim()
    seen = (np.abs(probability) > LEAST_SEEN) & (t >= first) & (t <= last)
    left, top = t[seen] - 0.35 * STEP_S, probability[seen]
    right, none = left + 0.7 * STEP_S, np.zeros_like(top)
    corners = np.stack([(left, none), (left, top), (right, top), (right, none)])  # (4, 2, n)
    drawn = PolyCollection(list(np.moveaxis(corners, 2, 0)), facecolor=colour, linewidth=0, **options)
    axes.add_collection(drawn, autolim=False)


def whole(content: ReportData) -> Window:
    """Return the window of a recording, with half a sample on either side."""
    t = content.signals.t
    return float(t[0]) - STEP_S / 2, max(float(t[-1]), float(t[0]) + STEP_S) + STEP_S / 2


def windows(content: ReportData) -> list[Window]:
    """Return the window [s] of each page: the whole, and its parts where that is longer than LONGEST_S."""
    first, last = whole(content)
    if last - first <= LONGEST_S:
        return [(first, last)]
    edges = np.linspace(first, last, math.ceil((last - first) / LONGEST_S) + 1).tolist()
    return [(first, last), *pairwise(edges)]
