"""Detects conflicts between the fields of a form and another operator's changes since the form was filled.

If both changed the same field, the operator is asked. If they changed different ones, both changes apply.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from caesura_clients.dashboard.correction_requests import EditRefused
from caesura_clients.dashboard.program_form_values import SCALES, shown_value, shown_values
from caesura_clients.program_editing import FIELD_WORDS, reference
from caesura_protocol.messages import (
    App,
    ChangeApp,
    Describe,
    EditProgram,
    NameProgram,
    Program,
    SessionStatus,
)

Values = Mapping[str, Any]
ATTEMPTS = 5  # to carry out a change that another operator is always a little faster than
UNKNOWN_AUTHOR = "another operator"
UNITS: Mapping[str, str] = {"speed": "%", "force_n": "N"}  # of the page; other numbers are in mm
_SUCCESS: Mapping[bool | None, str] = {True: "yes", False: "no", None: ""}


class EditConflict(EditRefused):
    """Another operator has changed a field of the form.

    found: the current values, in the units of the page.
    """

    def __init__(self, words: str, found: dict[str, Any]) -> None:
        super().__init__(words)
        self.found = found


def redescribed(command: Describe, status: SessionStatus) -> Describe:
    """Return the same change to the current description. Raises EditConflict."""
    present = status.description
    authors: dict[str, str] = {one.field: one.author for one in status.described_by}
    before, wanted = dict(command.before), dict(command.description)
    typed = {name: value for name, value in wanted.items() if value != before[name]}
    now = dict(present)
    found = {name: now[name] for name, value in typed.items() if now[name] not in (before[name], value)}
    if found:
        words = [
            _met_in_words(
                authors.get(name, UNKNOWN_AUTHOR), name, _stated(name, now[name]), _stated(name, typed[name])
            )
            for name in found
        ]
        raise EditConflict(_refusal(words), found)
    return command.model_copy(
        update={"before": present, "description": present.model_copy(update=typed)},
    )


def _stated(field: str, value: Any) -> str:
    """Return the value of a description's field as text."""
    if field == "success":
        return _SUCCESS[value]
    return _quoted(", ".join(value) if field == "tags" else value)


def edited_again(command: EditProgram, seen: Values, program: Program) -> EditProgram:
    """Return the same edit for the current program. Raises EditConflict.

    seen: the value that the form showed before the operator typed, by field, in the units of the page; a
    target has None for each coordinate that was not typed.
    """
    action = command.action
    if isinstance(action, NameProgram):
        _check_name(action, seen, program)
    elif isinstance(action, ChangeApp):
        app = next((one for one in program.apps if reference(one) == action.app), None)
        if app is None:  # inferred anew since: the service decides by the revision
            return command
        action = _changed(action, seen, app)
    return command.model_copy(update={"revision": program.edit_revision, "action": action})


def _check_name(action: NameProgram, seen: Values, program: Program) -> None:
    now = program.name or ""
    if "name" in seen and now not in (seen["name"], action.name):
        named = [edit.author for edit in program.edits if edit.action == NameProgram(name=now)]
        author = named[-1] if named else UNKNOWN_AUTHOR
        raise EditConflict(
            _refusal([_met_in_words(author, "name", _quoted(now), _quoted(action.name))]), {"name": now}
        )


def _changed(action: ChangeApp, seen: Values, app: App) -> ChangeApp:
    """Return the change, with the current value of each coordinate of its target that was not typed.

    Raises EditConflict.
    """
    now, found = shown_values(app), dict[str, Any]()
    for name, wanted in _wanted(action):
        if name in seen and (present := _met(seen[name], now.get(name), wanted)) is not None:
            found[name] = present[0]
    if found:
        wishes = dict(_wanted(action))
        words = [
            _met_in_words(_author(app, name), name, _valued(name, there), _valued(name, wishes[name], there))
            for name, there in found.items()
        ]
        raise EditConflict(_refusal(words), found)
    old = seen.get("target")
    if action.target is None or app.target is None or not isinstance(old, list) or len(old) != 3:
        return action
    axes = zip(action.target, app.target, old, strict=True)
    target = tuple(held if was is None else typed for typed, held, was in axes)
    return action.model_copy(update={"target": target})


def _wanted(action: ChangeApp) -> Iterator[tuple[str, Any]]:
    """Yield the fields that a change sets, with their values in the units of the page.

    "" for a cleared field.
    """
    for name in FIELD_WORDS:
        if (value := getattr(action, name, None)) is not None:
            yield name, shown_value(name, value)
        elif name in action.as_taught:
            yield name, ""


def _met(seen: Any, now: Any, wanted: Any) -> tuple[Any] | None:
    """Return the current value in a 1-tuple if it is neither the seen nor the wanted one; else None.

    If the seen value is a list, such as a target, the result has None for each axis without a conflict.
    """
    both = isinstance(now, list) and isinstance(wanted, list)
    if both and isinstance(seen, list) and len(seen) == len(now):
        rows = zip(seen, now, wanted, strict=True)
        axes = [None if was is None or held in (was, wish) else held for was, held, wish in rows]
        return (axes,) if any(one is not None for one in axes) else None
    return None if now in (seen, wanted) else (now,)


def _author(app: App, field: str) -> str:
    return next((mark.author for mark in app.changes if mark.field == field), UNKNOWN_AUTHOR)


def _valued(field: str, value: Any, there: Any = None) -> str:
    """Return a value of an app as text in the units of the page.

    there: of a target, None for axes to leave out.
    """
    if field not in SCALES:
        return _quoted(value)
    unit = UNITS.get(field, "mm")
    if isinstance(value, list):
        rows = zip("xyz", value, there or value, strict=True)
        axes = [f"{axis} = {one:g}" for axis, one, other in rows if None not in (one, other)]
        return f"{', '.join(axes)} {unit}"
    return "" if value is None or value == "" else f"{value:g} {unit}"


def _met_in_words(author: str, field: str, there: str, typed: str) -> str:
    """Return text on another author's change of a field to `there`, and on the typed value.

    there, typed: texts, "" for a cleared field.
    """
    what = FIELD_WORDS.get(field, field)
    did = f"has set the {what} to {there}" if there else f"has cleared the {what}"
    return f"{author} {did} meanwhile; you {f'set it to {typed}' if typed else 'cleared it'}"


def _quoted(text: str | None) -> str:
    return f"'{text}'" if text else ""


def _refusal(words: list[str]) -> str:
    first, *others = words
    return " ".join([f"Not saved: {first}.", *(f"{one[0].upper()}{one[1:]}." for one in others)])
