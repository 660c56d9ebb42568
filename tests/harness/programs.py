"""Task programs for tests: a pick and place and a press, as the simulated teacher gives them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from caesura_protocol.app_kinds import AppKind
from caesura_protocol.messages import App, AppPath, Quaternion, RestForce, Vector, ViaPoint
from caesura_protocol.programs.document import ProgramFile, document_of_apps

DOWN = (-0.70710678, 0.70710678, 0.0, 0.0)  # fingers down, the hand turned to -y


def app(kind: AppKind, t0: float, tn: float, target: Vector | None = None, **fields: Any) -> App:
    made: dict[str, Any] = {
        "kind": kind,
        "t0": t0,
        "tn": tn,
        "target": target,
        "orientation": None if target is None else DOWN,
        "joints": None,
        "force": None,
        "force_taught": None,
        "load_kg": None,
        "load_sd_kg": None,
        "gripper_width": None,
        "confidence": 0.95,
        "segments": (),
    }
    return App.model_validate(made | fields)


def path_from(
    start: Vector,
    t0: float,
    tn: float,
    length_m: float,
    orientation: Quaternion = DOWN,
    via: tuple[ViaPoint, ...] = (),
) -> AppPath:
    """The path of an app that was followed without a deviation."""
    return AppPath(
        start=ViaPoint(t=t0, position=start, orientation=orientation),
        via=via,
        tn=tn,
        length_m=length_m,
        deviation_m=0.0,
        deviation_rad=0.0,
        tolerance_m=0.002,
        tolerance_rad=0.02,
    )


def move(t0: float, start: Vector, target: Vector, orientation: Quaternion = DOWN, **fields: Any) -> App:
    """A straight movement of one second, with its path."""
    path = path_from(start, t0, t0 + 1.0, math.dist(start, target), orientation)
    stated = {"path": path, "orientation": orientation} | fields
    return app("cartesian_motion", t0, t0 + 1.0, target, **stated)


def set_down_at(let_go: App) -> App:
    """An app of fingers that let go of what stands on something, as it was felt."""
    return let_go.model_copy(update={"force_taught": (0.0, 0.0, -2.0)})


def pick_and_place() -> tuple[App, ...]:
    """In the cell of the scenario `pick_and_place`."""
    return (
        app("move_to_contact", 0.2, 1.8, (-0.014, -0.673, 0.107)),
        app("grasp", 1.8, 3.5, (-0.014, -0.673, 0.107), gripper_width=0.05),
        app("transport", 4.0, 5.7, (-0.018, -0.624, 0.156), load_kg=0.25, load_sd_kg=0.01),
        app("transport", 5.7, 7.5, (-0.021, -0.475, 0.107), load_kg=0.25, load_sd_kg=0.01),
        app(
            "gripper_move",
            7.5,
            9.8,
            (-0.021, -0.475, 0.107),
            gripper_width=0.08,
            force_taught=(0.0, 0.0, -2.0),
        ),
        app("cartesian_motion", 10.1, 12.0, (-0.021, -0.562, 0.29)),
    )


def squeezed() -> tuple[App, ...]:
    """What is grasped at 50 mm is squeezed to 30 mm on its way, and the grip is eased again."""
    reach, grasp, lift, carry, *rest = pick_and_place()
    taken = grasp.model_copy(update={"target": lift.target, "t0": lift.tn, "tn": lift.tn})
    grips = (taken.model_copy(update={"gripper_width": width}) for width in (0.03, grasp.gripper_width))
    return (reach, grasp, lift, *grips, carry, *rest)


def press() -> tuple[App, ...]:
    """In the cell of the scenario `dispenser`."""
    return (
        app("move_to_contact", 0.8, 2.6, (-0.02, -0.52, 0.19)),
        app("apply_force", 2.6, 4.2, (-0.02, -0.52, 0.165), force=(0.0, 0.0, -10.0)),
        app("cartesian_motion", 4.2, 5.7, (-0.02, -0.53, 0.29)),
    )


def set_down_at_once() -> tuple[App, ...]:
    """`pick_and_place`, whose carry is one movement: from the table over 50 mm in the air to the table."""
    touch, grasp, lift, carry, let_go, leave = pick_and_place()
    start, over, end = touch.target, lift.target, carry.target
    assert start is not None
    assert over is not None
    assert end is not None
    via = ViaPoint(t=5.7, position=over, orientation=DOWN, velocity=(0.0, 0.0, 0.0))
    length = math.dist(start, over) + math.dist(over, end)
    carried = carry.model_copy(update={"t0": 4.0, "path": path_from(start, 4.0, 7.5, length, via=(via,))})
    return touch, grasp, carried, let_go, leave


def wiped() -> tuple[App, ...]:
    """A stroke along a surface: pressed for 0.8 s before it begins, and for 0.5 s when it has ended."""
    touch, pressed, _ = press()
    place = (-0.02, -0.52, 0.19)
    path = move(0.0, place, (0.08, -0.52, 0.19)).path
    assert path is not None
    start = path.start.model_copy(update={"t": pressed.t0 + 0.8})
    along = path.model_copy(update={"start": start, "tn": pressed.t0 + 1.8})
    update = {"path": along, "tn": pressed.t0 + 2.3, "target": (0.08, -0.52, 0.19)}
    return touch, pressed.model_copy(update=update)


def pressed_harder_before(newton: float = 12.0) -> tuple[App, ...]:
    """`wiped`, pressed harder before its way than along it, and softer after it."""
    touch, stroke = wiped()
    before, after = RestForce(newton=newton, newton_taught=18.0), RestForce(newton=5.0, newton_taught=5.0)
    return touch, stroke.model_copy(update={"rest_before": before, "rest_after": after})


def barrel_m(x: float, y: float) -> float:
    """The height of the barrel of `over_barrel` at x and y [m]."""
    return 0.19 - 0.2 * (1.0 - math.cos(math.asin(min(max((y + 0.52) / 0.2, -1.0), 1.0))))


def over_barrel(seconds: float = 4.0, radius_m: float = 0.2, half_degrees: int = 30) -> tuple[App, ...]:
    """A stroke over the top of a barrel along x: along y by twice an angle, the tool along its normal."""

    def at(angle: float, t: float) -> ViaPoint:
        half = -0.5 * angle  # about x, after DOWN
        x, y, z, w = DOWN
        sine, cosine = math.sin(half), math.cos(half)
        turned = (cosine * x + sine * w, cosine * y - sine * z, cosine * z + sine * y, cosine * w - sine * x)
        place = (0.0, -0.52 + radius_m * math.sin(angle), 0.19 - radius_m * (1.0 - math.cos(angle)))
        return ViaPoint(t=t, position=place, orientation=turned)

    touch, pressed, _ = press()
    start, *via, end = (
        at(math.radians(degrees), pressed.t0 + seconds * (degrees + half_degrees) / (2 * half_degrees))
        for degrees in range(-half_degrees, half_degrees + 1, 10)
    )
    path = path_from(
        start.position, start.t, end.t, radius_m * math.radians(2 * half_degrees), via=tuple(via)
    )
    path = path.model_copy(update={"start": start})
    reached = {"target": start.position, "orientation": start.orientation}
    stroke = {"path": path, "tn": end.t, "target": end.position, "orientation": end.orientation}
    return touch.model_copy(update=reached), pressed.model_copy(update=stroke)


def curved(speed: float = 0.1) -> tuple[App, ...]:
    """A press after a way around a corner."""
    touch, *rest = press()
    place, flat = (-0.03, -0.56, 0.3), (speed, 0.0, 0.0)
    path = AppPath(
        start=ViaPoint(t=0.8, position=(-0.03, -0.6, 0.33), orientation=DOWN),
        via=(
            ViaPoint(t=1.8, position=place, orientation=DOWN, velocity=flat),
            ViaPoint(t=2.5, position=(-0.02, -0.52, 0.195), orientation=DOWN, velocity=flat),
        ),
        tn=2.6, length_m=0.2, deviation_m=0.001, deviation_rad=0.0, tolerance_m=0.002, tolerance_rad=0.02,
    )  # fmt: skip
    return touch.model_copy(update={"path": path}), *rest


def slid(seconds: float, down_m: float = 0.0) -> tuple[App, ...]:
    """A stroke of 0.1 m in so many seconds, that leads down."""
    touch, stroke = wiped()
    path, target = stroke.path, (0.08, -0.52, 0.19 - down_m)
    assert path is not None
    path = path.model_copy(update={"tn": path.start.t + seconds})
    return touch, stroke.model_copy(update={"path": path, "tn": path.tn, "target": target})


def circle(seconds: float = 4.0, radius: float = 0.05, **fields: Any) -> App:
    """A way around a circle in a plane, turning by 90°."""
    angles = np.linspace(0.0, 2.0 * np.pi, 9)
    speed = 2.0 * np.pi * radius / seconds
    turned = (Rotation.from_rotvec([0, 0, a / 4]) * Rotation.from_quat(DOWN) for a in angles)
    points = [
        ViaPoint(
            t=1.0 + seconds * a / (2 * np.pi),
            position=(0.4 + radius * np.cos(a), radius * np.sin(a), 0.3),
            orientation=tuple(turn.as_quat().tolist()),
            velocity=(-speed * np.sin(a), speed * np.cos(a), 0.0),
        )
        for a, turn in zip(angles, turned, strict=True)
    ]
    path = AppPath(
        start=points[0].model_copy(update={"velocity": None}), via=tuple(points[1:-1]), tn=1.0 + seconds,
        length_m=2 * np.pi * radius, deviation_m=0.001, deviation_rad=0.0,
        tolerance_m=0.002, tolerance_rad=0.02,
    )  # fmt: skip
    made = app("cartesian_motion", 1.0, 1.0 + seconds, points[-1].position, path=path, **fields)
    return made.model_copy(update={"orientation": points[-1].orientation})


def as_file(apps: tuple[App, ...], name: str = "example") -> ProgramFile:
    return document_of_apps(apps, name)
