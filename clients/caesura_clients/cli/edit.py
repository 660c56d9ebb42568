"""`caesura edit`: correct a session from the command line."""

from __future__ import annotations

import getpass
from collections.abc import Sequence
from typing import Annotated, Any, NamedTuple

import typer
from pydantic import Field, TypeAdapter
from rich.console import Console
from rich.table import Table
from rich.text import Text

from caesura_clients.cli.connection_options import Config, Connect
from caesura_clients.cli.edit_action_validation import refused_in_words, validated, wrong
from caesura_clients.cli.options import connected, named, reported
from caesura_clients.cli.result_tables import PLAIN, clock_lines
from caesura_clients.client import Caesura
from caesura_clients.correction_words import (
    changepoint_made,
    changepoint_meant,
    described,
    effect_words,
    in_words,
    moved_words,
    no_corrections,
    relabel_doubt,
    since_words,
)
from caesura_clients.session_corrections import edit as edit_session
from caesura_protocol.errors import NotFound
from caesura_protocol.messages import (
    Ack,
    Action,
    Correction,
    EditEffect,
    Insert,
    Move,
    Redo,
    Remove,
    Since,
    Snapshot,
)
from caesura_protocol.session_time_display import NO_OFFSET, SessionClock, clock_of, local_moment


class _Form(NamedTuple):
    """The typed form of an action: its first word, the words of its values, and its name on the wire."""

    typed: str
    words: tuple[str, ...]
    do: str


FORMS: Sequence[_Form] = (
    _Form("insert", ("t",), "insert"),
    _Form("remove", ("t",), "remove"),
    _Form("move", ("t", "to"), "move"),
    _Form("relabel", ("t", "kind"), "relabel"),
    _Form("limit_force", ("t", "newton"), "limit_force"),
    _Form("name_phase", ("t", "name"), "name_phase"),
    _Form("undo", (), "undo"),
    _Form("undo", ("number",), "take_back"),
    _Form("redo", (), "redo"),
    _Form("since", ("number",), "since"),
)
USAGE = "; ".join(" ".join([form.typed, *(word.upper() for word in form.words)]) for form in FORMS)
_ACTION: TypeAdapter[Action | Since] = TypeAdapter(Annotated[Action | Since, Field(discriminator="do")])


def edit(
    station: Annotated[str, typer.Argument(help="Teaching station.")],
    session: Annotated[str, typer.Argument(help="Session, as `caesura sessions` names it.")],
    action: Annotated[
        list[str] | None,
        typer.Argument(
            help=f"{USAGE}. Times in \\[s]. NEWTON: a force, or none for no limit. NUMBER: as in the list "
            "of corrections, which is shown without an action. since: show what those after NUMBER changed."
        ),
    ] = None,
    author: Annotated[
        str | None,
        typer.Option(envvar="CAESURA_AUTHOR", help="Author of the correction; by default the login name."),
    ] = None,
    revision: Annotated[
        int | None,
        typer.Option(min=0, help="Revision of the session that the correction is for; default: the current."),
    ] = None,
    preview: Annotated[
        bool, typer.Option("--preview", help="Show what the correction would change; change nothing.")
    ] = False,
    endpoint: Connect = None,
    config: Config = None,
) -> None:
    """Correct a session, open or closed: changepoints, kinds, force limits, names of phases."""
    wanted = parse(action) if action else None
    with reported():
        named(station)
        with connected(endpoint, config) as caesura:
            if wanted is None:
                _print_corrections(caesura.snapshot(station, session))
                return
            seen = NOT_SEEN if revision is None else NOT_SEEN._replace(revision=revision)
            if revision is None or _times(wanted):
                seen = _seen(caesura, station, session, revision)
            wanted = _on_clock(wanted, seen.clock)
            with refused_in_words(wanted, seen.clock):
                if preview or isinstance(wanted, Since):
                    effect = caesura.preview(station, session, wanted, revision=seen.revision)
                    would = "nothing is changed; this edit would do:"
                    typer.echo(since_words(wanted) if isinstance(wanted, Since) else would)
                    _print_effect(wanted, effect, seen.clock)
                    return
                ack = edit_session(
                    caesura.transport,
                    station,
                    session,
                    wanted,
                    author=author or getpass.getuser(),
                    revision=seen.revision,
                )
    typer.echo(f"{_done(wanted, ack, seen.clock)}; {station}/{session} is at revision {ack.revision}")
    if ack.effect is not None:
        _print_effect(wanted, ack.effect, seen.clock)


