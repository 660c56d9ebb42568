"""Safety limits of a program, shared by check, simulation and exported scripts."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, NamedTuple, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from caesura_protocol.errors import CaesuraError
from caesura_protocol.messages import Vector
from caesura_protocol.up_direction import up_text
from caesura_protocol.validation_words import first_finding

PLANNED_SHARE = 0.9  # of a limit of speed or turn that a movement may reach
STOP_SHARE = 0.95  # of a limit of speed or force, from which on the robot is stopped


class Safety(BaseModel):
    """Limits of speed, force and position.

    Speeds are the flange's; forces are exerted or measured by the robot. Each field has bounds that all
    supported arms satisfy, so that a number in millimetres is rejected.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    speed_m_per_s: Annotated[float, Field(gt=0.0, le=5.0)] = 0.6  # never faster
    contact_speed_m_per_s: Annotated[float, Field(gt=0.0, le=0.25)] = 0.03  # where contacts are looked for
    turn_rad_per_s: Annotated[float, Field(gt=0.0, le=10.0)] = (
        2.5  # of the flange: a Panda's own limit (libfranka, Cartesian rotation)
    )
    force_n: Annotated[float, Field(gt=0.0)] | None = (
        None  # the cell's limit of what a program may ask for; None: it has none
    )
    felt_force_n: Annotated[float, Field(gt=0.0, le=1000.0)] = 30.0  # of anything, before the robot stops
    contact_n: Annotated[float, Field(gt=0.0, le=100.0)] = 4.0  # from which a contact is one
    search_m: Annotated[float, Field(gt=0.0, le=0.5)] = 0.04  # of contacts, and beyond a way
    load_kg: Annotated[float, Field(ge=0.0, le=1000.0)] = 3.0  # what the Panda carries
    grasp_force_n: Annotated[float, Field(gt=0.0)] = 20.0
    gripper_m_per_s: Annotated[float, Field(gt=0.0)] = 0.05
    gripper_width_m: Annotated[float, Field(ge=0.0, le=1.0)] = 0.08
    workspace_low: Vector = (-0.75, -0.75, -0.05)  # [m] of the flange
    workspace_high: Vector = (0.75, 0.75, 0.9)
    duration_s: Annotated[float, Field(gt=0.0)] = 60.0  # of an app
    pause_s: Annotated[float, Field(ge=0.0)] = 10.0  # between two apps; a longer one is shortened
    least_confidence: Annotated[float, Field(ge=0.0, le=1.0)] = 0.5  # below it an app is named

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        """Check that the box has a volume, and that the contact force is below the stop force."""
        for axis, low, high in zip("xyz", self.workspace_low, self.workspace_high, strict=True):
            if low >= high:
                raise ValueError(f"workspace_low is above workspace_high in {axis}: {low:g} and {high:g} m")
        if self.contact_n >= self.felt_force_n:
            stops = f"felt_force_n, at which the robot stops, is {self.felt_force_n:g} N"
            raise ValueError(f"contact_n is {self.contact_n:g} N, expected less: {stops}")
        return self

    @property
    def most_felt_n(self) -> float:
        """The greatest force [N] that a robot presses without being stopped."""
        return STOP_SHARE * self.felt_force_n

    @property
    def most_force_n(self) -> float:
        """The greatest force [N] of a run: at most the cell's limit, and below the robot's stop."""
        return self.most_felt_n if self.force_n is None else min(self.force_n, self.most_felt_n)

    def slower(self, speed_m_per_s: float, turn_rad_per_s: float) -> float:
        """Return the factor of time, 1 or more, with which a movement of these peaks keeps the limits."""
        fastest = max(speed_m_per_s / self.speed_m_per_s, turn_rad_per_s / self.turn_rad_per_s)
        return max(1.0, fastest / PLANNED_SHARE)


DEFAULT = Safety()


class CellSettings(NamedTuple):
    """Requirements of a cell on the programs taught in it; None: none, or the service's own choice.

    force_limit_n: [N] of every app; path_tolerance_m, path_tolerance_rad: of the paths [m], [rad]; robot:
    name of the cell's arm; up: away from gravity, of length 1, in the arm's base frame.
    """

    force_limit_n: float | None = None
    path_tolerance_m: float | None = None
    path_tolerance_rad: float | None = None
    robot: str | None = None
    up: Vector | None = None

    @property
    def stated_texts(self) -> dict[str, str]:
        """The stated settings by name, in the form of files."""
        stated = {key: value for key, value in self._asdict().items() if value is not None}
        return {key: up_text(value) if key == "up" else str(value) for key, value in stated.items()}

    def completed_by(self, other: CellSettings) -> CellSettings:
        """Return this setting, completed by another where it states nothing."""
        return other._replace(**{name: own for name, own in self._asdict().items() if own is not None})


UNSET = CellSettings()


def read_safety(path: Path) -> Safety:
    """Read the limits of a cell: a JSON object with those that differ from the default.

    Raises CaesuraError.
    """
    try:
        return Safety.model_validate_json(path.read_bytes())
    except OSError as error:
        raise CaesuraError(f"cannot read {path}: {error.strerror}") from error
    except ValidationError as error:
        raise CaesuraError(f"{path}: {first_finding(error, Safety.model_fields)}") from error
