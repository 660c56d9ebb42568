"""Parts of a demonstration that are in no app: motion at both of its ends, and touches.

Motion between two apps is found from their paths (`caesura_protocol.programs.checks.fidelity`). Motion before
the first app and after the last one, and a contact that is too short for an app, are not. So a note of the
program states them, and whether the demonstration began or ended while the flange moved.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby, pairwise

from caesura_protocol.app_kinds import APP_KINDS, ends_in_contact
from caesura_protocol.messages import App, Segment, Vector
from caesura_protocol.number_words import fixed, interval
from caesura_protocol.programs.checks.fidelity import STEPPED_M, STEPPED_RAD
from caesura_protocol.programs.program_gripper import GRIPS
from caesura_protocol.rotations import angle_between
from caesura_protocol.up_direction import UP
from caesura_service.constants import GRAVITY
from caesura_service.program.carried_loads import hangs
from caesura_service.program.program_segment import PUSHES_BACK_N, Moment, MomentAt, length

NAMED = 5  # touches in a note, the strongest ones
LEFT_OUT = "Taught and in no app: "
BEGINS_MOVING = "The recording begins in motion: the way to where the program begins was not seen."
ENDS_MOVING = "The recording ends in motion: the program stops where it was seen last."


def left_out_note(
    segments: Sequence[Segment],
    apps: Sequence[App],
    moment_at: MomentAt,
    up: Vector = UP,
    fingers: Iterable[str] = (),
) -> str | None:
    """Return a note on the parts of a finished demonstration in no app.

    None if there are none, or none are known. apps: as they were inferred, in time order; up: away from
    gravity, base frame; fingers: texts on their motion in no app.
    """
    if not segments or not apps:
        return None
    said = [*_at_the_ends(segments, apps, moment_at), *_touches(segments, apps, up), *fingers]
    return f"{LEFT_OUT}{'; '.join(said)}. Teach it again where the robot is to do it." if said else None


def _at_the_ends(segments: Sequence[Segment], apps: Sequence[App], moment_at: MomentAt) -> Iterator[str]:
    first, last = apps[0], apps[-1]
    began, begins = segments[0].t0, first.t0 if first.path is None else first.path.start.t
    if moved := _moved(moment_at(began), moment_at(begins)):
        path = "" if first.path is None else "the path of "
        yield f"{moved} at {interval(began, begins, 1)} s, before {path}the first app"
    until = last.tn if last.path is None else last.path.tn
    ended, there = segments[-1].tn, moment_at(until)
    reached = there if last.target is None else Moment(last.target, last.orientation, None, None)
    if moved := _moved(reached, moment_at(ended)):
        path = "" if last.path is None else "the path of "
        yield f"{moved} at {interval(min(until, ended), ended, 1)} s, after {path}the last app"


def _moved(one: Moment, other: Moment) -> str:
    """Return how far a flange moves and turns, as text; empty below the drift of a hand at rest."""
    metres, turned = math.dist(one.position, other.position), 0.0
    if one.orientation is not None and other.orientation is not None:
        turned = angle_between(one.orientation, other.orientation)
    parts = [f"{fixed(1000 * metres, 0)} mm"] if metres > STEPPED_M else []
    parts += [f"{math.degrees(turned):.0f}°"] if turned > STEPPED_RAD else []
    return " and ".join(parts)


def _touches(segments: Sequence[Segment], apps: Sequence[App], up: Vector) -> Iterator[str]:
    """Yield contacts in no app.

    Those that continue an app in contact or lie in one are left out, and so are bounces before it, and the
    weight of what was grasped and is carried directly before or after.
    """
    used = {index for app in apps for index in app.segments}
    beside = {index for app in apps if APP_KINDS[app.kind].in_contact for index in app.segments}
    weights = _weights(apps)
    met = [(one.t0, two.t0) for one, two in pairwise(apps) if ends_in_contact(one.kind, two.kind)]
    lost: list[list[Segment]] = []
    place = 0
    for touches, run in groupby(segments, key=lambda one: one.contact == "contact"):
        steps = list(run)
        end = place + len(steps)
        weight_n = max(weights.get(place - 1, 0.0), weights.get(end, 0.0))
        if (
            touches
            and used.isdisjoint(range(place, end))
            and not (beside & {place - 1, end} or _is_weight(steps, weight_n, up))
        ):
            lost.append(steps)
        place = end
    lost = [steps for steps in lost if not any(t0 < steps[0].t0 and steps[-1].tn <= tn for t0, tn in met)]
    strongest = sorted(lost, key=_newtons)[-NAMED:]
    for steps in lost:
        if steps in strongest:
            when = interval(steps[0].t0, steps[-1].tn, 1)
            yield f"a contact of {fixed(_newtons(steps), 1)} N at {when} s"
    if rest := len(lost) - len(strongest):
        yield f"{rest} weaker contacts"


def _weights(apps: Sequence[App]) -> dict[int, float]:
    """Return the weights [N] of what was grasped and is carried, by the indices of the segments."""
    weights: dict[int, float] = {}
    grasped = False
    for app in apps:
        grasped = app.kind == "grasp" if app.kind in GRIPS else grasped
        if grasped and APP_KINDS[app.kind].carries and app.load_kg is not None:
            weights |= dict.fromkeys(app.segments, app.load_kg * GRAVITY)
    return weights


def _is_weight(steps: Sequence[Segment], weight_n: float, up: Vector) -> bool:
    """Whether a contact is only the weight [N] of what is carried beside it, as it is lifted or let go."""
    most_n = weight_n + PUSHES_BACK_N
    return weight_n > 0.0 and _newtons(steps) < most_n and all(hangs(step.force, up) for step in steps)


def _newtons(steps: Sequence[Segment]) -> float:
    return max(length(step.force) for step in steps)
