"""A task program as a file: the data for a robot to run it, and for an engineer to review it.

`version` is that of the format; `revision` is that of the program. The file states its units. The output of
`caesura program --json` and `caesura segment --json` can be read as well.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import repeat
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from caesura_protocol.app_force_limit import with_force_limit
from caesura_protocol.app_kinds import APP_KINDS, Precondition, app_name, name_of_app
from caesura_protocol.errors import CaesuraError
from caesura_protocol.messages import MAX_GAPS, App, Gap, Name, Phase, Program, TaskName, Up, WrenchReport
from caesura_protocol.programs.app_time_shifts import edited_times
from caesura_protocol.programs.apps_by_phase import Group, edited_group_notes, groups_of
from caesura_protocol.programs.default_safety import re_targeted, safety_for
from caesura_protocol.programs.document_timing import ProgramTiming
from caesura_protocol.programs.held_grasps import held_grasps
from caesura_protocol.programs.safety import DEFAULT, Safety
from caesura_protocol.robots import robot_description
from caesura_protocol.validation_words import Place, dotted, first_finding

FORMAT: Literal["caesura.program"] = "caesura.program"
VERSION: Literal[2] = 2

REMEDY = "--retarget keeps its poses and leaves out its joints"

UNITS: Mapping[str, str] = MappingProxyType(
    {
        "target": "m, flange in the base frame",
        "orientation": "quaternion x y z w, flange in the base frame",
        "joints": "rad",
        "path": "as target and orientation; its times are those of the demonstration",
        "screw": "axis and a point of it (m) in the base frame, rad, m in one turn, Nm that the robot exerts",
        "force": "N that the robot exerts, base frame",
        "load": "kg",
        "gripper_width": "m between the fingers",
        "time": "s of the demonstration",
    }
)


UNITS_EDITED: Mapping[str, str] = MappingProxyType(
    {
        **UNITS,
        "path": "as target and orientation; its times are those of the edited program",
        "time": "s of the program as it is edited: apps one after the other",
    }
)


class BadProgramError(CaesuraError, ValueError):
    """The file is not a task program; the message states the file, the place and the expected content."""


class ProgramStep(App):
    """An app, with the conditions that must hold before it is run."""

    preconditions: tuple[Precondition, ...] = ()
    follows: bool = True  # the app before it, as when they were taught; False where an edit put it there


class ProgramFile(BaseModel):
    """The document. Readers ignore unknown fields; version 1 has neither paths nor gaps."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    format: Literal["caesura.program"] = FORMAT
    version: Literal[1, 2] = VERSION
    units: dict[str, str] = Field(default_factory=lambda: dict(UNITS))
    station: Name
    session: Name
    instance: Name
    epoch: int = 0
    revision: int = 0  # version of the program: it rises with every change
    t: float = 0.0  # [s] up to which the demonstration was seen
    complete: bool = True
    safety: Safety = DEFAULT
    apps: tuple[ProgramStep, ...]
    notes: tuple[str, ...] = ()
    gaps: Annotated[tuple[Gap, ...], Field(max_length=MAX_GAPS)] = ()  # the newest ones
    wrench: WrenchReport | None = None
    groups: tuple[Group, ...] = ()  # the apps of each phase
    name: TaskName | None = None  # that a person gave it
    edits: int = 0  # how many edits the program has had; undo and redo count
    timing: ProgramTiming | None = None  # None: as it was taught
    robot: Name | None = None  # on which it was taught; None: not stated
    up: Up | None = None  # away from gravity, base frame, as it was taught; None: not stated, z is assumed
    gripper: Name | None = None  # that runs it, of the table of grippers; None: the robot's

    def as_json(self) -> str:
        """Return the file's text. Raises ValueError for a number that is not finite, which JSON lacks."""
        content = self.model_dump(mode="python")
        for place, value in _not_finite(content):
            raise ValueError(f"{_place_in(content, place)} is {value}, expected a finite number")
        return json.dumps(content, indent=2, allow_nan=False) + "\n"


