"""Programs and edits of them, as tests make them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from caesura_protocol.messages import (
    App,
    AppPath,
    AppReference,
    EditProgram,
    Program,
    ProgramAction,
    ReplacePart,
    ViaPoint,
)
from caesura_service.program_edits.edit_log import EditLog
from caesura_service.program_edits.program_with_edits import with_edits
from harness.programs import pick_and_place

START = ViaPoint(t=0.2, position=(-0.014, -0.673, 0.29), orientation=None)
PATH = AppPath(
    start=START,
    tn=1.8,
    length_m=0.18,
    deviation_m=0.001,
    deviation_rad=0.0,
    tolerance_m=0.002,
    tolerance_rad=0.02,
)


def program(apps: Sequence[App], **changes: Any) -> Program:
    fields = {"station": "cell-1", "session": "s1", "instance": "test-1", "epoch": 1, "version": 4, "t": 12.0}
    return Program(**fields, complete=True, apps=tuple(apps), **changes)


def ref(app: App) -> AppReference:
    return AppReference(kind=app.kind, t0=app.t0, tn=app.tn, added=app.added)


def log(*actions: ProgramAction, author: str = "Ann", again: Sequence[App] = ()) -> EditLog:
    """again: the apps of each `ReplacePart`."""
    made = EditLog()
    for action in actions:
        command = EditProgram(session="s1", revision=made.revision, author=author, action=action)
        made = made.after(command, 100.0, again if isinstance(action, ReplacePart) else ())
    return made


def edited(
    apps: Sequence[App], *actions: ProgramAction, again: Sequence[App] = (), **changes: Any
) -> Program:
    return with_edits(program(apps, **changes), log(*actions, again=again))


def taught() -> tuple[App, ...]:
    first, *rest = pick_and_place()
    return (first.model_copy(update={"path": PATH, "joints": (0.1,) * 7}), *rest)
