"""`caesura teach`: writes a demonstration by the simulated teacher, with its truth, to a file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from caesura_clients.cli.options import reported
from caesura_lab.teacher.motion_profiles import PROFILES, Profile
from caesura_lab.teacher.scenarios import SCENARIOS
from caesura_protocol.errors import CaesuraError
from caesura_protocol.formats.write import check_new, check_writable
from caesura_protocol.messages import WRENCH_SOURCES, WrenchSource
from caesura_protocol.number_words import counted

if TYPE_CHECKING:
    from caesura_lab.teacher.simulated_teaching import Demonstration, SimulatedTeaching


def teach(
    scenario: Annotated[str | None, typer.Argument(help="Name of a scenario; --list shows all.")] = None,
    *,
    seed: Annotated[
        int, typer.Option(min=0, help="Seed of the simulated person; 0: the person of the thesis.")
    ] = 0,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="File to write, .npz; by default SCENARIO.npz.")
    ] = None,
    wrench_source: Annotated[str, typer.Option(help="Where the wrench is measured.")] = "flange_sensor",
    profile: Annotated[
        str | None, typer.Option(help="Speed profile of the hand; by default the person's own.")
    ] = None,
    rate: Annotated[float, typer.Option(help="Sampling rate [Hz].")] = 1000.0,
    natural: Annotated[
        bool,
        typer.Option(
            "--natural", help="Simulate a person's habits, as in the suite teacher; by default ideal strokes."
        ),
    ] = False,
    robot: Annotated[
        str, typer.Option(help="The arm: a name listed by `caesura robots`, or the path of a robot.json.")
    ] = "panda",
    list_scenarios: Annotated[bool, typer.Option("--list", help="List the scenarios and stop.")] = False,
) -> None:
    """Simulate a demonstration; write its recording and, beside it, the true segments."""
    if list_scenarios or scenario is None:
        _list()
        return
    file = out or Path(f"{scenario}.npz")
    if file.suffix != ".npz":
        raise typer.BadParameter(f"{file} has suffix {file.suffix!r}, expected .npz", param_hint="--out")
    truth_file = file.with_suffix(".ann.json")
    with reported():
        _check_new(file, truth_file)
    teaching = _teaching(scenario, seed, wrench_source, profile, rate, robot, natural=natural)
    demonstration = _simulate(teaching)
    demonstration.recording.save(file)
    truth_file.write_text(
        json.dumps(demonstration.truth | {"file": file.name}, indent=1) + "\n", encoding="utf-8"
    )
    samples = counted(demonstration.recording.t.size, "sample")
    Console().print(f"{file}: {samples}, {teaching.duration_s:.1f} s; {truth_file}")


def _check_new(file: Path, truth_file: Path) -> None:
    """Make the directory. Raises CaesuraError if it cannot be written to, or one of the files exists."""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CaesuraError(f"cannot write {file}: {error.strerror}") from error
    check_writable(file)
    for one in (file, truth_file):
        check_new(one)  # it may be taught or annotated by a person


def _teaching(
    scenario: str,
    seed: int,
    wrench_source: str,
    profile: str | None,
    rate: float,
    robot: str,
    *,
    natural: bool,
) -> SimulatedTeaching:
    # Pinocchio and scipy take a second to load: only for who teaches.
    from caesura_lab.teacher.simulated_teaching import SimulatedTeaching  # noqa: PLC0415

    source = cast(WrenchSource, _one_of(WRENCH_SOURCES, wrench_source, "--wrench-source"))
    chosen = cast(Profile, _one_of(PROFILES, profile, "--profile")) if profile else None
    try:
        return SimulatedTeaching(
            scenario,
            seed=seed,
            wrench_source=source,
            profile=chosen,
            rate_hz=rate,
            natural=natural,
            robot=robot,
        )
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error


def _one_of(known: Sequence[str], value: str, option: str) -> str:
    if value not in known:
        raise typer.BadParameter(f"{value!r}, expected one of {', '.join(known)}", param_hint=option)
    return value


def _simulate(teaching: SimulatedTeaching) -> Demonstration:
    from caesura_lab.teacher.simulated_teaching import finish  # noqa: PLC0415

    chunks = []
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(teaching.scenario.name, total=teaching.duration_s)
        for chunk in teaching.chunks():
            chunks.append(chunk)
            progress.update(task, completed=float(chunk[-1, 0]))
    return finish(teaching, chunks)


def _list() -> None:
    table = Table("scenario", "seconds", "what is taught")
    for scenario in SCENARIOS.values():
        table.add_row(scenario.name, f"{scenario.steps[-1].until_s:.1f}", scenario.summary)
    Console().print(table)
