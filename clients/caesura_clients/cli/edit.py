"""`caesura edit`: correct a session from the command line."""

from __future__ import annotations

import getpass
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated, Any

import typer
from pydantic import TypeAdapter, ValidationError

from caesura_clients.cli.connection_options import Config, Connect
from caesura_clients.cli.options import connected, named, reported
from caesura_clients.client import Caesura
from caesura_clients.editing import edit as edit_session
from caesura_protocol.errors import CaesuraError, NotFound, ProtocolError
from caesura_protocol.messages import Action, LimitForce
from caesura_protocol.session_clock import NO_OFFSET, SessionClock, clock_of
from caesura_protocol.validation_words import first_finding

# What stands behind each action on the command line.
WORDS: dict[str, tuple[str, ...]] = {
    "insert": ("t",),
    "remove": ("t",),
    "move": ("t", "to"),
    "relabel": ("t", "kind"),
    "limit_force": ("t", "newton"),
    "name_phase": ("t", "name"),
    "undo": (),
    "redo": (),
}
USAGE = "; ".join(" ".join([do, *(word.upper() for word in words)]) for do, words in WORDS.items())
_ACTION: TypeAdapter[Action] = TypeAdapter(Action)


def edit(
    station: Annotated[str, typer.Argument(help="Teaching station.")],
    session: Annotated[str, typer.Argument(help="Session, as `caesura sessions` names it.")],
    action: Annotated[list[str], typer.Argument(help=f"{USAGE}. Times \\[s]; NEWTON none lifts a limit.")],
    author: Annotated[
        str | None, typer.Option(envvar="CAESURA_AUTHOR", help="Whose correction; by default the login's.")
    ] = None,
    revision: Annotated[
        int | None, typer.Option(min=0, help="Of the session as it was seen; by default the current one.")
    ] = None,
    endpoint: Connect = None,
    config: Config = None,
) -> None:
    """Correct a session, open or closed: changepoints, kinds, force limits, names of phases."""
    wanted = parse(action)
    with reported():
        named(station)
        with connected(endpoint, config) as caesura:
            clock, current = NO_OFFSET, revision
            if revision is None or _times(wanted):
                clock, current = _seen(caesura, station, session, revision)
            wanted = _on_clock(wanted, clock)
            with nearest_named(wanted, clock):
                ack = edit_session(
                    caesura.transport,
                    station,
                    session,
                    wanted,
                    author=author or getpass.getuser(),
                    revision=current,
                )
    typer.echo(f"{station}/{session} is at revision {ack.revision}")


def _seen(
    caesura: Caesura, station: str, session: str, revision: int | None
) -> tuple[SessionClock, int | None]:
    """The clock of a session, and the revision that was stated, or else its own."""
    try:
        found = caesura.snapshot(station, session)
    except NotFound:
        if revision is None:
            raise
        return NO_OFFSET, revision  # the service may know it, and hold it no longer
    return clock_of(found.segments.segments), found.status.revision if revision is None else revision


def _on_clock(wanted: Action, clock: SessionClock) -> Action:
    """The action with its times on the clock of the session."""
    return wanted.model_copy(update={name: clock.read(t) for name, t in _times(wanted).items()})


def _times(wanted: Action) -> dict[str, float]:
    """The times [s] of an action by the names of their fields; undo and redo have none."""
    return {name: getattr(wanted, name) for name in ("t", "to") if hasattr(wanted, name)}


@contextmanager
def nearest_named(wanted: Action, clock: SessionClock = NO_OFFSET) -> Iterator[None]:
    """Name the nearest apps where a force limit meets none. Raises CaesuraError in place of that refusal."""
    try:
        yield
    except ProtocolError as refusal:
        if refusal.code != "conflict" or not isinstance(wanted, LimitForce) or refusal.value != wanted.t:
            raise
        spans = refusal.expected if isinstance(refusal.expected, list | tuple) else []
        nearest = ", ".join(f"{_span(str(span), clock)} s" for span in spans)
        there = f"the nearest that do: {nearest}" if nearest else "no app of this session does"
        raise CaesuraError(f"no app exerts a force at {clock.brief(wanted.t)} s; {there}") from refusal


def _span(words: str, clock: SessionClock) -> str:
    """Two times as a refusal states them, `[3.0, 4.5]`, as people read them."""
    return " to ".join(clock.brief(float(t)) for t in words.strip("[]()").split(", "))


def parse(words: list[str]) -> Action:
    """An action as it is typed. Raises BadParameter, which names what there is.

    >>> parse(["move", "3.2", "3.4"])
    Move(do='move', t=3.2, to=3.4)
    """
    do, *values = [word.replace("-", "_") if i == 0 else word for i, word in enumerate(words)]
    names = WORDS.get(do)
    if names is None or len(values) != len(names):
        raise typer.BadParameter(f"{' '.join(words)!r}, expected one of: {USAGE}", param_hint="ACTION")
    given: dict[str, Any] = dict(zip(names, values, strict=True))
    if given.get("newton") == "none":
        given["newton"] = None
    try:
        return _ACTION.validate_python({"do": do, **given})
    except ValidationError as error:
        raise typer.BadParameter(
            first_finding(error, named=lambda place: str(place[-1]).upper()), param_hint="ACTION"
        ) from error
