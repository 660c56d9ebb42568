"""Phases against all groupings of short demonstrations, and how they behave while a demonstration goes on."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import pairwise, product

import numpy as np
import pytest

from caesura_protocol.messages import Phase, Segment
from caesura_service.changepoint.default_presets import DEFAULT
from caesura_service.phases import PARAMETERS, Chain, PhaseTracker
from caesura_service.phases.model import CONTACT_STATES, PIECE_S, SegmentFeatures, seen
from caesura_service.phases.posterior import best_last, best_states, first_step, next_step, posterior
from caesura_service.phases.retraced_path import way_of
from caesura_service.phases.tracker import PlacesBetween

NAMES = {"free": "motion", "contact": "sliding", "transport": "transport"}
CONTACT_OF = {"cycle": "free"}  # contact state of a phase kind, where it is not the kind's name
CHAIN = Chain(PARAMETERS)
FREE, CONTACT, TRANSPORT, CYCLE, STROKES = PARAMETERS.kinds


def segment(t0: float, seconds: float, contact: str, start: tuple, end: tuple, p: float = 0.999) -> Segment:
    return Segment(
        t0=t0, tn=t0 + seconds, kind=NAMES[contact], motion="motion", contact=contact, probability=p,
        runner_up="motion" if contact != "free" else "transport", log_odds=1.0, certainty="final",
        position_start=start, position_end=end, force_start=(0, 0, 0), force_end=(0, 0, 0),
        force_held=None, load_kg=None, load_sd_kg=None,
    )  # fmt: skip


def demonstration(*parts: tuple[str, float, tuple]) -> list[Segment]:
    """Segments in a row: contact state, seconds, where each ends."""
    found, t, place = [], 0.0, (0.4, 0.0, 0.3)
    for contact, seconds, end in parts:
        found.append(segment(t, seconds, contact, place, end))
        t, place = t + seconds, end
    return found


LEFT, RIGHT, ABOVE, AWAY = (0.4, -0.2, 0.1), (0.4, 0.2, 0.1), (0.4, 0.0, 0.15), (0.2, 0.0, 0.4)


def wiping() -> list[Segment]:
    """Reach, four strokes with a lift-off after the second, retract."""
    strokes = [("contact", 1.3, RIGHT), ("contact", 1.3, LEFT)]
    lift = [("free", 0.6, ABOVE), ("free", 0.5, LEFT)]
    away = [("free", 1.5, AWAY), ("free", 1.0, AWAY)]
    return demonstration(("free", 1.5, LEFT), *strokes, *lift, *strokes, *away)


def straight(segments: list[Segment]) -> PlacesBetween:
    """Where a demonstration leads through whose segments are straight lines."""
    t = [one.t0 for one in segments] + [segments[-1].tn]
    ends = np.array([one.position_start for one in segments] + [segments[-1].position_end])
    return lambda t0, tn: np.stack([np.interp(np.linspace(t0, tn, 30), t, axis) for axis in ends.T], axis=1)


def grouped(
    segments: list[Segment],
    *,
    finished: bool = True,
    chain: Chain = CHAIN,
    places: PlacesBetween | None = None,
) -> list[Phase]:
    decided, rest = PhaseTracker(chain, places or straight(segments)).update(segments, finished=finished)
    return [*decided, *rest]


def look(tracker: PhaseTracker, segments: list[Segment], settled: int) -> tuple[list[Phase], list[Phase]]:
    """What the tracker says of all segments so far, of which so many have settled."""
    for segment in segments[tracker.settled : settled]:
        tracker.settle(segment)
    return tracker.update(segments[settled:], finished=False)


def shown(phases: list[Phase]) -> list[tuple[str, int, int, int]]:
    return [(one.kind, one.first_segment, one.last_segment, one.strokes) for one in phases]


# --- brute force: every way to group, weighed as the model's docstring says --------------------------------


def log_normal(law, seconds: float, grows: bool) -> float:
    z = (math.log(seconds) - math.log(law.median_s)) / law.spread
    if grows:
        return 1.0 - 0.5 * (1.0 + math.erf(z / math.sqrt(2.0)))
    return math.exp(-z * z / 2.0) / (seconds * law.spread * math.sqrt(2.0 * math.pi))


def normal(x: np.ndarray, mean: np.ndarray, sd: float) -> float:
    return math.exp(-0.5 * (math.dist(x, mean) / sd) ** 2) / (sd * math.sqrt(2.0 * math.pi)) ** len(x)


def pieces_gone_over(phase: list[SegmentFeatures], parameters) -> list[tuple[int, list[int]]]:
    """Of each piece of way, its segment and which earlier pieces of the phase it goes over again."""
    pieces = [
        (i, middle, step)
        for i, one in enumerate(phase)
        for middle, step in zip(one.way.middles, one.way.steps, strict=True)
    ]
    return [
        (
            i,
            [
                earlier
                for earlier, (_, there, other) in enumerate(pieces[:number])
                if math.dist(middle, there) < parameters.near_m
                and step @ other > math.cos(math.radians(45.0)) * math.hypot(*step) * math.hypot(*other)
                and 0.02 * (number - earlier) > 3.0 * parameters.near_m
            ],
        )
        for number, (i, middle, step) in enumerate(pieces)
    ]


class Cycles:
    """What a cycle weighs over any other movement, by the numbers of its first and last segment."""

    def __init__(self, segments: list[SegmentFeatures], parameters) -> None:
        self._segments, self._parameters = segments, parameters
        self._over = {
            (first, last): pieces_gone_over(segments[first : last + 1], parameters)
            for last in range(len(segments))
            for first in range(last + 1)
        }
        self._unit = 0.02 / (3.0 * parameters.near_m)
        self._astray = (1.0 - parameters.again) / (1.0 - parameters.by_chance)

    def _remembered(self, start: int, last: int) -> int:
        return max(start, last + 1 - self._parameters.memory)

    def _before_the_round(self, start: int, last: int) -> int:
        pieces = self._over[start, last] if last >= start else []
        return min((earlier for _, over in pieces for earlier in over), default=0)

    def gone_over(self, start: int, last: int) -> float:
        """Density of the way of a phase's last segment."""
        if int(self._segments[last].likelihood.argmax()) != 0:
            return 1.0
        first, weight, closed = self._remembered(start, last), 1.0, False
        for i, over in self._over[first, last]:
            closed |= bool(over)
            if i == last - first and closed:
                weight *= self._parameters.again / self._parameters.by_chance if over else self._astray
        if last + 1 - start < self._parameters.memory:
            weight *= self._astray ** (
                self._before_the_round(start, last) - self._before_the_round(start, last - 1)
            )
        return weight**self._unit

    def ends(self, start: int, last: int) -> float:
        """How often a phase ends here, over how often its kind does."""
        has_come_round = any(over for _, over in self._over[self._remembered(start, last), last])
        return 1.0 if has_come_round else self._parameters.left_open


