"""Segments a recording without a network, in the same batches as a bridge would send.

The results equal those of a session over the network at its end, to the last bit.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.batching import Batcher
from caesura_protocol.codec import pack_samples, signals_of
from caesura_protocol.errors import ProtocolError
from caesura_protocol.lost_samples import losses_of, rows_after_losses
from caesura_protocol.messages import Close, Describe, Description, Edit, EditProgram, Open, SampleBatch
from caesura_protocol.programs.safety import UNSET, CellSettings
from caesura_protocol.recording import ASSUMED, Recording, RecordingError
from caesura_protocol.session_time_display import OF_DAY_S
from caesura_service.journal import Record
from caesura_service.segmentation.opening_layout import layout_of
from caesura_service.segmentation.pipeline import make_pipeline
from caesura_service.segmentation.pipeline_interface import PipelineView
from caesura_service.sessions.batch_validation import validated_samples
from caesura_service.sessions.limits import Limits
from caesura_service.signals import WrenchCapabilities

BATCH_SAMPLES = 20
AT_ONCE = 500  # batches that are taken at once where only the last view counts


def opening_of(recording: Recording, preset: str | None = None, setting: CellSettings = UNSET) -> Open:
    """Return the opening with which a bridge would send the recording.

    Values that `setting` leaves open are those of the recording.
    """
    return Open(
        session="file",
        columns=recording.columns,
        wrench_source=recording.wrench_source,
        hand_on_robot=recording.hand_on_robot,
        force_frame=recording.force_frame,
        length_unit=recording.length_unit,
        preset=preset,
        **setting.completed_by(recording.setting)._asdict(),
        declared_units=recording.declared_units,
        assumed=recording.assumptions,
    )


def capabilities_of(recording: Recording) -> WrenchCapabilities:
    """Return the capabilities of the recording's wrench. Raises ValueError for columns it cannot segment."""
    return layout_of(opening_of(recording)).source


def batches(recording: Recording, at_once: int = 1) -> Iterator[NDArray[np.float64] | None]:
    """Yield the samples (n, columns) of a recording in the batches that a service would receive.

    at_once: the number of batches that are joined. None where samples were lost. Raises ProtocolError
    `malformed`.
    """
    columns = recording.columns
    for number, part in enumerate(parts_of(recording)):
        if number:
            yield None
        batcher = Batcher(columns, BATCH_SAMPLES)
        received = (
            validated_samples(
                pack_samples(rows, columns, session="file", epoch=0, seq=seq), columns, Limits()
            )
            for seq, rows in enumerate([*batcher.push(part), *batcher.flush()])
        )
        while joined := [*islice(received, at_once)]:
            yield np.concatenate(joined)


def parts_of(recording: Recording) -> list[NDArray[np.float64]]:
    """Return the samples (n, columns) of a recording, divided where samples were lost.

    The first part is empty if they were lost before the first sample, the last one likewise.
    """
    return np.split(recording.matrix(), rows_after_losses(recording.t, recording.lost))


def views(
    recording: Recording,
    preset: str = "default",
    *,
    threshold: float | None = None,
    setting: CellSettings = UNSET,
    at_once: int = 1,
) -> Iterator[PipelineView]:
    """Yield the view after every batch of a recording, and a last one after its end.

    threshold: as for `make_pipeline`; at_once: as for `batches`, after which a view follows. Raises
    ProtocolError or ValueError for a preset, columns or values that cannot be segmented.
    """
    pipeline = make_pipeline(opening_of(recording, preset, setting), preset, threshold=threshold)
    taken = 0
    for samples in batches(recording, at_once):
        if samples is None:
            pipeline.declare_gap()
            continue
        try:
            pipeline.push(samples)
        except ValueError as error:
            raise ValueError(_counted_from(taken, str(error))) from error
        taken += len(samples)
        yield pipeline.view
    pipeline.finish()
    yield pipeline.view


def _counted_from(taken: int, error: str) -> str:
    """Return an error text whose sample is counted from the start of the recording, not of its batch."""
    return re.sub(r"^sample (\d+)", lambda found: f"sample {taken + int(found[1])}", error)


def recording_of(records: Iterable[Record]) -> Recording:
    """Return the samples of a session's records, in order, with losses, description and number of changes.

    Raises RecordingError without samples.
    """
    opening: Open | None = None
    description, changes, began_s = Description(), 0, math.inf
    last: int | None = None
    taken: dict[int, NDArray[np.float64]] = {}
    for record in records:
        match record.message:
            case Open():
                if opening is None:
                    description = record.message.description or description
                opening = record.message
            case Describe() as change:
                description = change.description
            case Edit() | EditProgram():
                changes += 1
            case Close(last_seq=seq, success=success):
                last = seq
                if success is not None:
                    description = description.model_copy(update={"success": success})
            case SampleBatch() as batch if opening is not None:
                with suppress(ProtocolError):  # it was refused when it came
                    taken[batch.seq] = samples = validated_samples(batch, opening.columns, Limits())
                    began_s = min(began_s, record.at - float(samples[:, 0].max()))
    if opening is None or not taken:
        raise RecordingError("the session has no samples")
    matrix = np.concatenate([taken[seq] for seq in sorted(taken)])
    return Recording(
        t=matrix[:, 0],
        signals=signals_of(opening.columns, matrix),
        wrench_source=opening.wrench_source,
        hand_on_robot=opening.hand_on_robot,
        force_frame=opening.force_frame,
        length_unit=opening.length_unit,
        declared_units=opening.declared_units,
        assumed=tuple(ASSUMED[key] for key in opening.assumed),
        setting=CellSettings(*(getattr(opening, name) for name in CellSettings._fields)),
        name=opening.session,
        lost=losses_of({seq: (float(one[0, 0]), float(one[-1, 0])) for seq, one in taken.items()}, last),
        description=description,
        changes=changes,
        began_s=began_s if began_s >= OF_DAY_S else None,
    )


def segment_recording(
    recording: Recording,
    preset: str = "default",
    *,
    threshold: float | None = None,
    setting: CellSettings = UNSET,
    progress: Callable[[int], None] = lambda samples: None,
) -> PipelineView:
    """Segment a whole recording. progress: called with the number of samples processed. Raises as `views`."""
    for view in views(recording, preset, threshold=threshold, setting=setting, at_once=AT_ONCE):
        progress(view.samples)
    return view


def as_json(view: PipelineView) -> dict[str, Any]:
    """Return the view as plain values, for scripts."""
    return {
        "segments": [segment.model_dump(mode="json") for segment in view.segments],
        "phases": [phase.model_dump(mode="json") for phase in view.phases],
        "changepoints": [changepoint.model_dump(mode="json") for changepoint in view.changepoints],
        "program": [app.model_dump(mode="json") for app in view.apps],
        "force_limit_n": view.force_limit_n,
        "robot": view.robot,
        "up": view.up,
        "notes": list(view.notes),
        "gaps": [gap.model_dump(mode="json") for gap in view.gaps],
        "wrench": view.wrench.model_dump(mode="json"),
        "delay_s": view.delay_s,
        "samples": view.samples,
        "repeats": view.repeats,
        "observations": view.observations,
    }
