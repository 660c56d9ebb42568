"""Forces on what is held that its load does not explain."""

from __future__ import annotations

from dataclasses import replace

import pytest

from caesura_protocol.messages import App
from caesura_service.constants import GRAVITY
from caesura_service.program import Moment, MomentAt, unreproduced_pulls_note
from harness.programs import app
from service.program.segments import moment_at

PLACE = (0.4, 0.0, 0.2)
CARRIES = (
    app("hold", 0.0, 2.0, PLACE, load_kg=0.5),
    app("transport", 2.0, 4.0, PLACE, load_kg=0.5),
)


def pulled(newton: float, t0: float, tn: float) -> MomentAt:
    """The weight of 0.5 kg, with a pull along x between two times [s]."""

    def at(t: float) -> Moment:
        return replace(moment_at(t), force=(newton if t0 <= t < tn else 0.0, 0.0, -0.5 * GRAVITY))

    return at


@pytest.mark.parametrize(
    ("newton", "seconds", "stated"),
    [(20.0, 0.6, True), (-20.0, 0.6, True), (20.0, 0.3, False), (4.0, 1.5, False)],
)
def test_a_pull_on_what_is_held_is_stated(newton: float, seconds: float, stated: bool):
    """A plug was pulled with 25 N for half a second: the program carried 1.15 kg, without a word."""
    found = unreproduced_pulls_note(CARRIES, pulled(newton, 0.2, 0.2 + seconds))
    none = "Forces that no app exerts, because apps that carry exert none"
    said = f"{none}: a force of 20.0 N beside the weight of 0.50 kg"
    assert found == (f"{said} at 0.0–2.0 s." if stated else None)


@pytest.mark.parametrize(
    "apps",
    [
        (),
        (app("hold", 0.0, 2.0, PLACE),),
        (app("cartesian_motion", 0.0, 2.0, PLACE),),
        (app("hold", 0.0, 0.2, PLACE, load_kg=1.0),),
    ],
)
def test_what_is_not_weighed_or_too_short_is_not_stated(apps: tuple[App, ...]):
    assert unreproduced_pulls_note(apps, pulled(20.0, 0.0, 2.0)) is None
