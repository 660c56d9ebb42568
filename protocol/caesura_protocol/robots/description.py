"""Robots as data: their URDF, their limits, and the place where they measure the wrench.

A robot is a folder with a `robot.json` and a URDF without meshes. `docs/robots.md` has the fields.
"""

from __future__ import annotations

import json
import logging
import math
import os
from functools import cache, cached_property
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Annotated, Literal, Self
from xml.etree import ElementTree

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from caesura_protocol.errors import CaesuraError
from caesura_protocol.messages import JOINTS_MOST, Name, WrenchSource
from caesura_protocol.robots.grippers import GripperDescription
from caesura_protocol.robots.grippers import gripper as named_gripper
from caesura_protocol.validation_words import first_finding

ENTRY_POINTS = "caesura.robots"  # name → a function without arguments that returns the path of a robot.json
SHIPPED = Path(__file__).parent
FILE = "robot.json"
FOLDER = "CAESURA_ROBOTS"  # environment variable: a folder of robots, one folder each
MAX_FILE_BYTES = 1 << 18  # of a description and of a URDF; those that ship have 7 kB at most

logger = logging.getLogger(__name__)

Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
Number = Annotated[float, Field(allow_inf_nan=False)]
Frame = Annotated[str, Field(min_length=1, max_length=128)]
Listed = Annotated[tuple[Positive, ...], Field(min_length=1, max_length=JOINTS_MOST)]


class RobotError(CaesuraError, ValueError):
    """A robot is unknown, or its description cannot be used."""


def _named_gripper(value: object) -> object:
    """Return the listed gripper of this name; any other value unchanged."""
    return named_gripper(value) if isinstance(value, str) else value


