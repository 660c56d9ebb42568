"""`caesura sessions export` and `delete`: what needs the journal itself, on the machine where it is."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer

from caesura_clients.cli.options import Station, reported
from caesura_clients.cli.sessions import sessions
from caesura_protocol.distribution import installing
from caesura_protocol.errors import CaesuraError, NotFound
from caesura_protocol.recording import Recording
from caesura_service.config import journal_directory, journal_path
from caesura_service.journal import (
    Copy,
    Journal,
    JournalBusyError,
    JournalError,
    Key,
    PeerCopy,
    SqliteJournal,
)
from caesura_service.offline_segmentation import recording_of

Session = Annotated[str, typer.Argument(help="Name of the session.")]
Instance = Annotated[
    str | None, typer.Option(help="Look into the journal of this instance alone, not into all of DIR.")
]
Directory = Annotated[
    Path | None,
    typer.Option("--journal", metavar="DIR", help="As for `caesura serve`, whose default it has."),
]


@sessions.command("export")
def export(
    session: Session,
    out: Annotated[Path, typer.Option("--out", "-o", help="Where to: .npz or .mcap.")],
    station: Station = None,
    journal: Directory = None,
    instance: Instance = None,
) -> None:
    """Write a session: .npz, a recording that `caesura segment` and a bridge can read; or .mcap, samples and
    results for Foxglove and Rerun.

    The service may be running.
    """
    with reported():
        write = _writer_of(out)
        key, copies = _found(_journals(journal, instance), session, station)
        with _opened(copies[0].path) as kept:
            try:
                recording = write(kept, key, out)
            except OSError as error:
                raise CaesuraError(f"cannot write {out}: {error.strerror}") from error
    typer.echo(f"{out}: {recording.t.size} samples, {recording.t[-1] - recording.t[0]:.2f} s")


@sessions.command("delete")
def delete(
    session: Session,
    station: Station = None,
    journal: Directory = None,
    instance: Instance = None,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Do not ask on a terminal.")] = False,
) -> None:
    """Delete a session for good: its samples, results and corrections, in every journal of DIR.

    It runs on the service's machine and needs write access to the journal. While the service runs, only a
    closed session is deleted. On a terminal it asks first.
    """
    with reported():
        key, copies = _found(_journals(journal, instance), session, station)
        if not yes and sys.stdin.isatty():
            places = ", ".join(str(found.path) for found in copies)
            typer.confirm(
                f"Delete samples, results and corrections of {'/'.join(key)} in {places}?", abort=True
            )
        for found in copies:
            _delete(found, closed=copies[0].copy.closed)
    typer.echo(f"{'/'.join(key)} deleted")


def _delete(found: PeerCopy, *, closed: bool) -> None:
    """Raises CaesuraError where it is open, and a service may be at it."""
    try:
        with _opened(found.path, alone=not closed) as kept:
            kept.forget(*found.copy.key)
    except JournalBusyError:
        name = "/".join(found.copy.key)
        raise CaesuraError(f"{name} is open: close it, or end the service first") from None


def _write_npz(kept: Journal, key: Key, out: Path) -> Recording:
    recording = recording_of(kept.replay(*key))
    recording.save(out)
    return recording


def _write_mcap(kept: Journal, key: Key, out: Path) -> Recording:
    taught = import_module("caesura_lab.export.session_export").taught_from(kept, *key)
    import_module("caesura_lab.export.mcap_file").write_mcap(out, taught)
    recording: Recording = taught.recording
    return recording


WRITERS: Mapping[str, Callable[[Journal, Key, Path], Recording]] = {".npz": _write_npz, ".mcap": _write_mcap}


def _writer_of(out: Path) -> Callable[[Journal, Key, Path], Recording]:
    """Raises CaesuraError for a suffix without a writer, and where its extra is missing."""
    if out.suffix not in WRITERS:
        raise CaesuraError(f"cannot write {out}: expected the suffix {' or '.join(WRITERS)}")
    if out.suffix == ".mcap" and find_spec("mcap") is None:
        raise CaesuraError(f"writing .mcap needs {installing('mcap')}")
    return WRITERS[out.suffix]


def _journals(directory: Path | None, instance: str | None) -> list[Path]:
    """Of one instance, or all of the directory. Raises Absent where there is none."""
    where = directory or journal_directory()
    wanted = where / "*.sqlite" if instance is None else journal_path(where, instance)
    found = sorted(where.glob(wanted.name))
    if not found:
        raise NotFound(
            f"no journal {wanted}: this runs where the service does; --journal and --instance name it"
        )
    return found


@contextmanager
def _opened(path: Path, *, alone: bool = False) -> Iterator[SqliteJournal]:
    """A journal; what is wrong with it is an error for a user, but that another has what shall be `alone`."""
    try:
        with SqliteJournal(path, alone=alone) as kept:
            yield kept
    except JournalError as error:
        if alone and isinstance(error, JournalBusyError):
            raise
        raise CaesuraError(str(error)) from error


def _found(journals: list[Path], session: str, station: str | None) -> tuple[Key, list[PeerCopy]]:
    """The one session that is meant, and where it is, the copy that is furthest along first.

    Raises Absent, which names what there is, or CaesuraError.
    """
    known = [PeerCopy(path, copy) for path in journals for copy in _copies(path, one_of=len(journals))]
    meant = [found for found in known if found.copy.session == session]
    meant = [found for found in meant if station in {None, found.copy.station}]
    stations = list(dict.fromkeys(found.copy.station for found in meant))
    if not meant:
        there = ", ".join(dict.fromkeys("/".join(found.copy.key) for found in known))
        where = journals[0] if len(journals) == 1 else journals[0].parent
        raise NotFound(
            f"no session {session!r} at {station or 'any station'} in {where}; known: {there or 'none'}"
        )
    if len(stations) > 1:
        named = ", ".join(stations)
        raise CaesuraError(f"several stations have a session {session!r}: name one of {named} with --station")
    return meant[0].copy.key, sorted(meant, key=lambda found: found.copy.progress, reverse=True)


def _copies(path: Path, one_of: int) -> tuple[Copy, ...]:
    """What a journal has; one of several that cannot be read is passed over."""
    try:
        with _opened(path) as kept:
            return kept.copies()
    except CaesuraError as error:
        if one_of == 1:
            raise
        typer.echo(f"passed over: {error}", err=True)
        return ()
