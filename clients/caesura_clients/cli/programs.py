"""`caesura program`: shows the task program of a station or a file, or writes it in one of the formats."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.text import Text

from caesura_clients import query
from caesura_clients.cli.connection_options import Config, Connect, Json, OnlyStation
from caesura_clients.cli.options import (
    CellFile,
    ForceLimit,
    GripperOption,
    Retarget,
    RobotOption,
    connected,
    only_station,
    reported,
    safety_of,
)
from caesura_clients.cli.program_speed import TAUGHT, KeepPause, Speed, at_speed
from caesura_clients.cli.result_tables import apps_table, clock_lines, doubtful_apps, program_view
from caesura_protocol.command_line_advice import at_command_line
from caesura_protocol.errors import CaesuraError
from caesura_protocol.formats.write import check_not_read, whole_file
from caesura_protocol.programs.apps_by_phase import renamed
from caesura_protocol.programs.checks import document_findings, findings_beside_notes
from caesura_protocol.programs.comparison import differences
from caesura_protocol.programs.document import (
    BadProgramError,
    ProgramFile,
    document,
    in_cell,
    on_robot,
    read_document,
)
from caesura_protocol.programs.export_formats import WRITERS
from caesura_protocol.programs.program_gripper import with_gripper
from caesura_protocol.session_time_display import SessionClock, clock_from, clock_of

TABLE_WIDTH = 100  # [characters] of a table in a file


class ProgramFormat(StrEnum):
    """Format in which a program is written."""

    TABLE = "table"
    JSON = "json"
    FRANKY = "franky"
    URSCRIPT = "urscript"
    XARM = "xarm"
    BT = "bt"


def program(
    station: OnlyStation = None,
    session: Annotated[
        str | None, typer.Option(help="Session, open or closed; by default the station's current one.")
    ] = None,
    file: Annotated[
        Path | None, typer.Option(help="JSON of a program, instead of a station's program.")
    ] = None,
    output_format: Annotated[
        ProgramFormat,
        typer.Option(
            "--format",
            help="Table, JSON, script for franky, urscript or xarm, or tree of BehaviorTree.CPP (bt).",
        ),
    ] = ProgramFormat.TABLE,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Write to this file.")] = None,
    cell: CellFile = None,
    force_limit: ForceLimit = None,
    name_group: Annotated[
        list[str] | None,
        typer.Option(
            metavar="GROUP=NAME",
            help="Name a group of apps, given by its number from 1 or its name; may be repeated. The name is "
            "only in this output; `caesura edit … name_phase` stores one.",
        ),
    ] = None,
    inferred: Annotated[
        bool, typer.Option("--inferred", help="Without the edits of operators (`caesura edit-program`).")
    ] = False,
    against: Annotated[
        str | None,
        typer.Option(
            metavar="FILE|STATION/SESSION|STATION/SESSION@EDIT",
            help="Show the differences from this program instead. @EDIT: as after that edit; 0: unedited.",
        ),
    ] = None,
    speed: Speed = TAUGHT,
    keep_pause: KeepPause = None,
    gripper: GripperOption = None,
    robot: RobotOption = None,
    retarget: Retarget = False,
    as_json: Json = False,
    endpoint: Connect = None,
    config: Config = None,
) -> None:
    """Show the task program of a station or of one of its sessions, or write it for a robot.

    --json prints the message as on the wire, --format json a document of its own (docs/programs.md).
    """
    with reported():
        _check_output(against, out)
        timed = partial(at_speed, speed=speed, keeps_pause=[number - 1 for number in keep_pause or ()])
        if as_json and not (speed == TAUGHT and robot is None):
            option = "--robot" if robot is not None else "--speed"
            raise CaesuraError(f"--json prints the message as it was taught: use --format json with {option}")

        def made_of(taught: ProgramFile) -> ProgramFile:
            placed = on_robot(taught, robot, retarget=retarget)
            return timed(_in_cell(placed, cell, force_limit))

        if file is not None:
            of_service = {"--station": station, "--session": session, "--inferred": inferred}
            _check_file_options(of_service | {"--json": as_json}, file, out)
            made = with_gripper(made_of(read_document(file)), gripper)
            if against is not None:
                _compare(made, against, endpoint, config)
                return
            write_program(_named(made, name_group), output_format, out)
            return
        with connected(endpoint, config) as caesura:
            name = only_station(caesura, station, session)
            if as_json and against is None and session is None and not inferred:
                typer.echo(caesura.program(name).model_dump_json(indent=2))
                return
            snapshot = query.snapshot(caesura.transport, name, session, inferred=inferred)
            found, phases = snapshot.program, snapshot.segments.phases
            clock = clock_of(snapshot.segments.segments)
        if against is not None:
            _compare(made_of(document(found)), against, endpoint, config)
        elif as_json:
            typer.echo(found.model_dump_json(indent=2))
        elif output_format is ProgramFormat.TABLE and not (
            speed != TAUGHT or out or cell or force_limit or robot or name_group
        ):
            Console().print(*clock_lines(clock), program_view(found, clock, phases), sep="\n")
        else:
            made = made_of(document(found, phases=phases))
            made = with_gripper(made, gripper)
            write_program(_named(made, name_group), output_format, out, clock)


def _check_output(against: str | None, out: Path | None) -> None:
    """Raise CaesuraError for a file that would not be written."""
    if against is not None and out is not None:
        raise CaesuraError("--against prints the differences, and -o writes a program: leave out one of them")


def _check_file_options(of_service: Mapping[str, object], file: Path, out: Path | None) -> None:
    """Raise CaesuraError for a stated option that has no effect on a file, or an output onto the file."""
    for option, value in of_service.items():
        if value:
            raise CaesuraError(f"{option} is for a program of the service: leave out {option} or --file")
    if out is not None:
        check_not_read(out, [file])


def _compare(made: ProgramFile, against: str, endpoint: str | None, config: Path | None) -> None:
    """Print the differences between a program and the one of a file or a session."""
    station, separator, session = against.partition("/")
    if separator and not Path(against).exists():
        with connected(endpoint, config) as caesura:
            name, at, number = session.partition("@")
            if at and not number.isdecimal():
                expected = f"{station}/{name}@3"
                raise CaesuraError(f"{against}: {number!r} is no number of an edit, expected as {expected}")
            newest = caesura.snapshot(station, name).program
            if at and int(number) > newest.edit_revision:
                raise CaesuraError(f"{against}: the newest edit of the program is {newest.edit_revision}")
            other = document(
                query.program_at_edit(caesura.transport, station, name, int(number)) if at else newest
            )
    else:
        other = read_document(Path(against))
    found = differences(made, other)
    typer.echo("\n".join(found) if found else f"no differences from {against}")


def _in_cell(program: ProgramFile, cell: Path | None, force_limit: float | None) -> ProgramFile:
    if cell is None and force_limit is None:
        return program
    return in_cell(program, safety_of(program, cell, force_limit))


def _named(program: ProgramFile, names: Sequence[str] | None) -> ProgramFile:
    """Return the program with names for its groups. Raises CaesuraError for an unknown group."""
    return program.model_copy(update={"groups": renamed(program.groups, names)}) if names else program


def write_program(
    program: ProgramFile, output_format: ProgramFormat, out: Path | None, clock: SessionClock | None = None
) -> None:
    """Write a program. Raises CaesuraError if it cannot be written.

    clock: of its session; None for a file, whose times are shown relative to its first app.
    """
    try:
        if output_format is ProgramFormat.TABLE:
            begins = program.apps[0].t0 if program.apps else 0.0
            _write_table(program, out, clock or clock_from(begins))
            return
        text = WRITERS[output_format.value].write(program)
        if out is None:
            typer.echo(text, nl=False)
        else:
            with whole_file(out) as part:  # half a script may run, as far as it goes
                part.write_text(text, encoding="utf-8")
        if WRITERS[output_format.value].is_script:
            _name_errors(program)
    except ValueError as error:
        raise BadProgramError(f"{program.station}/{program.session} cannot be written: {error}") from error
    except OSError as error:
        raise CaesuraError(f"cannot write {out}: {error.strerror}") from error


def _name_errors(program: ProgramFile) -> None:
    """Print the errors of a check on stderr: the script contains them only as comments."""
    for one in document_findings(program):
        if one.severity == "error":
            typer.echo(f"{one}; caesura check refuses this program, read it before it runs", err=True)


def _write_table(program: ProgramFile, out: Path | None, clock: SessionClock) -> None:
    state = "complete" if program.complete else "being taught"
    name = f"{escape(program.name)}: " if program.name else ""
    title = f"{name}{program.station} / {program.session}, revision {program.revision}, {state}"
    findings = map(clock.text, map(str, findings_beside_notes(program)))
    noted = (clock.text(at_command_line(note)) for note in program.notes)
    notes = map(Text, (*noted, *doubtful_apps(program.apps), *findings))
    parts = [*clock_lines(clock), apps_table(program.apps, title, clock, program.groups), *notes]
    if out is None:
        Console().print(*parts, sep="\n")
    else:
        with out.open("w", encoding="utf-8") as file:
            Console(file=file, width=TABLE_WIDTH).print(*parts, sep="\n")