def weigher(
    segments: list[SegmentFeatures], ended: bool, parameters, cycles: Cycles
) -> Callable[[tuple], float]:
    """The weight of a grouping: of each segment its kind's number, whether it interrupts, and whether a phase
    starts. Groupings share most of their factors.
    """

    @cache
    def factor(i: int, start: int, k: int, aside: bool) -> float:
        kind = parameters.kinds[k]
        gone_over = cycles.gone_over(start, i) if kind.retraces and not aside else 1.0
        return emitted(segments[i], kind, aside, parameters) * gone_over

    @cache
    def after(i: int, start: int, pair: tuple) -> float:
        return follows(segments, i, start, pair, parameters, cycles)

    @cache
    def at_the_end(start: int, k: int, aside: bool) -> float:
        kind = parameters.kinds[k]
        if not ended:
            return 1.0
        if aside:
            return kind.bounds * (1.0 - kind.resumed)
        return kind.bounds * kind.ends * (cycles.ends(start, len(segments) - 1) if kind.retraces else 1.0)

    def weight(grouping: tuple) -> float:
        total, start = parameters.kinds[grouping[0][0]].bounds, 0
        for i, (k, aside, starts) in enumerate(grouping):
            if starts and aside:
                return 0.0
            total *= after(i, start, grouping[i - 1 : i + 1]) if i else 1.0
            start = i if starts else start
            total *= factor(i, start, k, aside)
        return total * at_the_end(start, *grouping[-1][:2])

    return weight


