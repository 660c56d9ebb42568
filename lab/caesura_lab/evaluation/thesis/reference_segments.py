"""The segment tables of the thesis (Fig. 4.6 to 4.19) as data.

A boundary has the time of the thesis' table and an event, by which it is found in the simulated
demonstration: a mark of its truth, or a position from the table. The simulated hand differs from the thesis'
by some tenths of a second, so a boundary at its own event is accepted too
(`table_row_comparison.references`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from caesura_service.changepoint.probability_threshold_segmenter import THRESHOLD

Place = tuple[float, float, float]
Mark = Literal["contact_on", "contact_off", "decay", "start", "stop", "corner"]


@dataclass(frozen=True)
class ThesisBoundary:
    """A boundary between two segments in the thesis, at time t [s].

    event: what the hand does there, None where nothing particular. also: the time that the thesis' text gives
    for it, where that is another. stated: whether the thesis gives the time; otherwise it is the simulated
    demonstration's. seen_after_s: delay with which the thesis' online segmentation showed it, None where it
    never did.
    """

    t: float
    event: Mark | Place | None = None
    also: float | None = None
    stated: bool = True
    seen_after_s: float | None = None


@dataclass(frozen=True)
class ExpectedValue:
    """A figure of one segment: the vertical force that it ends with [N], or the load carried in it [kg]."""

    segment: int
    what: Literal["force_n", "load_kg"]
    thesis: float


@dataclass(frozen=True)
class ThesisRow:
    """One result of the thesis.

    inner: all boundaries but the recording's end; states: the thesis' u of every segment (1 free, 2 contact,
    3 transport), "?" where it says none, empty where the model has none. threshold: on the probability of a
    changepoint; without one the best segmentation decides. online: measured as a session
    measures; otherwise by the offline recursion, as the thesis did. contact_within_s, others_within_s: median
    delay allowed to a change of contact, and to any other boundary. cycle_ms: the thesis' cost of a cycle.
    """

    name: str
    source: str
    scenario: str
    preset: str
    inner: tuple[ThesisBoundary, ...]
    states: str = ""
    values: tuple[ExpectedValue, ...] = ()
    threshold: float | None = THRESHOLD
    online: bool = False
    contact_within_s: float = np.inf
    others_within_s: float = np.inf
    cycle_ms: float | None = None

    def is_contact(self, index: int) -> bool:
        """Whether a boundary is a change of contact."""
        return self.inner[index].event in ("contact_on", "contact_off")

    @property
    def segments(self) -> int:
        """The number of segments."""
        return len(self.inner) + 1


def _plain(times: Sequence[float]) -> tuple[ThesisBoundary, ...]:
    return tuple(ThesisBoundary(t) for t in times)


# Places of passed points, from the tables.
_PARKOUR = {
    2.2: (-0.096, -0.390, 0.059),
    3.5: (-0.046, -0.521, 0.064),
    4.2: (0.052, -0.523, 0.067),
    5.0: (0.045, -0.411, 0.066),
    6.0: (-0.048, -0.428, 0.054),
    7.0: (-0.088, -0.563, 0.091),
    7.4: (-0.148, -0.547, 0.063),
}
_TRANSPORT = (-0.018, -0.624, 0.156)  # Fig. 4.8, 4.17
_TRANSPORT_LATER = (-0.019, -0.596, 0.154)  # Fig. 4.12
_RETREAT = (-0.021, -0.479, 0.166)  # Fig. 4.17

ROWS: tuple[ThesisRow, ...] = (
    ThesisRow(
        "R1",
        "Fig. 4.6",
        "three_point",
        "constant_velocity",
        _plain((1.6, 3.0, 4.4, 5.7, 7.2, 8.5, 9.8, 10.9, 11.6, 13.2)),
    ),
    ThesisRow(
        "R2",
        "Fig. 4.7",
        "parkour",
        "constant_velocity",
        _plain((1.3, 2.3, 3.4, 4.2, 5.0, 5.9, 6.9, 7.7)),
    ),
    ThesisRow(
        "R3",
        "Fig. 4.8",
        "pick_and_place",
        "constant_velocity",
        _plain((0.8, 1.8, 4.4, 5.7, 7.5, 10.3, 11.3)),
    ),
    ThesisRow(
        "R4",
        "Fig. 4.9",
        "three_point",
        "second_order_1",
        (
            ThesisBoundary(3.0, "start"),
            ThesisBoundary(5.9, "start"),
            ThesisBoundary(8.4, "start"),
            ThesisBoundary(10.0, (0.034, -0.342, 0.031)),
            ThesisBoundary(11.9, "start"),
        ),
    ),
    ThesisRow(
        "R5.1",
        "Fig. 4.10",
        "parkour",
        "second_order_1",
        (
            ThesisBoundary(1.8, (-0.151, -0.414, 0.053)),
            ThesisBoundary(3.5, (-0.046, -0.521, 0.064)),
            ThesisBoundary(5.8, (-0.037, -0.414, 0.060)),
            ThesisBoundary(7.1, (-0.100, -0.569, 0.083)),
        ),
    ),
    ThesisRow(
        "R5.2",
        "Fig. 4.11",
        "parkour",
        "second_order_2",
        (ThesisBoundary(1.4, "start"), *(ThesisBoundary(t, place) for t, place in _PARKOUR.items())),
    ),
    ThesisRow(
        "R6",
        "Fig. 4.12",
        "pick_and_place",
        "second_order_1",
        (
            ThesisBoundary(4.4, "contact_off"),
            ThesisBoundary(6.0, _TRANSPORT_LATER),
            ThesisBoundary(10.4, "contact_off"),
        ),
    ),
    ThesisRow(
        "R7",
        "Fig. 4.13",
        "dispenser",
        "force",
        (
            ThesisBoundary(2.6, "contact_on"),
            ThesisBoundary(4.2, "decay"),
            ThesisBoundary(4.7, "contact_off"),
            ThesisBoundary(7.6, "contact_on"),
            ThesisBoundary(9.3, "decay"),
            ThesisBoundary(9.7, "contact_off"),
        ),
        values=(ExpectedValue(1, "force_n", 21.1), ExpectedValue(4, "force_n", 20.3)),
    ),
    ThesisRow(
        "R8",
        "Fig. 4.14",
        "pick_and_place",
        "force",
        (
            ThesisBoundary(1.8, "contact_on"),
            ThesisBoundary(3.5, "decay"),
            ThesisBoundary(4.1, "contact_off"),
            ThesisBoundary(7.5, "contact_on"),
            ThesisBoundary(9.8, "decay"),
            ThesisBoundary(10.2, "contact_off"),
        ),
        values=(
            ExpectedValue(1, "force_n", 15.0),
            ExpectedValue(3, "force_n", -2.9),
            ExpectedValue(4, "force_n", 9.9),
        ),
    ),
    ThesisRow(
        "R9",
        "Fig. 4.15",
        "pick_and_place",
        "contact",
        (
            ThesisBoundary(1.9, "contact_on"),
            ThesisBoundary(4.2, "contact_off"),
            ThesisBoundary(7.5, "contact_on"),
            ThesisBoundary(10.1, "contact_off"),
        ),
        states="12321",
        values=(ExpectedValue(2, "load_kg", 0.276),),
    ),
    ThesisRow(
        "R10",
        "Fig. 4.16",
        "dispenser",
        "integrated",
        (  # its table is not printed: the times are those of the same recording in Fig. 4.13
            ThesisBoundary(2.6, "contact_on"),
            ThesisBoundary(4.2, "decay"),
            ThesisBoundary(4.7, "contact_off"),
            ThesisBoundary(6.4, "start", stated=False),
            ThesisBoundary(7.6, "contact_on"),
            ThesisBoundary(9.3, "decay"),
            ThesisBoundary(9.7, "contact_off"),
        ),
        states="12?112?1",
        values=(ExpectedValue(1, "force_n", 20.0), ExpectedValue(5, "force_n", 20.0)),
    ),
    ThesisRow(
        "R11",
        "Fig. 4.17",
        "pick_and_place",
        "integrated",
        (
            ThesisBoundary(1.8, "contact_on"),
            ThesisBoundary(3.5, "decay"),
            ThesisBoundary(4.2, "contact_off"),
            ThesisBoundary(5.7, _TRANSPORT),
            ThesisBoundary(7.5, "contact_on"),
            ThesisBoundary(9.8, "decay"),
            ThesisBoundary(10.8, _RETREAT, also=10.2),  # 10.2 s in section 4.2.6
        ),
        states="12133211",
        values=(ExpectedValue(3, "load_kg", 0.257), ExpectedValue(4, "load_kg", 0.293)),
    ),
    ThesisRow(
        "R12",
        "Fig. 4.18",
        "pick_and_place",
        "contact",
        (
            ThesisBoundary(1.9, "contact_on", seen_after_s=0.6),
            ThesisBoundary(4.2, "contact_off", seen_after_s=0.6),
            ThesisBoundary(7.5, "contact_on", seen_after_s=0.6),
            ThesisBoundary(10.1, "contact_off", seen_after_s=0.6),
        ),
        online=True,
        contact_within_s=0.6,
        cycle_ms=18.0,
    ),
    ThesisRow(
        "R13",
        "Fig. 4.19",
        "pick_and_place",
        "integrated",
        (
            ThesisBoundary(1.8, "contact_on", seen_after_s=0.6),
            ThesisBoundary(3.5, "decay"),
            ThesisBoundary(4.2, "contact_off", seen_after_s=0.6),
            ThesisBoundary(6.0, _TRANSPORT, seen_after_s=1.2),
            ThesisBoundary(7.4, "contact_on", seen_after_s=0.6),
            ThesisBoundary(9.8, "decay"),
            ThesisBoundary(10.2, "contact_off", seen_after_s=0.6),
        ),
        online=True,
        contact_within_s=0.2,
        others_within_s=1.0,
        cycle_ms=82.6,
    ),
)
# The same boundaries by the preset that a session has without being asked, and its way to decide.
ROWS = (*ROWS, replace(ROWS[-1], name="R13 default", preset="default", threshold=None))
