"""Asks in a terminal what a recording leaves open: columns, units, wrench, hand and robot.

Each question has a default, which Enter accepts. The answers for a csv of other software become a mapping
file. Other formats contain names and units, and the answers become options.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import NamedTuple

import typer

from caesura_protocol.errors import SourceError
from caesura_protocol.formats.csv_layout_detection import (
    CsvLayout,
    guessed,
    likely_units,
    read_layout,
    with_turns,
)
from caesura_protocol.formats.csv_read_mapped import SIGNAL_OF_COLUMN, TURNS, UNITS
from caesura_protocol.formats.mapping_file_write import MappingAnswers, mapping_text
from caesura_protocol.messages import COLUMNS_OF_SIGNAL, FORCE_FRAMES, HANDS_ON_ROBOT, WRENCH_SOURCES
from caesura_protocol.number_words import counted
from caesura_protocol.robots import robot_names
from caesura_protocol.up_direction import UP, parse_up, up_text

NAMES = {"t": "the time", **dict.fromkeys(TURNS, "the angles")}  # in the question for their unit
Ask = Callable[..., str]  # words of the question, default=
EMPTY = "nothing is assumed here:"
NEEDS_ORIENTATION = " Those in the axes of the flange need an orientation, which is missing here"
NONE = "-"  # answers that the file has no such column, or that nothing is stated
#: Signals with one question each; the joints and their torques are asked for together.
ASKED = {
    "pos": "Position of the flange in the base frame",
    "quat": "Orientation of the flange, a quaternion x y z w, or three angles",
    "q": "Joint positions",
    "force": "Force",
    "torque": "Moment",
    "tau": "External joint torques",
    "gripper": "Opening of the gripper",
}
ANGLES = (
    "Which angles? A rotation vector is axis times angle, as of Universal Robots; roll, pitch, yaw are turns "
    "about x, then y, then z of the base frame, as of UFACTORY"
)
WHOSE = (
    "Are they forces of the environment on the robot, or of the robot? A table on which the robot presses "
    "pushes it up: a force that points up then is that of the environment, a positive z on an upright base"
)
WHICH_WAY_UP = (
    "Up, away from gravity in the base frame: z of an arm on a table, -z of one that hangs from a ceiling, "
    "or three numbers x,y,z of length 1"
)
HELP = (
    "Enter takes what stands in brackets. Columns are named, or counted from 1, and divided by blanks or "
    f"commas; {NONE} states that the file has none."
)


class Answered(NamedTuple):
    """Answers about a recording: the path of the written mapping file, or options."""

    mapping: Path | None
    options: Mapping[str, str]


def ask_about(path: Path, ask: Ask | None = None) -> Answered:
    """Ask what a recording leaves open; return the answers.

    Raises SourceError without a terminal, RecordingError if a csv contains no table.
    """
    if ask is None:
        if not in_a_terminal():
            raise SourceError("--ask needs a terminal to ask in; --mapping names a file with the answers")
        ask = _prompt
    layout = read_layout(path) if path.suffix.lower() == ".csv" else None
    if layout is None or layout.is_own:
        return Answered(None, _asked_wrench(ask, (), {} if layout is None else layout.stated))
    typer.echo(f"{path.name} has the columns")
    for number, name in enumerate(layout.header, start=1):
        typer.echo(f"  {number:3d}  {name:24s} {', '.join(row[number - 1] for row in layout.rows[:3])}, …")
    typer.echo(HELP)
    answers = ask_mapping(layout, ask)
    chosen = _new_file(ask, path.with_suffix(".toml"))
    try:
        chosen.write_text(mapping_text(answers), encoding="utf-8")
    except OSError as error:
        raise SourceError(f"cannot write {chosen}: {error.strerror}") from error
    return Answered(chosen, {})


def _new_file(ask: Ask, proposed: Path) -> Path:
    """Ask for a file to write until there is none of that name: a mapping may have been edited by hand."""
    if proposed.exists():
        typer.echo(f"{proposed} exists and is kept; --mapping {proposed} reads it")
    while True:
        answer = ask("Write the answers to", default=None if proposed.exists() else str(proposed)).strip()
        if answer and not Path(answer).exists():
            return Path(answer)
        typer.echo(f"{answer!r} exists: name a new file" if answer else f"{EMPTY} name a new file")


def in_a_terminal() -> bool:
    """Return whether a terminal is attached, so that questions can be asked."""
    return sys.stdin.isatty() and sys.stdout.isatty()


def _prompt(words: str, default: str | None = None) -> str:
    """Ask once. Without a default an empty answer is returned: typer would repeat the question silently."""
    return str(typer.prompt(words, default=default or "", show_default=default is not None))


def ask_mapping(layout: CsvLayout, ask: Ask) -> MappingAnswers:
    """Ask which column is what, in which unit, and how the wrench was measured."""
    guess = with_turns(layout, guessed(layout))
    columns = {"t": _asked_columns(ask, "Time", layout, [guess.columns.get("t", "")], (1,))[0]}
    for signal, words in ASKED.items():
        names = COLUMNS_OF_SIGNAL[signal]
        if signal == "tau":  # one a joint
            names = tuple(
                name for name, joint in zip(names, COLUMNS_OF_SIGNAL["q"], strict=True) if joint in columns
            )
            if not names:
                continue
        if signal == "quat":
            columns |= _asked_orientation(ask, words, layout, guess.columns)
            continue
        proposed = [guess.columns[name] for name in names if name in guess.columns]
        widths = range(1, len(names) + 1) if signal == "q" else (len(names),)
        needed = signal == "q" and "px" not in columns
        found = _asked_columns(ask, words, layout, proposed, (*widths,) if needed else (0, *widths))
        columns |= dict(zip(names, found, strict=False))
    units = likely_units(layout, columns)
    signals = dict.fromkeys(SIGNAL_OF_COLUMN[column] for column in columns)
    for signal in signals:
        known = UNITS[signal]
        if len(known) > 1:
            words = f"Unit of {NAMES.get(signal) or ASKED[signal].lower()}"
            units[signal] = _chosen(ask, words, known, units.get(signal, next(iter(known))))
    wrench = _asked_wrench(ask, signals, layout.stated)
    up = _asked_up(ask, layout.stated.get("up")) if {"force", "tau"} & set(signals) else None
    return guess._replace(columns=columns, units=units, up=up, **wrench)


def _asked_up(ask: Ask, stated: str | None) -> str | None:
    """Ask for the direction away from gravity; return None for the default of an upright base."""
    while True:
        try:
            found = parse_up(ask(WHICH_WAY_UP, default=stated or "z"))
        except ValueError as error:
            typer.echo(str(error))
        else:
            return None if stated is None and found == UP else up_text(found)


def _asked_orientation(
    ask: Ask, words: str, layout: CsvLayout, guessed_columns: Mapping[str, str]
) -> dict[str, str]:
    """Ask for the columns of the orientation, and, of three angles, for their convention."""
    forms = {"quat": COLUMNS_OF_SIGNAL["quat"], **TURNS}
    likely = next((form for form, names in forms.items() if names[0] in guessed_columns), None)
    proposed = [] if likely is None else [guessed_columns[name] for name in forms[likely]]
    found = _asked_columns(ask, words, layout, proposed, (0, 3, 4))
    form = _chosen(ask, ANGLES, TURNS, likely if found == proposed else None) if len(found) == 3 else "quat"
    return dict(zip(forms[form], found, strict=False))


def _asked_wrench(ask: Ask, signals: Collection[str], stated: Mapping[str, str]) -> dict[str, str]:
    """Ask where the wrench was measured, whether a hand was on the robot, and which robot it was.

    signals: those of a csv, empty if not known; stated: by the comments of the file, proposed as answers.
    Return the answers by name of the option.
    """
    found: dict[str, str] = {}
    if not signals or {"force", "tau"} & set(signals):
        # Without a default: an answer by Enter alone would turn contact and load on.
        found["wrench_source"] = _chosen(
            ask, "Where was the wrench measured?", WRENCH_SOURCES, stated.get("wrench_source")
        )
    found["hand_on_robot"] = _chosen(
        ask, "Was the robot guided by hand?", HANDS_ON_ROBOT, stated.get("hand_on_robot", "unknown")
    )
    if {"force", "torque"} & set(signals):
        turned = {"quat", "q", *TURNS} & set(signals)
        words = "In which frame are the forces?" + ("" if turned else NEEDS_ORIENTATION)
        found["force_frame"] = _chosen(ask, words, FORCE_FRAMES, stated.get("force_frame", "base"))
        found["force_of"] = _chosen(ask, WHOSE, ("environment", "robot"), "environment")
    robot = _chosen(
        ask, f"Which robot? {NONE} for another", (NONE, *robot_names()), stated.get("robot", NONE)
    )
    return found if robot == NONE else {**found, "robot": robot}


def _asked_columns(
    ask: Ask, words: str, layout: CsvLayout, proposed: list[str], widths: Collection[int]
) -> list[str]:
    """Ask for the columns of a signal, until their number is one of `widths`."""
    default = " ".join(_short(layout, name) for name in proposed if name) or (NONE if 0 in widths else None)
    while True:
        answer = ask(words, default=default).replace(",", " ").split()
        found = [] if answer == [NONE] else [_resolved(layout, one) for one in answer]
        unknown = [one for one, name in zip(answer, found, strict=False) if name is None]
        if not unknown and len(found) in widths and len(set(found)) == len(found):
            return [name for name in found if name is not None]
        expected = " or ".join(str(width) for width in widths) if len(widths) < 4 else f"up to {max(widths)}"
        typer.echo(
            f"no column {unknown[0]!r}"
            if unknown
            else f"{counted(len(found), 'column')}, expected {expected}, each once"
        )


def _short(layout: CsvLayout, name: str) -> str:
    """Return a column's name, or its number if the name contains blanks or commas."""
    return name if not set(" ,") & set(name) else str(layout.header.index(name) + 1)


def _resolved(layout: CsvLayout, word: str) -> str | None:
    if word in layout.header:
        return word
    return layout.header[int(word) - 1] if word.isdigit() and 0 < int(word) <= len(layout.header) else None


def _chosen(ask: Ask, words: str, known: Collection[str], default: str | None) -> str:
    """Ask until the answer is one of `known` or an abbreviation of it; return it."""
    if len(known) == 1:
        return next(iter(known))
    while True:
        answer = ask(f"{words} ({', '.join(known)})", default=default).strip()
        found = [answer] if answer in known else [one for one in known if answer and one.startswith(answer)]
        if len(found) == 1:
            return found[0]
        typer.echo(f"{repr(answer) + ',' if answer else EMPTY} expected one of {', '.join(known)}")