def document(program: Program, safety: Safety | None = None, phases: Sequence[Phase] = ()) -> ProgramFile:
    """Return a program message as a document; the cell's force limit is that of the program, if it has one.

    safety: limits of the cell, by default those of the program's robot; phases: those of its session, by
    which its apps are grouped.
    """
    times = edited_times(program.apps, program.gaps, program.edits)
    apps = _steps(program.apps) if times is None else _steps(times.apps, times.follows)
    safety = safety_for(program.robot) if safety is None else safety
    if program.force_limit_n is not None:
        safety = safety.model_copy(update={"force_n": program.force_limit_n})
    return ProgramFile(
        station=program.station,
        session=program.session,
        instance=program.instance,
        epoch=program.epoch,
        revision=program.version,
        t=program.t,
        complete=program.complete,
        safety=safety,
        units=dict(UNITS if times is None else UNITS_EDITED),
        apps=apps,
        notes=(*program.notes, *edited_group_notes(program.apps, phases, program.edits)),
        gaps=program.gaps if times is None else times.gaps,
        name=program.name,
        edits=program.edit_revision,
        wrench=program.wrench,
        groups=groups_of(program.apps, phases, program.edits),
        robot=program.robot,
        up=program.up,
    )


def document_of_apps(apps: tuple[App, ...], name: str, safety: Safety = DEFAULT) -> ProgramFile:
    """Return the program of a recording without a station; the name is converted to a valid session name."""
    name = re.sub(r"[^a-z0-9_-]+", "-", name.lower()).strip("-_")[:64] or "recording"
    t = max((app.tn for app in apps), default=0.0)
    return ProgramFile(station="file", session=name, instance="file", t=t, safety=safety, apps=_steps(apps))


def in_cell(program: ProgramFile, safety: Safety) -> ProgramFile:
    """Return the program in another cell: no app exerts more than the cell's limit."""
    most = safety.force_n
    steps = program.apps if most is None else tuple(with_force_limit(app, most) for app in program.apps)
    return program.model_copy(update={"safety": safety, "apps": steps})


def on_robot(program: ProgramFile, robot: str | None, *, retarget: bool = False) -> ProgramFile:
    """Return the program on a robot, by its name or file; None: on the one that it states.

    Raises CaesuraError for another robot than the taught one, unless `retarget` is set: joints are then left
    out, and poses are kept. Raises it, too, if the joints of an app that is not re-targeted have another
    number than the robot's.
    """
    if robot is None:
        return program
    arm = robot_description(robot)
    name, taught_on = arm.name, program.robot or "a robot that was not stated"
    placed = {"robot": name, "safety": re_targeted(program.safety, program.robot, name)}
    if program.robot == name or (program.robot is None and not retarget):
        if wrong := joint_count_mismatch(program, name, len(arm.joints)):
            raise CaesuraError(wrong)
        return program.model_copy(update=placed)
    if not retarget:
        raise CaesuraError(f"the program was taught on {program.robot}, not on {name}: {REMEDY}")
    steps = tuple(app.model_copy(update={"joints": None}) for app in program.apps)
    note = (
        f"Taught on {taught_on}, re-targeted to {name}: its poses stay, its joints are left out. "
        "Poses are those of the flange: the tool needs the length and the orientation of the taught one."
    )
    return program.model_copy(update={**placed, "apps": steps, "notes": (*program.notes, note)})


def joint_count_mismatch(program: ProgramFile, arm: str, count: int) -> str | None:
    """Return why a program is not for an arm with so many joints, by its first such app; None: it may be."""
    for index, app in enumerate(program.apps):
        if app.joints is not None and len(app.joints) != count:
            taught = f"{name_of_app(index, app)} was taught with {len(app.joints)} joints"
            return f"{taught}, and {arm} has {count}: {REMEDY}"
    return None