def _print_effect(action: Action | Since, effect: EditEffect, clock: SessionClock) -> None:
    typer.echo("\n".join(effect_words(effect, clock)))
    if doubt := relabel_doubt(action, effect):
        typer.echo(f"warning: {doubt}", err=True)


class _SessionSeen(NamedTuple):
    """A session before an edit."""

    clock: SessionClock
    revision: int | None


NOT_SEEN = _SessionSeen(NO_OFFSET, None)


def _done(action: Action, ack: Ack, clock: SessionClock) -> str:
    """Return text on an applied action; of an undo and a redo, on the correction that it moved, if known."""
    if moved := moved_words(action, ack, clock):
        return f"{'done again' if isinstance(action, Redo) else 'took back'}: {moved}"
    return in_words(action, clock) + ("" if ack.effect is None else _beside(action, ack.effect, clock))


def _beside(action: Action, effect: EditEffect, clock: SessionClock) -> str:
    """Return text on the changepoints of an action at other times than typed.

    Empty if the shown times are equal.
    """
    said = []
    if isinstance(action, Remove | Move):
        said += [("was", action.t, changepoint_meant(action, effect))]
    if isinstance(action, Insert | Move):
        wanted = action.to if isinstance(action, Move) else action.t
        said += [("is", wanted, changepoint_made(action, effect))]
    off = [
        (verb, clock.shown(there)) for verb, typed, there in said if clock.shown(typed) != clock.shown(there)
    ]
    return f" (it {', and '.join(f'{verb} at {there} s' for verb, there in off)})" if off else ""


def _print_corrections(found: Snapshot) -> None:
    clock, corrections = clock_of(found.segments.segments), found.program.corrections
    listed = corrections_table(corrections, clock) if corrections else no_corrections(found.status.revision)
    Console().print(*clock_lines(clock), listed, sep="\n")


def _seen(caesura: Caesura, station: str, session: str, revision: int | None) -> _SessionSeen:
    """Return a session before an edit, with the stated revision, or by default its current one."""
    try:
        found = caesura.snapshot(station, session)
    except NotFound:
        if revision is None:
            raise
        return NOT_SEEN._replace(revision=revision)  # the service may know it, and hold it no longer
    current = found.status.revision if revision is None else revision
    return _SessionSeen(clock_of(found.segments.segments), current)


def _on_clock(wanted: Action | Since, clock: SessionClock) -> Action | Since:
    """Return the action with its typed times converted to the session's clock."""
    return wanted.model_copy(update={name: clock.read(t) for name, t in _times(wanted).items()})


def _times(wanted: Action | Since) -> dict[str, float]:
    """Return the times [s] of an action by field name; undo and redo have none."""
    return {name: getattr(wanted, name) for name in ("t", "to") if hasattr(wanted, name)}


def parse(words: list[str]) -> Action | Since:
    """Return the typed action. Raises BadParameter, which lists the valid actions.

    >>> parse(["move", "3.2", "3.4"])
    Move(do='move', t=3.2, to=3.4)
    """
    typed, *values = words
    form = next((one for one in FORMS if _matches(one, typed, values)), None)
    if form is None:
        raise wrong(f"{' '.join(words)!r} is no correction, expected one of: {USAGE}")
    given: dict[str, Any] = dict(zip(form.words, values, strict=True))
    if given.get("newton") == "none":
        given["newton"] = None
    return validated(_ACTION, {"do": form.do, **given})


def _matches(form: _Form, typed: str, values: Sequence[str]) -> bool:
    return form.typed == typed.replace("-", "_") and len(form.words) == len(values)


def corrections_table(corrections: Sequence[Correction], clock: SessionClock) -> Table:
    """Return a table of a session's corrections, one per row."""
    table = Table("#", "correction", "at", "state", title="corrections", **PLAIN)
    for one in corrections:
        state = one.state.replace("_", " ") + (f": {one.reason}" if one.reason else "")
        words = map(Text, (described(one, clock), local_moment(one.at), state))
        table.add_row(str(one.number), *words)
    return table
