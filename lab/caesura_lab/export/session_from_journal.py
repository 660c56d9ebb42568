"""A session with its samples, results and time of day, read from its journal.

Time of day: samples have the session's clock, and the journal the time of day at which each batch arrived. A
batch cannot arrive before its last sample was taken, so the batch with the shortest delay gives the best
estimate of the time of day of session time 0; no sample is dated later than its arrival.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

from caesura_protocol.formats.mcap_schemas import TaskProgram
from caesura_protocol.messages import Open, Program
from caesura_protocol.recording import Recording, RecordingError
from caesura_service.config import DEFAULT_PRESET
from caesura_service.journal import Journal, JournalDamagedError, MemoryJournal, Outcome, Record
from caesura_service.offline_segmentation import recording_of
from caesura_service.ownership.registry import Registry
from caesura_service.ownership.takeover import is_current
from caesura_service.program_edits import log_of, with_edits
from caesura_service.publishing.events import Owner
from caesura_service.publishing.session_state import SessionState, program_of
from caesura_service.segmentation.pipeline import make_pipeline
from caesura_service.segmentation.pipeline_interface import PipelineView
from caesura_service.sessions.limits import Limits
from caesura_service.sessions.restored_outcome import view_from_snapshot


@dataclass(frozen=True)
class SessionExport:
    """A session to export: recording, results and time of day."""

    station: str
    opening: Open  # the last one, with its preset filled in
    recording: Recording  # as it was sent
    began_s: float  # [s] time of day at the session's time 0
    view: PipelineView
    program: TaskProgram  # as people edited it


def read_session_export(journal: Journal, station: str, session: str) -> SessionExport:
    """Read a session from a journal. Raises RecordingError where it has no samples, JournalError."""
    records = [_with_preset(record) for record in journal.replay(station, session)]
    recording = recording_of(records)
    outcome = _whole_outcome(journal, station, session)
    view, program = _result_of_records(records) if outcome is None else _result_of_outcome(outcome)
    opening = [record.message for record in records if isinstance(record.message, Open)][-1]
    began_s = max(recording.began_s or 0.0, math.ceil(-float(recording.t.min())))  # no sample before 1970
    return SessionExport(station, opening, recording, began_s, view, TaskProgram.of(program))


def _with_preset(record: Record) -> Record:
    """Return an opening with a preset: a service records its choice; other journals may have none."""
    message = record.message
    if not isinstance(message, Open) or message.preset is not None:
        return record
    return record._replace(message=message.model_copy(update={"preset": DEFAULT_PRESET}))


def _whole_outcome(journal: Journal, station: str, session: str) -> Outcome | None:
    """Return the stored outcome of a closed session, where it has all gaps and the last edit."""
    outcome = None
    with suppress(JournalDamagedError):  # its records have all that the outcome has
        outcome = journal.outcome(station, session)
    (copy,) = journal.copies(station, session)
    whole = outcome is not None and not outcome.snapshot.status.gaps_before and is_current(outcome, copy)
    return outcome if whole else None


def _result_of_outcome(outcome: Outcome) -> tuple[PipelineView, Program]:
    """Return the view and the edited program from the stored outcome of a closed session."""
    inferred = outcome.snapshot.program
    return view_from_snapshot(outcome.snapshot), with_edits(inferred, log_of(inferred))


def _result_of_records(records: Sequence[Record]) -> tuple[PipelineView, Program]:
    """Return the view and the edited program by replaying the records through the service."""
    state = _replayed_state(records)
    return state.view, program_of(state)


def _replayed_state(records: Sequence[Record]) -> SessionState:
    journal = MemoryJournal(sys.maxsize)  # they are in memory already
    for record in records:
        journal.append(record)
    registry = Registry(
        owner=Owner("export", 0),
        pipeline_factory=make_pipeline,
        default_preset=DEFAULT_PRESET,
        journal=journal,
        limits=Limits(),
    )
    for failed in registry.restore():
        raise RecordingError(f"{failed.station}/{failed.session} cannot be replayed: {failed.error}")
    (state,) = registry.index.all_states()
    return state
