"""`caesura evaluate`: scores a segmentation against the truth, and compares it with other methods."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence, Sized
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer
from rich.console import Console, RenderableType
from rich.progress import MofNCompleteColumn, Progress

from caesura_clients.cli.options import AngleUnit, ForceFrame, ForceUnit, TimeUnit, UpOption, reported
from caesura_lab.evaluation.cases.suites import (
    AS_STATED,
    OPEN,
    SUITES,
    TAUGHT,
    Case,
    ReadingOptions,
    SuiteOptions,
    files,
    missing_recordings,
    suite,
)
from caesura_lab.evaluation.methods import Method, MissingExtraError, PresetMethod, baselines
from caesura_lab.evaluation.reports import calibration, reliability_diagram
from caesura_lab.evaluation.reports.calibration import calibrate
from caesura_lab.evaluation.reports.report import as_json, report
from caesura_lab.evaluation.reports.tables import as_markdown, as_text
from caesura_lab.evaluation.runner import RefusedRecording, Verdict, each_or_refused, judge_all
from caesura_lab.evaluation.scoring.score import Score
from caesura_lab.evaluation.studies import motion_library_evidence as libraries
from caesura_lab.evaluation.worker_pool import each
from caesura_lab.ground_truth import ToleranceOptions, TruthError
from caesura_protocol.command_line_advice import at_command_line
from caesura_protocol.errors import CaesuraError, ProtocolError
from caesura_protocol.number_words import counted
from caesura_protocol.package_version_and_extras import import_extra, install_command
from caesura_protocol.programs.document_timing import RunSpeed
from caesura_protocol.recording import RecordingError
from caesura_protocol.robots import robot_description
from caesura_service.changepoint.presets import KNOWN_PRESETS, WITHOUT

DEFAULT_PRESET = "default"
DEFAULT_PRESETS = [DEFAULT_PRESET, "integrated"]
WORKERS = 2
WIDTH = 90  # [characters] of text in a file
THESIS, ROUNDTRIP, REALISM, COACHING = "thesis", "roundtrip", "realism", "coaching"
ALL_SUITES = [*SUITES, THESIS, ROUNDTRIP, REALISM, COACHING]
SEEDS, THESIS_SEEDS, COACHING_SEEDS = 5, 20, 3
SLACK_S = 0.2
WIDEST_S = 10.0  # of a tolerance: beyond it every changepoint of a segment is right
DATA_VARIABLE = "CAESURA_REAL_DATA"

R = TypeVar("R")


@dataclass(frozen=True)
class ResultPage:
    """Results that can be written in each format."""

    text: Callable[[], RenderableType]
    markdown: Callable[[], str]
    plain: Callable[[], dict[str, Any]]
    unmet: Sequence[str] = ()  # bars of the suite that are not met, as text
    refused: str = ""  # how many recordings were refused, as text


@dataclass(frozen=True)
class SuiteVerdicts:
    """Verdicts of named methods, notes on missing recordings, and how many were refused, as text."""

    title: str
    methods: list[str]
    verdicts: list[Verdict]
    missing: list[str]
    refused: str


class Format(StrEnum):
    """The format in which results are written."""

    TEXT = "text"
    MARKDOWN = "markdown"
    JSON = "json"


def evaluate(
    recordings: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[FILES]...", help="Annotated recordings or bags, or directories of them."),
    ] = None,
    *,
    suite_name: Annotated[
        str | None,
        typer.Option("--suite", help=f"Name of a suite, instead of files: {', '.join(ALL_SUITES)}."),
    ] = None,
    seeds: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Number of simulated people for each scenario.",
            show_default=f"{SEEDS}, thesis and roundtrip {THESIS_SEEDS}, coaching {COACHING_SEEDS}",
        ),
    ] = None,
    first_seed: Annotated[int, typer.Option(min=0, help="Seed of the first simulated person.")] = 1,
    robot: Annotated[
        str | None,
        typer.Option(
            help=f"The arm of the suites {', '.join(TAUGHT)} and {ROUNDTRIP}.", show_default="panda"
        ),
    ] = None,
    speed: Annotated[
        RunSpeed,
        typer.Option(help="Speed of the suite roundtrip: taught, or the fastest within the arm's limits."),
    ] = "taught",
    data: Annotated[
        Path,
        typer.Option(
            help="Directory of the recordings, for suites of recordings.",
            envvar=DATA_VARIABLE,
            show_default="data/real",
        ),
    ] = OPEN,
    preset: Annotated[list[str] | None, typer.Option(help="Preset to evaluate; may be repeated.")] = None,
    with_baselines: Annotated[
        bool, typer.Option("--baselines/--no-baselines", help="Evaluate other methods, too.")
    ] = True,
    tolerance: Annotated[
        float,
        typer.Option(
            min=0.0,
            max=WIDEST_S,
            help="Smallest tolerance \\[s]; smaller ones of annotated points are raised to it.",
        ),
    ] = 0.0,
    slack: Annotated[
        float,
        typer.Option(
            min=0.0,
            max=WIDEST_S,
            help="Seconds that a second set of results adds to the tolerance of each point, before "
            "--tolerance. 0: no second set.",
        ),
    ] = SLACK_S,
    ablate: Annotated[
        bool,
        typer.Option("--ablate", help="Evaluate default, and variants that each lack one of its models."),
    ] = False,
    confusion: Annotated[
        bool, typer.Option("--confusion", help="Show the presets' class confusion and typical errors.")
    ] = False,
    calibrated: Annotated[
        bool,
        typer.Option("--calibration", help="Compare the presets' stated probabilities with the truth."),
    ] = False,
    diagram_file: Annotated[
        Path | None,
        typer.Option("--diagram", help="File for the diagram of --calibration: .svg, .png or .pdf."),
    ] = None,
    evidence: Annotated[
        bool, typer.Option("--evidence", help="Compare motion libraries by log evidence, without the truth.")
    ] = False,
    mutated: Annotated[
        int | None,
        typer.Option(
            "--mutations",
            min=1,
            help="Suite roundtrip: check and run this number of corrupted programs instead.",
        ),
    ] = None,
    output_format: Annotated[Format, typer.Option("--format", help="Format of the output.")] = Format.TEXT,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Write to this file.")] = None,
    mapping: Annotated[
        Path | None, typer.Option(help="Names and units in a csv or rosbag2 of other software.")
    ] = None,
    force_frame: ForceFrame = None,
    length_unit: Annotated[
        str | None, typer.Option(metavar="UNIT", help="Unit of positions: m, cm, mm; overrides the file.")
    ] = None,
    time_unit: TimeUnit = None,
    angle_unit: AngleUnit = None,
    force_unit: ForceUnit = None,
    up: UpOption = None,
    workers: Annotated[int, typer.Option(min=1, help="Number of processes.")] = WORKERS,
) -> None:
    """Compare segmentations with the truth: boundaries, classes, delays, load and force.

    The exit code is 1 if a recording is refused. All others are evaluated.
    """
    with reported():
        try:
            _check_calibration(
                suite_name, calibrated=calibrated, otherwise=ablate or evidence, file=diagram_file
            )
            _check_robot(robot, suite_name)
            _check_speed(speed, suite_name, spoilt=mutated is not None)
            reading = ReadingOptions(mapping, force_frame, length_unit, time_unit, angle_unit, force_unit, up)
            _check_reading(reading, suite_name)
            extent = SuiteOptions(seeds or SEEDS, first_seed, data, robot=robot)
            if evidence:
                cases = _cases(recordings or [], suite_name, extent, reading, known=list(SUITES))
                page = _evidence_page(suite_name, cases, missing_recordings(suite_name, extent), workers)
            elif suite_name == ROUNDTRIP and not recordings:
                people = range(first_seed, first_seed + (seeds or THESIS_SEEDS))
                page = (
                    _round_trip_page(people, robot or "panda", speed, workers)
                    if mutated is None
                    else _mutation_page(mutated, workers)
                )
            elif (other := OTHER_SUITES.get(suite_name or "")) and not recordings:
                made, usual_seeds = other
                page = made(data, range(first_seed, first_seed + (seeds or usual_seeds)), workers)
            else:
                cases = _cases(recordings or [], suite_name, extent, reading)
                if calibrated:
                    methods = _methods(preset or [DEFAULT_PRESET], with_baselines=False)
                elif ablate:
                    methods = _ablated()
                else:
                    methods = _methods(preset or DEFAULT_PRESETS, with_baselines=with_baselines)
                judged = _judged(
                    cases,
                    methods,
                    tolerance=tolerance,
                    slack=slack,
                    suite_name=suite_name,
                    missing=missing_recordings(suite_name, extent),
                    workers=workers,
                )
                if calibrated:
                    page = _calibration(judged, diagram_file)
                else:
                    page = _page(judged, (preset or DEFAULT_PRESETS) if confusion else [])
        except (TruthError, RecordingError, MissingExtraError) as error:
            raise ProtocolError("malformed", str(error)) from error
        _write(page, output_format, out)


def _judged(
    cases: Sequence[Case],
    methods: Sequence[Method],
    *,
    tolerance: float,
    slack: float,
    suite_name: str | None,
    missing: Sequence[str],
    workers: int,
) -> SuiteVerdicts:
    """Judge every method on every case, without slack and with it; warn of what recordings lack."""
    tolerance_options = [ToleranceOptions(s, tolerance) for s in sorted({0.0, slack})]
    results, refused = _accepted(judge_all(cases, methods, tolerance_options, workers=workers), cases)
    judged = SuiteVerdicts(
        title=_title(suite_name, len(cases) - len(refused), tolerance),
        methods=[method.name for method in methods],
        verdicts=[verdict for some in results for verdict in some],
        missing=[*missing, *_left_out(refused)],
        refused=_refused_words(len(refused), len(cases)),
    )
    if suite_name in {None, "real"}:  # the others change recordings, or make them
        _warn(judged.verdicts)
    return judged


# The suites below import a second's worth of scipy, which every command would wait for.


def _thesis_page(_data: Path, seeds: range, workers: int) -> ResultPage:
    from caesura_lab.evaluation.thesis import suite as thesis  # noqa: PLC0415
    from caesura_lab.evaluation.thesis import suite_tables  # noqa: PLC0415
    from caesura_lab.evaluation.thesis import summary as thesis_summary  # noqa: PLC0415

    tasks = thesis.tasks(seeds)
    result = thesis_summary.summarise(_with_progress(each(thesis.run_task, tasks, workers=workers), tasks))
    title = suite_tables.title(seeds)
    return ResultPage(
        text=lambda: suite_tables.as_text(result, title),
        markdown=lambda: suite_tables.as_markdown(result, title),
        plain=lambda: {"title": title, "settings": thesis_summary.as_json(result)},
    )


def _round_trip_page(seeds: range, robot: str, speed: RunSpeed, workers: int) -> ResultPage:
    from caesura_lab.evaluation.programs import program_round_trip  # noqa: PLC0415

    cases = program_round_trip.cases(seeds, robot, speed)
    summary = program_round_trip.summarise(
        _with_progress(each(program_round_trip.run_round_trip, cases, workers=workers), cases)
    )
    title = program_round_trip.title(seeds, robot, speed)
    return ResultPage(
        text=lambda: program_round_trip.page(summary, title).as_text(),
        markdown=lambda: program_round_trip.page(summary, title).as_markdown(),
        plain=lambda: {"title": title, "trips": program_round_trip.as_json(summary)},
    )


def _realism_page(data: Path, seeds: range, workers: int) -> ResultPage:
    from caesura_lab.evaluation.studies import realism  # noqa: PLC0415

    return _suite_page(realism, realism.load, realism.cases(data, seeds), seeds, workers)


def _coaching_page(data: Path, seeds: range, workers: int) -> ResultPage:
    from caesura_lab.evaluation.hints import hint_recall  # noqa: PLC0415

    return _suite_page(hint_recall, hint_recall.run, hint_recall.cases(seeds, data), seeds, workers)


def _suite_page(
    suite: Any, run: Callable[[Any], object], cases: Sequence[Any], seeds: range, workers: int
) -> ResultPage:
    """Return the page of a suite: a module with `summarise`, `title`, `page` and `as_json`.

    A suite with bars has `unmet` too.
    """
    result = suite.summarise(_with_progress(each(run, cases, workers=workers), cases))
    title = suite.title(seeds)
    return ResultPage(
        text=lambda: suite.page(result, title).as_text(),
        markdown=lambda: suite.page(result, title).as_markdown(),
        plain=lambda: {"title": title, **suite.as_json(result)},
        unmet=suite.unmet(result) if hasattr(suite, "unmet") else (),
    )


#: Suites in which no methods are compared: what makes their page, and how many people there usually are.
OTHER_SUITES: Mapping[str, tuple[Callable[[Path, range, int], ResultPage], int]] = {
    THESIS: (_thesis_page, THESIS_SEEDS),
    REALISM: (_realism_page, SEEDS),
    COACHING: (_coaching_page, COACHING_SEEDS),
}


def _mutation_page(count: int, workers: int) -> ResultPage:
    from caesura_lab.evaluation.programs import program_mutations  # noqa: PLC0415

    numbers = range(count)
    fates = list(_with_progress(each(program_mutations.run_mutation, numbers, workers=workers), numbers))
    return ResultPage(
        text=lambda: program_mutations.page(fates).as_text(),
        markdown=lambda: program_mutations.page(fates).as_markdown(),
        plain=lambda: program_mutations.as_json(fates),
    )


def _evidence_page(
    suite_name: str | None, cases: Sequence[Case], missing: Sequence[str], workers: int
) -> ResultPage:
    results, refused = _accepted(each_or_refused(libraries.library_evidence, cases, workers=workers), cases)
    evidences = libraries.sorted_by_recording(results)
    title = libraries.title(f"suite {suite_name}" if suite_name else "files", evidences)
    notes = [*missing, *_left_out(refused)]
    return ResultPage(
        text=lambda: libraries.page(evidences, title, notes).as_text(),
        markdown=lambda: libraries.page(evidences, title, notes).as_markdown(),
        plain=lambda: libraries.as_json(evidences, title, notes),
        refused=_refused_words(len(refused), len(cases)),
    )


def _page(judged: SuiteVerdicts, detailed: Sequence[str]) -> ResultPage:
    result = report(judged.title, judged.methods, judged.verdicts, judged.missing)
    return ResultPage(
        text=lambda: as_text(result, detailed=detailed),
        markdown=lambda: as_markdown(result, detailed=detailed),
        plain=lambda: as_json(result),
        refused=judged.refused,
    )


def _calibration(judged: SuiteVerdicts, diagram_file: Path | None) -> ResultPage:
    result = calibrate(judged.title, judged.methods, judged.verdicts, judged.missing)
    if diagram_file is not None:
        _draw(result, diagram_file)
    return ResultPage(
        text=lambda: calibration.as_text(result),
        markdown=lambda: calibration.as_markdown(result),
        plain=lambda: calibration.as_json(result),
        refused=judged.refused,
    )


def _check_calibration(
    suite_name: str | None, *, calibrated: bool, otherwise: bool, file: Path | None
) -> None:
    """Check that a calibration can be made before anything is judged. Raises TruthError.

    otherwise: whether --ablate or --evidence ask for another comparison; file: of the diagram.
    """
    if calibrated and (otherwise or suite_name not in (None, *SUITES)):
        raise TruthError(
            f"--calibration judges presets on files or on a suite of {', '.join(SUITES)}, "
            "without --ablate or --evidence"
        )
    if file is not None and not calibrated:
        raise TruthError(f"--diagram {file} draws a calibration: add --calibration")
    if file is not None and file.suffix.lower() not in reliability_diagram.SUFFIXES:
        raise TruthError(
            f"{file}: suffix {file.suffix!r}, expected one of {', '.join(reliability_diagram.SUFFIXES)}"
        )


def _check_robot(robot: str | None, suite_name: str | None) -> None:
    """Check that a named robot is known and can be simulated. Raises RobotError or TruthError."""
    if robot is None:
        return
    robot_description(robot)
    if suite_name not in {*TAUGHT, ROUNDTRIP}:
        suites = [*TAUGHT, ROUNDTRIP]
        raise TruthError(f"--robot {robot} is for a --suite of {suites}, in which a robot is simulated")


def _check_speed(speed: RunSpeed, suite_name: str | None, *, spoilt: bool) -> None:
    """Check that programs run at a speed. Raises CaesuraError; spoilt: whether mutated programs are run."""
    if speed == "taught":
        return
    if suite_name != ROUNDTRIP or spoilt:
        raise TruthError(f"--speed {speed} is for --suite {ROUNDTRIP} without --mutations")
    with import_extra("retiming", f"the speed {speed}"):
        import caesura_lab.retiming  # noqa: F401, PLC0415


def _check_reading(reading: ReadingOptions, suite_name: str | None) -> None:
    """Check that options of files are given with files. Raises TruthError."""
    given = [f"--{name.replace('_', '-')} {value}" for name, value in reading._asdict().items() if value]
    if given and suite_name is not None:
        raise TruthError(f"{given[0]} is for files, and --suite {suite_name} reads its own")


def _draw(result: calibration.CalibrationReport, file: Path) -> None:
    try:
        reliability_diagram.write(result, file)
    except ModuleNotFoundError as error:
        message = f"{error.name} is not installed; {install_command('report')}, or leave out --diagram"
        raise MissingExtraError(message) from error
    except OSError as error:
        raise ProtocolError("malformed", f"cannot write {file}: {error.strerror}") from error


def _ablated() -> list[Method]:
    return [PresetMethod(name) for name in (DEFAULT_PRESET, *WITHOUT)]


def _methods(presets: Sequence[str], *, with_baselines: bool) -> list[Method]:
    unknown = sorted(set(presets) - set(KNOWN_PRESETS))
    if unknown:
        raise ProtocolError("malformed", "unknown preset", value=unknown[0], expected=list(KNOWN_PRESETS))
    own: list[Method] = [PresetMethod(name) for name in dict.fromkeys(presets)]
    return [*own, *(baselines() if with_baselines else [])]


def _cases(
    recordings: Sequence[Path],
    suite_name: str | None,
    extent: SuiteOptions,
    reading: ReadingOptions = AS_STATED,
    *,
    known: Sequence[str] = ALL_SUITES,
) -> list[Case]:
    if bool(recordings) == (suite_name is not None):
        raise TruthError(f"name either files or one --suite of {', '.join(known)}")
    if suite_name is not None and suite_name not in SUITES:
        raise TruthError(f"no suite {suite_name!r}, known: {', '.join(known)}")
    if suite_name is not None:
        return suite(suite_name, extent)
    return files(recordings, reading)


def _accepted(results: Iterator[R | RefusedRecording], cases: Sequence[Case]) -> tuple[list[R], list[str]]:
    """Return the results, and why recordings were refused. Raises TruthError if all were."""
    found = list(_with_progress(results, cases))
    refused = sorted(one.reason for one in found if isinstance(one, RefusedRecording))
    for reason in refused if len(refused) < len(found) else refused[1:]:
        typer.echo(f"error: {reason}", err=True)
    if len(refused) == len(found):
        raise TruthError(refused[0])
    return [one for one in found if not isinstance(one, RefusedRecording)], refused


def _left_out(refused: Sequence[str]) -> list[str]:
    return [f"left out: {reason}" for reason in refused]


def _refused_words(refused: int, of: int) -> str:
    return f"{refused} of {counted(of, 'recording')} refused" if refused else ""


def _with_progress(results: Iterator[R], of: Sized) -> Iterator[R]:
    """Yield the results, with a progress bar."""
    columns = (*Progress.get_default_columns(), MofNCompleteColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        yield from progress.track(results, total=len(of), description="judging")


def _warn(verdicts: Sequence[Verdict]) -> None:
    """Print the warnings on each recording once, as `caesura segment` does."""
    scores = sorted((one for one in verdicts if isinstance(one, Score)), key=lambda one: one.recording)
    said = (f"warning: {one.recording}: {caution}" for one in scores for caution in one.cautions)
    for line in dict.fromkeys(said):
        typer.echo(at_command_line(line), err=True)


def _title(suite_name: str | None, count: int, least_s: float) -> str:
    what = f"suite {suite_name}" if suite_name else "files"
    least = f", at least {least_s:g} s" if least_s else ""
    intervals = "; 95 % intervals" if count > 1 else ""
    return f"{what}: {counted(count, 'recording')}, each point's own tolerance{least}{intervals}"


def _write(page: ResultPage, output_format: Format, out: Path | None) -> None:
    """Write a page. Raises CaesuraError afterwards for unmet bars of the suite, and refused recordings."""
    try:
        _print(page, output_format, out)
    except OSError as error:
        raise ProtocolError("malformed", f"cannot write {out}: {error.strerror}") from error
    if page.unmet:
        raise CaesuraError(f"not met: {'; '.join(page.unmet)}")
    if page.refused:
        raise CaesuraError(page.refused)


def _print(page: ResultPage, output_format: Format, out: Path | None) -> None:
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
