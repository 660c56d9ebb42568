"""Plans a program for controllers with lines and blends: first poses, straight legs, contacts, pauses."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from caesura_protocol.app_contacts import ends_in_contact
from caesura_protocol.app_kinds import name_of_app
from caesura_protocol.messages import App, Vector
from caesura_protocol.programs.app_time_shifts import rest_newtons, rests_of
from caesura_protocol.programs.contact_forces import press_direction, without_friction
from caesura_protocol.programs.document import ProgramFile
from caesura_protocol.programs.program_gripper import GRIPS
from caesura_protocol.programs.safety import Safety
from caesura_protocol.programs.straight_legs import (
    SHORT_M,
    SLOWEST_M_PER_S,
    STILL_RAD,
    Leg,
    Quaternion,
    straight_legs,
)
from caesura_protocol.programs.ways_between_apps import WayToPath, ways_to_paths

STANDOFF_M = 0.02  # before a contact, from where it is looked for slowly
ROUNDING_M = 1e-6
LEAST_PAUSE_S = 0.05


class PlannedApp(NamedTuple):
    """An app with its movements.

    place: index in the program, from 0; start: (position [m], orientation) to which the arm moves first, from
    any pose; begins: taught start; legs: following movements; contact: (3,) direction of the search if a
    contact ends the app; wait_s: rest of a press before the legs; stay_s: duration of a press without legs;
    hold_s: rest after the legs, of a hold or a press; of a hold that a contact ends, before them; pause_s:
    pause after the app. wait_n, hold_n: forces during these rests. clear_legs: number of legs that leave the
    contact of the app before; there is no contact search on them, and the sensor is zeroed after them; None
    without legs, so that the tool is still in contact. stands: where the arm must be already, for a grasp
    before any movement.
    """

    place: int
    app: App
    start: tuple[Vector, Quaternion | None] | None
    begins: Vector | None
    legs: list[Leg]
    contact: Vector | None
    wait_s: float
    stay_s: float
    hold_s: float
    pause_s: float
    wait_n: float
    hold_n: float
    clear_legs: int | None
    stands: Vector | None

    @property
    def name(self) -> str:
        """The app's displayed number, with its name or else its kind."""
        return name_of_app(self.place, self.app)


def planned_apps(program: ProgramFile, acceleration: float) -> Iterator[PlannedApp]:
    """Plan apps whose preconditions hold, each press along the normal of the touched surface.

    acceleration: [m/s²] of a leg that starts and stops.
    """
    place: Vector | None = None  # at the end of the last movement, and the orientation there
    orientation: Quaternion | None = None
    moved = False  # by any app before this one
    touched: Vector | None = None  # the place of a contact that is not left yet
    apps = [without_friction(app) for app in program.apps]
    for index, (app, way) in enumerate(zip(apps, ways_to_paths(apps), strict=True)):
        following = apps[index + 1] if index + 1 < len(apps) else None
        contact = press_direction(app, following) if ends_in_contact(app, following) else None
        short = None if contact is None else _scaled(contact, STANDOFF_M)
        legs = []
        if app.kind not in GRIPS and (app.kind != "apply_force" or app.path is not None):
            before = None if place is None else (place, orientation)
            legs = straight_legs(app, before, program.safety, acceleration, stop_short=short)
        begins = place if app.path is None else app.path.start.position
        if begins is not None and all(_stays(leg, begins) for leg in legs):
            legs = []
        wait, stay, hold = _seconds_at_rest(app, legs, ends_in_contact=contact is not None)
        start = None
        if not moved and legs:
            start, legs = _begun(app, legs)
        elif way is not None and _goes_to_its_path(app, legs, short):
            legs = [_leg_to_path(app, way, program.safety), *legs]
        stands = app.target if app.kind == "grasp" and not moved else None
        moved = moved or start is not None
        legs, clear = _cleared(legs, touched, contact)
        wait_n, hold_n = rest_newtons(app)
        yield PlannedApp(
            place=index,
            app=app,
            start=start,
            begins=begins,
            legs=legs,
            contact=contact,
            wait_s=wait,
            stay_s=stay,
            hold_s=hold,
            pause_s=pause_between(app, following, program.safety),
            wait_n=wait_n,
            hold_n=hold_n,
            clear_legs=clear,
            stands=stands,
        )
        place, orientation = app.target or place, app.orientation or orientation
        touches = contact is not None or app.kind == "apply_force"
        touched = place if touches else _still_touched(legs, touched)


