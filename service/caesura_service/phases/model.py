"""Phases as a hidden Markov model over segments: kinds, durations and transitions.

A demonstration is a sequence of phases, a phase a sequence of segments. Most segments of a phase are in its
contact state; a run of others inside it is an interruption: the tool lifts off between two strokes. Each
segment of a phase of kind k emits

- its contact state (free, contact, transport), by `PhaseKind.own` or, in an interruption, `aside`,
- its duration, log-normal (`own_s`, `aside_s`); for a segment that still grows, the survival probability of
  its duration so far. The rest at the end of a demonstration may have any duration, until an operator stops
  it,
- whether it moves, and how far, normal on each axis (`moving`, `step_m`): a round of a cycle ends where it
  began, and an interruption may lead anywhere (`aside_step_m`).
  A rest between two phases in one contact state, such as a reach and a circle, belongs to the first,
- the place at which a phase is resumed after an interruption: near an end of one of its strokes with
  probability `repeats`, otherwise anywhere in the work space. So repeated strokes belong to one phase,
- the share of its path that retraces the path of its phase (`retraced_path`). A cycle retraces it from the
  second round on; another movement in the air does so by chance. The path before the retraced part does not
  belong to the cycle. A cycle that has not retraced its path seldom ends (`Parameters.left_open`).

A segment's contact state is uncertain: its likelihood follows from its class and the runner-up, reduced by a
share for wrong models (`Parameters.wrong`). Class probabilities contain the prior weight of their kinds. The
likelihood divides it out (`Parameters.priors`), because phases have a prior of their own; otherwise the
rarity of a load would count twice.

Some segments end at a false boundary. A share of them (`Parameters.cut`) is a piece of any duration. So a
piece of 0.1 s is weak evidence of the kind of its phase.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.messages import PhaseKind as Name
from caesura_protocol.messages import Segment
from caesura_service.phases.retraced_path import APART, PIECE_M, Retraced, Way, retraced

Array = NDArray[np.float64]

CONTACT_STATES = ("free", "contact", "transport")
STATE_OF_KIND = {"motion": 0, "steady": 0, "contact": 1, "sliding": 1, "transport": 2, "hold": 2}
SQRT_TAU = math.sqrt(2.0 * math.pi)
LARGEST_LOG = 700.0  # of which the exponential is finite
LEAST = 1e-100  # of a density over the highest: no state is impossible, however long a segment lasts
LEAST_S = 0.05  # half an observation: a shorter segment has no length that could be read


class LogNormal(NamedTuple):
    """Duration with a median [s] and a standard deviation of its logarithm."""

    median_s: float
    spread: float

    def density(self, seconds: float) -> float:
        """Return the density [1/s] of a duration [s]."""
        z = math.log(seconds / self.median_s) / self.spread
        return math.exp(-0.5 * z * z) / (seconds * self.spread * SQRT_TAU)

    def survival(self, seconds: float) -> float:
        """Return the probability of a longer duration than this one [s]."""
        z = math.log(seconds / self.median_s) / self.spread
        return 0.5 * math.erfc(z / math.sqrt(2.0))


PIECE_S = LogNormal(0.5, 1.5)  # of a segment that is cut where nothing ends: 0.1 to 2 s, within a deviation


@dataclass(frozen=True)
class PhaseKind:
    """The parameters of the phases of one kind; probabilities are per segment.

    own, aside: (free, contact, transport) contact state of its own segments, and of those that interrupt;
    own_s, aside_s: their durations. moving: one of its segments is a movement; step_m [m]: standard deviation
    per axis of its displacement. ends, interrupted: the phase ends, or is interrupted, after one of its own
    segments. resumed: an interruption is over. repeats: a phase is resumed at an end of an earlier stroke.
    retraces: it goes over its way again and again. bounds: a demonstration begins, and ends, in this kind.
    weight: the frequency at which it follows another kind, relative to other kinds.
    """

    name: Name
    own: tuple[float, float, float]
    aside: tuple[float, float, float]
    own_s: LogNormal
    aside_s: LogNormal
    ends: float
    interrupted: float
    resumed: float
    repeats: float
    retraces: bool
    bounds: float
    moving: float
    step_m: float
    weight: float


@dataclass(frozen=True)
class Parameters:
    """The assumptions of a model of phases.

    wrong: of a segment's class probabilities, the share that is spread evenly. priors: prior weight of each
    contact state in these probabilities. cut: the share of segments that are pieces, of any length. last: the
    share that ends a demonstration. aside_step_m [m]: standard deviation per axis of the displacement of a
    movement that interrupts a phase, of any kind. near_m, far_m [m]: standard deviation per axis of the place
    where a stroke is repeated, and of any other place of the tool. again, by_chance: the share of its way
    that a cycle retraces, and another movement; ways of `retraced_path.APART` times near_m do so
    independently. left_open: how often a cycle that has not retraced its path ends, relative to one that has.
    memory: segments of a phase that its next one may repeat.
    """

    kinds: tuple[PhaseKind, ...]
    wrong: float = 0.01
    priors: tuple[float, float, float] = (1.0, 1.0, 1.0)
    cut: float = 0.0
    last: float = 0.0
    aside_step_m: float = 0.12
    near_m: float = 0.04
    far_m: float = 0.20
    again: float = 0.9
    by_chance: float = 0.05
    left_open: float = 0.02
    memory: int = 10


class SegmentFeatures(NamedTuple):
    """The features of a segment from which the model infers phases.

    likelihood: (3,) of each contact state. start, end: (3,) [m]. grows: its end is not known yet. moves: it
    is a movement, not a rest. way, retraced: of a movement, its pieces, and those that it retraces.
    """

    likelihood: Array
    seconds: float
    start: Array
    end: Array
    grows: bool
    moves: bool
    way: Way
    retraced: Retraced

    @property
    def state(self) -> int:
        """The most probable contact state."""
        return int(self.likelihood.argmax())


def seen(
    segment: Segment,
    parameters: Parameters,
    way: Way,
    before: Sequence[SegmentFeatures],
    *,
    grows: bool,
) -> SegmentFeatures:
    """Return the features of a segment.

    before: the features of the segments before it, the last one last.
    """
    earlier = [(one.way, one.retraced) for one in before]
    return SegmentFeatures(
        likelihood=_likelihood(segment, parameters),
        seconds=max(segment.tn - segment.t0, LEAST_S),
        start=np.array(segment.position_start),
        end=np.array(segment.position_end),
        grows=grows,
        moves=segment.motion == "motion",
        way=way,
        retraced=retraced(way, earlier, parameters.near_m, parameters.memory),
    )


def _likelihood(segment: Segment, parameters: Parameters) -> Array:
    """Return the likelihood (3,) of the contact states: class probabilities without prior weights."""
    own = CONTACT_STATES.index(segment.contact)
    other = own if segment.runner_up is None else STATE_OF_KIND.get(segment.runner_up, own)
    share = np.zeros(3)
    share[own] += segment.probability
    share[other] += 1.0 - segment.probability
    share /= parameters.priors
    likelihood: Array = (1.0 - parameters.wrong) * share / share.sum() + parameters.wrong / 3.0
    return likelihood


class Chain:
    """The states of the model and how one follows another.

    A state is a kind, whether the segment is its own (0) or interrupts (1), and the age: how many segments
    the phase has, up to `memory`. kind, aside, age: (states,). States of age 1 are starts, and start no
    interruption. first: (states,) probability at the first segment. end: (states,) that a demonstration
    ends there. goes_on, switches, resumes: (states, states) of the second given the first. What begins a
    phase stands apart, because a cycle that has not come round seldom ends; what resumes one, because where
    that happens counts. switches is there twice, for a second segment that rests and for one that moves; so
    is log_next_into: (states, states) log of all together, of the first given the second. switching,
    resuming: which of its entries begin or resume a phase. states: (states,) their numbers.
    """

    def __init__(self, parameters: Parameters) -> None:
        """Raise ValueError for a memory below 2, or probabilities outside of their limits."""
        if parameters.memory < 2:
            raise ValueError(f"memory is {parameters.memory} segments, expected 2 or more")
        for one in parameters.kinds:
            _check(one)
        self.parameters, count = parameters, len(parameters.kinds)
        grid = np.indices((count, 2, parameters.memory)).reshape(3, -1)
        self.kind, self.aside, self.age = grid[0], grid[1], grid[2] + 1
        ends, interrupted, resumed, bounds = (
            np.array([getattr(one, name) for one in parameters.kinds])[self.kind] for name in _SHARES[:4]
        )
        self._begins, is_aside = (self.age == 1) & (self.aside == 0), self.aside == 1
        self.first = self._begins * bounds
        self.end = bounds * np.where(is_aside, 1.0 - resumed, ends)
        older = self.age == np.minimum(self.age + 1, parameters.memory)[:, None]
        goes_on = older & (self.kind == self.kind[:, None])
        switches = self._begins & (self.kind != self.kind[:, None])
        ends, interrupted, resumed, after_aside = (
            each[:, None] for each in (ends, interrupted, resumed, is_aside)
        )
        weight = np.array([one.weight for one in parameters.kinds])
        others = np.maximum(weight.sum() - weight, np.finfo(float).tiny)
        enters = (weight / others[:, None])[self.kind[:, None], self.kind]
        after_own = np.where(is_aside, interrupted, 1.0 - ends - interrupted)
        inside = np.where(after_aside, is_aside * (1.0 - resumed), after_own)
        switches = switches * ~after_aside * ends * enters
        own_state = np.array([max(range(3), key=one.own.__getitem__) for one in parameters.kinds])
        moving = np.array([one.moving for one in parameters.kinds])[self.kind]
        alike = own_state[self.kind][:, None] == own_state[self.kind]
        # A phase after one in its own contact state begins with a movement, with probability 1 for `moving`.
        begins_if = np.where(alike, np.stack([0.0 * moving, 1.0 / moving])[:, None], 1.0)
        self.goes_on: Array = goes_on * inside
        self.switches: Array = switches * begins_if  # (2, states, states)
        self.resumes: Array = goes_on * after_aside * ~is_aside * resumed
        with np.errstate(divide="ignore"):
            into = (self.goes_on + self.switches + self.resumes).swapaxes(1, 2)
            self.log_next_into: Array = np.log(into.copy())
        self.switching, self.resuming = np.nonzero(switches.T), np.nonzero(self.resumes.T)
        self.states = np.arange(self.kind.size)
        self._states = np.array([[one.own, one.aside] for one in parameters.kinds])
        self._own_state = own_state.tolist()
        self._retraces = np.array([one.retraces for one in parameters.kinds])[self.kind] & (self.aside == 0)

    def starts(self, name: Name) -> NDArray[np.bool_]:
        """Return a mask (states,) of the states in which a phase of that name starts."""
        named = np.array([one.name == name for one in self.parameters.kinds])[self.kind]
        found: NDArray[np.bool_] = named & self._begins
        return found

    def emission(self, segment: SegmentFeatures) -> Array:
        """Return the density (states,) of the features of a segment, over the highest; at least LEAST."""
        share = np.log(self._states @ segment.likelihood)
        seconds = [
            [
                self._log_lasts(one.own_s, one.bounds * one.ends, segment),
                self._log_lasts(one.aside_s, one.bounds * (1.0 - one.resumed), segment),
            ]
            for one in self.parameters.kinds
        ]
        steps = [
            [_log_step(one.moving, step_m, segment) for step_m in (one.step_m, self.parameters.aside_step_m)]
            for one in self.parameters.kinds
        ]
        each = (share + seconds + steps)[self.kind, self.aside]
        if segment.state == 0:  # what goes over its way again in contact is one phase without being a cycle
            each += self._retraces * self._log_retraced(segment.retraced)[self.age - 1]
        found: Array = np.maximum(np.exp(each - each.max()), LEAST)
        return found

    def ends(self, segment: SegmentFeatures) -> Array:
        """Return the weight (states,) of a phase's end after a segment.

        It is 1; for a cycle that has not retraced its path, `left_open`.
        """
        is_open = self._retraces & ~np.isfinite(segment.retraced.first)[self.age - 1]
        return np.where(is_open, self.parameters.left_open, 1.0)

    def _log_retraced(self, of_segment: Retraced) -> Array:
        """Return the log weight (memory,) of a cycle, from the numbers of retraced and other pieces of a
        segment.

        The index is the age of the phase.
        """
        share, chance = self.parameters.again, self.parameters.by_chance
        again, astray = math.log(share / chance), math.log((1.0 - share) / (1.0 - chance))
        pieces = APART * self.parameters.near_m / PIECE_M  # that are retraced together
        not_again = of_segment.astray + of_segment.more_outside
        found: Array = (again * of_segment.again + astray * not_again) / pieces
        return found

    def _log_lasts(self, duration: LogNormal, end: float, segment: SegmentFeatures) -> float:
        """Return the log density [1/s] of a duration, whole or cut.

        For a growing segment its log survival probability. end: probability that a demonstration which ends
        with this segment ends in such a state.
        """
        of = LogNormal.survival if segment.grows else LogNormal.density
        whole, piece, cut = of(duration, segment.seconds), of(PIECE_S, segment.seconds), self.parameters.cut
        lasts = (1.0 - cut) * whole + cut * piece
        if segment.grows and not segment.moves:
            over = self.parameters.last * end
            lasts = (1.0 - over) * lasts + over
        return math.log(max(lasts, LEAST))

    def resumed(self, segment: SegmentFeatures, before: Sequence[SegmentFeatures]) -> Array:
        """Return the density of resuming a phase at the segment's start, relative to resuming it anywhere.

        The result (states,) is by the state before the segment. before: the earlier segments, the last one
        last.
        """
        earlier = before[: -self.parameters.memory - 1 : -1]
        weight = np.ones((len(self.parameters.kinds), self.parameters.memory))
        for number, (kind, state) in enumerate(zip(self.parameters.kinds, self._own_state, strict=True)):
            strokes = [age for age, one in enumerate(earlier) if one.state == state] if kind.repeats else []
            if strokes:
                gain = self._gain(segment.start, earlier, strokes)
                weight[number, strokes[0] :] += kind.repeats * (gain - 1.0)
        found: Array = weight[self.kind, self.age - 1]
        return found

    def _gain(self, start: Array, earlier: Sequence[SegmentFeatures], strokes: Sequence[int]) -> Array:
        """Return the density of a resumption at `start` over one anywhere, by the age of a phase.

        Ages are those from its last stroke on.

        earlier: the segments before it, the last one first; strokes: the indices of those that are strokes of
        the phase.
        """
        places = np.concatenate([(earlier[age].start, earlier[age].end) for age in strokes])
        gain, count = np.zeros(self.parameters.memory), np.zeros(self.parameters.memory)
        near = _gain(start, places, earlier[strokes[0]].end, self.parameters)
        gain[strokes] = near.reshape(-1, 2).sum(axis=1)
        count[strokes] = 2.0
        mean: Array = gain.cumsum() / np.maximum(count.cumsum(), 1.0)
        return mean[strokes[0] :]


def _log_step(moving: float, step_m: float, segment: SegmentFeatures) -> float:
    """Return the log density [1/m³] of whether a segment moves, and of its displacement.

    moving: the probability that it does; step_m [m]: standard deviation per axis of its displacement.
    """
    if not segment.moves:
        return math.log(1.0 - moving)
    step = (segment.end - segment.start) / step_m
    far = -3.0 * math.log(step_m * SQRT_TAU) - 0.5 * float(step @ step)
    return math.log(moving) + far


_SHARES = ("ends", "interrupted", "resumed", "bounds", "moving")


def _check(one: PhaseKind) -> None:
    """Raise ValueError for shares or probabilities outside of their limits."""
    sums = {"own": sum(one.own), "aside": sum(one.aside)}
    if any(abs(total - 1.0) > 1e-9 for total in sums.values()):
        raise ValueError(f"contact states of phase {one.name!r} sum to {sums}, expected 1")
    shares = {name: getattr(one, name) for name in _SHARES}
    if not all(0.0 < share < 1.0 for share in shares.values()) or one.ends + one.interrupted >= 1.0:
        raise ValueError(f"phase {one.name!r} has {shares}, expected each within 0 and 1, and rest to go on")
    if not 0.0 <= one.repeats < 1.0:
        raise ValueError(f"phase {one.name!r} repeats {one.repeats}, expected 0 ≤ repeats < 1")


def _gain(start: Array, places: Array, left: Array, parameters: Parameters) -> Array:
    """Return the density (…,) of a start [m] near each place (…, 3), over one anywhere around `left`."""
    near, far = (start - places) / parameters.near_m, (start - left) / parameters.far_m
    scale = 3.0 * math.log(parameters.far_m / parameters.near_m) + 0.5 * float(far @ far)
    gain: Array = np.exp(np.minimum(scale - 0.5 * np.square(near).sum(axis=-1), LARGEST_LOG))
    return gain
