"""Returns the apps of a session that replace a part of another session's program, or refuses them."""

from __future__ import annotations

from caesura_protocol.codec import encode
from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import MAX_PART_APPS, MAX_PART_BYTES, App, Program
from caesura_protocol.programs.app_time_shifts import edited_times
from caesura_protocol.up_direction import APART_RAD, UP, tilt_between, up_text


def apps_for(program: Program, taught_again: Program) -> tuple[App, ...]:
    """Return the apps of `taught_again`, with its edits, for a part of `program` of the same station.

    Raises ProtocolError `conflict` or `too_large`, with the reason.
    """
    name, apps = taught_again.session, _one_after_the_other(taught_again)
    for fails, reason in (
        (name == program.session, "replaces no part of itself: teach the part in a session of its own"),
        (not taught_again.complete, "is still open: stop it first"),
        (not apps, "has no apps"),
        (_has_gaps(taught_again), "lost samples within its apps: teach the part once more"),
    ):
        if fails:
            raise ProtocolError("conflict", f"session {name} {reason}", value=name)
    for what, of_part, of_program in (
        ("robot", taught_again.robot, program.robot),
        ("wrench source", _wrench_source(taught_again), _wrench_source(program)),
    ):
        if of_part != of_program:
            why = f"session {name} has another {what} than the program"
            raise ProtocolError("conflict", why, value=of_part, expected=of_program)
    if tilt_between(taught_again.up, program.up) > APART_RAD:
        why = f"session {name} was taught on a base that is mounted otherwise than that of the program"
        value, expected = up_text(taught_again.up or UP), up_text(program.up or UP)
        raise ProtocolError("conflict", why, value=value, expected=expected)
    _check_size(name, apps)
    return apps


def _one_after_the_other(program: Program) -> tuple[App, ...]:
    """Return the apps at the times of their execution, with the speeds that operators set in them."""
    times = edited_times(program.apps, (), program.edits)
    if times is None:
        return tuple(program.apps)
    return tuple(app.model_copy(update={"speed": None}) for app in times.apps)


def _check_size(name: str, apps: tuple[App, ...]) -> None:
    for why, value, limit in (
        ("has too many apps for a part", len(apps), MAX_PART_APPS),
        (
            "has too long paths for a part [bytes]",
            sum(len(encode(app).payload) for app in apps),
            MAX_PART_BYTES,
        ),
    ):
        if value > limit:
            raise ProtocolError("too_large", f"session {name} {why}", value=value, limit=limit)


def _has_gaps(program: Program) -> bool:
    return any(gap.t0 < app.tn and app.t0 < gap.tn for gap in program.gaps for app in program.apps)


def _wrench_source(program: Program) -> str | None:
    return None if program.wrench is None else program.wrench.source
