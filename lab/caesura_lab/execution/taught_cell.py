"""A simulated cell for a program whose own cell is unknown.

Its surfaces and its object are inferred from the program. There is a level surface of the size of the contact
at each contact, and one object of the taught width and weight at a grasp. There are no other obstacles, and
the friction is that of the teacher's surfaces. So a run shows whether the arm can execute the program, not
whether the real cell allows it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from caesura_lab.execution.executor import SimulatedCell
from caesura_lab.teacher.guided_arm import lever_along
from caesura_lab.teacher.level_surface_contact import Surface
from caesura_lab.teacher.motion_profiles import Array
from caesura_lab.teacher.person import THESIS, Person
from caesura_lab.teacher.scenarios import Scenario, Step
from caesura_protocol.app_contacts import ends_in_contact
from caesura_protocol.app_kinds import APP_KINDS, name_of_app
from caesura_protocol.errors import CaesuraError
from caesura_protocol.messages import App, Quaternion, Vector
from caesura_protocol.number_words import counted
from caesura_protocol.programs.contact_forces import without_friction
from caesura_protocol.programs.program_gripper import GRIP_REACH_M
from caesura_protocol.reproduced_path import knots_of
from caesura_protocol.rotations import matrix_of

AROUND_M = 0.02  # of a surface beyond what is touched of it
COMPLIANT_M = 0.012  # from which depth on what is pressed gives way
LEVEL_COSINE = 0.94  # of 20°: a force that leans further is not that of a level surface
NEED = "name the cell with --scenario"
DOWN = (1.0, 0.0, 0.0, 0.0)  # fingers down, where a program states no orientation


@dataclass
class _Contact:
    """A contact from its touch to its release; tips: (3,) [m] of the fingertips, at the touch first."""

    index: int
    app: App
    tips: list[Array] = field(default_factory=list)
    force_n: float = 0.0


def cell_as_taught(apps: Sequence[App], person: Person = THESIS, seed: int = 0) -> SimulatedCell:
    """Return the cell that a program implies; person and seed: of its friction and sensors.

    Raises CaesuraError if the program needs more than level surfaces and one object.
    """
    start = _start(apps)
    contacts, grasps = list(_contacts(apps)), _grasps(apps)
    steps = tuple(Step("grasp", 0.0, to=_place(apps, i)) for i, _ in grasps[:1])
    surfaces = tuple(map(_surface, contacts))
    scenario = Scenario("as taught", "what the program touches", start, steps, surfaces)
    loads = [app.load_kg for app in apps if app.load_kg is not None]
    width_m = grasps[0][1].gripper_width if grasps else None
    return SimulatedCell(scenario, person, seed, load_kg=max(loads, default=None), width_m=width_m)


def taught_cell_in_words(cell: SimulatedCell) -> str:
    """Return a sentence with the surfaces and the object of a cell as taught."""
    count = len(cell.scenario.surfaces)
    standing = [counted(count, "level surface")] if count else []
    standing += ["one object"] if cell.scenario.steps else []
    return f"cell as taught: {', '.join([*standing, 'nothing else'])}; friction and stiffness are assumed"


def _start(apps: Sequence[App]) -> Vector:
    """Return the first position [m] of the flange. Raises CaesuraError for a program without a target."""
    for app in apps:
        if app.path is not None:
            return app.path.start.position
        if app.target is not None:
            return app.target
    raise CaesuraError("the program has no target: there is nothing to run")


def _place(apps: Sequence[App], index: int) -> Vector:
    """Return the target [m] of an app, or of the last one before it that has one."""
    targets = [app.target for app in apps[: index + 1] if app.target is not None]
    return targets[-1] if targets else _start(apps)


def _grasps(apps: Sequence[App]) -> list[tuple[int, App]]:
    """Return the grasps with their numbers. Raises CaesuraError for one of another object than the first."""
    grasps: list[tuple[int, App]] = []
    left: Vector | None = None  # [m] where the object was let go
    for index, app in enumerate(apps):
        if app.kind == "gripper_move" and grasps:
            left = _place(apps, index)
        if app.kind != "grasp":
            continue
        if left is not None and math.dist(left, _place(apps, index)) > GRIP_REACH_M:
            name = name_of_app(index, app)
            raise CaesuraError(f"{name} grips a second object; a cell as taught has one: {NEED}")
        grasps.append((index, app))
    return grasps


def _contacts(apps: Sequence[App]) -> Iterator[_Contact]:
    """Yield the contacts in order. Raises CaesuraError for one that a level surface cannot cause."""
    contact: _Contact | None = None
    orientation: Quaternion = DOWN
    for index, app in enumerate(apps):
        following = apps[index + 1] if index + 1 < len(apps) else None
        orientation = app.orientation or orientation
        _check(index, app)
        touches = ends_in_contact(app, following)
        if contact is not None and not APP_KINDS[app.kind].in_contact:
            yield contact
            contact = None
        if touches or (contact is None and APP_KINDS[app.kind].presses):
            contact = _Contact(index, app)
        if contact is None:
            continue
        contact.tips += _tips(app, _place(apps, index), orientation, whole=not touches)
        contact.force_n = max(contact.force_n, 0.0 if app.force is None else -app.force[2])
    if contact is not None:
        yield contact


def _check(index: int, app: App) -> None:
    """Raise CaesuraError for an app that needs more than a level surface."""
    name = name_of_app(index, app)
    if app.screw is not None and APP_KINDS[app.kind].presses:
        raise CaesuraError(f"{name} turns in contact; a level surface does not resist a turn: {NEED}")
    force = without_friction(app).force
    if force is None:
        return
    size = float(np.linalg.norm(force))
    if size > 0.0 and -force[2] < LEVEL_COSINE * size:
        toward = ", ".join(f"{value:.1f}" for value in force)
        raise CaesuraError(f"{name} exerts ({toward}) N; surfaces of a cell as taught are level: {NEED}")


def _tips(app: App, place: Vector, orientation: Quaternion, *, whole: bool) -> list[Array]:
    """Return the positions (3,) [m] of the fingertips in contact.

    They are those at the end of an app, or along its path if `whole`.
    """
    lever = lever_along(matrix_of(orientation)[:, 2])
    if whole and app.path is not None and app.target is not None:
        return [np.array(pose[:3]) + lever for pose in knots_of(app)[1]]
    return [np.array(place) + lever]


def _surface(contact: _Contact) -> Surface:
    """Return the surface of a contact: rigid, or yielding to the depth of the press."""
    tips = np.array(contact.tips)
    low, high = tips[:, :2].min(axis=0), tips[:, :2].max(axis=0)
    center = 0.5 * (low + high)
    radius = float(np.linalg.norm(tips[:, :2] - center, axis=1).max()) + AROUND_M
    top, deepest = float(tips[0, 2]), float(tips[:, 2].min())
    depth = top - deepest
    place = (float(center[0]), float(center[1]))
    if depth <= COMPLIANT_M:
        return Surface(top, place, radius)
    return Surface(top, place, radius, travel_m=depth, spring_n_per_m=max(contact.force_n, 1.0) / depth)
