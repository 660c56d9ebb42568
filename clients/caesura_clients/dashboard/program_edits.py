"""Edits a program at the request of a browser: editable values, past edits, and findings of the check.

Requests of a browser are not trusted: each is validated as an `EditProgram`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from functools import cache
from typing import Any, NamedTuple

from pydantic import ValidationError

from caesura_clients.dashboard.correction_requests import EditRefused, field_words, refused, said
from caesura_clients.dashboard.edit_conflicts import ATTEMPTS, UNITS, edited_again
from caesura_clients.dashboard.program_form_values import SCALES, shown_numbers, shown_texts
from caesura_clients.program_editing import (
    FIELD_WORDS,
    AppNames,
    in_words,
    names_of,
    outcome_words,
    reference,
)
from caesura_clients.query import snapshot
from caesura_clients.session_corrections import is_stale, send
from caesura_protocol.app_kinds import APP_KINDS, AppKind
from caesura_protocol.errors import CaesuraError, ProtocolError
from caesura_protocol.messages import (
    Ack,
    App,
    AppChange,
    ChangeApp,
    EditProgram,
    NameProgram,
    Program,
    ProgramAction,
    ProgramEdit,
)
from caesura_protocol.number_words import fixed
from caesura_protocol.programs.app_time_shifts import PLACED, edited_times
from caesura_protocol.programs.checks import findings_beside_notes
from caesura_protocol.programs.document import document
from caesura_protocol.programs.export_formats import WRITERS, formats_of
from caesura_protocol.robots import grippers, robot_description
from caesura_protocol.session_time_display import NO_OFFSET, SessionClock
from caesura_protocol.transport.transport_interface import Transport
from caesura_protocol.validation_words import first_finding

Request = Mapping[str, Any]
ONE_PLACE_M = 1e-3  # so far apart two positions of one name may be
CHECKED = 200  # apps that a program may have for its check at every change


class ProgramDesk:
    """Sends edits of programs to the service."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def carry_out(
        self,
        station: str,
        request: Request,
        clock: SessionClock = NO_OFFSET,
        program: Program | None = None,
        others: Iterable[Program] = (),
    ) -> str:
        """Edit a program; return the outcome as text. Raises EditRefused, and EditConflict.

        request: with `seen`, the values with which the form was filled, the edit applies to the current
        program. clock: of the session, for the text. program: the last one received. others: programs of
        other sessions, in which a name may occur too.
        """
        seen = request.get("seen")
        command = parse({name: value for name, value in request.items() if name != "seen"})
        try:
            if isinstance(seen, dict):
                ack = self._edit(station, command, seen, program)
            else:
                ack = send(self._transport, station, command)
        except (ProtocolError, CaesuraError) as error:
            raise refused(error, command, clock) from error
        names = None if program is None else names_of(program)
        words = outcome_words(command.action, ack, clock, names)
        return f"{words[0].upper()}{words[1:]}.{shared_name(command.action, program, others)}"

    def _edit(self, station: str, command: EditProgram, seen: dict[str, Any], program: Program | None) -> Ack:
        """Edit the current program, unless another operator has changed the same field."""
        is_known = program is not None and program.session == command.session
        now = program if is_known else None
        for _ in range(ATTEMPTS - 1):
            now = now or snapshot(self._transport, station, command.session).program
            try:
                return send(self._transport, station, edited_again(command, seen, now))
            except ProtocolError as refusal:
                if not is_stale(refusal):
                    raise
                now = None
        now = snapshot(self._transport, station, command.session).program
        return send(self._transport, station, edited_again(command, seen, now))


