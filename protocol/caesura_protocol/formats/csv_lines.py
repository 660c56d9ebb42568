"""Reads the lines of a csv file, UTF-8 or UTF-16, and the options stated in its comments."""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from caesura_protocol.recording import STATED, RecordingError

BLANK = " "
#: What Excel writes above a table: which delimiter it has. It is no row.
_SEP_LINE = re.compile(r"\"?sep=.\"?[;,\t ]*", re.IGNORECASE)
_UTF16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


def encoding_of(path: Path) -> str:
    """Return UTF-16 if the file begins with its byte order mark, else UTF-8. Raises OSError as `open`."""
    with path.open("rb") as stream:
        return "utf-16" if stream.read(2) in _UTF16 else "utf-8-sig"


def read_lines(path: Path) -> list[str]:
    """Return all lines without their ends.

    Raises RecordingError for an unknown encoding, OSError as `open`.
    """
    content = path.read_bytes()
    encoding = encoding_of(path)
    try:
        text = content.decode(encoding)
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise RecordingError(
            f"{path}, line {line}: byte {content[error.start]:#04x} is not {encoding.removesuffix('-sig')}: "
            f"save it as UTF-8, for example by iconv -f latin1 -t utf-8 {path.name}"
        ) from error
    if "\0" in text[:1000]:
        raise RecordingError(
            f"{path}: has zero bytes, expected a text: save it as UTF-8, for example by iconv -f utf-16le "
            f"-t utf-8 {path.name}"
        )
    return text.splitlines()


def is_comment(line: str) -> bool:
    """Return whether a line is a comment, states an option, or states the delimiter as Excel does.

    >>> is_comment("# robot: ur5e"), is_comment("sep=;"), is_comment("t;px;py;pz")
    (True, True, False)
    """
    return line.lstrip().startswith("#") or _SEP_LINE.fullmatch(line.strip()) is not None


def rows_of(lines: Iterable[str], delimiter: str) -> list[list[str]]:
    """Return the cells of each line without blanks around them; several blanks count as one delimiter.

    >>> rows_of(["t  px ", "0.0 -0.1"], " ")
    [['t', 'px'], ['0.0', '-0.1']]
    """
    is_blank = delimiter == BLANK
    stripped = (line.strip() for line in lines) if is_blank else lines
    rows = csv.reader(stripped, delimiter=delimiter, skipinitialspace=is_blank)
    return [[cell.strip() for cell in row] for row in rows]


def cell_of(row: Sequence[str], index: int) -> str:
    """Return a cell of a row; empty if the row is shorter."""
    return row[index] if index < len(row) else ""


def stated_in_comments(lines: Iterable[str]) -> dict[str, str]:
    """Return the values of all `# name: value` comments, by name.

    >>> stated_in_comments(["# wrench_source: flange_sensor", "# hand on robot: yes", "# of a day", "t,px"])
    {'wrench_source': 'flange_sensor', 'hand_on_robot': 'yes'}
    """
    comments = [line.strip().lstrip("#").partition(":") for line in lines if is_comment(line)]
    # A table program puts the delimiters of all columns behind a comment that it has read.
    return {_option(key): value.strip().rstrip(",;\t ") for key, separator, value in comments if separator}


def _option(key: str) -> str:
    """Return an option's name with its words joined by underscores; any other key unchanged."""
    name = "_".join(key.lower().replace("-", " ").replace("_", " ").split())
    return name if name in STATED else key.strip()