class RobotDescription(BaseModel):
    """A robot arm as data. Positions, speeds and torques of the joints have their limits in the URDF."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: Name
    title: str  # as its maker calls it
    urdf: str  # file name, beside the description
    joints: Annotated[tuple[Frame, ...], Field(min_length=1, max_length=JOINTS_MOST)]  # base to flange
    flange: Frame  # link of the URDF
    tool: Frame | None = None  # link between the fingertips; None: there is no hand in the URDF
    acceleration_limits: Listed  # [rad/s²]
    jerk_limits: Listed  # [rad/s³]
    flange_acceleration_limit: Positive  # [m/s²]
    flange_jerk_limit: Positive  # [m/s³]
    friction_nm: Listed  # [Nm] Coulomb friction of the joints
    motor_inertia: Annotated[tuple[Number, ...], Field(max_length=JOINTS_MOST)] = ()  # [kg m²] at the joints
    postures: Annotated[tuple[tuple[Number, ...], ...], Field(min_length=1)]  # [rad] starts of the IK
    reach_m: Positive  # of the flange from the shoulder
    payload_kg: Positive
    wrench_source: WrenchSource  # what its source usually reads of a wrench, without accessories
    wrench_is_relative: bool = False  # its zero is that of the last zeroing, and drifts: zero it before use
    gripper: Annotated[GripperDescription | None, BeforeValidator(_named_gripper)] = None
    task_offset_m: tuple[Number, Number, Number] = (0.0, 0.0, 0.0)  # by which simulated tasks stand elsewhere
    script: Literal["franky", "urscript", "xarm"] | None = None  # that `caesura program` writes for it
    sources: dict[str, str] = {}  # where the figures come from
    folder: Path = Path()  # set by the reader, not by the file

    @model_validator(mode="after")
    def _same_length(self) -> Self:
        count = len(self.joints)
        listed = {
            "acceleration_limits": len(self.acceleration_limits),
            "jerk_limits": len(self.jerk_limits),
            "friction_nm": len(self.friction_nm),
            "motor_inertia": len(self.motor_inertia) or count,
            **{f"postures[{i}]": len(posture) for i, posture in enumerate(self.postures)},
        }
        for field, length in listed.items():
            if length != count:
                raise ValueError(f"{field} has {length} numbers, expected one for each of {count} joints")
        if not all(inertia >= 0.0 and math.isfinite(inertia) for inertia in self.motor_inertia):
            raise ValueError(f"motor_inertia is {list(self.motor_inertia)}, expected numbers of at least 0")
        return self

    @property
    def urdf_path(self) -> Path:
        """The path of the URDF."""
        return self.folder / self.urdf

    @cached_property
    def most_turn_rad(self) -> float:
        """The furthest [rad] that a joint may turn from zero, by the URDF; 0 if that cannot be read."""
        try:
            limits = ElementTree.parse(self.urdf_path).findall("joint/limit")
            return max(abs(float(one.get(end, "0"))) for one in limits for end in ("lower", "upper"))
        except (ElementTree.ParseError, OSError, ValueError):
            return 0.0


@cache
def robot_description(name: str) -> RobotDescription:
    """Return the description of a robot by its name, or by the path of a `robot.json` or its folder.

    A robot that was read from a path can be found by its name from then on. Names are those of `robot_names`.
    Raises RobotError for an unknown name, an unusable file, and a `CAESURA_ROBOTS` without robots.
    """
    known = _known()
    if (found := known.get(name)) is not None:
        path = _path_of(found)
        description = _read(path)
        if description.name != name:
            raise RobotError(f"{path}: name is {description.name!r}, expected {name!r}, as its folder")
        return description
    path = Path(name)
    if path.suffix == ".json" or len(path.parts) > 1 or (path / FILE).is_file():
        path = path / FILE if path.is_dir() else path
        description = _read(path)
        other = _path_of(known.setdefault(description.name, path))
        if other.resolve() != path.resolve():
            raise RobotError(f"{path}: name is {description.name!r}, which the robot in {other} has")
        return description
    _check_folder()
    # A service's refusal has room for 200 characters.
    own = f"the path of a {FILE} as --robot, or a folder {FOLDER}, for a live session at the service too"
    raise RobotError(f"robot {name!r} is not known, expected one of {', '.join(known)}; {own}")


def robot_names() -> tuple[str, ...]:
    """Return the names of the robots of this package, of others, and of the folder `CAESURA_ROBOTS`.

    Raises RobotError for a `CAESURA_ROBOTS` without robots, or with the name of another robot.
    """
    _check_folder()
    return tuple(_known())


def _check_folder() -> None:
    """Raise RobotError if `CAESURA_ROBOTS` has no robot, or a name that is in use."""
    if not (folder := os.environ.get(FOLDER)):
        return
    own = {path.parent.name: path for path in sorted(Path(folder).glob(f"*/{FILE}"))}
    if not own:
        raise RobotError(f"{FOLDER} is {folder!r}, expected a folder that holds robots: NAME/{FILE}")
    if taken := [path for name, path in own.items() if _known()[name] != path]:
        raise RobotError(f"{taken[0]}: the name {taken[0].parent.name!r} is taken, expected another folder")


@cache
def _known() -> dict[str, Path | EntryPoint]:
    """Return the source of each robot's description, by name of the robot.

    If several have one name, the shipped one counts; the others are logged.
    """
    known: dict[str, Path | EntryPoint] = {}
    folder = os.environ.get(FOLDER)
    own = [] if not folder else sorted(Path(folder).glob(f"*/{FILE}"))
    if folder and not Path(folder).is_dir():
        logger.warning("%s is %s, which is no folder: it adds no robots", FOLDER, folder)
    for path in sorted(SHIPPED.glob(f"*/{FILE}")):
        known[path.parent.name] = path
    for point in entry_points(group=ENTRY_POINTS):
        _add(known, point.name, point)
    for path in own:
        _add(known, path.parent.name, path)
    return known


def _add(known: dict[str, Path | EntryPoint], name: str, place: Path | EntryPoint) -> None:
    if name in known:
        logger.warning("robot %r of %s is left out: another robot has its name; rename it", name, place)
    known.setdefault(name, place)


def _path_of(found: Path | EntryPoint) -> Path:
    """Return the path of a description; an entry point's package is imported at its first use.

    Raises RobotError if that fails.
    """
    if isinstance(found, Path):
        return found
    try:
        return Path(found.load()())
    except Exception as error:
        why = f"{type(error).__name__}: {error}"
        raise RobotError(f"robot {found.name!r}: entry point {found.value} fails: {why}") from error


def _read(path: Path) -> RobotDescription:
    try:
        _check_size(path)
        content = json.loads(path.read_text("utf-8"))
        description = RobotDescription.model_validate(content)
    except RobotError:
        raise
    except RecursionError as error:
        raise RobotError(f"{path}: no description: nested too deeply") from error
    except OSError as error:
        raise RobotError(f"{path}: cannot be read: {error.strerror}") from error
    except ValidationError as error:
        raise RobotError(f"{path}: {_found(error)}") from error
    except ValueError as error:
        raise RobotError(f"{path}: no JSON: {error}") from error
    description = description.model_copy(update={"folder": path.parent.resolve()})
    if Path(description.urdf).name != description.urdf or not description.urdf_path.is_file():
        raise RobotError(f"{path}: urdf is {description.urdf!r}, which is no file beside it")
    _check_size(description.urdf_path)
    return description


def _found(error: ValidationError) -> str:
    """Return text on the errors of a description: all missing fields, or else the first invalid one."""
    errors = error.errors()
    if missing := [str(one["loc"][0]) for one in errors if one["type"] == "missing" and len(one["loc"]) == 1]:
        return f"has no {', '.join(missing)}; docs/robots.md, A new arm, has every field with its unit"
    if not errors[0]["loc"]:  # fields that do not fit each other, which the text names
        return errors[0]["msg"].removeprefix("Value error, ")
    return first_finding(error, RobotDescription.model_fields)


def _check_size(path: Path) -> None:
    """Raise RobotError for a file too large to be read at each opening of a session."""
    if (size := path.stat().st_size) > MAX_FILE_BYTES:
        raise RobotError(f"{path}: has {size} bytes, expected at most {MAX_FILE_BYTES}")
