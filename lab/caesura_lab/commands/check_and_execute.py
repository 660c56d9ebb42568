"""`caesura check` and `caesura execute`: checks a task program, and runs it on the simulated robot."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from caesura_clients.cli.connection_options import Json
from caesura_clients.cli.options import (
    CellFile,
    ForceLimit,
    GripperOption,
    Retarget,
    RobotOption,
    parsed_up,
    reported,
    safety_of,
)
from caesura_lab.teacher.person import THESIS, draw_person
from caesura_lab.teacher.scenarios import SCENARIOS, Scenario, moved
from caesura_protocol.app_kinds import name_of_app
from caesura_protocol.errors import CaesuraError, SourceError
from caesura_protocol.number_words import counted
from caesura_protocol.programs.checks import group_findings, unfinished_findings
from caesura_protocol.programs.checks.findings import CheckReport
from caesura_protocol.programs.checks.mounting import mounting_findings
from caesura_protocol.programs.document import ProgramFile, on_robot, read_document
from caesura_protocol.programs.program_gripper import gripper_of, with_gripper
from caesura_protocol.robots import robot_description
from caesura_protocol.session_time_display import NO_OFFSET, SessionClock, clock_from
from caesura_protocol.up_direction import APART_RAD, UP, tilt_between, up_in_words

if TYPE_CHECKING:
    from caesura_lab.execution.executor import RunResult

ProgramPath = Annotated[
    Path, typer.Argument(metavar="PROGRAM", help="JSON of `caesura program --format json`.")
]
UpOfBase = Annotated[
    str | None,
    typer.Option(
        "--up",
        metavar="X,Y,Z",
        help="Direction opposite to gravity in the base frame of the robot that runs it: X,Y,Z, or an axis.",
        show_default="not compared",
    ),
]
ScenarioName = Annotated[
    str | None,
    typer.Option(
        "--scenario",
        help="Simulated cell with its surfaces and objects: a scenario of `caesura teach --list`.",
    ),
]


def check(
    file: ProgramPath,
    scenario: ScenarioName = None,
    cell_file: CellFile = None,
    force_limit: ForceLimit = None,
    robot: RobotOption = None,
    retarget: Retarget = False,
    gripper: GripperOption = None,
    up: UpOfBase = None,
    as_json: Json = False,
) -> None:
    """Check whether a program can be run, app by app. The exit code is 1 if an app cannot."""
    # Pinocchio takes a second to load: only for who needs it.
    from caesura_lab.execution.cell_limits import Cell as SimulatedCell  # noqa: PLC0415
    from caesura_lab.execution.cell_simulation import CellSimulation  # noqa: PLC0415
    from caesura_lab.execution.checks import DemonstrationQuality  # noqa: PLC0415
    from caesura_lab.execution.checks import check as check_program  # noqa: PLC0415
    from caesura_service.robot import load_robot  # noqa: PLC0415

    with reported():
        program = with_gripper(on_robot(read_document(file), robot, retarget=retarget), gripper)
        safety = safety_of(program, cell_file, force_limit)
        cell = (
            SimulatedCell(safety)
            if scenario is None
            else CellSimulation(_scenario(scenario, program), THESIS.load_kg).cell(safety)
        )
        report = check_program(
            program.apps,
            cell,
            DemonstrationQuality(program.gaps, program.wrench, program.timing, program.notes),
            None if program.robot is None else load_robot(program.robot),
            gripper_of(program),
        )
        mounting = mounting_findings(program.up, parsed_up(up))
        report = CheckReport(
            (*unfinished_findings(program), *mounting, *report.findings, *group_findings(program))
        )
    if as_json:
        typer.echo(json.dumps([asdict(one) for one in report.findings], indent=1))
    else:
        clock = _clock_of(program)
        if clock.words:
            typer.echo(clock.words)
        for finding in report.findings:
            typer.echo(clock.text(str(finding)))
        verdict = "can be run" if report.passed else "cannot be run"
        counts = f"{counted(len(report.errors), 'error')}, {counted(len(report.warnings), 'warning')}"
        typer.echo(f"{file}: {counted(len(program.apps), 'app')}, {counts}: {verdict}")
    if not report.passed:
        raise typer.Exit(1)


def execute(
    file: ProgramPath,
    *,
    simulated: Annotated[
        bool, typer.Option("--simulated", help="Run it on the simulated robot (the only one here).")
    ] = False,
    scenario: ScenarioName = None,
    cell_file: CellFile = None,
    force_limit: ForceLimit = None,
    seed: Annotated[
        int, typer.Option(min=0, help="Seed of the object and the sensors, as for `caesura teach`.")
    ] = 0,
    robot: RobotOption = None,
    retarget: Retarget = False,
    gripper: GripperOption = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Write a recording of the run, .npz.")
    ] = None,
) -> None:
    """Run a program on the simulated robot. The exit code is 1 if it is refused or stopped.

    Without --scenario it runs in a cell as taught: a level surface stands where the program touches, and an
    object where it grasps.
    """
    with reported():
        if not simulated:
            raise CaesuraError(
                "only --simulated is run here; for a robot, write a script: caesura program --format franky, "
                "urscript or xarm, as `caesura robots` lists it for the arm"
            )
        if out is not None and out.suffix != ".npz":
            raise CaesuraError(f"{out} has suffix {out.suffix!r}, expected .npz")
        program = with_gripper(on_robot(read_document(file), robot, retarget=retarget), gripper)
        if tilt_between(program.up, UP) > APART_RAD:
            raise CaesuraError(
                f"{file}: taught with {up_in_words(program.up or UP)} upwards, and the simulated robot "
                f"stands upright: it runs what was taught with at most {math.degrees(APART_RAD):g}° of tilt"
            )
        limits = safety_of(program, cell_file, force_limit)
        stopped = _run(program.model_copy(update={"safety": limits}), scenario, seed, out)
    if stopped:
        raise typer.Exit(1)


def _run(program: ProgramFile, scenario: str | None, seed: int, out: Path | None) -> bool:
    """Run a program on the simulated robot and print its figures; return whether the run was stopped."""
    import numpy as np  # noqa: PLC0415

    from caesura_lab.execution.cell_limits import Cell  # noqa: PLC0415
    from caesura_lab.execution.checks import DemonstrationQuality  # noqa: PLC0415
    from caesura_lab.execution.checks import check as check_program  # noqa: PLC0415
    from caesura_lab.execution.executor import SimulatedCell  # noqa: PLC0415
    from caesura_lab.execution.executor import execute as run  # noqa: PLC0415
    from caesura_lab.execution.taught_cell import cell_as_taught, taught_cell_in_words  # noqa: PLC0415
    from caesura_protocol.programs.checks.findings import RefusedError  # noqa: PLC0415
    from caesura_service.robot import load_robot  # noqa: PLC0415

    person = THESIS if seed == 0 else draw_person(np.random.default_rng(seed), f"person-{seed}")
    quality = DemonstrationQuality(timing=program.timing)
    robot, gripper = load_robot(program.robot or "panda"), gripper_of(program)
    named = None if scenario is None else _scenario(scenario, program)
    if program.robot is None:
        typer.echo("robot not stated: simulated on a Panda", err=True)
    try:
        if named is None:
            try:
                cell = cell_as_taught(program.apps, person, seed)
            except CaesuraError:  # what is wrong with the program goes before what such a cell lacks
                report = check_program(program.apps, Cell(program.safety), quality, robot, gripper)
                if report.passed:
                    raise
                raise RefusedError(report) from None
        else:
            cell = SimulatedCell(named, person, seed)
        done = run(program.apps, cell, program.safety, quality=quality, robot=robot, gripper=gripper)
    except RefusedError as refused:
        lines = "\n".join(map(_clock_of(program).text, map(str, refused.report.errors)))
        raise SourceError(f"{program.station}/{program.session} is refused:\n{lines}") from refused
    if out is not None:
        try:
            done.recording.save(out)
        except OSError as error:
            raise CaesuraError(f"cannot write {out}: {error.strerror}") from error
    if scenario is None:
        typer.echo(taught_cell_in_words(cell), err=True)
    typer.echo(_figures(done) + (f"; {out}" if out else ""))
    if done.stopped is not None:
        where = "" if done.at is None else f" in {name_of_app(done.at, program.apps[done.at])}"
        typer.echo(f"stopped{where}: {done.stopped}", err=True)
    return done.stopped is not None


def _figures(done: RunResult) -> str:
    """Return the duration of a run, its highest speed and its strongest contact as text."""
    import numpy as np  # noqa: PLC0415

    fastest = float(np.linalg.norm(done.trace.twist[:, :3], axis=1).max())
    strongest = float(np.linalg.norm(done.trace.contact, axis=1).max())
    return f"{done.trace.t[-1]:.1f} s, at most {1000.0 * fastest:.0f} mm/s and {strongest:.1f} N"


def _clock_of(program: ProgramFile) -> SessionClock:
    """Return the clock for displaying the program's times, as in the table of `caesura program`."""
    return clock_from(program.apps[0].t0) if program.apps else NO_OFFSET


def _scenario(name: str, program: ProgramFile) -> Scenario:
    """Return the scenario, moved to the reach of the program's robot. Raises CaesuraError if unknown."""
    if name not in SCENARIOS:
        raise CaesuraError(f"no scenario {name!r}, known: {', '.join(SCENARIOS)}")
    return moved(SCENARIOS[name], robot_description(program.robot or "panda").task_offset_m)
