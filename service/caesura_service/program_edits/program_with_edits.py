"""Applies an operator's edits to an inferred program, again after each new inference.

Rules
- An edit refers to an app by its kind and start time. After a correction it applies to the app of this kind
  whose time overlaps most, if they share half of their joint time.
- Edits are applied one after the other. One whose app is gone is listed as not applied, with the reason.
- An edit whose app has changed times, as after a correction that joined two apps, is applied, with a note.
- A field of an app has the value of its last edit. Apps that are taught later follow in their own order.
- No force is above the limit of the cell, or above that which a correction sets for the app.
- Apps that were taught again are part of their edit, at constant times: the first one begins where the part
  began when it was replaced.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from caesura_protocol.app_kinds import app_title
from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import (
    MAX_TAUGHT_AGAIN,
    App,
    Correction,
    DeleteApp,
    Program,
    ProgramEdit,
    ReplacePart,
)
from caesura_protocol.number_words import fixed
from caesura_service.program_edits.edit_log import EditLog
from caesura_service.program_edits.edited_app_list import EditedAppList
from caesura_service.program_edits.edited_app_list_cache import EditedAppListCache, go_on

NAMED = 5  # deleted apps in a note, the newest ones


def with_edits(
    program: Program,
    log: EditLog,
    drafts: EditedAppListCache | None = None,
    pause: Callable[[], None] = go_on,
) -> Program:
    """Return the inferred program with these edits.

    Its notes name the apps that were deleted, the edits that do not apply, and those that apply to an app at
    another time.

    drafts: cached drafts of earlier edits of the session; pause: called after each edit and app.
    """
    if not log.revision:
        return program
    made = _edited(_draft(program, log, drafts, pause), pause)
    taken_back = log.listed[len(log.active) :]
    changes = {
        "apps": made.apps,
        "name": made.name,
        "edit_revision": log.revision,
        "edits": (*made.edits, *taken_back),
        "notes": (
            *program.notes,
            *_deleted(made.edits),
            *(_note(edit) for edit in made.edits if edit.reason),
        ),
    }
    return program.model_copy(update=changes)


def at_edit(
    program: Program,
    log: EditLog,
    number: int,
    drafts: EditedAppListCache | None = None,
    pause: Callable[[], None] = go_on,
) -> Program:
    """Return the version of the program with the effective edits up to a number; 0: none."""
    bare = program.model_copy(update={"edits": (), "edit_revision": 0})
    version = EditLog(tuple(edit for edit in log.active if edit.number <= number), (), number)
    return with_edits(bare, version, drafts, pause)


def check_applies(
    program: Program,
    log: EditLog,
    drafts: EditedAppListCache | None = None,
    pause: Callable[[], None] = go_on,
) -> None:
    """Check that the last edit of a log applies to the inferred program. Raises ProtocolError `conflict`."""
    draft = _draft(program, log, drafts, pause)
    if not draft.known:
        return
    last = draft.known[-1]
    if _is_left_out(last):
        raise ProtocolError("conflict", str(last.reason))
    if isinstance(last.action, ReplacePart) and (standing := draft.taught_again) > MAX_TAUGHT_AGAIN:
        why = (
            f"the program would have {standing} apps that were taught again, of {MAX_TAUGHT_AGAIN} at most: "
            "replace or undo some of them"
        )
        raise ProtocolError("conflict", why, limit=MAX_TAUGHT_AGAIN)


def _draft(
    program: Program, log: EditLog, drafts: EditedAppListCache | None, pause: Callable[[], None]
) -> EditedAppList:
    drafts = EditedAppListCache() if drafts is None else drafts
    return drafts.draft(program.apps, log.active, program.force_limit_n, program.corrections, pause)


def _is_left_out(edit: ProgramEdit) -> bool:
    return edit.state == "not_applied"


def _deleted(edits: Sequence[ProgramEdit]) -> Iterator[str]:
    """Yield a note on the taught apps that people deleted: the program does not do what they did."""
    deleted = [
        f"{app_title(edit.action.app.kind)} at {fixed(edit.action.app.t0, 1)} s ({edit.author})"
        for edit in edits
        if isinstance(edit.action, DeleteApp) and edit.action.app.added is None and not _is_left_out(edit)
    ]
    if deleted:
        rest = len(deleted) - NAMED
        more = f" and {rest} earlier ones" if rest > 0 else ""
        yield f"Taught and deleted: {', '.join(deleted[-NAMED:])}{more}."


def _note(edit: ProgramEdit) -> str:
    applied = "not applied" if _is_left_out(edit) else "applied"
    return f"Edit {edit.number} by {edit.author} ({edit.action.do}) is {applied}: {edit.reason}."


class EditingResult(NamedTuple):
    """The apps after edits, and each edit with its outcome."""

    apps: tuple[App, ...]
    edits: tuple[ProgramEdit, ...]
    name: str | None  # of the program


def apply(
    apps: Sequence[App],
    edits: Sequence[ProgramEdit],
    force_limit_n: float | None = None,
    corrections: Sequence[Correction] = (),
) -> EditingResult:
    """Apply edits to inferred apps, oldest first.

    force_limit_n: of the cell [N]; corrections: of the session, which may limit the force of an app.
    """
    return _edited(EditedAppListCache().draft(apps, edits, force_limit_n, corrections))


def _edited(draft: EditedAppList, pause: Callable[[], None] = go_on) -> EditingResult:
    apps: list[App] = []
    for item in draft.items:
        apps.append(item.app)
        pause()
    return EditingResult(tuple(apps), tuple(draft.known), draft.name)
