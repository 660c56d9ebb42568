"""Forces in the air that are too weak for a contact are named by a note of the program."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from caesura_protocol.messages import App
from caesura_service.program import Moment, MomentAt, unreproduced_touches_note
from harness.programs import app, move
from service.program.segments import moment_at

PLACE = (0.4, 0.0, 0.2)
WAY = (move(0.0, PLACE, PLACE), move(9.0, PLACE, PLACE))


def felt(*touches: tuple[float, float, float], drift_n: float = 0.0, turn: NDArray[np.float64] | None = None):
    """A force along z, each as newton, begin and end [s], on a drift over ten seconds and 0.03 N of noise."""
    noise = np.random.default_rng(0).normal(0.0, 0.03, (200, 3))
    frame = np.eye(3) if turn is None else turn

    def at(t: float) -> Moment:
        newton = sum(newton for newton, t0, tn in touches if t0 <= t < tn) + drift_n * t / 10.0
        x, y, z = (frame @ (noise[round(10 * t)] + (0.0, 0.0, newton))).tolist()
        return replace(moment_at(t), force=(x, y, z))

    return at


def note(at: MomentAt, apps: tuple[App, ...] = WAY) -> str | None:
    return unreproduced_touches_note(apps, at, 0.0, 10.0)


def test_lines_that_a_pen_draws_lightly_are_named() -> None:
    """They were movements, and nothing stated that the pen had touched the paper."""
    assert note(felt((3.0, 2.0, 3.0), (-3.2, 6.0, 7.5))) == (
        "Forces without a contact, in no app: 3.0 N at 2.0–3.0 s; 3.2 N at 6.0–7.5 s. To have "
        "the robot press there, press harder."
    )


@pytest.mark.parametrize(
    ("newton", "seconds", "drift_n", "stated"),
    [
        (3.0, 0.6, 0.0, True),
        (3.0, 0.4, 0.0, False),
        (2.0, 2.0, 0.0, False),
        (0.0, 0.0, 2.3, False),
        (7.0, 0.3, 0.0, True),
        (7.0, 0.2, 0.0, True),
        (4.0, 0.2, 0.0, False),
        (20.0, 0.1, 0.0, False),
    ],
    ids=[
        "long enough",
        "too short",
        "too weak",
        "a drift",
        "hit in passing",
        "hit shortly",
        "a jolt",
        "a spike",
    ],
)
def test_only_what_is_no_drift_is_named(newton: float, seconds: float, drift_n: float, stated: bool) -> None:
    assert (note(felt((newton, 4.0, 4.0 + seconds), drift_n=drift_n)) is not None) == stated


@pytest.mark.parametrize(("m_per_s2", "stated"), [(0.5, True), (3.0, False)])
def test_a_short_force_that_the_inertia_of_a_tool_explains_is_not_named(
    m_per_s2: float, stated: bool
) -> None:
    """A hit of 8 N for 0.2 s, as at a corner of a table, had no note; nor has a jolt of a tool of 2 kg."""
    hit = felt((8.0, 4.0, 4.2))

    def at(t: float) -> Moment:
        since = min(max(t - 3.8, 0.0), 0.6)  # [s] of acceleration
        z = 0.5 * m_per_s2 * since**2 + m_per_s2 * since * max(t - 4.4, 0.0)
        return replace(hit(t), position=(0.0, 0.0, z))

    assert (note(at) is not None) == stated


@pytest.mark.parametrize("kind", ["apply_force", "transport", "grasp", "cartesian_motion"])
def test_a_force_in_an_app_that_states_it_is_not_named(kind: str) -> None:
    pushed = {"force_taught": (0.0, 0.0, -9.0)} if kind == "cartesian_motion" else {}
    there = app(kind, 4.0, 5.0, PLACE, **pushed)
    assert note(felt((9.0, 3.8, 5.2)), (WAY[0], there, WAY[1])) is None


def test_a_force_that_turns_has_its_size() -> None:
    """A crank was turned twice by a finger, against 6 N: its mean over two turns was 0.1 N."""

    def cranked(t: float) -> Moment:
        newton = 6.0 if 2.0 <= t < 4.0 else 0.0
        turned = np.pi * t
        return replace(moment_at(t), force=(newton * np.cos(turned), newton * np.sin(turned), 0.0))

    assert "6.0 N at 2.0–4.0 s" in (note(cranked) or "")


def test_of_many_the_strongest_are_named() -> None:
    touches = [(3.0 + 0.5 * k, 2.5 * k + 1.0, 2.5 * k + 1.6) for k in range(7)]
    found = unreproduced_touches_note(WAY, felt(*touches), 0.0, 19.9)
    assert found is not None
    assert "6.0 N" in found
    assert "3.0 N" not in found
    assert "; 2 weaker ones." in found


def test_what_is_named_does_not_depend_on_the_base_frame() -> None:
    turn = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0]
    touches = (3.0, 2.0, 3.0), (-3.2, 6.0, 7.5)
    assert note(felt(*touches, turn=turn)) == note(felt(*touches))


def test_a_demonstration_without_a_force_has_no_note() -> None:
    assert note(moment_at) is None
    assert unreproduced_touches_note((), felt(), 0.0, 0.1) is None
