"""Options that several commands share, and the error output: one line and an exit code, no traceback."""

from __future__ import annotations

import inspect
import math
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from textwrap import indent
from typing import Annotated, Any, NamedTuple, get_type_hints

import typer

from caesura_clients import query
from caesura_clients.client import Caesura, connect
from caesura_clients.refusal_words import refusal_words
from caesura_protocol.errors import AccessDenied, CaesuraError, NotFound, ProtocolError, Unreachable
from caesura_protocol.keys import check_name
from caesura_protocol.messages import (
    FORCE_FRAMES,
    HANDS_ON_ROBOT,
    MOST_TOLERANCE_M,
    MOST_TOLERANCE_RAD,
    WRENCH_SOURCES,
    Vector,
)
from caesura_protocol.plausibility import UNITS
from caesura_protocol.programs.default_safety import cell_safety
from caesura_protocol.programs.document import ProgramFile
from caesura_protocol.programs.safety import UNSET, CellSettings, Safety, read_safety
from caesura_protocol.recording import UnknownColumnsError
from caesura_protocol.robots import grippers, robot_description
from caesura_protocol.up_direction import parse_up

WrenchSource = Annotated[
    str | None,
    typer.Option(metavar="NAME", help=f"Where the wrench is measured: {', '.join(WRENCH_SOURCES)}."),
]
HandOnRobot = Annotated[
    str | None,
    typer.Option(metavar="NAME", help=f"Does a person guide the robot by hand? {', '.join(HANDS_ON_ROBOT)}."),
]
ForceFrame = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help=f"Frame of the forces, if the file does not state it: {', '.join(FORCE_FRAMES)}.",
        show_default="base",
    ),
]

UpOption = Annotated[
    str | None,
    typer.Option(
        "--up",
        metavar="X,Y,Z",
        help="Direction opposite to gravity in the base frame, for an arm that is tilted or hangs: three "
        "numbers, or an axis such as -z.",
        show_default="as in the file, or z",
    ),
]
ForceLimit = Annotated[
    float | None,
    typer.Option(
        min=0.1,
        metavar="N",
        help="Highest force [N] that an app of the program exerts. By default forces are as taught.",
    ),
]
MOST_TOLERANCE_MM = round(1000 * MOST_TOLERANCE_M)
PathTolerance = Annotated[
    float | None,
    typer.Option(
        min=0.1,
        max=MOST_TOLERANCE_MM,
        metavar="MM",
        help="Largest deviation of a path from the taught one \\[mm]; by default the service's, 2.",
    ),
]
AngleTolerance = Annotated[
    float | None,
    typer.Option(
        min=0.1,
        max=round(math.degrees(MOST_TOLERANCE_RAD)),
        metavar="DEG",
        help="Largest deviation of the orientation along it [°]; by default the service's, 1.",
    ),
]
CellFile = Annotated[
    Path | None,
    typer.Option(
        "--cell", metavar="FILE", help="JSON with the cell's limits (docs/programs.md, Limits of a cell)."
    ),
]
GripperOption = Annotated[
    str | None,
    typer.Option(
        "--gripper",
        metavar="NAME",
        help=f"Gripper that runs the program, if not the robot's own: {', '.join(grippers())}.",
    ),
]
RobotOption = Annotated[
    str | None,
    typer.Option(
        "--robot",
        metavar="NAME|FILE",
        help="The arm: a name listed by `caesura robots`, or the path of a robot.json.",
    ),
]
Retarget = Annotated[
    bool,
    typer.Option(
        "--retarget", help="Accept a program for another robot: keep its poses, drop its joint angles."
    ),
]
LengthUnit = Annotated[
    str | None,
    typer.Option(
        "--length-unit", "--unit", metavar="UNIT", help="Unit of positions: m, cm, mm; overrides the file."
    ),
]
TimeUnit = Annotated[
    str | None, typer.Option(metavar="UNIT", help=f"Unit of times in the file: {', '.join(UNITS['time'])}.")
]
AngleUnit = Annotated[
    str | None, typer.Option(metavar="UNIT", help=f"Unit of joints in the file: {', '.join(UNITS['angle'])}.")
]
ForceUnit = Annotated[
    str | None, typer.Option(metavar="UNIT", help=f"Unit of forces in the file: {', '.join(UNITS['force'])}.")
]
CONNECT_TIMEOUT_S = 5.0
MAPPING_HINT = (
    "`caesura segment FILE --ask` asks which column is what and writes a mapping. This one may be a "
    "beginning, with … for names that are missing:"
)


class Reading(NamedTuple):
    """Options for reading a recording, as the arguments of `load_recording`."""

    wrench_source: WrenchSource = None
    hand_on_robot: HandOnRobot = None
    force_frame: ForceFrame = None
    length_unit: LengthUnit = None
    time_unit: TimeUnit = None
    angle_unit: AngleUnit = None
    force_unit: ForceUnit = None


