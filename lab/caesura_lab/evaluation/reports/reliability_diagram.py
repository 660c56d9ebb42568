"""Reliability diagram: the share that was right against the stated probability, with counts below."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from caesura_lab.evaluation.reports.calibration import EDGES, FEW, CalibrationReport, ReliabilityCurve, once
from caesura_lab.evaluation.reports.tables import with_slack

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SUFFIXES = (".svg", ".png", ".pdf")
INK, FAINT = "#1b1d1f", "#6d7278"
# Okabe and Ito's palette; methods also differ in their markers.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")
MARKERS = ("o", "s", "^", "D")
NEAR = 0.05  # a bin this close to the diagonal is called calibrated
DPI = 150


def write(result: CalibrationReport, path: Path) -> None:
    """Write the diagram to a file with one of `SUFFIXES`. Raises OSError, ModuleNotFoundError."""
    draw(result).savefig(path, dpi=DPI)


def draw(result: CalibrationReport) -> Figure:
    """Draw one panel of changepoints per slack, and one of classes."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - an extra

    panels = _panels(result)
    figure = Figure(figsize=(4.0 * len(panels), 5.2), layout="constrained")
    above, below = figure.subplots(
        2, len(panels), sharex=True, squeeze=False, gridspec_kw={"height_ratios": (4, 1)}
    )
    for (title, unit, curves), upper, lower in zip(panels, above, below, strict=True):
        _reliability(upper, title, curves)
        _counts(lower, unit, curves)
    above[0].set_ylabel("share right")
    above[-1].legend(loc="upper left", frameon=False, fontsize=8)
    figure.suptitle(result.title, fontsize=9)
    return figure


Panel = tuple[str, str, list[tuple[str, ReliabilityCurve]]]


def _panels(result: CalibrationReport) -> list[Panel]:
    """Return title, unit of the counts, and the methods' curves of every panel."""
    slacks = sorted({one.slack_s for one in result.calibrations})
    changepoints: list[Panel] = [
        (
            f"changepoints, {with_slack(slack)}",
            "number",
            [(one.method, one.changepoints) for one in result.calibrations if one.slack_s == slack],
        )
        for slack in slacks
    ]
    classes = [(one.method, one.classes) for one in once(result.calibrations)]
    return [*changepoints, ("classes of segments", "time [s]", classes)]


def _reliability(axes: Axes, title: str, curves: Sequence[tuple[str, ReliabilityCurve]]) -> None:
    line = np.array([0.0, 1.0])
    axes.fill_between(line, line - NEAR, line + NEAR, color=FAINT, alpha=0.18, linewidth=0)
    axes.plot(line, line, color=FAINT, linewidth=0.8, linestyle="--")
    for i, (method, one) in enumerate(curves):
        bins = [b for b in one.bins if b.share.n]
        colour, marker = COLOURS[i % len(COLOURS)], MARKERS[i % len(MARKERS)]
        stated = [b.stated for b in bins]
        axes.plot(stated, [b.share.right for b in bins], color=colour, linewidth=0.8, label=method)
        for b in bins:
            fill = colour if b.share.n >= FEW else "white"
            axes.plot([b.stated] * 2, [b.share.low, b.share.high], color=colour, linewidth=1.2)
            axes.plot(
                b.stated, b.share.right, color=colour, marker=marker, markerfacecolor=fill, markersize=5
            )
    axes.set_title(title, fontsize=10, color=INK)
    axes.set_xlim(0.0, 1.02)
    axes.set_ylim(0.0, 1.02)


def _counts(axes: Axes, unit: str, curves: Sequence[tuple[str, ReliabilityCurve]]) -> None:
    widths = np.diff(EDGES) / max(len(curves), 1)
    for i, (_, one) in enumerate(curves):
        left = np.array(EDGES[:-1]) + i * widths
        axes.bar(
            left,
            [b.weight for b in one.bins],
            widths,
            align="edge",
            color=COLOURS[i % len(COLOURS)],
            alpha=0.6,
        )
    axes.set_xlabel("stated probability")
    axes.set_ylabel(unit, fontsize=8)