def read_document(path: Path) -> ProgramFile:
    """Read a program. Raises BadProgramError."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BadProgramError(f"{path}: cannot be read: {error.strerror}") from error
    except json.JSONDecodeError as error:
        place = f"line {error.lineno}, column {error.colno}"
        raise BadProgramError(
            f"{path}: {place}: no JSON, expected a program as a JSON object. Of a recording, caesura segment "
            "FILE --json OUT writes one"
        ) from error
    except ValueError as error:
        raise BadProgramError(
            f"{path}: no text in UTF-8, expected a program as a JSON object. Of a recording, caesura segment "
            "FILE --json OUT writes one"
        ) from error
    except RecursionError as error:
        raise BadProgramError(f"{path}: nested too deeply, expected a program as a JSON object") from error
    if not isinstance(content, dict):
        raise BadProgramError(f"{path}: holds a {type(content).__name__}, expected an object")
    version = content.get("version")
    if content.get("format") == FORMAT and isinstance(version, int) and version > VERSION:
        raise BadProgramError(
            f"{path}: version is {version}, expected at most {VERSION}: a newer Caesura wrote it. Install "
            "that one here, or write the program again with this one"
        )
    try:
        return _parsed(content, path.stem)
    except ValidationError as error:
        found = first_finding(error, named=partial(_place_in, content))
        raise BadProgramError(f"{path}: {found}") from error


def _parsed(content: dict[str, Any], name: str) -> ProgramFile:
    if "format" in content:
        return ProgramFile.model_validate(content)
    if isinstance(content.get("program"), list):  # what `caesura segment --json` writes
        apps = [App.model_validate(app) for app in content["program"]]
        phases = [Phase.model_validate(phase) for phase in content.get("phases", ())]
        safety = Safety(force_n=content.get("force_limit_n"))
        taught: dict[str, Any] = {
            key: content[key] for key in ("gaps", "wrench", "robot", "up") if key in content
        }
        taught["notes"] = _with_warnings(content.get("notes", []), content.get("warnings"))
        written = document_of_apps(tuple(apps), name, safety)
        groups = {"groups": [group.model_dump() for group in groups_of(apps, phases)]}
        program = ProgramFile.model_validate(written.model_dump() | taught | groups)
        limits = re_targeted(program.safety, None, program.robot)
        return program.model_copy(update={"safety": limits})
    return document(Program.model_validate(content))


def _with_warnings(notes: Any, warnings: Any) -> Any:
    """Return the notes with warnings of the recording's reader; notes that are no list are unchanged."""
    if not isinstance(notes, list) or not isinstance(warnings, list):
        return notes
    said = [one.removeprefix("Warning: ") for one in warnings if isinstance(one, str)]
    return [*notes, *(one for one in said if one not in notes)]


def _not_finite(value: Any, place: Place = ()) -> Iterator[tuple[Place, float]]:
    """Yield the numbers in the content of a program that are not finite, each with its place."""
    if isinstance(value, dict | list | tuple):
        for name, part in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _not_finite(part, (*place, name))
    if isinstance(value, float) and not math.isfinite(value):
        yield place, value


def _place_in(content: dict[str, Any], place: Place) -> str:
    """Return the name of a field, preceded by its app."""
    if len(place) < 2 or place[0] != "apps":
        return dotted(place)
    index = int(place[1])
    app = content["apps"][index]
    name = app_name(index, str(app.get("kind", "?")) if isinstance(app, dict) else "?")
    return f"{name}: {dotted(place[2:])}" if place[2:] else name


def _steps(apps: Sequence[App], follows: Iterable[bool] = repeat(True)) -> tuple[ProgramStep, ...]:
    """Return apps as steps; follows: whether each follows the app before it as when they were taught.

    A grasp that changes the grip on what is held must hold it.
    """
    steps = []
    for app, held, after in zip(apps, held_grasps(apps), follows, strict=False):
        regrips = app.kind == "grasp" and held is not None
        preconditions = ("holding",) if regrips else APP_KINDS[app.kind].preconditions
        facts = {"preconditions": preconditions, "follows": after}
        steps.append(ProgramStep.model_validate(app.model_dump() | facts))
    return tuple(steps)
