"""Phases against all groupings of short demonstrations, and how they behave while a demonstration goes on."""

import math
from dataclasses import replace
from functools import cache
from itertools import pairwise, product

import numpy as np
import pytest

from caesura_protocol.messages import Phase, Segment
from caesura_service.changepoint.default import DEFAULT
from caesura_service.phases import PARAMETERS, Chain, PhaseTracker
from caesura_service.phases.model import CONTACT_STATES, PIECE_S, SegmentFeatures, seen
from caesura_service.phases.posterior import best_last, best_states, first_step, next_step, posterior
from caesura_service.phases.retracing import way_of
from caesura_service.phases.tracker import PlacesBetween

NAMES = {"free": "motion", "contact": "sliding", "transport": "transport"}
CONTACT_OF = {"cycle": "free"}  # contact state of a phase kind, where it is not the kind's name
CHAIN = Chain(PARAMETERS)
FREE, CONTACT, TRANSPORT, CYCLE = PARAMETERS.kinds


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
    decided, rest = PhaseTracker(chain, places or straight(segments)).look(segments, finished=finished)
    return [*decided, *rest]


def look(tracker: PhaseTracker, segments: list[Segment], settled: int) -> tuple[list[Phase], list[Phase]]:
    """What the tracker says of all segments so far, of which so many have settled."""
    for segment in segments[tracker.settled : settled]:
        tracker.settle(segment)
    return tracker.look(segments[settled:], finished=False)


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


def weight_of(segments: list[SegmentFeatures], grouping: tuple, ended: bool, parameters) -> float:
    """grouping: of each segment its kind's number, whether it interrupts, and whether a phase starts."""
    total, start = parameters.kinds[grouping[0][0]].bounds, 0
    for i, (one, (k, aside, starts)) in enumerate(zip(segments, grouping, strict=True)):
        kind = parameters.kinds[k]
        if i:
            before_kind, before_aside, _ = grouping[i - 1]
            before = parameters.kinds[before_kind]
            if starts:
                if before_aside or before_kind == k:
                    return 0.0
                if CONTACT_OF.get(kind.name, kind.name) == CONTACT_OF.get(before.name, before.name):
                    total *= 1.0 / kind.moving if one.moves else 0.0
                others = sum(each.weight for each in parameters.kinds) - before.weight
                total *= before.ends * kind.weight / others
            else:
                if before_kind != k:
                    return 0.0
                own = {False: 1.0 - kind.ends - kind.interrupted, True: kind.interrupted}
                total *= {True: {True: 1.0 - kind.resumed, False: kind.resumed}, False: own}[before_aside][
                    aside
                ]
        if starts:
            start = i
            if aside:
                return 0.0
        elif grouping[i - 1][1] and not aside:
            total *= resumed(segments[max(start, i - parameters.memory) : i], one, kind, parameters)
        classes, law = (kind.aside, kind.aside_s) if aside else (kind.own, kind.own_s)
        whole, piece = (log_normal(each, one.seconds, one.grows) for each in (law, PIECE_S))
        lasts = (1.0 - parameters.cut) * whole + parameters.cut * piece
        over = parameters.last * kind.bounds * (1.0 - kind.resumed if aside else kind.ends)
        lasts += over * (1.0 - lasts) if one.grows and not one.moves else 0.0
        total *= float(np.dot(classes, one.likelihood)) * lasts
        total *= (
            1.0
            if aside
            else gone_over(segments[max(start, i + 1 - parameters.memory) : i + 1], kind, parameters)
        )
        moving = kind.moving
        total *= moving * normal(one.end - one.start, np.zeros(3), kind.step_m) if one.moves else 1 - moving
    last, last_aside, _ = grouping[-1]
    kind = parameters.kinds[last]
    return total * (kind.bounds * (1.0 - kind.resumed if last_aside else kind.ends) if ended else 1.0)


def resumed(phase: list[SegmentFeatures], one: SegmentFeatures, kind, parameters) -> float:
    """Density of where a phase is resumed, over that of resuming it anywhere."""
    state = CONTACT_STATES.index(CONTACT_OF.get(kind.name, kind.name))
    strokes = [each for each in phase if int(each.likelihood.argmax()) == state]
    if not strokes:
        return 1.0
    anywhere = normal(one.start, strokes[-1].end, parameters.far_m)
    near = [normal(one.start, place, parameters.near_m) for s in strokes for place in (s.start, s.end)]
    return 1.0 - kind.repeats + kind.repeats * float(np.mean(near)) / anywhere


