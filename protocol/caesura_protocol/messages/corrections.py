"""Corrections of a session's results, their commands, and the effect of each."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from caesura_protocol.app_kinds import AppKind
from caesura_protocol.messages.field_types import (
    AppLabel,
    Author,
    Count,
    EditState,
    Kind,
    Listed,
    Name,
    Newtons,
    PhaseKind,
    PhaseName,
    Seconds,
    ShortTag,
    Vector,
)
from caesura_protocol.messages.limits import MAX_EFFECT_ROWS
from caesura_protocol.messages.message import Message


class Insert(Message):
    """Insert a changepoint, at the observation boundary nearest to `t`."""

    do: Literal["insert"] = "insert"
    t: Seconds  # [s]


class Remove(Message):
    """Remove the changepoint nearest to `t`: its two segments become one."""

    do: Literal["remove"] = "remove"
    t: Seconds  # [s]


class Move(Message):
    """Move the changepoint nearest to `t` to `to`."""

    do: Literal["move"] = "move"
    t: Seconds  # [s]
    to: Seconds  # [s]


class Relabel(Message):
    """Set the kind of the segment that contains `t`, which keeps its changepoints and gets none inside."""

    do: Literal["relabel"] = "relabel"
    t: Seconds  # [s]
    kind: Kind


class LimitForce(Message):
    """Limit the force of the app in whose time `t` lies to `newton`."""

    do: Literal["limit_force"] = "limit_force"
    t: Seconds  # [s]
    newton: Newtons | None  # None: only the cell's limit


class NamePhase(Message):
    """Name the phase that contains `t`; its apps are a group of that name."""

    do: Literal["name_phase"] = "name_phase"
    t: Seconds  # [s]
    name: PhaseName


class Undo(Message):
    """Undo the last correction."""

    do: Literal["undo"] = "undo"


class Redo(Message):
    """Redo the correction that was undone last."""

    do: Literal["redo"] = "redo"


class TakeBack(Message):
    """Undo one correction; later ones stay."""

    do: Literal["take_back"] = "take_back"
    number: Count  # of the correction, as the program lists it


Change = Insert | Remove | Move | Relabel | LimitForce | NamePhase
Action = Annotated[
    Insert | Remove | Move | Relabel | LimitForce | NamePhase | Undo | Redo | TakeBack,
    Field(discriminator="do"),
]


class Edit(Message):
    """Command: correct the results of an open or closed session. Refused if the revision differs."""

    type: Literal["edit"] = "edit"
    session: Name
    revision: Count  # of the session, as the editor has seen it; every edit makes it one more
    author: Author
    action: Action
    with_effect: bool = False  # requested in the Ack; an older editor reads at most 256 items of one


class Since(Message):
    """Request for the changes by all corrections after one, from the state then to the current one."""

    do: Literal["since"] = "since"
    number: Count  # of the last one that counts before, as the program lists it; 0: none does


class Preview(Message):
    """Command: return what an edit would change. It is refused if the edit would be; nothing is changed.

    The reply is an Ack with the effect and the current revision.
    """

    type: Literal["preview"] = "preview"
    session: Name
    revision: Count  # as of an edit
    action: Annotated[Action | Since, Field(discriminator="do")]


class SegmentOutline(Message):
    """The fields of a segment in an effect."""

    t0: Seconds  # [s]
    tn: Seconds  # [s]
    kind: Kind
    load_kg: float | None = (
        None  # transport and hold: what is carried; a row differs by its times and kind alone
    )
    load_sd_kg: float | None = None


class AppOutline(Message):
    """The fields of an app in an effect."""

    kind: AppKind
    name: AppLabel | None = None  # that a person gave it
    t0: Seconds  # [s]
    tn: Seconds  # [s]
    target: Vector | None = None  # [m] base frame
    force: Vector | None = None  # [N] what the robot exerts
    load_kg: float | None = None
    load_sd_kg: float | None = None  # a row differs by its load alone
    gripper_width: float | None = None  # [m]


class PhaseOutline(Message):
    """The fields of a phase in an effect."""

    t0: Seconds  # [s]
    tn: Seconds  # [s]
    kind: PhaseKind
    name: PhaseName | None = None


class EditEffect(Message):
    """Changes by an edit: the removed segments, apps and phases, and those that replace them.

    Each list runs from the first one that differs to the last one, both at the same time. Two differ if their
    outlines do.
    """

    first_segment: Count  # index of the first one, before and after
    segments_before: Annotated[Listed[SegmentOutline], Field(max_length=MAX_EFFECT_ROWS)] = ()
    segments_after: Annotated[Listed[SegmentOutline], Field(max_length=MAX_EFFECT_ROWS)] = ()
    first_app: Count  # index of the first one in the program, before and after
    apps_before: Annotated[Listed[AppOutline], Field(max_length=MAX_EFFECT_ROWS)] = ()
    apps_after: Annotated[Listed[AppOutline], Field(max_length=MAX_EFFECT_ROWS)] = ()
    first_phase: Count = 0  # index of the first one, before and after
    phases_before: Annotated[Listed[PhaseOutline], Field(max_length=MAX_EFFECT_ROWS)] = ()
    phases_after: Annotated[Listed[PhaseOutline], Field(max_length=MAX_EFFECT_ROWS)] = ()
    more: Count = 0  # rows that are not listed, of all six together
    inferred_again: bool = (
        False  # another version made the session's results: others change with the edit, too
    )


class Correction(Message):
    """A correction of a session, and whether it is in effect."""

    number: Count  # of this one, from 1; undo and redo count
    author: Author
    at: Seconds  # [s] time of day (UTC)
    action: Annotated[Change, Field(discriminator="do"), ShortTag]
    meant: Seconds | None = None  # [s] where the changepoint was that it removed or moved
    placed: Seconds | None = None  # [s] where the changepoint is that it inserted or moved; None: yet to come
    state: EditState = "applied"
    reason: str | None = None  # why it is not applied
