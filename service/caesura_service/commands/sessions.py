"""`caesura sessions export` and `delete`: what needs the journal itself, on the machine where it is."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer

from caesura_clients.cli.options import Station, reported
from caesura_clients.cli.sessions import sessions
from caesura_clients.errors import Absent, CaesuraError
from caesura_clients.recording import Recording
from caesura_service.config import DEFAULT_INSTANCE, journal_directory, journal_path
from caesura_service.journal import Journal, JournalBusyError, JournalError, Key, SqliteJournal
from caesura_service.recordings import recording_of

Session = Annotated[str, typer.Argument(help="Name of the session.")]
Instance = Annotated[str, typer.Option(help="Name of the instance.")]
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
    instance: Instance = DEFAULT_INSTANCE,
) -> None:
    """Write a session: .npz, a recording that `caesura segment` and a bridge can read; or .mcap, samples and
    results for Foxglove and Rerun.

    The service may be running.
    """
    with reported():
        write = _writer_of(out)
        with _opened(journal, instance, alone=False) as kept:
            key = _found(kept, session, station)
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
    instance: Instance = DEFAULT_INSTANCE,
) -> None:
    """Delete a session for good. While the service runs, only a closed one."""
    with reported():
        try:
            key = _deleted(session, station, journal, instance, alone=True)
        except JournalBusyError:
            key = _deleted(session, station, journal, instance, alone=False)
    typer.echo(f"{'/'.join(key)} deleted")


def _deleted(session: str, station: str | None, directory: Path | None, instance: str, *, alone: bool) -> Key:
    with _opened(directory, instance, alone=alone) as kept:
        key = _found(kept, session, station)
        if not alone and key not in kept.closed():
            raise CaesuraError(f"{'/'.join(key)} is open: close it, or end the service first")
        kept.forget(*key)
        return key


def _write_npz(kept: Journal, key: Key, out: Path) -> Recording:
    recording = recording_of(kept.replay(*key))
    recording.save(out)
    return recording


def _write_mcap(kept: Journal, key: Key, out: Path) -> Recording:
    taught = import_module("caesura_service.export.taught").taught_from(kept, *key)
    import_module("caesura_service.export.mcap_file").write_mcap(out, taught)
    recording: Recording = taught.recording
    return recording


WRITERS: Mapping[str, Callable[[Journal, Key, Path], Recording]] = {".npz": _write_npz, ".mcap": _write_mcap}


def _writer_of(out: Path) -> Callable[[Journal, Key, Path], Recording]:
    """Raises CaesuraError for a suffix without a writer, and where its extra is missing."""
    if out.suffix not in WRITERS:
        raise CaesuraError(f"cannot write {out}: expected the suffix {' or '.join(WRITERS)}")
    if out.suffix == ".mcap" and find_spec("mcap") is None:
        raise CaesuraError("writing .mcap needs pip install 'caesura[mcap]'")
    return WRITERS[out.suffix]


@contextmanager
def _opened(directory: Path | None, instance: str, *, alone: bool) -> Iterator[SqliteJournal]:
    """The journal of an instance; what is wrong with it is an error for a user, but that it is in use."""
    path = journal_path(directory or journal_directory(), instance)
    if not path.exists():
        raise Absent(f"no journal {path}: this runs where the service does; --journal and --instance name it")
    try:
        with SqliteJournal(path, alone=alone) as kept:
            yield kept
    except JournalBusyError:
        raise
    except JournalError as error:
        raise CaesuraError(str(error)) from error


def _found(kept: SqliteJournal, session: str, station: str | None) -> Key:
    """The one session that is meant. Raises Absent, which names what there is, or CaesuraError."""
    known = kept.sessions()
    meant = [key for key in known if key[1] == session and station in {None, key[0]}]
    if not meant:
        there = ", ".join("/".join(key) for key in known)
        raise Absent(
            f"no session {session!r} at {station or 'any station'} in {kept.path}; known: {there or 'none'}"
        )
    if len(meant) > 1:
        where = ", ".join(key[0] for key in meant)
        raise CaesuraError(f"several stations have a session {session!r}: name one of {where} with --station")
    return meant[0]
