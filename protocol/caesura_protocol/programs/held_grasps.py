"""Grasps of an object that is held already: the fingers squeeze it, or ease their grip on it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from caesura_protocol.messages import App

SAME_WIDTH_M = 0.003  # by which the openings around one object may differ


class HeldGrasps(NamedTuple):
    """The first and the last grasp of an object that is held, as indices of apps."""

    first: int
    last: int


def held_grasps(apps: Sequence[App]) -> Iterator[HeldGrasps | None]:
    """Yield the grasps of what is held before each app, and after the last; None where nothing is held."""
    held: HeldGrasps | None = None
    yield held
    for index, app in enumerate(apps):
        if app.kind == "grasp":
            held = HeldGrasps(index if held is None else held.first, index)
        elif app.kind == "gripper_move":
            held = None
        yield held


def is_regrip(app: App, first: App, last: App) -> bool:
    """Return whether a grasp changes the grip on what is held; first, last: the grasps that hold it.

    The fingers open no wider than they were around the object.
    """
    width, widest, now = (one.gripper_width or 0.0 for one in (app, first, last))
    return abs(width - now) > SAME_WIDTH_M and width <= widest + SAME_WIDTH_M


def eased_grasps(apps: Sequence[App]) -> frozenset[int]:
    """Return the indices of the grasps that open the fingers around what is held."""
    held = zip(apps, held_grasps(apps), strict=False)
    return frozenset(
        index
        for index, (app, grasps) in enumerate(held)
        if app.kind == "grasp" and grasps is not None and eases(app, apps[grasps.last])
    )


def eases(app: App, grasped: App) -> bool:
    """Return whether a grasp opens the fingers that hold what an earlier app grasped."""
    return (app.gripper_width or 0.0) > (grasped.gripper_width or 0.0) + SAME_WIDTH_M
