"""`caesura evaluate`: how good a segmentation is, against the truth and beside other methods."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence, Sized
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer
from rich.console import Console, RenderableType
from rich.progress import MofNCompleteColumn, Progress

from caesura_clients.cli.options import reported
from caesura_clients.recording import RecordingError
from caesura_protocol.errors import ProtocolError
from caesura_service.changepoint.presets import PRESETS, WITHOUT
from caesura_service.judge import evidence as libraries
from caesura_service.judge import mutations, realism, roundtrip
from caesura_service.judge.judging import Verdict, judge_all
from caesura_service.judge.methods import Method, MissingExtraError, Ours, baselines
from caesura_service.judge.pool import each
from caesura_service.judge.report import as_json, report
from caesura_service.judge.suites import REAL, SUITES, Case, Extent, files, suite
from caesura_service.judge.tables import as_markdown, as_text
from caesura_service.judge.thesis import suite as thesis
from caesura_service.judge.thesis import summary as thesis_summary
from caesura_service.judge.thesis import tables as thesis_tables
from caesura_service.truth import Leniency, TruthError

DEFAULT_PRESET = "default"
DEFAULT_PRESETS = [DEFAULT_PRESET, "integrated"]
WORKERS = 2
WIDTH = 90  # [characters] of text in a file
THESIS, ROUNDTRIP, REALISM = "thesis", "roundtrip", "realism"
ALL_SUITES = [*SUITES, THESIS, ROUNDTRIP, REALISM]
SEEDS, THESIS_SEEDS = 5, 20

Made = TypeVar("Made")


@dataclass(frozen=True)
class Page:
    """Results, as they can be written."""

    text: Callable[[], RenderableType]
    markdown: Callable[[], str]
    plain: Callable[[], dict[str, Any]]


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
        str | None, typer.Option("--suite", help=f"Instead of files: {', '.join(ALL_SUITES)}.")
    ] = None,
    seeds: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Simulated people a scenario.",
            show_default=f"{SEEDS}, thesis and roundtrip {THESIS_SEEDS}",
        ),
    ] = None,
    first_seed: Annotated[int, typer.Option(min=0, help="The first of them.")] = 1,
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
    slack: Annotated[
        float, typer.Option(min=0.0, help="Added to each point's own tolerance [s], before --tolerance.")
    ] = 0.0,
    ablate: Annotated[
        bool, typer.Option("--ablate", help="Judge default beside itself without each of its principles.")
    ] = False,
    confusion: Annotated[
        bool, typer.Option("--confusion", help="Show the presets' class confusion and typical errors.")
    ] = False,
    evidence: Annotated[
        bool, typer.Option("--evidence", help="Compare motion libraries by log evidence; needs no truth.")
    ] = False,
    mutated: Annotated[
        int | None,
        typer.Option("--mutations", min=1, help="Roundtrip: check and run so many spoilt programs instead."),
    ] = None,
    output_format: Annotated[Format, typer.Option("--format", help="How to write it.")] = Format.TEXT,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Write to this file.")] = None,
    workers: Annotated[int, typer.Option(min=1, help="Processes.")] = WORKERS,
) -> None:
    """Judge segmentations against the truth: boundaries, classes, delays, load and force."""
    with reported():
        try:
            if evidence:
                extent = Extent(seeds or SEEDS, first_seed, data)
                cases = _cases(recordings or [], suite_name, extent, known=list(SUITES))
                page = _evidence(suite_name, cases, workers)
            elif suite_name == ROUNDTRIP and not recordings:
                people = range(first_seed, first_seed + (seeds or THESIS_SEEDS))
                page = _roundtrip(people, workers) if mutated is None else _mutated(mutated, workers)
            elif suite_name == THESIS and not recordings:
                page = _thesis(range(first_seed, first_seed + (seeds or THESIS_SEEDS)), workers)
            elif suite_name == REALISM and not recordings:
                page = _realism(data, range(first_seed, first_seed + (seeds or SEEDS)), workers)
            else:
                cases = _cases(recordings or [], suite_name, Extent(seeds or SEEDS, first_seed, data))
                methods = (
                    _ablated()
                    if ablate
                    else _methods(preset or DEFAULT_PRESETS, with_baselines=with_baselines)
                )
                leniency = Leniency(slack, tolerance)
                verdicts = _judged(cases, methods, leniency, workers)
                title = _title(suite_name, cases, leniency)
                detailed = (preset or DEFAULT_PRESETS) if confusion else []
                page = _page(title, methods, verdicts, detailed)
        except (TruthError, RecordingError, MissingExtraError) as error:
            raise ProtocolError("malformed", str(error)) from error
        _write(page, output_format, out)


def _thesis(seeds: range, workers: int) -> Page:
    tasks = thesis.tasks(seeds)
    result = thesis_summary.summarise(_watched(each(thesis.perform, tasks, workers=workers), tasks))
    title = thesis_tables.title(seeds)
    return Page(
        text=lambda: thesis_tables.as_text(result, title),
        markdown=lambda: thesis_tables.as_markdown(result, title),
        plain=lambda: {"title": title, "settings": thesis_summary.as_json(result)},
    )


def _roundtrip(seeds: range, workers: int) -> Page:
    cases = roundtrip.cases(seeds)
    summary = roundtrip.summarise(_watched(each(roundtrip.travel, cases, workers=workers), cases))
    title = roundtrip.title(seeds)
    return Page(
        text=lambda: roundtrip.as_text(summary, title),
        markdown=lambda: roundtrip.as_markdown(summary, title),
        plain=lambda: {"title": title, "trips": roundtrip.as_json(summary)},
    )


def _realism(data: Path, seeds: range, workers: int) -> Page:
    cases = realism.cases(data, seeds)
    result = realism.summarise(_watched(each(realism.load, cases, workers=workers), cases))
    title = realism.title(seeds)
    return Page(
        text=lambda: realism.as_text(result, title),
        markdown=lambda: realism.as_markdown(result, title),
        plain=lambda: {"title": title, **realism.as_json(result)},
    )


def _mutated(count: int, workers: int) -> Page:
    numbers = range(count)
    fates = list(_watched(each(mutations.meet_fate, numbers, workers=workers), numbers))
    return Page(
        text=lambda: mutations.as_text(fates),
        markdown=lambda: mutations.as_markdown(fates),
        plain=lambda: mutations.as_json(fates),
    )


def _evidence(suite_name: str | None, cases: Sequence[Case], workers: int) -> Page:
    told = libraries.ordered(_watched(each(libraries.tell, cases, workers=workers), cases))
    title = libraries.title(f"suite {suite_name}" if suite_name else "files", told)
    return Page(
        text=lambda: libraries.as_text(told, title),
        markdown=lambda: libraries.as_markdown(told, title),
        plain=lambda: libraries.as_json(told, title),
    )


def _page(
    title: str, methods: Sequence[Method], verdicts: Sequence[Verdict], detailed: Sequence[str]
) -> Page:
    result = report(title, [method.name for method in methods], verdicts)
    return Page(
        text=lambda: as_text(result, detailed=detailed),
        markdown=lambda: as_markdown(result, detailed=detailed),
        plain=lambda: as_json(result),
    )


def _ablated() -> list[Method]:
    return [Ours(name) for name in (DEFAULT_PRESET, *WITHOUT)]


def _methods(presets: Sequence[str], *, with_baselines: bool) -> list[Method]:
    unknown = sorted(set(presets) - set(PRESETS))
    if unknown:
        raise ProtocolError("malformed", "unknown preset", value=unknown[0], expected=sorted(PRESETS))
    ours: list[Method] = [Ours(name) for name in dict.fromkeys(presets)]
    return [*ours, *(baselines() if with_baselines else [])]


def _cases(
    recordings: Sequence[Path],
    suite_name: str | None,
    extent: Extent,
    *,
    known: Sequence[str] = ALL_SUITES,
) -> list[Case]:
    if bool(recordings) == (suite_name is not None):
        raise TruthError(f"name either files or one --suite of {known}")
    if suite_name is not None and suite_name not in SUITES:
        raise TruthError(f"no suite {suite_name!r}, known: {known}")
    if suite_name is not None:
        return suite(suite_name, extent)
    return files(recordings)


def _judged(
    cases: Sequence[Case], methods: Sequence[Method], leniency: Leniency, workers: int
) -> list[Verdict]:
    verdicts = _watched(judge_all(cases, methods, leniency, workers=workers), cases)
    return [verdict for some in verdicts for verdict in some]


def _watched(results: Iterator[Made], of: Sized) -> Iterator[Made]:
    """The results, with a bar that tells how many have come."""
    columns = (*Progress.get_default_columns(), MofNCompleteColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        yield from progress.track(results, total=len(of), description="judging")


def _title(suite_name: str | None, cases: Sequence[Case], leniency: Leniency) -> str:
    what = f"suite {suite_name}" if suite_name else "files"
    slack = f" and {leniency.slack_s:g} s" if leniency.slack_s else ""
    least = f", at least {leniency.least_s:g} s" if leniency.least_s else ""
    return f"{what}: {len(cases)} recordings, each point's own tolerance{slack}{least}; 95 % intervals"


def _write(page: Page, output_format: Format, out: Path | None) -> None:
    try:
        _print(page, output_format, out)
    except OSError as error:
        raise ProtocolError("malformed", f"cannot write {out}: {error.strerror}") from error


def _print(page: Page, output_format: Format, out: Path | None) -> None:
    if output_format is Format.TEXT:
        if out is None:
            Console().print(page.text())
        else:
            with out.open("w", encoding="utf-8") as file:
                Console(file=file, width=WIDTH).print(page.text())
        return
    text = page.markdown() if output_format is Format.MARKDOWN else json.dumps(page.plain(), indent=1) + "\n"
    if out is None:
        typer.echo(text, nl=False)
    else:
        out.write_text(text, encoding="utf-8")