def gone_over(phase: list[SegmentFeatures], kind, parameters) -> float:
    """Density of what the last segment of a phase goes over again, over that of any other movement."""
    if not kind.retraces or int(phase[-1].likelihood.argmax()) != 0:
        return 1.0
    pieces = [
        (i, middle, step)
        for i, one in enumerate(phase)
        for middle, step in zip(one.way.middles, one.way.steps, strict=True)
    ]
    weight, closed = 1.0, False
    for number, (i, middle, step) in enumerate(pieces):
        again = any(
            math.dist(middle, there) < parameters.near_m
            and math.degrees(math.acos(np.clip(step @ other / math.hypot(*step) / math.hypot(*other), -1, 1)))
            < 45.0
            and 0.02 * (number - earlier) > 3.0 * parameters.near_m
            for earlier, (_, there, other) in enumerate(pieces[:number])
        )
        closed |= again
        if i == len(phase) - 1 and closed:
            as_cycle, as_other = parameters.again, parameters.by_chance
            weight *= as_cycle / as_other if again else (1.0 - as_cycle) / (1.0 - as_other)
    return weight ** (0.02 / (3.0 * parameters.near_m))


@cache
def groupings(count: int, kinds: int) -> list[tuple]:
    one = list(product(range(kinds), (False, True), (False, True)))
    first = [each for each in one if each[2] and not each[1]]
    return [
        each
        for each in product(first, *[one] * (count - 1))
        if all(after[2] or after[0] == before[0] for before, after in pairwise(each))
    ]


@pytest.mark.parametrize("memory", [2, 10])
@pytest.mark.parametrize("kinds", [(FREE, CONTACT, TRANSPORT), (CYCLE, CONTACT), (FREE, CYCLE)])
@pytest.mark.parametrize("ended", [True, False])
def test_the_posterior_is_that_over_all_groupings(ended: bool, memory: int, kinds: tuple) -> None:
    parameters = replace(PARAMETERS, memory=memory, kinds=kinds)
    chain = Chain(parameters)
    every = [
        one.model_copy(update={"motion": "steady"}) if i in (5, 7) else one for i, one in enumerate(wiping())
    ]
    for segments in (every[:4], every[2:6], [every[1], every[2], every[3], every[4], every[5]], every[3:8]):
        places, shown = straight(segments), []
        for one in segments:
            grows = not ended and one is segments[-1]
            shown.append(seen(one, parameters, way_of(places(one.t0, one.tn)), shown, grows=grows))
        steps = [first_step(chain, shown[0])]
        for i in range(1, len(shown)):
            steps.append(next_step(chain, steps[-1], shown[i], shown[:i]))
        all_of_them = groupings(len(segments), len(parameters.kinds))
        weights = np.array([weight_of(shown, each, ended, parameters) for each in all_of_them])
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


def test_circles_in_free_space_are_a_phase_of_their_own() -> None:
    circles = demonstration(
        ("free", 1.5, LEFT), ("free", 8.0, LEFT), ("free", 1.0, LEFT), ("free", 1.5, AWAY)
    )
    assert [(one.kind, one.first_segment) for one in grouped(circles)][:2] == [("free", 0), ("cycle", 1)]
    assert grouped(circles)[-1].kind == "free"


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


def test_a_stroke_does_not_go_over_itself() -> None:
    """Its pieces lie near each other, in one direction; so do those of two that follow each other."""
    whole = demonstration(("free", 3.0, RIGHT), ("free", 3.0, (0.4, 0.6, 0.1)))
    places, before = straight(whole), []
    for one in whole:
        before.append(seen(one, PARAMETERS, way_of(places(one.t0, one.tn)), before, grows=False))
    assert [len(one.way.middles) for one in before] == [14, 19]
    assert all(one.retraced.again.sum() == one.retraced.astray.sum() == 0.0 for one in before)


def test_a_rest_belongs_to_the_phase_before_it() -> None:
    """A reach, a rest, a circle, a rest, a return: each ends with its rest."""
    circles = demonstration(
        ("free", 1.5, LEFT),
        ("free", 1.0, LEFT),
        ("free", 8.0, LEFT),
        ("free", 1.0, LEFT),
        ("free", 1.5, AWAY),
    )
    resting = [
        one.model_copy(update={"motion": "steady"}) if i in (1, 3) else one for i, one in enumerate(circles)
    ]
    assert [(one.kind, one.first_segment) for one in grouped(resting)] == [
        ("free", 0),
        ("cycle", 2),
        ("free", 4),
    ]


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