class ProgramOptions(NamedTuple):
    """Options for making a program: the requirements of the cell."""

    cell: CellFile = None
    force_limit: ForceLimit = None
    path_tolerance: PathTolerance = None
    angle_tolerance: AngleTolerance = None
    robot: RobotOption = None
    up: UpOption = None

    def setting(self) -> CellSettings:
        """Return the cell settings of the options, converted to m and rad. Raises CaesuraError.

        A stated force limit takes precedence over the one in the cell's file.
        """
        cell = UNSET if self.cell is None else CellSettings(read_safety(self.cell).force_n)
        return CellSettings(
            self.force_limit,
            None if self.path_tolerance is None else self.path_tolerance / 1000.0,
            None if self.angle_tolerance is None else math.radians(self.angle_tolerance),
            None if self.robot is None else robot_description(self.robot).name,
            parsed_up(self.up),
        ).completed_by(cell)


def parsed_up(text: str | None) -> Vector | None:
    """Return the direction of `--up`. Raises CaesuraError."""
    try:
        return None if text is None else parse_up(text)
    except ValueError as error:
        raise CaesuraError(f"--{error}") from error


def grouped(command: Callable[..., None]) -> Callable[..., None]:
    """Return the command for typer: a parameter that is a NamedTuple of options is replaced by its fields."""
    signature = inspect.signature(command, eval_str=True)
    groups: dict[str, Any] = {
        name: one.annotation
        for name, one in signature.parameters.items()
        if isinstance(one.annotation, type) and issubclass(one.annotation, tuple)
    }
    parameters = [
        option
        for name, one in signature.parameters.items()
        for option in (_options_of(groups[name]) if name in groups else [one])
    ]

    @wraps(command)
    def run(**given: Any) -> None:
        made = {
            name: group(*(given.pop(option) for option in group._fields)) for name, group in groups.items()
        }
        command(**given, **made)

    keyword = inspect.Parameter.KEYWORD_ONLY
    run.__signature__ = signature.replace(  # type: ignore[attr-defined]
        parameters=[parameter.replace(kind=keyword) for parameter in parameters]
    )
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters} | {
        "return": None
    }
    del run.__wrapped__
    return run


def _options_of(group: Any) -> list[inspect.Parameter]:
    hints = get_type_hints(group, include_extras=True)
    return [
        inspect.Parameter(
            name, inspect.Parameter.KEYWORD_ONLY, default=group._field_defaults[name], annotation=hints[name]
        )
        for name in group._fields
    ]


def safety_of(program: ProgramFile, cell: Path | None, force_n: float | None) -> Safety:
    """Return the limits for a program: from the cell's file, or else from the program.

    Raises CaesuraError.
    """
    safety = program.safety if cell is None else cell_safety(cell, program.robot)
    return safety if force_n is None else safety.model_copy(update={"force_n": force_n})


def connected(endpoint: str | None, config: Path | None, *, patient: bool = False) -> Caesura:
    """Return a connection with these options; if patient, print why it waits, and wait for the router."""
    try:
        return connect(endpoint, config_file=config, timeout_s=CONNECT_TIMEOUT_S)
    except Unreachable as error:
        if not patient or isinstance(error, AccessDenied):
            raise
        typer.echo(f"waiting: {error}", err=True)
        return connect(endpoint, config_file=config, timeout_s=None)


@contextmanager
def ended_by_sigterm() -> Iterator[None]:
    """Treat SIGTERM as Ctrl-C while the context lasts, so that open resources are closed."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def reported() -> Iterator[None]:
    """Print an error that a user can act on as one line on stderr, and exit with code 1."""
    try:
        yield
    except (CaesuraError, ProtocolError) as error:
        why = refusal_words(error) if isinstance(error, ProtocolError) else str(error)
        typer.echo(f"error: {why}", err=True)
        if isinstance(error, UnknownColumnsError):
            typer.echo(f"{MAPPING_HINT}\n\n{indent(error.example, '    ')}", err=True)
        raise typer.Exit(1) from error


def named(typed: str | None, what: str = "station") -> str | None:
    """Return the typed name of a station or session after validation, before any output.

    Raises ProtocolError.
    """
    return None if typed is None else check_name(typed, what)


def only_station(caesura: Caesura, station: str | None, session: str | None = None) -> str:
    """Return the named station, or else the only one with a session of this name, in memory or stored.

    Without a session it is the only station with any in memory. Raises NotFound for none or several.
    """
    if station is not None:
        return station
    known = sorted({info.station for info in caesura.sessions() if session in {None, info.session}})
    if not known and session is not None:
        stored = query.stored_snapshots(caesura.transport, session=session)
        known = sorted({one.status.station for one in stored})
    if len(known) != 1:
        which = "sessions" if session is None else f"a session {session!r}"
        raise NotFound(
            f"several stations have {which}: {', '.join(known)}; name one with --station"
            if known
            else f"no station has {which}"
        )
    return known[0]
