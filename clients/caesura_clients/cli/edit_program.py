"""`caesura edit-program`: edit the program of a session from the command line.

Edits do not change the inferred program.
"""

from __future__ import annotations

import getpass
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Annotated, Any, NamedTuple

import typer
from pydantic import TypeAdapter
from rich.console import Console
from rich.table import Table
from rich.text import Text

from caesura_clients.cli.connection_options import Config, Connect
from caesura_clients.cli.edit_action_validation import refused_in_words, validated, word_of, wrong
from caesura_clients.cli.options import MOST_TOLERANCE_MM, connected, named, reported
from caesura_clients.cli.result_tables import PLAIN, clock_lines, program_view
from caesura_clients.program_editing import edit_program as send_edit
from caesura_clients.program_editing import in_words, names_of, outcome_words, part_between, reference
from caesura_protocol.app_kinds import APP_KINDS, facts_of, name_of_app
from caesura_protocol.errors import CaesuraError
from caesura_protocol.messages import AppReference, Program, ProgramAction
from caesura_protocol.session_time_display import NO_OFFSET, SessionClock, clock_of
from caesura_protocol.validation_words import Place

MM = 0.001  # [m]


class _Value(NamedTuple):
    """The typed form of a value: its field in the message, the parser of its text, and the text's form."""

    field: str
    read: Callable[[str], Any]
    form: str


def _length(text: str) -> float:
    return MM * float(text)


def _tolerance(text: str) -> float:
    """Raises ValueError for a number beyond MOST_TOLERANCE_MM, which is in another unit."""
    tolerance_m = _length(text)
    if tolerance_m > MM * MOST_TOLERANCE_MM:
        raise ValueError(text)
    return tolerance_m


def _vector(text: str, scale: float = 1.0) -> tuple[float, ...]:
    x, y, z = (scale * float(part) for part in text.split(","))
    return x, y, z


_TARGET = _Value("target", lambda text: _vector(text, MM), "X,Y,Z [mm]")
CHANGES: Mapping[str, _Value] = {
    "name": _Value("name", str, "TEXT"),
    "note": _Value("note", str, "TEXT"),
    "target": _TARGET,
    "position": _Value("target_name", str, "TEXT"),
    "speed": _Value("speed", float, "FACTOR"),
    "force": _Value("force_n", float, "NUMBER [N]"),
    "tolerance": _Value("tolerance_m", _tolerance, f"NUMBER [mm, up to {MOST_TOLERANCE_MM}]"),
    "width": _Value("gripper_width", _length, "NUMBER [mm]"),
    "as-taught": _Value(
        "as_taught", lambda text: [CHANGES[name].field for name in text.split(",")], "VALUE,VALUE"
    ),
}
INSERTED: Mapping[str, _Value] = {
    "name": CHANGES["name"],
    "target": _TARGET,
    "force": _Value("force", _vector, "X,Y,Z [N]"),
    "width": CHANGES["width"],
    "seconds": _Value("seconds", float, "NUMBER [s]"),
}
WORDS: Mapping[str, tuple[str, ...]] = {
    "change": ("app",),
    "move": ("app", "after"),
    "delete": ("app",),
    "duplicate": ("app",),
    "insert": ("after", "kind"),
    "replace": ("first", "last"),
    "name": ("name",),
    "undo": (),
    "redo": (),
}
VALUES: Mapping[str, Mapping[str, _Value]] = {"change": CHANGES, "insert": INSERTED}
USAGE = "; ".join(
    " ".join([do, *(word.upper() for word in words), *(["VALUE=…"] if do in VALUES else [])])
    for do, words in WORDS.items()
)
_LENGTHS = (_TARGET, CHANGES["tolerance"], CHANGES["width"])


def _forms(values: Mapping[str, _Value]) -> str:
    return ", ".join(f"{name}={value.form}" for name, value in values.items())


_HELP = f"Values of change: {_forms(CHANGES)}; of insert: {_forms(INSERTED)}. ".replace("[", r"\[")
_ACTION: TypeAdapter[ProgramAction] = TypeAdapter(ProgramAction)


def edit_program(
    station: Annotated[str, typer.Argument(help="Teaching station.")],
    session: Annotated[str, typer.Argument(help="Session, as `caesura sessions` names it.")],
    action: Annotated[
        list[str] | None,
        typer.Argument(
            help=f"{USAGE}. APP: its number in the table; AFTER: likewise, 0 for the beginning. "
            f"{_HELP}The part of replace: its first and last app, or --from and --to. "
            "Without an action the edits are listed."
        ),
    ] = None,
    author: Annotated[
        str | None,
        typer.Option(envvar="CAESURA_AUTHOR", help="Author of the edit; by default the login name."),
    ] = None,
    revision: Annotated[
        int | None,
        typer.Option(min=0, help="Revision of the program that the edit is for; default: the current."),
    ] = None,
    begins: Annotated[float | None, typer.Option("--from", help="replace: start of the part \\[s].")] = None,
    ends: Annotated[float | None, typer.Option("--to", help="replace: end of the part \\[s].")] = None,
    replacing: Annotated[
        str | None, typer.Option("--with", help="replace: session that replaces the part.")
    ] = None,
    endpoint: Connect = None,
    config: Config = None,
) -> None:
    """Edit the program of a session, open or closed. Edits can be undone; the inferred program is kept."""
    found = typed(action, Part(begins, ends, replacing)) if action else None
    with reported():
        named(station)
        with connected(endpoint, config) as caesura:
            snapshot = caesura.snapshot(station, session)
            program, clock = snapshot.program, clock_of(snapshot.segments.segments)
            if found is None:
                edits = edits_table(program, clock) if program.edits else "no edits"
                shown = program_view(program, clock, snapshot.segments.phases)
                Console().print(*clock_lines(clock), shown, edits, sep="\n")
                return
            wanted = parse(found, program, clock)
            seen = program.edit_revision if revision is None else revision
            with refused_in_words(wanted, clock):
                ack = send_edit(
                    caesura.transport,
                    station,
                    session,
                    wanted,
                    author=author or getpass.getuser(),
                    revision=seen,
                )
            typer.echo(f"{station}/{session}: {outcome_words(wanted, ack, clock, names_of(program))}")