def _seconds_at_rest(app: App, legs: list[Leg], *, ends_in_contact: bool) -> tuple[float, float, float]:
    """Return how long [s] an app waits before its legs, stays in place of legs, and holds after them."""
    if app.kind == "apply_force":
        wait, hold = rests_of(app)
        return wait, 0.0 if legs else app.tn - app.t0 - wait - hold, hold
    if not legs and not ends_in_contact and app.kind not in GRIPS:
        return 0.0, 0.0, app.tn - app.t0
    if app.kind == "hold":  # its way is a drift: it lasts as long as it was taught
        return 0.0, 0.0, max(app.tn - app.t0 - sum(leg.seconds for leg in legs), 0.0)
    return 0.0, 0.0, 0.0


def pause_between(app: App, following: App | None, safety: Safety) -> float:
    """Return the pause [s] that a robot makes between two apps: as it was taught, up to its limit."""
    return 0.0 if following is None else min(max(following.t0 - app.tn, 0.0), safety.pause_s)


def _stays(leg: Leg, place: Vector) -> bool:
    """Return whether a leg neither leaves a place nor turns."""
    return math.dist(leg.position, place) < SHORT_M and leg.turn_rad < STILL_RAD


def _leaves(leg: Leg, touched: Vector) -> bool:
    return math.dist(leg.position, touched) >= STANDOFF_M - ROUNDING_M


def _still_touched(legs: list[Leg], touched: Vector | None) -> Vector | None:
    """Return the position of a contact; None once a leg has left it."""
    return None if touched is not None and any(_leaves(leg, touched) for leg in legs) else touched


def _cleared(legs: list[Leg], touched: Vector | None, contact: Vector | None) -> tuple[list[Leg], int | None]:
    """Return the legs, with a stop where the contact has been left, and the number of legs that leave it.

    It is 0 without a contact to leave or to search; None without legs, in contact.
    """
    if contact is None or touched is None:
        return legs, 0
    if not legs:
        return legs, None
    far = (i for i, leg in enumerate(legs) if _leaves(leg, touched))
    last = next(far, len(legs) - 1)
    return [*legs[:last], legs[last]._replace(blend_m=0.0), *legs[last + 1 :]], last + 1


def _begun(app: App, legs: list[Leg]) -> tuple[tuple[Vector, Quaternion | None], list[Leg]]:
    """Return the first pose of a program, and the legs that remain after it."""
    if app.path is None:
        return (legs[0].position, legs[0].orientation), []
    return (app.path.start.position, app.path.start.orientation), legs


def _goes_to_its_path(app: App, legs: list[Leg], short: Vector | None) -> bool:
    """Return whether an app goes to the start of its path first.

    A press without legs stays where it is. A start beyond the place before a contact is left out.
    """
    if app.path is None or app.target is None or (app.kind == "apply_force" and not legs):
        return False
    left = zip(app.target, app.path.start.position, short or (0.0, 0.0, 0.0), strict=True)
    return short is None or sum((a - b) * c for a, b, c in left) > STANDOFF_M**2


def _leg_to_path(app: App, way: WayToPath, safety: Safety) -> Leg:
    """Return the leg on which the arm goes to the start of an app's path, and stops there."""
    assert app.path is not None
    start = app.path.start
    seconds = way.seconds * safety.slower(way.metres / way.seconds, way.radians / way.seconds)
    speed = None if way.metres < SHORT_M else max(way.metres / seconds, SLOWEST_M_PER_S)
    return Leg(start.position, start.orientation, speed, seconds, 0.0, way.radians)


def _scaled(vector: Vector, factor: float) -> Vector:
    x, y, z = vector
    return factor * x, factor * y, factor * z
