"""Messages for tests, taken from the golden vectors, and a source that needs no robot."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TypeVar

import numpy as np

from caesura_clients.session_state_reader import Update
from caesura_protocol.codec import decode, encoding_of
from caesura_protocol.messages import Changepoint, Message, Segment, Segments, Snapshot
from caesura_protocol.recording import Recording

VECTORS = Path(__file__).resolve().parents[1] / "vectors"
M = TypeVar("M", bound=Message)


def example(model: type[M]) -> M:
    """The golden example of a message."""
    payload = (VECTORS / f"{model.__name__}.msgpack").read_bytes()
    return decode(payload, encoding_of(model), model)


def segment(kind: str, t0: float = 0.0) -> Segment:
    return example(Segment).model_copy(update={"kind": kind, "t0": t0, "tn": t0 + 1.0})


def changepoint(t: float) -> Changepoint:
    return example(Changepoint).model_copy(update={"t": t})


def segments(seq: int, first: int, *kinds: str, **changes: object) -> Segments:
    update = {"seq": seq, "first": first, "segments": tuple(map(segment, kinds)), **changes}
    return example(Segments).model_copy(update=update)


def snapshot(seq: int, *kinds: str, **changes: object) -> Snapshot:
    """A snapshot whose segments have these kinds, all streams at `seq`; changes go into every result."""
    whole = example(Snapshot)
    state = changes.pop("state", "open")
    common = {"seq": seq, **changes}
    parts = {
        "status": whole.status.model_copy(update={**common, "state": state}),
        "changepoints": whole.changepoints.model_copy(update={**common, "first": 0, "changepoints": ()}),
        "segments": segments(seq, 0, *kinds, **changes),
        "posterior": None,
        "program": whole.program.model_copy(update=changes),
        "hints": None,
    }
    return whole.model_copy(update=parts)


def recording(samples: int = 1000, rate_hz: float = 1000.0) -> Recording:
    """A hand that moves along x; every sample differs."""
    t = np.arange(samples) / rate_hz
    pos = np.column_stack([0.1 * t, np.zeros(samples), np.full(samples, 0.3)])
    return Recording(
        t=t, signals={"pos": pos, "force": np.zeros((samples, 3))}, wrench_source="flange_sensor"
    )


class LiveSource:
    """A robot that cannot wait, and says what it is told to say."""

    columns = ("t", "px", "py", "pz")
    declared_units = ("length",)  # positions that count the samples
    wrench_source = "none"
    force_frame = "base"
    length_unit = "m"
    can_wait = False

    def __init__(self, chunks: list[np.ndarray] | None = None) -> None:
        self._chunks = chunks or []

    def chunks(self) -> Iterator[np.ndarray]:
        yield from self._chunks


def samples(count: int, t0: float = 0.0, rate_hz: float = 1000.0) -> np.ndarray:
    """(count, 4) samples of a LiveSource."""
    t = t0 + np.arange(count) / rate_hz
    return np.column_stack([t, t, t, t])


def until_complete(updates: Iterable[Update]) -> Update:
    """The first one of a session that is over, with its whole program."""
    return next(update for update in updates if update.closed and update.program.complete)
