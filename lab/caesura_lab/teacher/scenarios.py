"""The tasks to teach: scenarios as tables of steps.

Positions are flange positions in the base frame, fingers pointing down; those of the thesis stand as in its
tables (Fig. 4.6 to 4.17), where the Panda reaches them, so that its work plane lies below the robot's base.
`until_s` is when the nominal person is done with a step; other people stretch and shrink it.

A person presses by aiming below a surface, so a step's force holds until another press or a move changes it.

`BASIC` are the thesis' scenarios and others in which the tool keeps its orientation; `SKILLS` turn the tool,
go in circles or repeat strokes. In a scenario that turns, a position is that of the fingertips, raised by the
length of the fingers: the flange is there while the fingers point down.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import cos, radians, sin
from types import MappingProxyType
from typing import Literal

from caesura_lab.teacher.level_surface_contact import Surface
from caesura_lab.teacher.motion_profiles import Vector
from caesura_lab.teacher.phase_truth import Event
from caesura_lab.teacher.shaped_surface_contact import Hole, HorizontalCylinder, Screw

FINGERS_BELOW_FLANGE_M = 0.1034
Kind = Literal["move", "touch", "press", "slide", "grasp", "release", "dwell", "turn", "circle", "insert"]


@dataclass(frozen=True)
class Step:
    """One thing that a person does.

    move: to a place, on a smooth curve through `via`, without a stop there where `passing`. touch: until a
    surface stops the hand, at `until_s`. press: with a force. slide: to a place along the surface, with a
    force. grasp, release: the fingers have closed at, or begin to open at, `until_s`. dwell: stay. turn: the
    tool about its tip, to `angle_deg` from the start's orientation; a move, touch or slide with such an angle
    turns on its way. circle: `rounds` of a level circle of `radius_m`, back to here. insert: down to a place,
    with a force. begins: the skill that begins with this step, and the event that is (`phases`).
    """

    kind: Kind
    until_s: float
    to: Vector | None = None
    force_n: float = 0.0
    passing: bool = False
    via: tuple[Vector, ...] = ()
    angle_deg: float | None = None
    radius_m: float = 0.0
    rounds: int = 0
    begins: tuple[str, Event] | None = None


@dataclass(frozen=True)
class Scenario:
    """A task: where it starts [m], its steps, and what stands around.

    traced: some movements are as slow as creep, so that the truth distinguishes them by their length.
    whole_pose: the truth reads the turns of the tool and the way of its tip, not the flange's alone.
    turn_axis: of the base, about which the tool turns, None where it keeps its orientation. angle_spread:
    standard deviation of the angles from person to person, relative.
    """

    name: str
    summary: str
    start: Vector
    steps: tuple[Step, ...]
    surfaces: tuple[Surface, ...] = ()
    traced: bool = False
    whole_pose: bool = False
    turn_axis: Vector | None = None
    angle_spread: float = 0.0

    @property
    def end(self) -> Vector:
        """The last place [m] of the flange."""
        return [step.to for step in self.steps if step.to is not None][-1]


def moved(scenario: Scenario, offset: Vector) -> Scenario:
    """Return a scenario that stands elsewhere in the base frame, with all that it touches; offset [m]."""
    if offset == (0.0, 0.0, 0.0):
        return scenario
    dx, dy, dz = offset

    def place(at: Vector) -> Vector:
        return (at[0] + dx, at[1] + dy, at[2] + dz)

    def surface(one: Surface) -> Surface:
        center = (one.center_m[0] + dx, one.center_m[1] + dy)
        return replace(one, touch_height_m=one.touch_height_m + dz, center_m=center)

    steps = tuple(
        replace(step, to=None if step.to is None else place(step.to), via=tuple(map(place, step.via)))
        for step in scenario.steps
    )
    surfaces = tuple(map(surface, scenario.surfaces))
    return replace(scenario, start=place(scenario.start), steps=steps, surfaces=surfaces)


def tips(flange_height_m: float) -> float:
    """Height of the fingertips [m] where the flange has a height, fingers pointing down."""
    return flange_height_m - FINGERS_BELOW_FLANGE_M


A, B, C = (0.013, -0.540, 0.012), (0.035, -0.335, 0.030), (-0.160, -0.464, 0.018)

THREE_POINT = Scenario(
    "three_point",
    "two rounds over three points, the second without a stop at B (thesis Fig. 4.2, 4.6, 4.9)",
    A,
    (
        Step("dwell", 0.2),
        Step("move", 2.0, B),
        Step("dwell", 3.0),
        Step("move", 4.8, C),
        Step("dwell", 5.9),
        Step("move", 7.6, (0.018, -0.536, 0.010)),
        Step("dwell", 8.4),
        Step("move", 10.0, (0.034, -0.342, 0.031), passing=True),
        Step("move", 11.3, (-0.170, -0.468, 0.025)),
        Step("dwell", 11.9),
        Step("move", 13.6, (0.011, -0.550, 0.018)),
        Step("dwell", 15.1),
    ),
)

PARKOUR = Scenario(
    "parkour",
    "a figure of eight around two obstacles (thesis Fig. 4.3, 4.7, 4.11)",
    (-0.167, -0.462, 0.052),
    (
        Step("dwell", 1.3),
        Step("move", 2.2, (-0.096, -0.390, 0.059), passing=True),
        Step("move", 3.4, (-0.046, -0.521, 0.064), passing=True),
        Step("move", 4.2, (0.052, -0.523, 0.067), passing=True),
        Step("move", 5.0, (0.045, -0.411, 0.066), passing=True),
        Step("move", 6.0, (-0.048, -0.428, 0.054), passing=True),
        Step("move", 7.0, (-0.088, -0.563, 0.091), passing=True),
        Step("move", 7.6, (-0.150, -0.525, 0.060), passing=True),
        Step("move", 8.4, (-0.150, -0.459, 0.053)),
        Step("dwell", 8.9),
    ),
)

PICK_AND_PLACE = Scenario(
    "pick_and_place",
    "pick an object of 250 g up and put it down (thesis Fig. 4.4, 4.12, 4.14, 4.15, 4.17)",
    (-0.028, -0.648, 0.244),
    (
        Step("dwell", 0.15),
        Step("touch", 1.8, (-0.014, -0.673, 0.107)),
        Step("grasp", 3.0, force_n=15.0),
        Step("press", 3.5, force_n=15.0),
        Step("press", 3.8, force_n=3.0),
        Step("move", 5.7, (-0.018, -0.624, 0.156), passing=True),
        Step("touch", 7.5, (-0.021, -0.475, 0.107)),
        Step("release", 9.2, force_n=10.0),
        Step("press", 9.8, force_n=10.0),
        Step("press", 10.1, force_n=2.5),
        Step("move", 11.3, (-0.022, -0.531, 0.263), passing=True),
        Step("move", 12.3, (-0.021, -0.562, 0.290)),
        Step("dwell", 12.8),
    ),
    (Surface(tips(0.107)),),
)

PUMP = Surface(
    tips(0.190),
    center_m=(-0.02, -0.52),
    radius_m=0.04,
    travel_m=0.025,
    preload_n=3.0,
    spring_n_per_m=160.0,
    stiffness_n_per_m=1e4,
)

DISPENSER = Scenario(
    "dispenser",
    "press a soap dispenser twice (thesis Fig. 4.5, 4.13, 4.16)",
    (-0.03, -0.60, 0.33),
    (
        Step("dwell", 0.8),
        Step("touch", 2.6, (-0.02, -0.52, 0.190)),
        Step("press", 4.2, force_n=21.0),
        Step("move", 5.5, (-0.02, -0.53, 0.290)),
        Step("dwell", 6.4),
        Step("touch", 7.6, (-0.02, -0.52, 0.190)),
        Step("press", 9.3, force_n=20.0),
        Step("move", 11.2, (-0.03, -0.61, 0.32)),
        Step("dwell", 12.2),
    ),
    (PUMP,),
)

WIPING = Scenario(
    "wiping",
    "reach a table, wipe it with 5 to 20 N in four strokes, retract",
    (0.42, -0.02, 0.38),
    (
        Step("dwell", 0.8),
        Step("touch", 2.4, (0.40, -0.16, 0.150)),
        Step("press", 3.2, force_n=8.0, begins=("wipe", "contact_on")),
        Step("slide", 4.8, (0.41, 0.12, 0.150), force_n=12.0),
        Step("slide", 6.2, (0.47, -0.14, 0.150), force_n=15.0, passing=True),
        Step("slide", 7.6, (0.50, 0.12, 0.150), force_n=18.0),
        Step("dwell", 8.3),
        Step("slide", 10.0, (0.55, -0.14, 0.150), force_n=7.0),
        Step("press", 10.6, force_n=5.0),
        Step("move", 12.3, (0.45, 0.0, 0.34), begins=("retract", "contact_off")),
        Step("dwell", 13.2),
    ),
    (Surface(tips(0.150), friction=0.25),),
)

BUTTON_PLACES = ((0.42, -0.13), (0.47, 0.01), (0.43, 0.15))


def _button(x: float, y: float) -> Surface:
    return Surface(
        tips(0.180), center_m=(x, y), radius_m=0.02, travel_m=0.004, preload_n=3.0, spring_n_per_m=700.0
    )


BUTTON = Scenario(
    "button",
    "press three push buttons on a panel",
    (0.38, -0.05, 0.30),
    (
        Step("dwell", 0.8),
        Step("touch", 2.3, (*BUTTON_PLACES[0], 0.180)),
        Step("press", 3.1, force_n=9.0),
        Step("move", 3.9, (0.43, -0.10, 0.230), passing=True),
        Step("touch", 4.8, (*BUTTON_PLACES[1], 0.180)),
        Step("press", 5.4, force_n=12.0),
        Step("move", 6.4, (0.46, 0.07, 0.240)),
        Step("dwell", 7.2),
        Step("touch", 8.2, (*BUTTON_PLACES[2], 0.180)),
        Step("press", 9.4, force_n=10.0),
        Step("move", 10.9, (0.38, 0.05, 0.30)),
        Step("dwell", 11.8),
    ),
    (*(_button(x, y) for x, y in BUTTON_PLACES), Surface(tips(0.172))),
)

TRACING = Scenario(
    "tracing",
    "trace an angle and an arc at about 13 mm/s",
    (0.40, -0.10, 0.28),
    (
        Step("dwell", 1.0),
        Step("move", 2.6, (0.42, -0.06, 0.20)),
        Step("dwell", 3.6),
        Step("move", 7.6, (0.47, -0.06, 0.20), passing=True),
        Step("move", 11.6, (0.47, -0.01, 0.20)),
        Step("dwell", 12.8),
        Step("move", 18.8, (0.42, 0.04, 0.20), via=((0.455, 0.025, 0.20),)),
        Step("dwell", 19.8),
        Step("move", 21.4, (0.40, 0.0, 0.28)),
        Step("dwell", 22.4),
    ),
    traced=True,
)

CURVES = Scenario(
    "curves",
    "carry the arm along three free curves of 0.5 to 1 m",
    (0.42, -0.22, 0.28),
    (
        Step("dwell", 1.0),
        Step("move", 5.0, (0.45, 0.22, 0.30), via=((0.55, -0.12, 0.40), (0.52, 0.08, 0.26))),
        Step("dwell", 6.2),
        Step(
            "move",
            12.2,
            (0.44, -0.20, 0.32),
            via=((0.36, 0.12, 0.42), (0.50, 0.02, 0.47), (0.58, -0.12, 0.36)),
        ),
        Step("dwell", 13.4),
        Step("move", 16.4, (0.40, 0.02, 0.30), via=((0.50, -0.14, 0.24),)),
        Step("dwell", 17.4),
    ),
)

SCREW_PLACE = (0.45, -0.05, 0.200)

SCREWING = Scenario(
    "screwing",
    "drive a screw by three strokes of 120 degrees, lifting off once and as with a ratchet once",
    (0.40, 0.10, 0.36),
    (
        Step("dwell", 0.8),
        Step("touch", 2.8, SCREW_PLACE, angle_deg=-60.0),
        Step("press", 3.5, force_n=12.0, begins=("screw", "contact_on")),
        Step("turn", 6.7, force_n=12.0, angle_deg=60.0),
        Step("dwell", 7.2),
        Step("move", 8.0, (0.45, -0.05, 0.216)),
        Step("turn", 10.8, angle_deg=-60.0),
        Step("touch", 11.6, SCREW_PLACE),
        Step("press", 12.2, force_n=12.0),
        Step("turn", 15.4, force_n=14.0, angle_deg=60.0),
        Step("dwell", 15.9),
        Step("turn", 18.7, force_n=6.0, angle_deg=-60.0),
        Step("dwell", 19.1),
        Step("turn", 22.3, force_n=15.0, angle_deg=60.0),
        Step("press", 22.9, force_n=10.0),
        Step("move", 24.7, (0.41, 0.08, 0.34), angle_deg=0.0, begins=("retract", "contact_off")),
        Step("dwell", 25.5),
    ),
    (Screw(tips(0.200), stiffness_n_per_m=5e4),),  # under the tool wherever it comes down
    whole_pose=True,
    turn_axis=(0.0, 0.0, -1.0),
    angle_spread=0.12,
)

HOLE_PLACE, HOLE_FLOOR_M = (0.50, 0.10, 0.160), 0.025

PEG = Scenario(
    "peg",
    "pick a peg up, search its hole with the tilted peg, push it in 25 mm, let go",
    (0.40, -0.02, 0.34),
    (
        Step("dwell", 0.6),
        Step("touch", 2.2, (0.42, -0.16, 0.160)),
        Step("grasp", 3.3, force_n=15.0, begins=("pick", "contact_on")),
        Step("press", 3.7, force_n=3.0),
        Step("move", 5.1, (0.46, -0.02, 0.250), passing=True, begins=("carry", "contact_off")),
        Step("touch", 6.7, (0.50, 0.065, 0.160), angle_deg=14.0),
        Step("press", 7.2, force_n=5.0, begins=("insert", "contact_on")),
        Step("slide", 8.4, HOLE_PLACE, force_n=5.0),
        Step("turn", 9.4, force_n=5.0, angle_deg=0.0),
        Step("insert", 11.2, (*HOLE_PLACE[:2], HOLE_PLACE[2] - HOLE_FLOOR_M), force_n=17.0),
        Step("release", 12.4, force_n=10.0),
        Step("press", 12.7, force_n=3.0),
        Step("move", 14.4, (0.42, 0.02, 0.33), begins=("retract", "contact_off")),
        Step("dwell", 15.2),
    ),
    (
        Hole(tips(HOLE_PLACE[2]), center_m=HOLE_PLACE[:2], radius_m=0.008, floor_m=HOLE_FLOOR_M),
        Surface(tips(HOLE_PLACE[2])),
    ),
    whole_pose=True,
    turn_axis=(1.0, 0.0, 0.0),
)

POURING = Scenario(
    "pouring",
    "carry a vessel, tilt it in place by 90 degrees, hold, tilt it back, put it down",
    (0.40, -0.04, 0.36),
    (
        Step("dwell", 0.6),
        Step("touch", 2.3, (0.42, -0.18, 0.180)),
        Step("grasp", 3.4, force_n=15.0, begins=("pick", "contact_on")),
        Step("press", 3.7, force_n=3.0),
        Step("move", 6.0, (0.50, 0.08, 0.400), begins=("pour", "contact_off")),
        Step("dwell", 6.6),
        Step("turn", 8.8, angle_deg=90.0),
        Step("dwell", 10.2),
        Step("turn", 12.0, angle_deg=0.0),
        Step("dwell", 12.5),
        Step("touch", 15.0, (0.43, -0.16, 0.180)),
        Step("release", 16.2, force_n=8.0, begins=("place", "contact_on")),
        Step("press", 16.5, force_n=2.5),
        Step("move", 18.2, (0.40, -0.02, 0.34), begins=("retract", "contact_off")),
        Step("dwell", 19.0),
    ),
    (Surface(tips(0.180)),),
    whole_pose=True,
    turn_axis=(1.0, 0.0, 0.0),
    angle_spread=0.12,
)

CIRCLE = Scenario(
    "circle",
    "two full circles of 10 cm in free space, as one movement",
    (0.38, -0.10, 0.36),
    (
        Step("dwell", 0.8),
        Step("move", 2.4, (0.42, 0.02, 0.28)),
        Step("dwell", 3.2),
        Step("circle", 11.6, radius_m=0.05, rounds=2, begins=("circle", "start")),
        Step("dwell", 12.4),
        Step("move", 14.0, (0.38, -0.08, 0.34), begins=("return", "start")),
        Step("dwell", 14.8),
    ),
    whole_pose=True,
)

BARREL = HorizontalCylinder(tips(0.260))


def _on_barrel(x: float, angle_deg: float) -> Vector:
    """Place on the barrel where its normal leans by an angle towards y."""
    angle = radians(angle_deg)
    return (x, BARREL.radius_m * sin(angle), 0.260 - BARREL.radius_m * (1.0 - cos(angle)))


CONTOUR = Scenario(
    "contour",
    "slide over a barrel with 10 to 14 N, the tool along its normal, and back",
    (0.42, -0.02, 0.40),
    (
        Step("dwell", 0.8),
        Step("touch", 2.9, _on_barrel(0.46, -35.0), angle_deg=-35.0),
        Step("press", 3.6, force_n=10.0, begins=("follow", "contact_on")),
        Step("slide", 6.4, _on_barrel(0.46, 35.0), force_n=14.0, angle_deg=35.0),
        Step("dwell", 7.1),
        Step("slide", 9.7, _on_barrel(0.48, -35.0), force_n=11.0, angle_deg=-35.0),
        Step("press", 10.3, force_n=8.0),
        Step("move", 12.1, (0.42, 0.0, 0.38), angle_deg=0.0, begins=("retract", "contact_off")),
        Step("dwell", 12.9),
    ),
    (replace(BARREL, friction=0.2),),
    whole_pose=True,
    turn_axis=(-1.0, 0.0, 0.0),
)


def _peel(start_s: float, y: float, force_n: float, *, begins: tuple[str, Event] | None = None) -> list[Step]:
    """One stroke of peeling, from the touch on: 14 cm towards the base."""
    return [
        Step("press", start_s + 0.35, force_n=0.7 * force_n, begins=begins),
        Step("slide", start_s + 1.65, (0.40, y, 0.150), force_n=force_n),
    ]


def _again(start_s: float, y: float) -> list[Step]:
    """Lift off, return, touch for the next stroke."""
    return [
        Step("move", start_s + 1.0, (0.50, y, 0.205), passing=True),
        Step("touch", start_s + 1.75, (0.54, y, 0.150)),
    ]


PEELING = Scenario(
    "peeling",
    "peel with five strokes, each in contact, lifting off in between",
    (0.44, 0.10, 0.34),
    (
        Step("dwell", 0.8),
        Step("touch", 2.4, (0.54, -0.04, 0.150)),
        *_peel(2.4, -0.04, 12.0, begins=("peel", "contact_on")),
        *_again(4.05, -0.02),
        *_peel(5.8, -0.02, 14.0),
        *_again(7.45, 0.0),
        *_peel(9.2, 0.0, 13.0),
        *_again(10.85, 0.02),
        *_peel(12.6, 0.02, 15.0),
        *_again(14.25, 0.04),
        *_peel(16.0, 0.04, 12.0),
        Step("move", 19.3, (0.43, 0.08, 0.33), begins=("retract", "contact_off")),
        Step("dwell", 20.1),
    ),
    (Surface(tips(0.150), friction=0.25),),
    whole_pose=True,
)

BASIC: Mapping[str, Scenario] = MappingProxyType(
    {s.name: s for s in (THREE_POINT, PARKOUR, PICK_AND_PLACE, DISPENSER, WIPING, BUTTON, TRACING, CURVES)}
)
SKILLS: Mapping[str, Scenario] = MappingProxyType(
    {s.name: s for s in (SCREWING, PEG, POURING, CIRCLE, CONTOUR, PEELING)}
)
SCENARIOS: Mapping[str, Scenario] = MappingProxyType({**BASIC, **SKILLS})