def follows(segments: list, i: int, start: int, pair: tuple, parameters, cycles: Cycles) -> float:
    """Probability of a segment's state after the one before; start: where the phase before begins."""
    (before_k, before_aside, _), (k, aside, starts) = pair
    before, kind = parameters.kinds[before_k], parameters.kinds[k]
    if (before_aside or before_k == k) if starts else before_k != k:
        return 0.0
    if starts:
        ends = cycles.ends(start, i - 1) if before.retraces else 1.0
        return ends * enters(before, kind, segments[i], parameters)
    if not before_aside:
        return kind.interrupted if aside else 1.0 - kind.ends - kind.interrupted
    if aside:
        return 1.0 - kind.resumed
    phase = segments[max(start, i - parameters.memory) : i]
    return kind.resumed * resumed(phase, segments[i], kind, parameters)


def emitted(one: SegmentFeatures, kind, aside: bool, parameters) -> float:
    """Density of a segment's contact state, duration and step."""
    classes, law = (kind.aside, kind.aside_s) if aside else (kind.own, kind.own_s)
    whole, piece = (log_normal(each, one.seconds, one.grows) for each in (law, PIECE_S))
    lasts = (1.0 - parameters.cut) * whole + parameters.cut * piece
    over = parameters.last * kind.bounds * (1.0 - kind.resumed if aside else kind.ends)
    lasts += over * (1.0 - lasts) if one.grows and not one.moves else 0.0
    far = normal(one.end - one.start, np.zeros(3), parameters.aside_step_m if aside else kind.step_m)
    return (
        float(np.dot(classes, one.likelihood)) * lasts * (kind.moving * far if one.moves else 1 - kind.moving)
    )


def enters(before, kind, one: SegmentFeatures, parameters) -> float:
    """Probability that a phase ends and one of this kind follows."""
    rests = CONTACT_OF.get(kind.name, kind.name) == CONTACT_OF.get(before.name, before.name)
    begins = (1.0 / kind.moving if one.moves else 0.0) if rests else 1.0
    return (
        begins * before.ends * kind.weight / (sum(each.weight for each in parameters.kinds) - before.weight)
    )


def resumed(phase: list[SegmentFeatures], one: SegmentFeatures, kind, parameters) -> float:
    """Density of where a phase is resumed, over that of resuming it anywhere."""
    state = CONTACT_STATES.index(CONTACT_OF.get(kind.name, kind.name))
    strokes = [each for each in phase if int(each.likelihood.argmax()) == state]
    if not strokes:
        return 1.0
    anywhere = normal(one.start, strokes[-1].end, parameters.far_m)
    near = [normal(one.start, place, parameters.near_m) for s in strokes for place in (s.start, s.end)]
    return 1.0 - kind.repeats + kind.repeats * float(np.mean(near)) / anywhere


@cache
def groupings(count: int, kinds: int) -> list[tuple]:
    one = list(product(range(kinds), (False, True), (False, True)))
    first = [each for each in one if each[2] and not each[1]]
    return [
        each
        for each in product(first, *[one] * (count - 1))
        if all(after[2] or after[0] == before[0] for before, after in pairwise(each))
    ]