def edits_table(program: Program, clock: SessionClock) -> Table:
    """Return a table of a program's edits, one per row."""
    table = Table("#", "edit", "by", "state", title="edits", **PLAIN)
    names = names_of(program)
    for edit in program.edits:
        state = edit.state.replace("_", " ") + (f": {edit.reason}" if edit.reason else "")
        table.add_row(str(edit.number), *map(Text, (in_words(edit.action, clock, names), edit.author, state)))
    return table


class Part(NamedTuple):
    """Options of `replace`: start and end [s] of the replaced part, and the session of the new part."""

    t0: float | None = None
    tn: float | None = None
    session: str | None = None


NO_PART = Part()


class Typed(NamedTuple):
    """A typed edit: its first word, its further words, and its values; apps are still row numbers."""

    do: str
    words: Mapping[str, str]
    values: Mapping[str, Any]
    part: Part


def typed(words: Sequence[str], part: Part = NO_PART) -> Typed:
    """Parse the words of an edit, as far as this needs no program.

    Raises BadParameter, which lists the valid edits.
    """
    do, *rest = words
    if do == "replace":
        _check_part(rest, part)
        return Typed(do, dict(zip(WORDS[do], rest, strict=False)), {}, part)
    if part != NO_PART:
        raise wrong(f"--from, --to and --with belong to replace, not to {do}")
    names = WORDS.get(do)
    if names is None or len(rest) < len(names) or (do not in VALUES and len(rest) > len(names)):
        raise wrong(f"{' '.join(words)!r} is no edit, expected one of: {USAGE}")
    given = dict(zip(names, rest, strict=False))
    if given.get("kind", "grasp") not in APP_KINDS:
        raise wrong(f"{given['kind']!r} is no kind of app, expected one of: {', '.join(APP_KINDS)}")
    values: dict[str, Any] = {}
    for text in rest[len(names) :]:
        values |= _value(text, VALUES[do])
    facts = facts_of(given.get("kind", ""))
    if facts is not None and facts.presses and "force" not in values:
        form = INSERTED["force"].form
        raise wrong(f"{given['kind']} needs a force, in the base frame as the robot exerts it: force={form}")
    return Typed(do, given, values, part)


def parse(found: Typed, program: Program, clock: SessionClock = NO_OFFSET) -> ProgramAction:
    """Return the edit of a program from its typed form. Raises BadParameter or CaesuraError."""
    if found.do == "replace":
        first, last = _part(found, program, clock)
        fields = {"do": "replace_part", "first": first, "last": last, "session": found.part.session}
        return validated(_ACTION, fields)
    given: dict[str, Any] = {**found.words, **found.values}
    for name in ("app", "after"):
        if name in given:
            begins = name == "after" and given[name] == "0"
            given[name] = None if begins else _reference(program, given[name])
    return validated(_ACTION, {"do": found.do, **given}, partial(_typed_name, found.do))


def _typed_name(do: str, place: Place) -> str:
    """Return the name of a value as it is typed, with the unit in which errors state a length."""
    for name, value in VALUES.get(do, {}).items():
        if value.field in place:
            return f"{name} [m]" if value in _LENGTHS else name
    return word_of(place)


def _check_part(numbers: Sequence[str], part: Part) -> None:
    t0, tn, session = part
    if session is None or len(numbers) != (2 if t0 is None else 0) or (t0 is None) != (tn is None):
        raise wrong(
            "the part is not clear, expected: replace FIRST LAST --with SESSION, or "
            "replace --from T1 --to T2 --with SESSION"
        )


def _part(found: Typed, program: Program, clock: SessionClock) -> tuple[AppReference, AppReference]:
    """Return the first and last app of a part, given by their numbers or by times. Raises CaesuraError."""
    t0, tn, _ = found.part
    if t0 is not None and tn is not None:
        return part_between(program, clock.read(t0), clock.read(tn), clock)
    return _reference(program, found.words["first"]), _reference(program, found.words["last"])


def _value(text: str, values: Mapping[str, _Value]) -> dict[str, Any]:
    name, _, given = text.partition("=")
    if name not in values:
        raise wrong(f"{text!r} is no value, expected one of: {_forms(values)}")
    value = values[name]
    try:
        return {value.field: value.read(given)}
    except (KeyError, ValueError) as error:
        raise wrong(f"{name} is {given!r}, expected {name}={value.form}") from error


def _reference(program: Program, number: str) -> AppReference:
    """Return the reference of the app with this row number. Raises CaesuraError, which lists the apps."""
    index = int(number) - 1 if number.isdecimal() else -1
    if not 0 <= index < len(program.apps):
        there = ", ".join(name_of_app(i, app) for i, app in enumerate(program.apps)) or "none"
        raise CaesuraError(f"there is no app {number!r}; apps of the program: {there}")
    return reference(program.apps[index])
