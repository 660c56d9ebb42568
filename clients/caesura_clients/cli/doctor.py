"""`caesura doctor`: checks everything between a robot and its segments, and prints remedies."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from caesura_clients.cli.connection_options import Config, Connect, Json, Station
from caesura_clients.cli.options import Reading, grouped, named, reported
from caesura_clients.doctor import CheckResult, examine, examine_recording
from caesura_clients.doctor.findings import MARKS
from caesura_clients.doctor.run_checks import LISTEN_S
from caesura_protocol.formats.read import load_recording

STYLES = {"ok": typer.colors.GREEN, "warn": typer.colors.YELLOW, "bad": typer.colors.RED}
WIDTH = 12  # of a check's name


@grouped
def doctor(
    *,
    station: Station = None,
    seconds: Annotated[
        float, typer.Option(min=1.0, max=600.0, metavar="S", help="Seconds to listen to the stations.")
    ] = LISTEN_S,
    file: Annotated[Path | None, typer.Option(help="Check this recording instead.")] = None,
    reading: Reading,
    mapping: Annotated[
        Path | None,
        typer.Option(help="Names and units in a csv or rosbag2 of other software (docs/recordings.md)."),
    ] = None,
    as_json: Json = False,
    endpoint: Connect = None,
    config: Config = None,
) -> None:
    """Check connection, clock, credentials, journal, samples and wrench, and print remedies.

    The exit code is 1 if a check is marked ✗.
    """
    with reported():
        if file is not None:
            recording = load_recording(
                file,
                **reading._asdict(),
                mapping=mapping,
                check_units=False,  # a finding of its own
            )
            found = list(examine_recording(recording))
        else:
            found = _shown(examine(endpoint, config, station=named(station) or "*", seconds=seconds), as_json)
    if as_json:
        typer.echo(json.dumps([asdict(one) for one in found], indent=2, ensure_ascii=False))
    elif file is not None:
        _shown(found, quiet=False)
    if any(one.grade == "bad" for one in found):
        raise typer.Exit(1)


def _shown(findings: Iterable[CheckResult], quiet: bool) -> list[CheckResult]:
    """Return all findings; unless quiet, print each as soon as it is found."""
    seen: list[CheckResult] = []
    for one in findings:
        if not quiet:
            if one.station is not None and one.station not in {before.station for before in seen}:
                typer.echo(one.station)
            _say(one)
        seen.append(one)
    return seen


def _say(one: CheckResult) -> None:
    mark = typer.style(MARKS[one.grade], fg=STYLES[one.grade])
    typer.echo(f"{mark} {one.check:<{WIDTH}} {one.found}")
    if one.remedy:
        typer.echo(f"  {'':<{WIDTH}} → {one.remedy}")