@pytest.mark.slow
@pytest.mark.parametrize("memory", [2, 10])
@pytest.mark.parametrize(
    "kinds", [(FREE, CONTACT, TRANSPORT), (CYCLE, CONTACT), (FREE, CYCLE), (FREE, STROKES)]
)
@pytest.mark.parametrize("ended", [True, False])
def test_the_posterior_is_that_over_all_groupings(ended: bool, memory: int, kinds: tuple) -> None:
    parameters = replace(PARAMETERS, memory=memory, kinds=kinds)
    chain = Chain(parameters)
    every = [
        one.model_copy(update={"motion": "steady"}) if i in (5, 7) else one for i, one in enumerate(wiping())
    ]
    to_and_fro = demonstration(*[("free", 1.2, end) for end in (LEFT, RIGHT, LEFT, RIGHT, AWAY)])
    for segments in (every[:4], every[2:6], every[1:6], every[3:8], to_and_fro):
        places, shown = straight(segments), []
        for one in segments:
            grows = not ended and one is segments[-1]
            shown.append(seen(one, parameters, way_of(places(one.t0, one.tn)), shown, grows=grows))
        steps = [first_step(chain, shown[0])]
        for i in range(1, len(shown)):
            steps.append(next_step(chain, steps[-1], shown[i], shown[:i]))
        all_of_them = groupings(len(segments), len(parameters.kinds))
        weight = weigher(shown, ended, parameters, Cycles(shown, parameters))
        weights = np.array([weight(each) for each in all_of_them])
        of_kind, is_aside, begins = np.moveaxis(np.array(all_of_them), 2, 0)
        sure = posterior(chain, steps, ended=ended)
        for i, k, aside in product(range(len(segments)), range(len(parameters.kinds)), (False, True)):
            of_it = (of_kind[:, i] == k) & (is_aside[:, i] == aside)
            found = sure[i][(chain.kind == k) & (chain.aside == aside)].sum()
            assert found == pytest.approx(weights[of_it].sum() / weights.sum(), abs=1e-12)
            starts = of_it & (begins[:, i] == 1)
            found = sure[i][(chain.kind == k) & (chain.aside == aside) & (chain.age == 1)].sum()
            assert found == pytest.approx(weights[starts].sum() / weights.sum(), abs=1e-12)
        best = best_states(steps, best_last(chain, steps[-1], ended=ended))
        expected = all_of_them[int(weights.argmax())]
        assert [(chain.kind[s], bool(chain.aside[s]), chain.age[s] == 1) for s in best] == [*expected]


# --- behaviour --------------------------------------------------------------------------------------------


def test_a_wipe_with_a_lift_off_is_one_phase_between_reach_and_retract() -> None:
    phases = grouped(wiping())
    assert shown(phases) == [("free", 0, 0, 1), ("contact", 1, 6, 2), ("free", 7, 8, 1)]
    assert all(one.certainty == "final" and one.probability > 0.7 for one in phases)
    assert [(one.t0, one.tn) for one in phases[1:]] == [
        (1.5, wiping()[6].tn),
        (wiping()[6].tn, wiping()[8].tn),
    ]


def test_presses_at_places_apart_are_phases_of_their_own() -> None:
    far = (0.4, 0.6, 0.1)
    places = demonstration(
        ("free", 1.5, LEFT), ("contact", 1.0, LEFT), ("free", 1.5, AWAY), ("free", 1.5, far),
        ("contact", 1.0, far), ("free", 1.5, AWAY),
    )  # fmt: skip
    assert [one.kind for one in grouped(places)] == ["free", "contact", "free", "contact", "free"]
    back = demonstration(
        ("free", 1.5, LEFT), ("contact", 1.0, LEFT), ("free", 1.5, AWAY), ("free", 1.5, LEFT),
        ("contact", 1.0, LEFT), ("free", 1.5, AWAY),
    )  # fmt: skip
    assert shown(grouped(back)) == [("free", 0, 0, 1), ("contact", 1, 4, 2), ("free", 5, 5, 1)]


