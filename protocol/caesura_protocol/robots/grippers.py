"""Grippers as data: their opening, force and speed, and the signal of a held object.

The shipped grippers are in the table `grippers.json`. A robot refers to one by its name, or defines its own
as an object with the same fields (docs/robots.md, Grippers).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from caesura_protocol.errors import CaesuraError

TABLE = Path(__file__).with_name("grippers.json")
Interface = Literal["franka", "robotiq", "xarm", "digital_output"]  # by which a script drives it
Event = Literal["width", "object", "vacuum", "none"]
NEEDED: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "fingers": ("opening_m", "force_n"),
        "robotiq": ("opening_m", "force_n", "speed_m_per_s", "counts"),
        "digital_output": ("output",),
    }
)  # fields of a kind, and of an interface

Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=0, le=0xFFFF)]


class GripperError(CaesuraError, ValueError):
    """A gripper is unknown, or its description cannot be used."""


class GripperDescription(BaseModel):
    """A gripper. Numbers that do not apply, as to a suction cup, are None."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    title: str
    kind: Literal["fingers", "suction"] = "fingers"
    interface: Interface | None = None  # None: no script drives it
    opening_m: Positive | None = None  # between the fingers, at most
    least_force_n: NotNegative = 0.0
    force_n: Positive | None = None  # that it grasps with, at most
    least_speed_m_per_s: NotNegative = 0.0
    speed_m_per_s: Positive | None = None  # of both fingers together, at most
    counts: tuple[Count, Count] | None = None  # of the interface: open, shut
    output: Annotated[int, Field(ge=0, le=7)] | None = None  # digital output that switches it
    event: Event = "width"  # what shows that something is held
    sources: dict[str, str] = {}

    @model_validator(mode="after")
    def _complete(self) -> Self:
        needed = (*NEEDED.get(self.kind, ()), *NEEDED.get(self.interface or "", ()))
        if missing := [name for name in needed if getattr(self, name) is None]:
            by = f" with interface {self.interface}" if self.interface else ""
            raise ValueError(f"a gripper of kind {self.kind}{by} needs {', '.join(missing)}")
        if self.counts is not None and self.counts[0] == self.counts[1]:
            raise ValueError(f"counts are {self.counts}, expected two that differ")
        for name, least, most in (
            ("force_n", self.least_force_n, self.force_n),
            ("speed_m_per_s", self.least_speed_m_per_s, self.speed_m_per_s),
        ):
            if most is not None and least > most:
                raise ValueError(f"{name} is {most}, expected at least least_{name}, which is {least}")
        return self

    def count(self, width_m: float) -> int:
        """Return the count of a width, linear between open and closed."""
        (opened, shut), opening_m = self._calibration()
        share = min(max(width_m / opening_m, 0.0), 1.0)
        return round(shut + share * (opened - shut))

    def width_m(self, count: int) -> float:
        """Return the width [m] of a count, linear; within 0 and the opening."""
        (opened, shut), opening_m = self._calibration()
        share = (count - shut) / (opened - shut)
        return min(max(share, 0.0), 1.0) * opening_m

    def _calibration(self) -> tuple[tuple[int, int], float]:
        """Return the counts open and shut, and the opening [m]. Raises GripperError if one is not stated."""
        if self.counts is None or self.opening_m is None:
            raise GripperError(f"{self.title} has no counts, expected counts and opening_m")
        return self.counts, self.opening_m

    def register_counts(self, speed_m_per_s: float, force_n: float) -> tuple[int, int]:
        """Return speed and force as counts of Robotiq's registers: 0 for its least, 255 for its most."""
        force, speed = self.clamped(force_n, speed_m_per_s)
        return (
            _share_of_255(speed, self.least_speed_m_per_s, self.speed_m_per_s or speed),
            _share_of_255(force, self.least_force_n, self.force_n or force),
        )

    def clamped(self, force_n: float, speed_m_per_s: float) -> tuple[float, float]:
        """Return a force [N] and a speed [m/s] limited to the gripper's range."""
        force = max(force_n, self.least_force_n)
        speed = max(speed_m_per_s, self.least_speed_m_per_s)
        return min(force, self.force_n or force), min(speed, self.speed_m_per_s or speed)


def _share_of_255(value: float, least: float, most: float) -> int:
    return round(255 * (value - least) / (most - least)) if most > least else 255


@cache
def grippers() -> Mapping[str, GripperDescription]:
    """Return the shipped grippers by name."""
    table = json.loads(TABLE.read_text("utf-8"))
    return MappingProxyType({name: GripperDescription.model_validate(one) for name, one in table.items()})


def gripper(name: str) -> GripperDescription:
    """Return a gripper by its name. Raises GripperError, which lists the known ones."""
    if (found := grippers().get(name)) is None:
        raise GripperError(f"gripper {name!r} is not known, expected one of {', '.join(grippers())}")
    return found
