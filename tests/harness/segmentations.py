"""Segmentations of whole recordings, made once a version: equal recordings have equal results, to the bit."""

from __future__ import annotations

from functools import wraps
from typing import Any

from caesura_service.offline_segmentation import segment_recording
from caesura_service.segmentation.encoded_log import MessageSequence
from caesura_service.segmentation.pipeline_interface import PipelineView
from harness.once import once_a_version


@wraps(segment_recording)
def _segmented(*args: Any, **options: Any) -> PipelineView:
    """Without the file in which a pipeline may keep its results."""
    view = segment_recording(*args, **options)
    kept = {name: tuple(one) for name, one in view._asdict().items() if isinstance(one, MessageSequence)}
    return view._replace(**kept)


segmented = once_a_version(_segmented)