def test_a_hand_that_waits_after_its_retreat_is_in_contact_no_more() -> None:
    """A page showed "contact" until the operator pressed Stop."""
    pressed = demonstration(
        ("free", 1.2, LEFT),
        ("contact", 1.3, LEFT),
        ("free", 0.2, LEFT),
        ("free", 1.1, AWAY),
        ("free", 13.0, AWAY),
    )
    rests = {"motion": "steady", "kind": "steady"}
    pressed = [one.model_copy(update=rests if i in (2, 4) else {}) for i, one in enumerate(pressed)]
    assert [one.kind for one in grouped(pressed, finished=False)] == ["free", "contact", "free"]


RADIUS_M, ROUND_S = 0.08, 2.0


def on_a_circle(t: np.ndarray, first_s: float, last_s: float) -> np.ndarray:
    """(n, 3) [m] rounds between two times [s]; straight there from a metre away, and straight back."""
    angle = 2.0 * np.pi * (np.clip(t, first_s, last_s) - first_s) / ROUND_S
    away = np.clip(first_s - t, 0.0, None) + np.clip(t - last_s, 0.0, None)
    x, y = 0.4 + RADIUS_M * np.cos(angle), RADIUS_M * np.sin(angle)
    return np.stack([x, y, 0.1 + 0.5 * away], axis=1)


@pytest.mark.parametrize("borders", [(2.0, 10.0), (2.0, 3.2, 8.4, 9.3, 10.0), (2.0, 2.7, 3.1, 4.4, 10.0)])
def test_what_goes_over_a_cycle_again_is_part_of_it(borders: tuple[float, ...]) -> None:
    """Four rounds between a reach and a retract are one phase, wherever the segments are cut."""

    def places(t0: float, tn: float) -> np.ndarray:
        return on_a_circle(np.linspace(t0, tn, max(round(10.0 * (tn - t0)), 1) + 1), borders[0], borders[-1])

    edges = [0.0, *borders, 12.0]
    segments = [
        segment(t0, tn - t0, "free", tuple(places(t0, tn)[0]), tuple(places(t0, tn)[-1]))
        for t0, tn in pairwise(edges)
    ]
    phases = grouped(segments, places=places)
    assert [(one.kind, one.t0) for one in phases] == [("free", 0.0), ("cycle", 2.0), ("free", 10.0)]


def test_strokes_to_and_fro_once_are_no_cycle() -> None:
    """A way back leads over the way there, and is not that way again."""
    fro = demonstration(("free", 1.5, LEFT), ("free", 1.5, RIGHT), ("free", 1.5, LEFT), ("free", 1.5, AWAY))
    assert [one.kind for one in grouped(fro)] == ["free"]


def test_strokes_to_and_fro_again_and_again_are_one_cycle() -> None:
    """With the hand in the wrench a contact is not seen. The way shows where the strokes begin and end."""
    strokes = [("free", 0.9, RIGHT), ("free", 0.7, ABOVE), ("free", 0.6, LEFT)]
    peeled = demonstration(("free", 1.5, LEFT), *strokes, *strokes, *strokes, ("free", 1.5, AWAY))
    assert shown(grouped(peeled)) == [("free", 0, 0, 1), ("cycle", 1, 9, 1), ("free", 10, 10, 1)]


def test_short_strokes_in_contact_do_not_interrupt_a_cycle() -> None:
    """A round ends where it began. An interruption need not, and short strokes are no evidence of one."""
    places = [(0.4 + 0.012 * i, 0.035 * (i % 2), 0.1) for i in range(7)]
    strokes = [("contact", 0.5, place) for place in places[1:]]
    lifted = (0.48, 0.0, 0.11)
    wiped = demonstration(
        ("free", 1.5, ABOVE), ("free", 0.8, ABOVE), ("free", 0.7, places[0]), *strokes, ("free", 0.1, lifted),
        ("free", 1.1, AWAY),
    )  # fmt: skip
    wiped[1] = wiped[1].model_copy(update={"motion": "steady", "kind": "steady"})
    assert shown(grouped(wiped)) == [("free", 0, 2, 1), ("contact", 3, 8, 1), ("free", 9, 10, 1)]


