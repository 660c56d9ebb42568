"""Judges every method on every case. Worker processes load the cases, so that no large data is sent."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeVar

from caesura_lab.evaluation.baselines.conditioned_signals import grid_signals
from caesura_lab.evaluation.cases.suites import Case
from caesura_lab.evaluation.methods import Method
from caesura_lab.evaluation.scoring.score import Score, score
from caesura_lab.evaluation.worker_pool import each
from caesura_lab.ground_truth import ToleranceOptions, Truth, TruthError
from caesura_protocol.errors import ProtocolError
from caesura_protocol.recording import RecordingError

AS_READ = ToleranceOptions()


@dataclass(frozen=True)
class NotApplicable:
    """A method that could not be applied to a recording, with the reason."""

    method: str
    recording: str
    reason: str


@dataclass(frozen=True)
class RefusedRecording:
    """A recording without verdicts: it or its annotation cannot be read. reason: names the file."""

    reason: str


Verdict = Score | NotApplicable
Result = TypeVar("Result")


def judge(
    case: Case, methods: Sequence[Method], tolerance_options: Sequence[ToleranceOptions] = (AS_READ,)
) -> list[Verdict]:
    """Apply all methods to one case, once each, and score their results under every tolerance.

    Raises TruthError or RecordingError for a case that cannot be loaded or conditioned.
    """
    recording, truth = case.load()
    try:
        rest = "rests first" if grid_signals(recording).tared else "does not rest first"
    except ValueError as error:  # no observations, or a frame of the force that cannot be turned
        raise RecordingError(f"{case.name}: {str(error).removeprefix(f'{recording.name}: ')}") from error
    groups = tuple(dict.fromkeys(filter(None, (truth.robot, case.group))))
    about: dict[str, Any] = {
        "tags": (*case.tags, rest),
        "groups": groups,
        "subject": _subject(case, truth),
        "cautions": (*recording.cautions, *recording.doubts),
    }
    verdicts: list[Verdict] = []
    for method in methods:
        try:
            found = method.segment(recording)
        except RecordingError:
            raise
        except (ProtocolError, ValueError) as error:
            verdicts.append(NotApplicable(method.name, case.name, str(error)))
        else:
            for tolerance_option in tolerance_options:
                one = score(method.name, tolerance_option.apply_to(truth), found)
                verdicts.append(replace(one, **about, slack_s=tolerance_option.slack_s))
    return verdicts


def _subject(case: Case, truth: Truth) -> str:
    """Return the demonstration that the annotation names, because it may be in several files."""
    stated = "" if truth.source is None else truth.source.demonstration
    return stated or case.subject


def judge_all(
    cases: Sequence[Case],
    methods: Sequence[Method],
    tolerance_options: Sequence[ToleranceOptions] = (AS_READ,),
    *,
    workers: int = 1,
) -> Iterator[list[Verdict] | RefusedRecording]:
    """Yield the verdicts on each case, or why it cannot be read, in no order.

    With more than one worker, in processes.
    """
    return each_or_refused(
        partial(judge, methods=methods, tolerance_options=tolerance_options), cases, workers=workers
    )


def each_or_refused(
    work: Callable[[Case], Result], cases: Sequence[Case], *, workers: int = 1
) -> Iterator[Result | RefusedRecording]:
    """Yield the result of `work` for each case, or why it cannot be read, in no order."""
    return each(partial(_or_refused, work), cases, workers=workers)


def _or_refused(work: Callable[[Case], Result], case: Case) -> Result | RefusedRecording:
    try:
        return work(case)
    except (TruthError, RecordingError) as error:
        return RefusedRecording(str(error))
