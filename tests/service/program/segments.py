"""Segments as they are inferred, the robot in them, and the program that is made of them."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from caesura_protocol.messages import App, Segment
from caesura_service.program import GripperAction, Moment, MomentAt, ProgramSegment, task_program

PARTS = {
    "motion": ("motion", "free"),
    "steady": ("steady", "free"),
    "contact": ("steady", "contact"),
    "sliding": ("motion", "contact"),
    "transport": ("motion", "transport"),
    "hold": ("steady", "transport"),
}
DRIFT_N = (2.0, -1.5, 3.0)  # of the sensor since it was tared
ACROSS: dict[str, Any] = {"position_start": (0.0, 0.0, 0.2), "position_end": (0.1, 0.0, 0.2)}
OFF: dict[str, Any] = {"position_start": (0.0, 0.0, 0.2), "position_end": (0.0, 0.0, 0.3), "force_held": None}
GRASP, RELEASE = GripperAction(0.5, "grasp", 0.05), GripperAction(4.5, "release", 0.08)
UPRIGHT = (1.0, 0.0, 0.0, 0.0)  # the tool points down


def segment(kind: str, t0: float, tn: float, **fields: Any) -> Segment:
    motion, contact = PARTS[kind]
    made = {
        "t0": t0,
        "tn": tn,
        "kind": kind,
        "motion": motion,
        "contact": contact,
        "probability": 0.9,
        "runner_up": None,
        "log_odds": 0.0,
        "certainty": "final",
        "position_start": (0.0, 0.0, t0 / 10),
        "position_end": (0.0, 0.0, tn / 10),
        "force_start": (0.0, 0.0, 0.0),
        "force_end": (0.0, 0.0, 0.0),
        "force_held": None,
        "load_kg": None,
        "load_sd_kg": None,
    }
    return Segment.model_validate(made | fields)


def moment_at(t: float) -> Moment:
    return Moment((0.0, 0.0, t / 10), (0.0, 0.0, 0.0, 1.0), None, 0.04)


def stopping_at(t: float) -> Moment:
    """As `moment_at`, but the hand stops at every other observation: no movement goes on in the next one."""
    return moment_at(0.2 * math.floor(t / 0.2 + 1e-9))


def drifted(t: float, *, pushed_n: float = 0.0, at: MomentAt = moment_at) -> Moment:
    place = at(t)
    x, y, z = DRIFT_N
    return Moment(place.position, place.orientation, place.joints, place.gripper_width, (x, y, z + pushed_n))


def held(push_n: float) -> dict[str, Any]:
    x, y, z = DRIFT_N
    return {"force_held": (x, y, z + push_n)}


def turned(axis: tuple[float, float, float], t0: float, tn: float) -> Segment:
    """A turn in contact by 0.3 rad about an axis."""
    x, y, z = axis
    place = {"position_start": (0.1, 0.0, 0.2), "position_end": (0.11, 0.0, 0.2)}
    made = segment("sliding", t0, tn, **held(9.0), **place)
    return made.model_copy(update={"kind": "turning", "turn": (0.3 * x, 0.3 * y, 0.3 * z)})


def program(
    *segments: Segment, grips: tuple[GripperAction, ...] = (), at: MomentAt = moment_at, **options: Any
) -> tuple[App, ...]:
    steps = [ProgramSegment(index, one, one.probability) for index, one in enumerate(segments)]
    return task_program(steps, grips, at, **options)


def carried(at_n: float) -> tuple[App, ...]:
    """A load of 4 N is carried, rests and is moved on, under a force of its own from 2 to 5 s."""
    load = {"load_kg": 0.4, "load_sd_kg": 0.05}
    still = {"position_start": (0.1, 0.0, 0.2), "position_end": (0.1, 0.0, 0.2)}

    def at(t: float) -> Moment:
        return replace(moment_at(t), force=(0.0, 0.0, at_n if 2.0 < t < 5.0 else -4.0))

    return program(
        segment("transport", 0.0, 2.0, **load),
        segment("hold", 2.0, 3.5, **load, **still),
        segment("motion", 3.5, 4.2, **ACROSS),
        segment("steady", 4.2, 5.0, **still),
        segment("transport", 5.0, 7.0, **load),
        grips=(GripperAction(-1.0, "grasp", 0.03),),
        at=at,
    )


def kinds(apps: tuple[App, ...]) -> list[str]:
    return [app.kind for app in apps]


def forces_of(app: App) -> list[float]:
    """[N] taught: along its path, then in the rests that have a force of their own."""
    rests = [rest.newton_taught for rest in (app.rest_before, app.rest_after) if rest is not None]
    return [math.hypot(*(app.force_taught or ())), *rests]
