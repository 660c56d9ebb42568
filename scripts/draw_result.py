"""Draw a recording as Caesura divides it: the picture in the README.

Usage: python scripts/draw_result.py RECORDING OUT.png [PRESET]
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.patches import Patch

from caesura_clients.recording import Recording, load_recording
from caesura_protocol.messages import Segment
from caesura_service.recordings import segment_recording
from caesura_service.session.view import View

# Okabe and Ito's palette, which colour-blind readers can tell apart.
COLOUR_OF_KIND = {
    "motion": "#56B4E9",
    "steady": "#BBBBBB",
    "contact": "#D55E00",
    "sliding": "#E69F00",
    "transport": "#009E73",
    "hold": "#CC79A7",
}

LEAST_LABELLED_S = 1.0  # a shorter stretch has no room for its load


def main(recording_path: str, out: str, preset: str = "default") -> None:
    """Segment the recording and write the picture."""
    recording = load_recording(Path(recording_path))
    view = segment_recording(recording, preset)
    figure, axes = plt.subplots(3, 1, figsize=(10, 5.6), sharex=True, height_ratios=[3, 3, 1.2])
    _signals(recording, axes[0], axes[1])
    _changepoints(view, axes[2])
    for axis in axes:
        _shade(view.segments, axis)
        axis.spines[["top", "right"]].set_visible(False)
    _name_kinds(view.segments, axes[0])
    axes[2].set_xlabel("time [s]")
    axes[0].set_xlim(view.segments[0].t0, view.segments[-1].tn)
    figure.align_ylabels(axes)
    figure.tight_layout()
    figure.savefig(out, dpi=110)


def _signals(recording: Recording, above: Axes, below: Axes) -> None:
    tenth = slice(None, None, 10)
    position = recording.signals["pos"][tenth]
    above.plot(recording.t[tenth], 1000.0 * (position - position[0]), linewidth=1.2)
    above.set_ylabel("moved [mm]")
    below.plot(recording.t[tenth], recording.signals["force"][tenth], linewidth=1.2)
    below.set_ylabel("force [N]")
    below.legend(["x", "y", "z"], loc="upper right", ncols=3, frameon=False, fontsize=8)


def _changepoints(view: View, axis: Axes) -> None:
    times = [one.t for one in view.changepoints]
    axis.stem(
        times, [one.probability for one in view.changepoints], basefmt=" ", linefmt="k-", markerfmt="ko"
    )
    axis.set_ylim(0, 1.1)
    axis.set_ylabel("probability")


def _shade(segments: tuple[Segment, ...], axis: Axes) -> None:
    for one in segments:
        axis.axvspan(one.t0, one.tn, color=COLOUR_OF_KIND[one.kind], alpha=0.35, linewidth=0)
        axis.axvline(one.t0, color="k", linewidth=0.5, alpha=0.5)


def _name_kinds(segments: tuple[Segment, ...], axis: Axes) -> None:
    present = [kind for kind in COLOUR_OF_KIND if any(one.kind == kind for one in segments)]
    handles = [Patch(color=COLOUR_OF_KIND[kind], alpha=0.35, label=kind) for kind in present]
    axis.legend(
        handles=handles, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=len(present), frameon=False
    )
    for one in segments:
        if one.load_kg is not None and one.tn - one.t0 > LEAST_LABELLED_S:
            place = (0.5 * (one.t0 + one.tn), 0.9)
            axis.text(
                *place, f"{1000 * one.load_kg:.0f} g", ha="center", transform=axis.get_xaxis_transform()
            )


if __name__ == "__main__":
    main(*sys.argv[1:])
