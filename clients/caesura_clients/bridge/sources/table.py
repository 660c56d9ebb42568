"""The sources that the command line offers, by name. What a source needs is imported only when it is asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from caesura_clients.bridge.sources import Source
from caesura_clients.bridge.sources.file import FileSource
from caesura_clients.errors import BadSource
from caesura_clients.recording import RecordingError, load_recording


@dataclass(frozen=True)
class SourceOptions:
    """What may be said about a source; each takes what it understands."""

    file: Path | None = None
    pace: float = 1.0
    wrench_source: str | None = None
    length_unit: str | None = None
    scenario: str | None = None
    seed: int = 0


def open_source(name: str, options: SourceOptions) -> Source:
    """A source by its name. Raises BadSource, which names what there is."""
    build = SOURCES.get(name)
    if build is None:
        raise BadSource(f"no source {name!r}, expected one of {', '.join(SOURCES)}")
    return build(options)


def _file(options: SourceOptions) -> Source:
    if options.file is None:
        raise BadSource("the source file needs --file")
    try:
        recording = load_recording(
            options.file, wrench_source=options.wrench_source, length_unit=options.length_unit
        )
    except RecordingError as error:
        raise BadSource(str(error)) from error
    return FileSource(recording, pace=options.pace)


SOURCES: Mapping[str, Callable[[SourceOptions], Source]] = {"file": _file}
