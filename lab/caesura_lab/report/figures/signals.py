"""Page 1: the signals with their segments, and how probable a changepoint is. Thesis Fig. 4.6, first two."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from caesura_clients.cli.result_tables import phase_name
from caesura_lab.report.figures import style
from caesura_lab.report.report_data import THRESHOLD, ReportData
from caesura_protocol.messages import Segment

LETTER = 0.6  # width of a letter over the size of its font
NAME_SIZE, NUMBER_SIZE = 8.0, 6.5  # [pt]
LANE, BETWEEN_LANES, ABOVE_PANEL = 0.034, 0.006, 0.026  # heights, shares of the page
POINTS_PER_INCH = 72.0
CAPTION = "What was measured, how it was divided, and how sure each division is. Numbers as in the table."

Draw = Callable[[ReportData, Axes], None]


@dataclass(frozen=True)
class _Band:
    """An interval in a lane, with possible names, the longest first."""

    t0: float
    tn: float
    kind: str
    names: tuple[str, ...]
    ticks: Sequence[float] = ()  # [s] what a name must not be written over

    def widest(self, window: style.Window) -> tuple[float, float]:
        """Return the longest part [s] of the band without a tick; of negative width outside the window."""
        first, last = max(self.t0, window[0]), min(self.tn, window[1])
        edges = [first, *sorted(t for t in self.ticks if first < t < last), last]
        return max(pairwise(edges), key=lambda part: part[1] - part[0])


def signals_page(content: ReportData, window: style.Window) -> Figure:
    """Position, speed and force over time, shaded by kind, with the changepoint probability below."""
    figure = style.page(content, "Segmentation", CAPTION)
    _kinds_legend(content, figure)
    top = _draw_lanes(content, figure, window)
    panels = _panels(content)
    shared = style.TOP - (style.TOP - top) - style.BOTTOM - len(panels) * ABOVE_PANEL
    total = sum(weight for _, weight, _ in panels)
    drawn = []
    for label, weight, draw in panels:
        height = shared * weight / total
        top -= ABOVE_PANEL + height
        drawn.append(figure.add_axes((style.LEFT, top, style.RIGHT - style.LEFT, height)))
        drawn[-1].set_xlim(*window)  # what lies outside is not drawn
        _panel(content, drawn[-1], label, draw)
    for axes in drawn[:-1]:
        axes.tick_params(labelbottom=False)
    drawn[-1].set_xlabel("time [s]")
    figure.align_ylabels(drawn)
    return figure


def _panels(content: ReportData) -> list[tuple[str, float, Draw]]:
    """Return label, share of the height, and drawing function of each panel."""
    force = [("force on the robot [N]", 3.0, _force)] if content.signals.force is not None else []
    return [
        ("flange moved [mm]", 3.0, _position),
        ("speed [mm/s]", 1.6, _speed),
        *force,
        ("P(changepoint)", 1.9, _probability),
    ]


def _panel(content: ReportData, axes: Axes, label: str, draw: Draw) -> None:
    style.shade(content, axes)
    draw(content, axes)
    style.mark_truth(content, axes)
    axes.set_ylabel(label)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.97), ncols=4, borderaxespad=0.0, fontsize=8)


def _position(content: ReportData, axes: Axes) -> None:
    moved = 1000.0 * (content.signals.position - content.signals.position[0])
    _three_axes(content, axes, moved)


def _force(content: ReportData, axes: Axes) -> None:
    assert content.signals.force is not None, "a panel only where there is force"
    _three_axes(content, axes, content.signals.force)


def _three_axes(content: ReportData, axes: Axes, values: NDArray[np.float64]) -> None:
    for axis, line in enumerate(style.AXIS_LINES):
        for i, part in enumerate(content.signals.stretches):
            label = line["label"] if i == 0 else "_"
            axes.plot(content.signals.t[part], values[part, axis], **(line | {"label": label}))


def _speed(content: ReportData, axes: Axes) -> None:
    for part in content.signals.stretches:
        axes.plot(content.signals.t[part], 1000.0 * content.signals.speed[part], color=style.INK)
    axes.set_ylim(bottom=0.0)


def _probability(content: ReportData, axes: Axes) -> None:
    changes = content.changes
    style.bars(axes, changes.t, changes.online, label="at every observation")
    times = [one.t for one in content.view.changepoints]
    chosen = [one.probability for one in content.view.changepoints]
    axes.plot(times, chosen, "x", color=style.RED, markeredgewidth=1.6, label="chosen, give or take a sample")
    axes.axhline(
        THRESHOLD,
        color=style.INK,
        linewidth=0.9,
        linestyle=":",
        label=f"the thesis' threshold, {THRESHOLD:g}",
    )
    axes.set_ylim(0.0, 1.08)
    axes.set_yticks([0.0, 0.5, 1.0])


def _draw_lanes(content: ReportData, figure: Figure, window: style.Window) -> float:
    """Draw found and true segments as named bands; return the height on the page at which they end."""
    top = style.TOP
    for label, bands in _lanes(content):
        top -= LANE
        axes = figure.add_axes((style.LEFT, top, style.RIGHT - style.LEFT, LANE))
        axes.set_xlim(*window)
        _lane(axes, label, bands)
        if label == "truth":
            style.mark_truth(content, axes, optional=0.4, counted=1.0)
        top -= BETWEEN_LANES
    return top


def _lanes(content: ReportData) -> list[tuple[str, list[_Band]]]:
    found = [
        _Band(one.t0, one.tn, one.kind, (*_loaded(i, one), f"{i} {one.kind}", str(i)))
        for i, one in enumerate(content.view.segments, start=1)
    ]
    lanes = [("found", found)]
    if content.truth is not None:
        ticks = [one.t for one in content.truth.points]
        true = [_Band(one.t0, one.t1, one.kind, (one.kind,), ticks) for one in content.truth.spans]
        lanes.append(("truth", true))
    return [*lanes, *_phase_lanes(content)]


def _phase_lanes(content: ReportData) -> list[tuple[str, list[_Band]]]:
    """Return a lane of found phases, if more than one, and a lane of true phases, if the truth has any."""
    found, lanes = content.view.phases, []
    if len(found) > 1:
        bands = [
            _Band(one.t0, one.tn, style.KIND_OF_PHASE[one.kind], (phase_name(one), one.kind)) for one in found
        ]
        lanes.append(("phases", bands))
    if content.truth is not None and content.truth.phases:
        true = [_Band(one.t0, one.t1, "", (one.kind,)) for one in content.truth.phases]
        lanes.append(("true phases", true))
    return lanes


def _loaded(index: int, one: Segment) -> tuple[str, ...]:
    """Return the names of a segment with its load, if there is one."""
    return () if one.load_kg is None else (f"{index} {one.kind}, {1000.0 * one.load_kg:.0f} g",)


def _lane(axes: Axes, label: str, bands: list[_Band]) -> None:
    axes.set_axis_off()
    axes.set_ylim(0.0, 1.0)
    axes.text(-0.008, 0.5, label, ha="right", va="center", fontsize=8.5, transform=axes.transAxes)
    for band in (one for one in bands if style.is_seen(axes, one.t0, one.tn)):
        colour = style.COLOUR_OF_KIND.get(band.kind, style.FAINT)
        place = (band.t0, 0.0), band.tn - band.t0, 1.0
        axes.add_patch(Rectangle(*place, facecolor=colour, alpha=2 * style.SHADE, linewidth=0))
        _name(axes, band)
    style.upright_lines(axes, (band.t0 for band in bands), color=style.INK, linewidth=0.5, alpha=0.6)


def _name(axes: Axes, band: _Band) -> None:
    """Write the longest of a band's names that fits into it, if any."""
    first, last = axes.get_xlim()
    t0, tn = band.widest((first, last))
    width = style.A4_LANDSCAPE[0] * (style.RIGHT - style.LEFT) * (tn - t0) / (last - first)
    for name in band.names:
        size = NUMBER_SIZE if name.isdigit() else NAME_SIZE
        if width * POINTS_PER_INCH > LETTER * size * len(name):
            axes.text(0.5 * (t0 + tn), 0.48, name, ha="center", va="center", fontsize=size, clip_on=True)
            return


def _kinds_legend(content: ReportData, figure: Figure) -> None:
    kinds = style.kinds_present(content)
    handles = style.kind_patches(kinds)
    place = (0.5 * (style.LEFT + style.RIGHT), style.TOP + 0.022)
    legend = figure.legend(
        handles=handles, loc="center", bbox_to_anchor=place, ncols=len(kinds), borderpad=0, columnspacing=1.6
    )
    if content.truth is None:
        return
    legend.set_loc("center left")
    legend.set_bbox_to_anchor((style.LEFT, style.TOP + 0.022))
    note = "dashed: true boundaries (short: optional)"
    figure.text(style.RIGHT, style.TOP + 0.022, note, fontsize=8, ha="right", va="center")
