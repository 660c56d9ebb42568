"""Compares the online posterior at every moment with the offline one, and its delay. Fig. 4.18, 4.19."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from numpy.typing import NDArray

from caesura_lab.report.figures import style
from caesura_lab.report.report_data import DELAYS_S, ReportData

LEAST_PROBABILITY = 1e-4  # what is as white as paper
CAPTION = (
    "Grey: at each time, how probable each start of the current segment was then. A streak is a segment; its "
    "distance from the diagonal is how late it was known. Red: chosen changepoints."
)
WIDTH = style.RIGHT - style.LEFT - 0.055  # room for the grey scale


def run_length_page(content: ReportData, window: style.Window) -> Figure:
    """Changepoints offline and online, the posterior of the segment's start, and that seen with a delay."""
    figure = style.page(content, "Online against offline", CAPTION)
    changes = figure.add_axes((style.LEFT, 0.785, WIDTH, 0.115))
    image = figure.add_axes((style.LEFT, 0.365, WIDTH, 0.40))
    delayed = [figure.add_axes((style.LEFT, bottom, WIDTH, 0.062)) for bottom in (0.228, 0.149, style.BOTTOM)]
    for axes in (changes, image, *delayed):
        axes.set_xlim(*window)  # what lies outside is not drawn
    image.set_ylim(*window)
    _changes(content, changes)
    _scale(figure, _image(content, image))
    for axes, delay_s in zip(delayed, DELAYS_S, strict=True):
        _delayed(content, axes, delay_s)
    for axes in (changes, *delayed[:-1]):
        axes.tick_params(labelbottom=False)
    delayed[-1].set_xlabel("start of the segment τ [s]")
    delayed[1].set_ylabel("P(start at τ), as known")
    figure.align_ylabels((changes, image, *delayed))
    return figure


def _changes(content: ReportData, axes: Axes) -> None:
    """Draw offline probabilities upwards, online ones downwards."""
    changes = content.changes
    style.mark_changepoints(content, axes)
    style.bars(axes, changes.t, changes.offline)
    style.bars(axes, changes.t, -changes.online, style.BLUE)
    _beside(axes, "offline", 0.75)
    _beside(axes, "online", 0.25, style.BLUE)
    axes.axhline(0.0, color=style.INK, linewidth=0.8)
    axes.set_ylim(-1.1, 1.1)
    axes.set_yticks([-1.0, 0.0, 1.0], ["1", "0", "1"])
    axes.set_ylabel("P(changepoint)", fontsize=8.5)


def _image(content: ReportData, axes: Axes) -> AxesImage:
    first, last = axes.get_xlim()
    for one in content.view.changepoints:
        if style.is_seen(axes, one.t, one.t):
            axes.axhline(one.t, color=style.RED, linewidth=0.6, alpha=0.5, zorder=-1)
    drawn = axes.imshow(
        _grey(content.run_lengths.image(first, last)),
        origin="lower",
        extent=(first, last, first, last),
        aspect="auto",
        interpolation="nearest",
    )
    axes.plot([first, last], [first, last], color=style.FAINT, linewidth=0.6)
    axes.set_ylabel("start of the segment [s]")
    axes.set_xlabel("evaluated at [s]", labelpad=1)
    return drawn


def _grey(probability: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (m, m, 4) black with an opacity that grows with the logarithm of the probability."""
    shown = np.log(np.maximum(probability, LEAST_PROBABILITY)) / np.log(LEAST_PROBABILITY)
    image = np.zeros((*probability.shape, 4))
    image[..., 3] = 1.0 - shown
    return image


def _scale(figure: Figure, drawn: AxesImage) -> None:
    """Draw the scale of the greys, as probabilities, beside an image."""
    axes = figure.add_axes((style.LEFT + WIDTH + 0.012, 0.365, 0.014, 0.40))
    ramp = np.logspace(np.log10(LEAST_PROBABILITY), 0.0, 200)[:, None]
    decades = np.log10(LEAST_PROBABILITY)
    axes.imshow(_grey(ramp), origin="lower", aspect="auto", extent=(0.0, 1.0, decades, 0.0))
    axes.set_xticks([])
    axes.yaxis.tick_right()
    ticks = np.arange(decades, 1.0)
    axes.set_yticks(ticks, [f"{10.0**tick:g}" for tick in ticks], fontsize=8)
    axes.set_title("P", fontsize=9)
    for spine in axes.spines.values():
        spine.set_visible(True)


def _delayed(content: ReportData, axes: Axes, delay_s: float) -> None:
    """Draw P(the segment started at τ | data up to τ + delay), at τ."""
    style.mark_changepoints(content, axes)
    known = content.run_lengths.start_probability_after(delay_s)
    style.bars(axes, content.run_lengths.start_t[1:], known[1:])
    axes.set_ylim(0.0, 1.08)
    axes.set_yticks([0.0, 1.0])
    _beside(axes, f"{delay_s:g} s later")


def _beside(axes: Axes, name: str, height: float = 0.5, colour: str = style.INK) -> None:
    """Write a label to the right of a row, at a share of its height."""
    axes.text(1.008, height, name, color=colour, va="center", fontsize=8.5, transform=axes.transAxes)
