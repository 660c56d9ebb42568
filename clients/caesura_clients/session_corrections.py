"""Correction of a session: one edit, applied once or refused with the reason.

An edit states the revision that its author has seen, so that no operator overwrites the correction of
another. A closed session may have to be rebuilt from the journal first; until then the service answers
`overloaded`, and the edit is sent again.
"""

from __future__ import annotations

import time

from caesura_clients import query
from caesura_protocol.codec import decode, encode
from caesura_protocol.errors import ProtocolError, Unreachable
from caesura_protocol.keys import station_key
from caesura_protocol.messages import (
    Ack,
    Action,
    Control,
    Describe,
    Edit,
    EditEffect,
    EditProgram,
    Insert,
    Preview,
    Since,
)
from caesura_protocol.transport.transport_interface import Transport

Made = Edit | Preview | Describe | EditProgram  # what an operator changes, or would change

EDIT_TIMEOUT_S = 10.0  # an hour is filtered anew in half of that, on a busy machine
PATIENCE_S = 60.0  # a minute of a session is rebuilt from the journal in one or two
SILENCE_S = 5.0  # in which another instance takes over from one that died
RETRY_S = 0.25
MARK_ATTEMPTS = 5


def edit(
    transport: Transport,
    station: str,
    session: str,
    action: Action,
    *,
    author: str,
    revision: int | None = None,
) -> Ack:
    """Correct a session; return the acknowledgement with its new revision.

    revision: that the author has seen; by default the current one, which is queried first. Raises
    ProtocolError if the service refuses (`conflict`, with the current revision as its limit, if another edit
    came first), NotFound, or Unreachable if no service answers: the revision then shows whether the edit was
    applied.
    """
    if revision is None:
        revision = query.snapshot(transport, station, session).status.revision
    made = Edit(session=session, revision=revision, author=author, action=action, with_effect=True)
    return send(transport, station, made)


def preview(
    transport: Transport, station: str, session: str, action: Action | Since, *, revision: int | None = None
) -> EditEffect:
    """Return what a correction would change, or what those since one have changed.

    It changes nothing. Raises as `edit`.
    """
    if revision is None:
        revision = query.snapshot(transport, station, session).status.revision
    effect = send(transport, station, Preview(session=session, revision=revision, action=action)).effect
    if effect is None:
        raise ProtocolError("internal", "the service answered a preview without its effect")
    return effect


def send(transport: Transport, station: str, made: Made, *, patience_s: float = PATIENCE_S) -> Ack:
    """Send an edit; repeat it while the service is overloaded or silent, at most `patience_s`.

    Raises as `edit`.
    """
    began = time.monotonic()
    while True:
        try:
            return _ask(transport, station, made)
        except ProtocolError as refusal:
            if refusal.code != "overloaded" or time.monotonic() >= began + patience_s:
                raise
        except Unreachable:  # asking again does no harm: what was carried out is acknowledged once more
            if time.monotonic() >= began + min(patience_s, SILENCE_S):
                raise
        time.sleep(RETRY_S)


def mark(
    transport: Transport, station: str, session: str, t: float, *, author: str, revision: int = 0
) -> Ack:
    """Force a changepoint at a time [s], also while other editors correct the session.

    After a `conflict` it is sent again with the current revision, at most MARK_ATTEMPTS times. revision: an
    estimate of the current one, for the first attempt. Raises as `edit`.
    """
    for _ in range(MARK_ATTEMPTS):
        made = Edit(session=session, revision=revision, author=author, action=Insert(t=t))
        try:
            return send(transport, station, made)
        except ProtocolError as refusal:
            refused = refusal
            if not is_stale(refusal):
                raise
            revision = int(refusal.limit)
    raise refused


def is_stale(refusal: ProtocolError) -> bool:
    """Return whether another edit came first: a `conflict` of revisions, whose limit is the current one."""
    return refusal.code == "conflict" and type(refusal.value) is int and type(refusal.limit) is int


def _ask(transport: Transport, station: str, made: Made) -> Ack:
    content = encode(Control(command=made))
    answers = transport.query(station_key(station, "control"), content, timeout_s=EDIT_TIMEOUT_S)
    if answers.replies:
        return decode(answers.replies[0].payload, answers.replies[0].encoding, Ack)
    if answers.refusals:
        raise answers.refusals[0]
    if not (alive := query.services(transport)):
        raise query.no_service(transport)
    seen = (
        f"; if its revision is still {made.revision}, nothing has changed" if isinstance(made, Edit) else ""
    )
    raise Unreachable(
        f"no answer to the {made.type} of {station}/{made.session}, and {', '.join(alive)} is alive: "
        f"the answer was lost, another instance takes the station over, or it is forbidden{seen}"
    )
