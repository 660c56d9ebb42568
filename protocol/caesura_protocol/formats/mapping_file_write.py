"""Writes a mapping file from the answers to the questions that a csv of other software leaves open.

An operator answers them in the terminal or in the dashboard; `--mapping` reads the file the next time.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from caesura_protocol.formats.csv_read_mapped import SIGNAL_OF_COLUMN, UNITS

NO_ANSWER = ("", "unknown", None)


class MappingAnswers(NamedTuple):
    """Answers about a csv file. columns: Caesura's column → the file's, including `t`; units: by signal.

    force_of: `robot` if the file has the robot's force on the environment, which is then negated.
    """

    columns: Mapping[str, str]
    delimiter: str = ","
    decimal: str = "."
    units: Mapping[str, str] = {}
    wrench_source: str | None = None
    hand_on_robot: str = "unknown"
    force_frame: str | None = "base"
    force_of: str = "environment"
    robot: str | None = None
    up: str | None = None  # x,y,z, or an axis of the base


NEGATED = ("force", "torque")  # where the file has the robot's on the environment


def mapping_text(answers: MappingAnswers) -> str:
    """Return the mapping file as TOML, see docs/recordings.md. Columns without an answer are left out."""
    return "\n".join(_lines(answers)) + "\n"


def _lines(answers: MappingAnswers) -> Iterator[str]:
    stated = {
        "delimiter": answers.delimiter if answers.delimiter != "," else "",
        "decimal": answers.decimal if answers.decimal != "." else "",
        "wrench_source": answers.wrench_source,
        "hand_on_robot": answers.hand_on_robot,
        "force_frame": answers.force_frame if "fx" in answers.columns or not answers.columns else "",
        "robot": answers.robot,
        "up": answers.up,
    }
    yield from (f"{key} = {_quoted(value)}" for key, value in stated.items() if value not in NO_ANSWER)
    if not answers.columns:  # a rosbag2 names its signals by their types
        return
    yield from ("", "[time]", f"column = {_quoted(answers.columns.get('t', ''))}")
    if (unit := _unit("t", answers)) is not None:
        yield f"unit = {_quoted(unit)}"
    yield from ("", "[columns]")
    for column, name in answers.columns.items():
        if column != "t" and name:
            yield f"{column} = {_entry(column, name, answers)}"


def _entry(column: str, name: str, answers: MappingAnswers) -> str:
    signal, parts = SIGNAL_OF_COLUMN[column], [f"column = {_quoted(name)}"]
    if (unit := _unit(signal, answers)) is not None:
        parts.append(f"unit = {_quoted(unit)}")
    if answers.force_of == "robot" and signal in NEGATED:
        parts.append("scale = -1.0")
    return _quoted(name) if len(parts) == 1 else f"{{ {', '.join(parts)} }}"


def _unit(signal: str, answers: MappingAnswers) -> str | None:
    """Return the unit of a signal; None for the default of a mapping."""
    unit = answers.units.get(signal)
    return None if not unit or unit == next(iter(UNITS[signal])) else unit


def _quoted(text: object) -> str:
    """Return a TOML string. JSON strings are valid TOML, except for one character that TOML must escape."""
    return json.dumps(str(text), ensure_ascii=False).replace("\x7f", "\\u007f")
