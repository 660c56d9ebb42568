"""The format of log lines: text for people, or one JSON object a line for a log collector.

A line of JSON has `time` (UTC), `level`, `logger`, `instance` and `message`; `station` and `session` if it
concerns one; `exception` if there was one.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TextIO

from pythonjsonlogger.json import JsonFormatter

LEVELS = ("debug", "info", "warning", "error")

FIELDS = ("time", "level", "instance", "logger", "message")

_RENAMED = {"levelname": "level", "name": "logger", "exc_info": "exception"}


class _Ordered(JsonFormatter):
    """A formatter of JSON lines that begin with the fields common to all lines, for human readers."""

    def process_log_record(self, log_data: dict[str, Any]) -> dict[str, Any]:
        return {name: log_data[name] for name in (*FIELDS, *log_data) if name in log_data}


def text_formatter(instance: str) -> logging.Formatter:
    """Return the formatter of text lines."""
    return logging.Formatter(f"%(asctime)s %(levelname)s {instance} %(name)s: %(message)s")


def json_formatter(instance: str) -> logging.Formatter:
    """Return the formatter of JSON lines, one object each."""
    fields: dict[str, Any] = {"instance": instance}
    return _Ordered(
        ["levelname", "name", "message"],
        timestamp="time",
        rename_fields=_RENAMED,
        static_fields=fields,
        json_ensure_ascii=False,
    )


FORMATTERS: Mapping[str, Callable[[str], logging.Formatter]] = {
    "text": text_formatter,
    "json": json_formatter,
}


LOG_FORMATS = tuple(FORMATTERS)


class UnknownOption(ValueError):  # noqa: N818 - it reads better where it is caught
    """An option of the log has an unknown value."""

    def __init__(self, option: str, value: str, stations: Sequence[str]) -> None:
        super().__init__(f"{value!r}, known: {', '.join(stations)}")
        self.option = option


def log_to(stream: TextIO, *, level: str, log_format: str, instance: str) -> None:
    """Write records of at least a level to a stream. Raises UnknownOption."""
    if level.lower() not in LEVELS:
        raise UnknownOption("--log-level", level, LEVELS)
    if log_format not in FORMATTERS:
        raise UnknownOption("--log-format", log_format, LOG_FORMATS)
    handler = logging.StreamHandler(stream)
    handler.setFormatter(FORMATTERS[log_format](instance))
    logging.basicConfig(level=level.upper(), handlers=[handler])
