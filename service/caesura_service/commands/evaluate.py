"""`caesura evaluate`: how good a segmentation is, against the truth and beside other methods."""

from __future__ import annotations

import json
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress

from caesura_clients.cli.options import reported
from caesura_clients.recording import RecordingError
from caesura_protocol.errors import ProtocolError
from caesura_service.changepoint.presets import PRESETS
from caesura_service.judge.judging import Verdict, judge_all
from caesura_service.judge.methods import Method, MissingExtraError, Ours, baselines
from caesura_service.judge.report import Report, as_json, report
from caesura_service.judge.suites import REAL, SUITES, Case, Extent, files, suite
from caesura_service.judge.tables import as_markdown, as_text
from caesura_service.judge.truth import TruthError

DEFAULT_PRESETS = ["default", "integrated"]
WORKERS = 2
WIDTH = 90  # [characters] of text in a file


class Format(StrEnum):
    """How results are written."""

    TEXT = "text"
    MARKDOWN = "markdown"
    JSON = "json"


def evaluate(
    recordings: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[FILES]...", help="Annotated recordings, or directories of them."),
    ] = None,
    *,
    suite_name: Annotated[
        str | None, typer.Option("--suite", help=f"Instead of files: {', '.join(SUITES)}.")
    ] = None,
    seeds: Annotated[int, typer.Option(min=1, help="Teacher: people a scenario.")] = 5,
    first_seed: Annotated[int, typer.Option(min=0, help="Teacher: the first of them.")] = 1,
    data: Annotated[
        Path, typer.Option(help="Real: the directory of the recordings.", show_default="../shared/data/real")
    ] = REAL,
    preset: Annotated[
        list[str] | None, typer.Option(help="Preset of ours; may be given more than once.")
    ] = None,
    with_baselines: Annotated[
        bool, typer.Option("--baselines/--no-baselines", help="Judge other methods too.")
    ] = True,
    tolerance: Annotated[
        float, typer.Option(min=0.0, help="Widens the points' own tolerances to at least this many seconds.")
    ] = 0.0,
    confusion: Annotated[
        bool, typer.Option("--confusion", help="Show the presets' class confusion and typical errors.")
    ] = False,
    output_format: Annotated[Format, typer.Option("--format", help="How to write it.")] = Format.TEXT,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Write to this file.")] = None,
    workers: Annotated[int, typer.Option(min=1, help="Processes.")] = WORKERS,
) -> None:
    """Judge segmentations against the truth: boundaries, classes, delays, load and force."""
    with reported():
        try:
            methods = _methods(preset or DEFAULT_PRESETS, with_baselines=with_baselines)
            cases = _cases(recordings or [], suite_name, Extent(seeds, first_seed, data))
            verdicts = _judged(cases, methods, tolerance, workers)
        except (TruthError, RecordingError, MissingExtraError) as error:
            raise ProtocolError("malformed", str(error)) from error
        title = _title(suite_name, cases, tolerance)
        result = report(title, [method.name for method in methods], verdicts)
        _write(result, output_format, out, (preset or DEFAULT_PRESETS) if confusion else [])


def _methods(presets: Sequence[str], *, with_baselines: bool) -> list[Method]:
    unknown = sorted(set(presets) - set(PRESETS))
    if unknown:
        raise ProtocolError("malformed", "unknown preset", value=unknown[0], expected=sorted(PRESETS))
    ours: list[Method] = [Ours(name) for name in dict.fromkeys(presets)]
    return [*ours, *(baselines() if with_baselines else [])]


def _cases(recordings: Sequence[Path], suite_name: str | None, extent: Extent) -> list[Case]:
    if bool(recordings) == (suite_name is not None):
        raise TruthError(f"name either files or one --suite of {list(SUITES)}")
    if suite_name is not None:
        return suite(suite_name, extent)
    return files(recordings)


def _judged(
    cases: Sequence[Case], methods: Sequence[Method], tolerance_s: float, workers: int
) -> list[Verdict]:
    verdicts: list[Verdict] = []
    columns = (*Progress.get_default_columns(), MofNCompleteColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("judging", total=len(cases))
        for some in judge_all(cases, methods, tolerance_s, workers=workers):
            verdicts += some
            progress.advance(task)
    return verdicts


def _title(suite_name: str | None, cases: Sequence[Case], tolerance_s: float) -> str:
    what = f"suite {suite_name}" if suite_name else "files"
    floor = f", at least {tolerance_s:g} s" if tolerance_s else ""
    return f"{what}: {len(cases)} recordings, each point's own tolerance{floor}; 95 % intervals"


def _write(result: Report, output_format: Format, out: Path | None, detailed: Sequence[str]) -> None:
    try:
        _print(result, output_format, out, detailed)
    except OSError as error:
        raise ProtocolError("malformed", f"cannot write {out}: {error.strerror}") from error


def _print(result: Report, output_format: Format, out: Path | None, detailed: Sequence[str]) -> None:
    if output_format is Format.TEXT:
        if out is None:
            Console().print(as_text(result, detailed=detailed))
        else:
            with out.open("w", encoding="utf-8") as file:
                Console(file=file, width=WIDTH).print(as_text(result, detailed=detailed))
        return
    if output_format is Format.MARKDOWN:
        text = as_markdown(result, detailed=detailed)
    else:
        text = json.dumps(as_json(result), indent=1) + "\n"
    if out is None:
        typer.echo(text, nl=False)
    else:
        out.write_text(text, encoding="utf-8")