def shared_name(action: ProgramAction, program: Program | None, others: Iterable[Program]) -> str:
    """Return a sentence on a given name that something else has too; empty without one.

    A name is a label, so it is not refused. others: programs of other sessions.
    """
    if isinstance(action, NameProgram):
        held = next((one for one in others if one.name == action.name), None)
        whose = "" if held is None else f"the program of {held.station}/{held.session}"
        return _shared("program name", action.name, whose)
    if not isinstance(action, ChangeApp) or program is None:
        return ""
    mine = next((one for one in program.apps if reference(one) == action.app), None)
    for number, app in enumerate(program.apps, 1):
        if app is mine or mine is None:
            continue
        if action.name and app.name == action.name:
            return _shared("name", action.name, f"app {number}")
        place = action.target or mine.target
        if action.target_name and app.target_name == action.target_name and app.target and place:
            off_m = math.dist([value or 0.0 for value in place], app.target)
            if off_m > ONE_PLACE_M:
                whose = f"app {number}, {fixed(1000 * off_m, 0)} mm away"
                return _shared("position name", action.target_name, whose)
    return ""


def _shared(what: str, name: str, whose: str) -> str:
    return (
        f" The {what} '{name}' is also that of {whose}: choose another to distinguish them." if whose else ""
    )


def parse(request: Request) -> EditProgram:
    """Return the edit of a browser's request, checked. Raises EditRefused."""
    try:
        return EditProgram.model_validate(dict(request))
    except ValidationError as error:
        found = _beyond(error) or first_finding(error, named=field_words)
        raise EditRefused(said(found)) from error


def _beyond(error: ValidationError) -> str:
    """Return text on a number beyond its limit, in the unit of the page; empty for any other error."""
    one = error.errors(include_url=False)[0]
    field, given = str(one["loc"][-1]) if one["loc"] else "", one["input"]
    sides = [(_LIMITS[side], limit) for side, limit in one.get("ctx", {}).items() if side in _LIMITS]
    if field not in SCALES or not sides or not isinstance(given, int | float):
        return ""
    (side, limit), (scale, _), unit = sides[0], SCALES[field], UNITS.get(field, "mm")
    return f"the {FIELD_WORDS[field]} is {scale * given:g} {unit}, expected {side} {scale * limit:g} {unit}"


def editing_of(program: Program, clock: SessionClock = NO_OFFSET) -> dict[str, Any]:
    """Return the payload on a program's edits, the availability of undo and redo, and its exports."""
    states, names = [edit.state for edit in program.edits], names_of(program)
    return {
        "session": program.session,
        "name": program.name or "",
        "changed": _changed(program),
        "editRevision": program.edit_revision,
        "undoable": any(state != "undone" for state in states),
        "redoable": "undone" in states,
        "edits": [_edit_row(edit, clock, names) for edit in program.edits],
        "kinds": [_kind_row(kind) for kind in APP_KINDS],
        "exports": [
            [WRITERS[name].title, f"/programs/{program.station}/{program.session}/{name}"]
            for name in _formats_of(program.robot)
        ],
        "dataset": f"/datasets?session={program.station}/{program.session}" if program.complete else "",
        "grippers": _grippers_of(program),
    }


def _changed(program: Program) -> str:
    """Return how the program was changed last: edited, corrected, or changed, as by an undo."""
    if any(edit.at == program.edited for edit in program.edits):
        return "edited"
    return "corrected" if any(one.at == program.edited for one in program.corrections) else "changed"


def _kind_row(kind: AppKind) -> list[Any]:
    """Return an insertable kind: its name, its title, and the values that a new app of it may state."""
    facts = APP_KINDS[kind]
    stated = {
        "target": "target" in facts.ports,
        "force": facts.presses,
        "gripper_width": "width" in facts.ports,
        "seconds": bool(facts.needs),
    }
    return [kind, facts.title, [name for name, is_stated in stated.items() if is_stated]]


def _edit_row(edit: ProgramEdit, clock: SessionClock, names: AppNames) -> list[Any]:
    state, reason = edit.state.replace("_", " "), clock.text(edit.reason or "")
    return [edit.number, in_words(edit.action, clock, names), edit.author, state, reason]


