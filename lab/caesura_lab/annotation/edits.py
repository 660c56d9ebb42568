"""Edits of an annotation: pure functions from a document and a time to a new document.

A document is the content of an `.ann.json` file. Keys that no edit concerns are kept unchanged, so that a
file of a later version loses nothing. Documents are never changed in place: `AnnotationEditor` holds the
earlier ones.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from caesura_lab.ground_truth import KINDS
from caesura_protocol.errors import CaesuraError

Document = Mapping[str, Any]
Entry = Mapping[str, Any]
Edit = Callable[[Document, float], Document]

TOLERANCE_S = 0.15  # of a new point: reading uncertainty of a clear edge
TOLERANCE_STEP_S = 0.05
LEAST_TOLERANCE_S = 0.05
REACH_S = 0.5  # how far from the cursor the nearest point may lie
SAME_S = 0.001  # points closer than this are one; times are kept in milliseconds
UNDO_STEPS = 1000


def milliseconds(t: float) -> float:
    """Round a time [s] to the precision of annotations."""
    return round(t, 3)


class EditError(CaesuraError, ValueError):
    """An edit does not apply at this time; the message states why."""


def insert_point(document: Document, t: float, *, kind: str | None, level: str = "major") -> Document:
    """Add a changepoint at t [s]. Raises EditError outside of the window, or where one is already."""
    _check_window(document, t)
    points = list(document["changepoints"])
    if any(abs(point["t"] - t) < SAME_S for point in points):
        raise EditError(f"there is a changepoint at {t:.3f} s already")
    named = {} if kind is None else {"kind": kind}
    points.append({"t": t, **named, "tol": TOLERANCE_S, "level": level})
    return _with_points(document, points)


def remove_point(document: Document, t: float) -> Document:
    """Remove the changepoint nearest to t [s]. Raises EditError where none is within reach."""
    index = nearest(document, t)
    points = document["changepoints"]
    return _with_points(document, [*points[:index], *points[index + 1 :]])


def toggle_level(document: Document, t: float) -> Document:
    """Make the nearest changepoint optional, or major again."""
    return _replace(
        document, t, lambda point: {"level": "major" if point["level"] == "optional" else "optional"}
    )


def change_tolerance(document: Document, t: float, *, by_s: float) -> Document:
    """Widen or narrow the nearest changepoint's tolerance by by_s [s], down to LEAST_TOLERANCE_S."""
    return _replace(document, t, lambda point: {"tol": max(round(point["tol"] + by_s, 3), LEAST_TOLERANCE_S)})


def set_second_time(document: Document, t: float) -> Document:
    """Accept t [s] as well for the nearest changepoint: the other end of a slow release.

    Raises EditError outside of the window, or at the changepoint itself.
    """
    _check_window(document, t)
    if abs(document["changepoints"][nearest(document, t)]["t"] - t) < SAME_S:
        raise EditError(f"the changepoint is at {t:.3f} s itself: move the cursor to its second time")
    return _replace(document, t, lambda _point: {"t_alt": t})


def set_class(document: Document, t: float, *, kind: str | None) -> Document:
    """Set the class of the segment at t [s]; None removes it.

    Without a segment there, a new one reaches to the next major changepoints, segments or ends of the window.
    Raises EditError if there is no segment to remove.
    """
    segments = list(document["segments"])
    at = segment_at(document, t)
    if kind is None:
        if at is None:
            raise EditError(f"there is no class at {t:.3f} s")
        del segments[at]
    elif at is not None:
        segments[at] = {**segments[at], "cls": kind}
    else:
        first, last = _stretch(document, t)
        segments.append({"t0": first, "t1": last, "cls": kind})
    return {**document, "segments": sorted(segments, key=lambda segment: segment["t0"])}


def segment_at(document: Document, t: float) -> int | None:
    """Return the index of the segment at t [s]; None where there is none.

    Where two segments meet it is the later one, at the end of the window the last one.
    """
    last = document["window"][1]
    spans = ((segment["t0"], segment["t1"]) for segment in document["segments"])
    return next((i for i, (t0, t1) in enumerate(spans) if t0 <= t < t1 or t == t1 == last), None)


def nearest(document: Document, t: float) -> int:
    """Return the index of the changepoint nearest to t [s]. Raises EditError where none is within REACH_S."""
    points: Sequence[Entry] = document["changepoints"]
    index = min(range(len(points)), key=lambda i: abs(points[i]["t"] - t), default=None)
    if index is None or abs(points[index]["t"] - t) > REACH_S:
        raise EditError(f"no changepoint within {REACH_S:g} s of {t:.3f} s")
    return index


def _replace(document: Document, t: float, change: Callable[[Entry], Entry]) -> Document:
    index = nearest(document, t)
    points = list(document["changepoints"])
    points[index] = {**points[index], **change(points[index])}
    return _with_points(document, points)


def _with_points(document: Document, points: Sequence[Entry]) -> Document:
    return {**document, "changepoints": sorted(points, key=lambda point: point["t"])}


def _stretch(document: Document, t: float) -> tuple[float, float]:
    """Return the ends [s] of the free stretch around t."""
    _check_window(document, t)
    first, last = document["window"]
    majors = [point["t"] for point in document["changepoints"] if point["level"] == "major"]
    before = [*majors, *(segment["t1"] for segment in document["segments"])]
    after = [*majors, *(segment["t0"] for segment in document["segments"])]
    end = min([last, *(x for x in after if x > t)])
    return max([first, *(x for x in before if x <= t and x < end)]), end


def _check_window(document: Document, t: float) -> None:
    first, last = document["window"]
    if not first <= t <= last:
        raise EditError(f"{t:.3f} s is outside of the window from {first:.3f} to {last:.3f} s")


EDITS: Mapping[str, Edit] = {
    **{
        kind: partial(insert_point, kind=kind)
        for kind in ("start", "stop", "contact_on", "contact_off", "corner")
    },
    "dip": partial(insert_point, kind=None, level="optional"),
    "remove": remove_point,
    "level": toggle_level,
    "wider": partial(change_tolerance, by_s=TOLERANCE_STEP_S),
    "narrower": partial(change_tolerance, by_s=-TOLERANCE_STEP_S),
    "second": set_second_time,
    **{kind: partial(set_class, kind=kind) for kind in KINDS},
    "no class": partial(set_class, kind=None),
}


class AnnotationEditor:
    """An annotation during editing: the document, the earlier ones, and whether it is saved."""

    def __init__(self, document: Document) -> None:
        self._documents: deque[Document] = deque([document], maxlen=UNDO_STEPS)
        self._saved = document

    @property
    def document(self) -> Document:
        """The current annotation."""
        return self._documents[-1]

    @property
    def is_saved(self) -> bool:
        """True if the annotation equals the one that was opened or saved last."""
        return self.document == self._saved

    def edit(self, name: str, t: float) -> None:
        """Apply an edit of EDITS at t [s], to the millisecond. Raises EditError, which changes nothing."""
        if name not in EDITS:
            raise EditError(f"unknown edit {name!r}, expected one of {', '.join(EDITS)}")
        self._documents.append(EDITS[name](self.document, milliseconds(t)))

    def undo(self) -> None:
        """Return to the document before the last edit. Raises EditError where there is none."""
        if len(self._documents) == 1:
            raise EditError("nothing to undo")
        self._documents.pop()

    def mark_saved(self) -> None:
        """Record that the annotation is on disk."""
        self._saved = self.document
