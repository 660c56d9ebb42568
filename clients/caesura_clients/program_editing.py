"""Editing the program of a session: one edit, applied once or refused with the reason.

An edit states the `edit_revision` that its author has seen, so that no operator overwrites the edit of
another. It refers to apps by their kind and time; `reference` makes such a reference.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from caesura_clients import query
from caesura_clients.session_corrections import send
from caesura_protocol.app_kinds import app_name, app_title
from caesura_protocol.errors import CaesuraError
from caesura_protocol.messages import (
    Ack,
    App,
    AppReference,
    ChangeApp,
    DeleteApp,
    DuplicateApp,
    EditProgram,
    InsertApp,
    MoveApp,
    NameProgram,
    Program,
    ProgramAction,
    Redo,
    ReplacePart,
    Undo,
)
from caesura_protocol.session_time_display import NO_OFFSET, SessionClock
from caesura_protocol.transport.transport_interface import Transport

#: The index of each app in the program, None for one that is not in it, and its name, as `names_of` has them.
AppNames = Mapping[tuple[str, int | None, float | None], tuple[int | None, str | None]]

HALF = 0.5  # of the time of an app


def reference(app: App) -> AppReference:
    """Return the reference to an app in an edit."""
    return AppReference(kind=app.kind, t0=app.t0, tn=app.tn, added=app.added)


def part_between(
    program: Program, t0: float, tn: float, clock: SessionClock = NO_OFFSET
) -> tuple[AppReference, AppReference]:
    """Return references to the first and last app of the part that was taught between two times [s].

    An app belongs to it where at least half of its time lies between them. Raises CaesuraError where none
    does, and where other apps stand among these in the program. clock: of the session, for its message.
    """
    inside = [i for i, app in enumerate(program.apps) if _share_within(app, t0, tn) >= HALF]
    between = f"between {clock.brief(t0)} and {clock.brief(tn)} s"
    if not inside:
        raise CaesuraError(
            f"no app has at least half of its time {between}: name the part by the numbers of its apps"
        )
    first, last = inside[0], inside[-1]
    if len(inside) <= last - first:
        raise CaesuraError(f"the apps {between} do not follow each other: name the part by their numbers")
    return reference(program.apps[first]), reference(program.apps[last])


def _share_within(app: App, t0: float, tn: float) -> float:
    """Return the share of an app's time that lies between two times; 1 for an app without duration."""
    if app.tn <= app.t0:
        return float(t0 <= app.t0 <= tn)
    return (min(app.tn, tn) - max(app.t0, t0)) / (app.tn - app.t0)


def edit_program(
    transport: Transport,
    station: str,
    session: str,
    action: ProgramAction,
    *,
    author: str,
    revision: int | None = None,
) -> Ack:
    """Edit the program of a session, open or closed; return the acknowledgement.

    revision: `edit_revision` of the program that the author has seen; by default the current one, which is
    queried first. Raises ProtocolError if the service refuses, NotFound or Unreachable.
    """
    if revision is None:
        revision = query.snapshot(transport, station, session).program.edit_revision
    made = EditProgram(session=session, revision=revision, author=author, action=action)
    return send(transport, station, made)


FIELD_WORDS: Mapping[str, str] = {
    "name": "name",
    "note": "note",
    "target": "target",
    "target_name": "position name",
    "speed": "speed",
    "force_n": "force",
    "tolerance_m": "tolerance",
    "gripper_width": "gripper width",
    "place": "place in the program",
    "added": "added",
    "taught_again": "taught again",
}


def names_of(program: Program) -> AppNames:
    """Return the places and names of a program's apps, and the names that edits gave to apps not in it."""
    names: dict[tuple[str, int | None, float | None], tuple[int | None, str | None]] = {}
    for edit in program.edits:
        action = edit.action
        if isinstance(action, ChangeApp) and action.name and edit.state != "undone":
            names[_key(action.app)] = None, action.name
        elif isinstance(action, InsertApp) and action.name:
            names[action.kind, edit.number, None] = None, action.name
    return names | {_key(reference(app)): (index, app.name) for index, app in enumerate(program.apps)}


def _key(app: AppReference) -> tuple[str, int | None, float | None]:
    """Return what identifies an app: the edit that added it, or else its start."""
    return app.kind, app.added, app.t0 if app.added is None else None


def in_words(action: ProgramAction, clock: SessionClock = NO_OFFSET, names: AppNames | None = None) -> str:
    """Return text on an edit of a program. clock: of its session; names: of its apps.

    An app of the program has its number; another has its time, or the edit that added it.

    >>> in_words(DeleteApp(app=AppReference(kind="grasp", t0=1.8, tn=3.5)))
    "'grasp' at 1.8 s deleted"
    """

    def at(app: AppReference, name: str | None = None) -> str:
        index, known = (names or {}).get(_key(app), (None, None))
        if index is not None:
            return app_name(index, app.kind, name or known)
        when = f"at {clock.shown(app.t0, 1)} s" if app.added is None else f"that edit {app.added} added"
        return f"'{name or known or app_title(app.kind)}' {when}"

    match action:
        case ChangeApp(app=app):
            words = f"{at(app, action.name)}: {', '.join(_changes(action))}"
        case MoveApp(app=app, after=after):
            words = f"{at(app)} moved {_after(at(after) if after else None)}"
        case DeleteApp(app=app) | DuplicateApp(app=app):
            words = f"{at(app)} {action.do}d"
        case InsertApp(after=after, kind=kind, name=name):
            words = f"'{name or app_title(kind)}' inserted {_after(at(after) if after else None)}"
        case ReplacePart(first=first, last=last, session=session):
            part = at(first) if first == last else f"{at(first)} to {at(last)}"
            words = f"{part} replaced by session '{session}'"
        case NameProgram(name=name):
            words = f"program named '{name}'"
        case Undo() | Redo():
            words = f"{action.do} done"
    return words


def outcome_words(
    action: ProgramAction, ack: Ack, clock: SessionClock = NO_OFFSET, names: AppNames | None = None
) -> str:
    """Return text on an acknowledged edit; of an undo and a redo, on the edit that was undone or restored."""
    moved = ack.program_edit
    if moved is None:
        return in_words(action, clock, names)
    lead = "undone" if isinstance(action, Undo) else "done again"
    return f"{lead}: {in_words(moved.action, clock, names)} (edit {moved.number} by {moved.author})"


def _changes(action: ChangeApp) -> Iterator[str]:
    for name, words in FIELD_WORDS.items():
        if getattr(action, name, None) is not None:
            yield f"{words} set"
        elif name in action.as_taught:
            yield f"{words} as taught"


def _after(after: str | None) -> str:
    return f"after {after}" if after else "to the beginning"