def _grippers_of(program: Program) -> list[list[str]]:
    """Return name and title of the grippers that an export may state; empty if the gripper is known."""
    if not any(app.kind in {"grasp", "gripper_move"} for app in program.apps):
        return []
    with suppress(CaesuraError):  # a robot that is not known here
        if program.robot is not None and robot_description(program.robot).gripper is not None:
            return []
    return [[name, one.title] for name, one in grippers().items()]


@cache
def _formats_of(robot: str | None) -> list[str]:
    """Return the formats in which a robot's program can be written; all of them for an unknown robot."""
    try:
        return formats_of(robot)
    except CaesuraError:
        return formats_of(None)


def app_editing(apps: Sequence[App], index: int) -> dict[str, Any]:
    """Return the editable content of an app.

    It has its reference, its values in the page's units, and the places to which it can be moved.
    """
    app = apps[index]
    return {
        "reference": reference(app).model_dump(),
        "target": app.target,
        **shown_texts(app),
        "values": shown_numbers(app),
        "changes": [_change(mark) for mark in app.changes],
        "set": [mark.field for mark in app.changes if mark.field not in PLACED],
        "earlier": _behind(apps, index - 2) if index > 0 else None,
        "later": _behind(apps, index + 1) if index + 1 < len(apps) else None,
    }


def _behind(apps: Sequence[App], index: int) -> dict[str, Any]:
    """Return the place after the app at `index`, to which another is moved; below 0 the first place."""
    return {"after": reference(apps[index]).model_dump() if index >= 0 else None}


def _change(mark: AppChange) -> str:
    words = f"{FIELD_WORDS[mark.field]} by {mark.author}"
    scale, unit = _UNITS.get(mark.field, (0.0, ""))
    if isinstance(mark.inferred, float | int) and unit:
        return f"{words} (taught {scale * mark.inferred:.4g} {unit})"
    if isinstance(mark.inferred, tuple) and unit:
        taught = ", ".join(fixed(scale * float(x or 0.0), 0) for x in mark.inferred)
        return f"{words} (taught {taught} {unit})"
    return words


_LIMITS: Mapping[str, str] = {"ge": "at least", "gt": "more than", "le": "at most", "lt": "less than"}
_UNITS: Mapping[str, tuple[float, str]] = {
    "target": (1000.0, "mm"),
    "force_n": (1.0, "N"),
    "tolerance_m": (1000.0, "mm"),
    "gripper_width": (1000.0, "mm"),
}


class CheckedProgram(NamedTuple):
    """Apps at the times of the document, and the check's findings without a robot.

    A finding is (severity, reason); that of an app does not name it, because the page shows it at the app.
    """

    apps: Sequence[App]
    of_program: list[list[str]]
    of_apps: dict[int, list[list[str]]]


def checked(program: Program, clock: SessionClock = NO_OFFSET) -> CheckedProgram:
    """Compute the times of a program's document once, and check it.

    There are no findings while a program without edits is being taught: missing parts may still be taught.
    clock: of the session, for the reasons. The program's notes are not among the findings: the page shows
    them separately.
    """
    if not program.apps or not (program.complete or program.edits):
        return CheckedProgram(program.apps, [], {})
    if len(program.apps) > CHECKED:
        times = edited_times(program.apps, (), program.edits)
        reason = f"not checked here, because it has more than {CHECKED} apps: run 'caesura check'"
        return CheckedProgram(program.apps if times is None else times.apps, [["warning", reason]], {})
    made = document(program)
    of_program: list[list[str]] = []
    of_apps: dict[int, list[list[str]]] = {}
    for one in findings_beside_notes(made):
        reason = clock.text(one.on_page or one.reason)
        if one.index is None:
            of_program.append([one.severity, reason])
        else:
            of_apps.setdefault(one.index, []).append([one.severity, reason])
    return CheckedProgram(made.apps, of_program, of_apps)
