"""A pipeline without a filter, for tests of its surroundings: a changepoint at every jump.

It reads the second column of every tenth sample, and ends a segment where this jumps by more than one half.
Like the real one it is pure, and revises its results: the last changepoint stays provisional until the next
one.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import App, Change, Changepoint, Gap, Insert, Open, Segment, WrenchReport
from caesura_service.segmentation.corrections import ResolvedEdit
from caesura_service.segmentation.pipeline_interface import Pipeline, PipelineView

PRESETS = ("fake", "default", "raising", "raising-at-the-end", "unspeakable")
STRIDE = 10  # samples an observation
JUMP = 0.5
BROKEN_AT = 13.0  # a value that the preset `raising` breaks at
IMPOSSIBLE = -1.0  # a value that a robot cannot send
_ORIGIN = (0.0, 0.0, 0.0)
_KEPT = 1 << 14  # messages of the longest session of a test: each view has all of them again


def make_fake_pipeline(opening: Open, default_preset: str) -> Pipeline:
    """Return a FakePipeline. Raises ProtocolError for a preset that is not one of PRESETS."""
    preset = opening.preset or default_preset
    if preset not in PRESETS:
        raise ProtocolError("malformed", "unknown preset", value=preset, expected=list(PRESETS))
    report = WrenchReport(
        source=opening.wrench_source or "none",
        stated=opening.wrench_source is not None,
        contact_models=False,
        transport_models=False,
        tare=None,
        note="fake",
    )
    return FakePipeline(preset, report)


@dataclass
class FakePipeline:
    """Changepoints at jumps of the second column."""

    preset: str
    wrench: WrenchReport
    t: float = float("-inf")
    samples: int = 0
    repeats: int = 0
    observations: int = 0
    jumps: tuple[float, ...] = ()
    inserted: tuple[float, ...] = ()
    gaps: tuple[Gap, ...] = ()
    finished: bool = False
    _start: float = 0.0
    _value: float | None = None
    _last_t: float | None = None
    _gap_pending: bool = False
    _digest: float = field(default=0.0)

    @property
    def view(self) -> PipelineView:
        """The view of the samples so far."""
        return PipelineView(
            t=self.t,
            samples=self.samples,
            repeats=self.repeats,
            observations=self.observations,
            changepoints=self._changepoints(),
            segments=self._segments(),
            posterior_starts=(self._start, self._latest_start()),
            posterior_probabilities=(0.75, 0.25),
            apps=self._apps(),
            notes=(),
            gaps=self.gaps,
            wrench=self.wrench,
            delay_s=0.1,
            hypotheses=2,
            capped=0,
        )

    @property
    def due_s(self) -> float:
        """Always −inf, because every sample may change the view."""
        return float("-inf")

    def push(self, samples: NDArray[np.float64]) -> bool:
        """Process samples (n, columns). Raises ValueError for IMPOSSIBLE ones, and then changes nothing."""
        if (samples[:, 1] == IMPOSSIBLE).any():
            raise ValueError(f"px is {IMPOSSIBLE}, expected what a robot can send")
        for row in samples:
            self._push_one(float(row[0]), float(row[1]))
        return True

    def push_without_program(self, samples: NDArray[np.float64]) -> bool:
        """Push samples; the program is made at once."""
        return self.push(samples)

    has_due_program = False

    def make_due_program(self) -> None:
        """Make nothing, because every push makes its program."""

    def declare_gap(self) -> None:
        """Record a gap, which ends at the next sample, or at the end."""
        self._gap_pending = True

    def refresh(self) -> None:
        """Change nothing, because the view is always up to date."""

    @property
    def kinds(self) -> Sequence[str]:
        """The only kind of segment, a motion."""
        return ("motion",)

    def resolve(self, change: Change) -> ResolvedEdit:
        """Return a jump to insert. Raises ProtocolError for another correction or a time without samples."""
        if not isinstance(change, Insert):
            raise ProtocolError("conflict", "the fake inserts only", value=change.do)
        if not 0.0 <= change.t <= self.t:
            raise ProtocolError("malformed", "outside", value=change.t, limit=[0.0, max(self.t, 0.0)])
        return ResolvedEdit(inserted=change.t)

    def observation_at(self, t: float) -> int:
        """Return -1, because no correction of the fake refers to another."""
        return -1

    def corrected(self, corrections: Sequence[ResolvedEdit]) -> FakePipeline:
        """Return a pipeline with the jumps that these corrections insert."""
        return replace(self, inserted=tuple(one.inserted for one in corrections if one.inserted is not None))

    def finish(self) -> None:
        """Make everything final. Raises RuntimeError in the preset `raising-at-the-end`."""
        if self.preset == "raising-at-the-end":
            raise RuntimeError("cannot finish")
        self.observations += self.preset == "unspeakable"
        self.finished = True
        if self._gap_pending and self._last_t is not None:
            self._end_gap(self._last_t)

    @property
    def _all(self) -> tuple[float, ...]:
        return tuple(sorted({*self.jumps, *self.inserted}))

    def _latest_start(self) -> Any:
        """Return the newest start [s]; in the preset `unspeakable`, later a value that no message accepts."""
        return "now" if self.preset == "unspeakable" and self.observations > 2 else max(self.t, 0.0)

    def _push_one(self, t: float, value: float) -> None:
        if self.preset == "raising" and value == BROKEN_AT:
            raise RuntimeError(f"cannot stand {value}")
        if self._last_t is None:
            self._start = t
        elif t <= self._last_t:
            self.repeats += 1
            return
        if self._gap_pending:
            self._end_gap(t)
        self._last_t = t
        self.samples += 1
        self._digest = 0.9 * self._digest + value  # order matters, so a test sees a wrong one
        if self.samples % STRIDE == 0:
            self._observe(t, value)

    def _end_gap(self, t: float) -> None:
        t0 = t if self._last_t is None else self._last_t
        self.gaps = (*self.gaps, Gap(t0=t0, tn=t, reason="evicted"))
        self._gap_pending = False

    def _observe(self, t: float, value: float) -> None:
        self.t = t
        self.observations += 1
        if self._value is not None and abs(value - self._value) > JUMP:
            self.jumps = (*self.jumps, t)
            self._start = t
        self._value = value

    def _changepoints(self) -> tuple[Changepoint, ...]:
        final = len(self._all) if self.finished else len(self._all) - 1
        return tuple(_changepoint(t, is_final=index < final) for index, t in enumerate(self._all))

    def _segments(self) -> tuple[Segment, ...]:
        if not self.observations:
            return ()
        bounds = (0.0, *self._all, self.t)
        finals = (None if tn < self.t or self.finished else self._digest for tn in bounds[1:])
        return tuple(
            _segment(t0, tn, digest)
            for (t0, tn), digest in zip(itertools.pairwise(bounds), finals, strict=True)
        )

    def _apps(self) -> tuple[App, ...]:
        pairs = itertools.pairwise((0.0, *self._all))
        return tuple(_app(index, t0, tn) for index, (t0, tn) in enumerate(pairs))


@lru_cache(_KEPT)
def _changepoint(t: float, *, is_final: bool) -> Changepoint:
    return Changepoint(
        t=t,
        probability=1.0 if is_final else 0.8,
        certainty="final" if is_final else "provisional",
    )


@lru_cache(_KEPT)
def _segment(t0: float, tn: float, digest: float | None) -> Segment:
    """Make a segment. digest: of the samples so far; None if the segment is final."""
    return Segment(
        t0=t0,
        tn=tn,
        kind="motion",
        motion="motion",
        contact="free",
        probability=0.9,
        runner_up=None,
        log_odds=1.0,
        position_start=_ORIGIN,
        position_end=(0.0 if digest is None else digest, 0.0, 0.0),
        force_start=_ORIGIN,
        force_end=_ORIGIN,
        force_held=None,
        load_kg=None,
        load_sd_kg=None,
        certainty="final" if digest is None else "provisional",
    )


@lru_cache(_KEPT)
def _app(index: int, t0: float, tn: float) -> App:
    return App(
        kind="cartesian_motion",
        t0=t0,
        tn=tn,
        target=_ORIGIN,
        orientation=None,
        joints=None,
        force=None,
        force_taught=None,
        load_kg=None,
        load_sd_kg=None,
        gripper_width=None,
        confidence=0.9,
        segments=(index,),
    )
