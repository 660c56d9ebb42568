"""`caesura sessions export`, `delete` and `journals`: commands that need the journal, on its machine."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Literal

import typer

from caesura_clients.cli.connection_options import Station
from caesura_clients.cli.options import grouped, reported
from caesura_lab.commands.dataset_export_options import DATASET_OPTIONS, DatasetOptions, write_dataset
from caesura_protocol.errors import CaesuraError, NotFound, ProtocolError
from caesura_protocol.formats.write import write_npz
from caesura_protocol.number_words import counted
from caesura_protocol.package_version_and_extras import install_command
from caesura_protocol.recording import Recording
from caesura_service.config import journal_directory, journal_path
from caesura_service.journal import (
    Changes,
    Copy,
    Journal,
    JournalBusyError,
    JournalError,
    Key,
    PeerCopy,
    PeerJournals,
    SqliteJournal,
    last_owned,
    refused_in,
)
from caesura_service.journal.peer_journals import open_for_reading
from caesura_service.journal.rows import copies_in
from caesura_service.journal.sqlite_database import is_in_use
from caesura_service.offline_segmentation import recording_of

Session = Annotated[str, typer.Argument(help="Name of the session.")]
Instance = Annotated[
    str | None, typer.Option(help="Read the journal of this instance alone, not all of DIR.")
]
Directory = Annotated[
    Path | None,
    typer.Option(
        "--journal", metavar="DIR", help="Directory of journals, as for `caesura serve`; the same default."
    ),
]
Format = Literal["npz", "mcap", "lerobot"]
Found = tuple[Key, list[PeerCopy]]  # a session, and where it is


@grouped
def export(
    names: Annotated[
        list[str],
        typer.Argument(metavar="SESSION...", help="Or STATION/SESSION. Several become one dataset."),
    ],
    *,
    out: Annotated[Path, typer.Option("--out", "-o", help="Destination: .npz, .mcap, or a new directory.")],
    file_format: Annotated[
        Format | None, typer.Option("--format", help="By default the one of the suffix of --out.")
    ] = None,
    dataset: DatasetOptions,
    station: Station = None,
    journal: Directory = None,
    instance: Instance = None,
) -> None:
    """Write a session: .npz, a recording that `caesura segment` and a bridge can read; or .mcap, samples and
    results for Foxglove and Rerun; or, with --format lerobot, sessions as the episodes of a dataset.

    The service may be running.
    """
    with reported():
        chosen = _format_of(out, file_format, names, dataset)
        matches = [
            _find_session(_journal_paths(journal, instance), name, station) for name in dict.fromkeys(names)
        ]
        try:
            done = (
                _write_dataset(matches, out, dataset)
                if chosen == "lerobot"
                else _write_file(matches[0], out, chosen)
            )
        except OSError as error:
            raise CaesuraError(f"cannot write {out}: {error.strerror}") from error
    typer.echo(f"{out}: {done}")


def delete(
    session: Session,
    station: Station = None,
    journal: Directory = None,
    instance: Instance = None,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Do not ask. Needed without a terminal.")] = False,
) -> None:
    """Delete a session for good: its samples, results and corrections, in every journal of DIR.

    It runs on the service's machine and needs write access to the journal. While the service runs, only a
    closed session is deleted. It asks first; without a terminal to ask in, --yes is needed.
    """
    with reported():
        key, copies = _find_session(_journal_paths(journal, instance), session, station)
        if not yes:
            places = ", ".join(str(found.path) for found in copies)
            if not sys.stdin.isatty():
                raise CaesuraError(
                    f"{'/'.join(key)} is kept: there is no terminal to ask in. --yes deletes its samples, "
                    f"results and corrections in {places} without a question"
                )
            typer.confirm(
                f"Delete samples, results and corrections of {'/'.join(key)} in {places}?", abort=True
            )
        for found in copies:
            _delete(found, closed=copies[0].copy.closed)
    typer.echo(f"{'/'.join(key)} deleted")


def journals(journal: Directory = None) -> None:
    """List the journals of DIR, which of them no service has open, and the sessions that only such a one has.

    The service may be running; nothing is changed. One that cannot be read is reported on stderr.
    """
    with reported():
        held: dict[Path, tuple[Copy, ...]] = {}
        in_use: dict[Path, bool] = {}
        for path in _journal_paths(journal, None):
            try:
                with open_for_reading(path) as kept:
                    held[path], in_use[path] = copies_in(kept), is_in_use(path)
            except JournalError as error:
                typer.echo(str(error), err=True)
        for path in tuple(held):
            typer.echo(f"{path}: {_extent_in_words(held[path], path)}; {IN_USE[in_use[path]]}")
            if in_use[path]:
                continue
            only = _only_there(path, held)
            typer.echo(f"    {_only_there_in_words(path, only)}")
            if not only:
                del held[path]  # of two such journals with one session each, one has to stay


IN_USE = {True: "a service has it open", False: "no service has it open"}
NAMED = 10  # sessions of one journal, at most


def _extent_in_words(copies: Sequence[Copy], path: Path) -> str:
    is_open = sum(not copy.closed for copy in copies)
    return f"{path.stat().st_size / 1e6:.1f} MB, {counted(len(copies), 'session')}, {is_open} of them open"


def _only_there(path: Path, held: Mapping[Path, Sequence[Copy]]) -> list[str]:
    """Return the sessions of which no other journal has as much, from an owner as late."""
    elsewhere: dict[Key, list[Copy]] = {}
    for copy in (copy for other, copies in held.items() if other != path for copy in copies):
        elsewhere.setdefault(copy.key, []).append(copy)
    return [
        "/".join(copy.key)
        for copy in held[path]
        if not any(
            other.progress >= copy.progress and other.owner_epoch >= copy.owner_epoch
            for other in elsewhere.get(copy.key, ())
        )
    ]


def _only_there_in_words(path: Path, only: Sequence[str]) -> str:
    """Name the sessions that only this journal has; without any, state how to clear it away."""
    gone = f"if instance {path.stem} never starts again"
    if not only:
        return f"no session is only there: {gone}, move {path.name}* away"
    more = f" and {len(only) - NAMED} more" if len(only) > NAMED else ""
    named = ", ".join(only[:NAMED])
    return f"only there: {named}{more}; {gone}, export or delete them before you move {path.name}* away"


def _delete(matches: PeerCopy, *, closed: bool) -> None:
    """Delete a session. Raises CaesuraError if it is open and a service may be using it."""
    try:
        with _open_journal(matches.path, alone=not closed) as journal:
            journal.delete(*matches.copy.key)
    except JournalBusyError:
        station, session = matches.copy.key
        close = f"`caesura stop {station}`, or without its bridge `caesura stop {station} --without-bridge`"
        raise CaesuraError(f"{station}/{session} is open: {close}, or end the service first") from None


def _write_npz(journal: Journal, key: Key, out: Path) -> Recording:
    recording = recording_of(journal.replay(*key))
    write_npz(out, recording)
    return recording


def _write_mcap(journal: Journal, key: Key, out: Path) -> Recording:
    session_export = import_module("caesura_lab.export.session_from_journal").read_session_export(
        journal, *key
    )
    import_module("caesura_lab.export.mcap_file").write_mcap(out, session_export)
    recording: Recording = session_export.recording
    return recording


#: Formats of one session, a file each.
WRITERS: Mapping[Format, Callable[[Journal, Key, Path], Recording]] = {"npz": _write_npz, "mcap": _write_mcap}
EXTRAS: Mapping[Format, str] = {"mcap": "mcap", "lerobot": "pyarrow"}  # format, and extra → its package


def _write_file(matches: Found, out: Path, chosen: Format) -> str:
    """Write one session and return what was written."""
    key, copies = matches
    with _open_journal(copies[0].path) as journal:
        recording = WRITERS[chosen](journal, key, out)
    for line in recording.beyond_samples:
        typer.echo(line, err=True)
    return f"{counted(recording.t.size, 'sample')}, {recording.t[-1] - recording.t[0]:.2f} s"


def _write_dataset(matches: list[Found], out: Path, asked: DatasetOptions) -> str:
    """Write sessions as a dataset and return what was written."""
    read_session_export = import_module("caesura_lab.export.session_from_journal").read_session_export
    sessions = []
    for key, copies in matches:
        with _open_journal(copies[0].path) as journal:
            sessions.append(read_session_export(journal, *key))
    return write_dataset(out, sessions, asked)


def _format_of(out: Path, asked: Format | None, names: list[str], dataset: DatasetOptions) -> Format:
    """Return the format.

    Raises CaesuraError for none, for a missing extra, and for options that do not apply.
    """
    chosen = asked or next((one for one in WRITERS if out.suffix == f".{one}"), None)
    if chosen is None:
        raise CaesuraError(
            f"cannot write {out}: expected the suffix .npz or .mcap, or --format lerobot and a new directory"
        )
    if chosen in EXTRAS and find_spec(EXTRAS[chosen]) is None:
        raise CaesuraError(
            f"writing {'.mcap' if chosen == 'mcap' else chosen} needs {install_command(chosen)}"
        )
    if chosen == "lerobot":
        return chosen
    if out.suffix != f".{chosen}":
        raise CaesuraError(f"cannot write {out}: expected the suffix .{chosen}")
    if len(names) > 1:
        raise CaesuraError(f"{len(names)} sessions for one .{chosen} file: several are for --format lerobot")
    if dataset != DatasetOptions():
        raise CaesuraError(f"{DATASET_OPTIONS} are not for .{chosen}")
    return chosen


def _journal_paths(directory: Path | None, instance: str | None) -> list[Path]:
    """Return the journal of one instance, or all of the directory. Raises NotFound where there is none."""
    where = directory or journal_directory()
    wanted = where / "*.sqlite" if instance is None else journal_path(where, instance)
    matches = sorted(where.glob(wanted.name))
    if not matches:
        raise NotFound(
            f"no journal {wanted}: this runs where the service does; --journal and --instance name it"
        )
    return matches


@contextmanager
def _open_journal(path: Path, *, alone: bool = False) -> Iterator[SqliteJournal]:
    """Open a journal; convert its errors to CaesuraError.

    With `alone` it raises JournalBusyError unchanged if another process has the journal.
    """
    try:
        with SqliteJournal(path, alone=alone) as journal:
            yield journal
    except JournalError as error:
        if alone and isinstance(error, JournalBusyError):
            raise
        raise CaesuraError(str(error)) from error


def _find_session(journals: list[Path], session: str, station: str | None) -> Found:
    """Return the named session with its copies, the one with the most records first.

    session: its name, or without a `station` also STATION/SESSION, as messages list it.
    A copy with refused changes comes after the others. Raises NotFound, which lists the existing sessions, or
    CaesuraError.
    """
    if station is None and "/" in session:
        station, session = session.split("/", 1)
    known = [PeerCopy(path, copy) for path in journals for copy in _copies(path, one_of=len(journals))]
    meant = [matches for matches in known if matches.copy.session == session]
    meant = [matches for matches in meant if station in {None, matches.copy.station}]
    stations = list(dict.fromkeys(matches.copy.station for matches in meant))
    if not meant:
        there = ", ".join(dict.fromkeys("/".join(matches.copy.key) for matches in known))
        where = journals[0] if len(journals) == 1 else journals[0].parent
        raise NotFound(
            f"no session {session!r} at {station or 'any station'} in {where}; known: {there or 'none'}; "
            "--journal names the directory of another service"
        )
    if len(stations) > 1:
        named = ", ".join(stations)
        raise CaesuraError(f"several stations have a session {session!r}: name one of {named} with --station")
    last = last_owned(meant, lambda matches: matches.copy)

    def order(one: PeerCopy) -> tuple[object, ...]:
        refused = refused_in(one.copy, last.copy, lambda: (_changes(one), _changes(last)))
        return refused is None, one.copy.progress

    return meant[0].copy.key, sorted(meant, key=order, reverse=True)


def _changes(found: PeerCopy) -> Changes | None:
    """Return the changes of a copy; None where they cannot be read."""
    try:
        return Changes.of(PeerJournals(None).changes(found))
    except (JournalError, ProtocolError):
        return None


def _copies(path: Path, one_of: int) -> tuple[Copy, ...]:
    """Return the sessions of a journal. An unreadable one of several is reported on stderr and has none.

    Raises CaesuraError where the only one (`one_of` 1) is unreadable.
    """
    try:
        with _open_journal(path) as journal:
            return journal.copies()
    except CaesuraError as error:
        if one_of == 1:
            raise
        typer.echo(f"skipped: {error}", err=True)
        return ()
