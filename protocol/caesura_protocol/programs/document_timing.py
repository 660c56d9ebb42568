"""Timing of a program, as its document states it."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from caesura_protocol.messages import LEAST_SPEED, MOST_SPEED

AppNumber = Annotated[int, Field(ge=0)]
Speed = Annotated[float, Field(gt=0.0)] | Literal["optimal"]
RunSpeed = Literal["taught", "optimal"]


class ShorterPause(BaseModel):
    """A taught pause between two apps that a re-timed program shortens or leaves out."""

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)

    app: AppNumber  # that follows it
    taught_s: float  # [s] as it was taught
    seconds: float  # [s] as it is timed


class ProgramTiming(BaseModel):
    """Timing of a program; without it the times are as taught. Apps are counted from 0.

    speed: a factor of the taught speed, or `optimal`: as fast as the limits of the robot allow.
    """

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)

    speed: Speed
    retimed: tuple[AppNumber, ...] = ()  # apps whose durations changed
    keeps_pause: tuple[AppNumber, ...] = ()  # apps before which the taught pause is kept
    shorter_pauses: tuple[ShorterPause, ...] = ()  # in time order
    taught_s: float = 0.0  # [s] the whole program as it was taught
    seconds: float = 0.0  # [s] the whole program as it is timed

    @property
    def is_sane(self) -> bool:
        """Whether the factor is within its valid range."""
        return self.speed == "optimal" or LEAST_SPEED <= float(self.speed) <= MOST_SPEED