def test_a_long_way_there_and_back_is_no_cycle() -> None:
    """It ends where it began, and goes over nothing again."""
    t, y = [0.0, 1.5, 4.5, 7.5, 9.0], [-0.2, -0.2, 0.2, -0.2, -0.2]

    def places(t0: float, tn: float) -> np.ndarray:
        times = np.linspace(t0, tn, 81)
        away = np.interp(times, t, [0.3, 0.0, 0.0, 0.0, 0.3])
        return np.stack([0.4 - away, np.interp(times, t, y), 0.1 + away], axis=1)

    back = demonstration(("free", 1.5, LEFT), ("free", 6.0, LEFT), ("free", 1.5, AWAY))
    assert [one.kind for one in grouped(back, places=places)] == ["free"]


def test_a_stroke_does_not_go_over_itself() -> None:
    """Its pieces lie near each other, in one direction; so do those of two that follow each other."""
    whole = demonstration(("free", 3.0, RIGHT), ("free", 3.0, (0.4, 0.6, 0.1)))
    places, before = straight(whole), []
    for one in whole:
        before.append(seen(one, PARAMETERS, way_of(places(one.t0, one.tn)), before, grows=False))
    assert [len(one.way.middles) for one in before] == [14, 19]
    assert all(one.retraced.again.sum() == one.retraced.astray.sum() == 0.0 for one in before)


def test_a_rest_belongs_to_the_phase_before_it() -> None:
    """A reach, a rest, four rounds, a rest, a return: each ends with its rest."""
    edges = [0.0, 1.5, 2.5, 10.5, 11.5, 13.0]
    motions = ["motion", "steady", "motion", "steady", "motion"]

    def places(t0: float, tn: float) -> np.ndarray:
        moving = np.interp(np.linspace(t0, tn, 81), edges, [0.0, 1.5, 1.5, 9.5, 9.5, 11.0])
        return on_a_circle(moving, 1.5, 9.5)

    resting = [
        segment(t0, tn - t0, "free", tuple(places(t0, tn)[0]), tuple(places(t0, tn)[-1])).model_copy(
            update={"motion": motion}
        )
        for (t0, tn), motion in zip(pairwise(edges), motions, strict=True)
    ]
    phases = [(one.kind, one.first_segment) for one in grouped(resting, places=places)]
    assert phases == [("free", 0), ("cycle", 2), ("free", 4)]


def test_a_carry_is_a_phase_of_its_own() -> None:
    carried = demonstration(
        ("free", 1.5, LEFT), ("contact", 1.0, LEFT), ("transport", 2.0, RIGHT), ("contact", 1.0, RIGHT),
        ("free", 1.5, AWAY),
    )  # fmt: skip
    assert [one.kind for one in grouped(carried)] == ["free", "contact", "transport", "contact", "free"]


def unsure(one: Segment, probability: float) -> Segment:
    return one.model_copy(update={"probability": probability})


def test_a_load_that_is_unsure_by_its_prior_alone_is_a_phase() -> None:
    """A carry at 0.25 beside free motion at 0.75: the evidence is 11 to 1, the prior 0.03 to 1."""
    carried = demonstration(
        ("free", 1.5, LEFT), ("contact", 1.0, LEFT), ("transport", 2.0, RIGHT), ("transport", 1.5, LEFT),
        ("contact", 1.0, LEFT), ("free", 1.5, AWAY),
    )  # fmt: skip
    carried = [unsure(one, 0.25) if one.contact == "transport" else one for one in carried]
    kinds = ["free", "contact", "transport", "contact", "free"]
    assert [one.kind for one in grouped(carried)] == kinds
    twice = Chain(replace(PARAMETERS, priors=(1.0, 1.0, 1.0)))
    assert [one.kind for one in grouped(carried, chain=twice)] != kinds


