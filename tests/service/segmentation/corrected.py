"""A demonstration of `data/` in the pipeline, and corrections of it."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from caesura_protocol.errors import ProtocolError
from caesura_protocol.formats.read import load_recording
from caesura_protocol.messages import (
    Action,
    Edit,
    Open,
)
from caesura_service.offline_segmentation import batches, opening_of
from caesura_service.segmentation.pipeline import make_pipeline
from caesura_service.segmentation.pipeline_interface import Pipeline, PipelineView

DATA = Path(__file__).parents[3] / "data"
SHORT = 400  # batches of a demonstration that has not ended


@cache
def taught(name: str = "pick_and_place") -> tuple[Open, list[NDArray[np.float64]]]:
    recording = load_recording(DATA / f"{name}.npz")
    return opening_of(recording, "default"), list(batches(recording))


def begun(name: str = "pick_and_place", threshold: float | None = None) -> Pipeline:
    return make_pipeline(taught(name)[0], "default", threshold=threshold)


def fed(pipeline: Pipeline, numbers: range, name: str = "pick_and_place", lost: range = range(0)) -> Pipeline:
    for number in numbers:
        if number in lost:
            pipeline.declare_gap()
        else:
            pipeline.push(taught(name)[1][number])
    return pipeline


@cache
def whole(name: str = "pick_and_place", lost: range = range(0)) -> Pipeline:
    pipeline = fed(begun(name), range(len(taught(name)[1])), name, lost)
    pipeline.finish()
    return pipeline


def edit(action: Action) -> Edit:
    return Edit(session="s1", revision=0, author="Ann", action=action)


@cache
def with_one(pipeline: Pipeline, action: Any) -> PipelineView:
    return pipeline.corrected([pipeline.resolve(action)]).view


def times(view: PipelineView) -> list[float]:
    return [one.t for one in view.changepoints]


def refusal(pipeline: Pipeline, action: Any) -> ProtocolError:
    with pytest.raises(ProtocolError) as caught:
        pipeline.resolve(action)
    return caught.value
