"""A mapping file: maps names and units of other software to Caesura's.

It is TOML; `docs/recordings.md` has examples. Each reader uses its own part (`[time]` and `[columns]` for a
csv, `[topics]` for ROS 2); common options are at the top: `wrench_source`, `hand_on_robot`, `force_frame`,
`length_unit`, `robot`, `up`.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from caesura_protocol.recording import OPTIONS, RecordingError
from caesura_protocol.up_direction import parse_up, up_text
from caesura_protocol.validation_words import not_one_of


@dataclass(frozen=True)
class ColumnMapping:
    """The content of a mapping file; `name` is its name in errors."""

    name: str
    table: Mapping[str, Any]

    @property
    def options(self) -> dict[str, str]:
        """Return the options of the whole recording. Raises RecordingError for an unknown value."""
        said = {key: self.table[key] for key in OPTIONS if key in self.table}
        for key, value in said.items():
            if value not in OPTIONS[key]:
                raise self.error(not_one_of(key, value, OPTIONS[key]))
        if "robot" in self.table:
            said["robot"] = str(self.table["robot"])
        if "up" in self.table:
            said["up"] = self._up(self.table["up"])
        return said

    def _up(self, value: Any) -> str:
        """Return the direction in the form of a text file, from a text or an array of numbers."""
        try:
            return up_text(parse_up(",".join(map(str, value)) if isinstance(value, list) else str(value)))
        except ValueError as error:
            raise self.error(str(error)) from error

    def section(self, key: str) -> Mapping[str, Any]:
        """Return a table of the file, empty where it is missing. Raises RecordingError for another value."""
        found = self.table.get(key, {})
        if not isinstance(found, Mapping):
            raise self.error(f"{key} is {found!r}, expected a table [{key}]")
        return found

    def check_keys(self, where: str, found: Iterable[str], expected: Iterable[str]) -> None:
        """Raise RecordingError for an unknown key, so that a typo is detected."""
        unknown = sorted(set(found) - set(expected))
        if unknown:
            raise self.error(
                f"{where}: unknown {', '.join(map(repr, unknown))}, known: {', '.join(expected)}"
            )

    def error(self, what: str) -> RecordingError:
        """Return an error that names this file."""
        return RecordingError(f"{self.name}: {what}")


def load_mapping(path: Path) -> ColumnMapping:
    """Read a mapping file. Raises RecordingError."""
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise RecordingError(f"{path}: not a readable mapping file ({error})") from error
    mapped = ColumnMapping(path.name, table)
    mapped.check_keys(
        "the top",
        table,
        (*OPTIONS, "robot", "up", "delimiter", "decimal", "time", "columns", "topics", "domain"),
    )
    return mapped