def test_the_prior_of_a_load_is_that_of_the_preset() -> None:
    loads = {kind.weight for kind in DEFAULT.kinds if kind.contact == "transport"}
    assert loads == {PARAMETERS.priors[CONTACT_STATES.index("transport")]}


def test_a_piece_of_a_retract_hides_no_phase() -> None:
    """After a contact the hand rests for 0.1 s, then it leaves."""
    pieces = demonstration(
        ("free", 1.5, LEFT), ("contact", 1.5, LEFT), ("free", 0.1, LEFT), ("free", 2.2, AWAY),
        ("free", 0.4, AWAY),
    )  # fmt: skip
    pieces = [one.model_copy(update={"motion": "steady"}) if i == 2 else one for i, one in enumerate(pieces)]
    expected = [("free", 0), ("contact", 1), ("free", 2)]
    assert [(one.kind, one.first_segment) for one in grouped(pieces)] == expected
    whole = Chain(replace(PARAMETERS, cut=0.0))
    assert [(one.kind, one.first_segment) for one in grouped(pieces, chain=whole)] != expected


def session(rounds: int) -> list[Segment]:
    """The same wiping again and again, a metre further each time."""
    parts = [(one.contact, one.tn - one.t0, one.position_end) for one in wiping()]
    far = [(c, s, (x, y + 1.0 * i, z)) for i in range(rounds) for c, s, (x, y, z) in parts]
    return demonstration(*far)


def test_final_phases_stay_and_looks_do_not_matter() -> None:
    segments = session(8)
    looked, once = PhaseTracker(CHAIN, straight(segments)), PhaseTracker(CHAIN, straight(segments))
    final: list[Phase] = []
    for count in range(1, len(segments) + 1):
        settled = max(count - 2, looked.settled)
        newly, rest = look(looked, segments[:count], settled)
        assert all(one.certainty == "final" for one in newly)
        assert all(one.certainty == "provisional" for one in rest)
        final += newly
        phases = [*final, *rest]
        assert phases[0].first_segment == 0
        assert phases[-1].last_segment == count - 1
        assert all(a.last_segment + 1 == b.first_segment for a, b in pairwise(phases))
    settled = len(segments) - 2
    decided, rest = look(once, segments, settled)
    assert decided == final
    assert len(final) >= 12, "most phases are decided long before the end"
    assert look(looked, segments, settled)[1] == rest


@pytest.mark.slow
def test_what_is_kept_does_not_grow() -> None:
    segments = session(60)
    tracker = PhaseTracker(CHAIN, straight(segments))
    for count in range(1, len(segments) + 1):
        look(tracker, segments[:count], count - 1)
        assert len(tracker._kept) <= 16


def test_one_long_phase_is_kept_as_briefly() -> None:
    strokes = [("contact", 1.2, RIGHT if i % 2 else LEFT) for i in range(300)]
    segments = demonstration(("free", 1.5, LEFT), *strokes)
    tracker = PhaseTracker(CHAIN, straight(segments))
    for count in range(1, len(segments) + 1):
        _, rest = look(tracker, segments[:count], count - 1)
        assert len(tracker._kept) <= 16
    assert shown(rest)[-1] == ("contact", 1, 300, 1)


def test_a_model_without_sense_is_refused() -> None:
    with pytest.raises(ValueError, match="memory is 1"):
        Chain(replace(PARAMETERS, memory=1))
    bad = replace(PARAMETERS.kinds[0], ends=0.9, interrupted=0.2)
    with pytest.raises(ValueError, match=r"'ends': 0\.9"):
        Chain(replace(PARAMETERS, kinds=(bad, *PARAMETERS.kinds[1:])))
