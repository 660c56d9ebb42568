"""`caesura hints`: prints each hint when it is raised, updated and cleared, or runs a command for it."""

from __future__ import annotations

import os
import shlex
import shutil
import signal
import subprocess
from collections.abc import Iterable
from contextlib import closing, suppress
from typing import Annotated

import typer

from caesura_clients.cli.connection_options import Config, Connect, Station
from caesura_clients.cli.options import connected, ended_by_sigterm, named, reported
from caesura_clients.hint_lifecycle import HintChange, HintChanges
from caesura_clients.session_follower import events
from caesura_protocol.command_line_advice import at_command_line

PATIENCE_S = 5.0  # for a command


def hints(
    station: Station = None,
    command: Annotated[
        str | None,
        typer.Option(
            "--exec",
            metavar="COMMAND",
            help="Run this command at each change, for at most 5 s and without a shell: for variables and "
            "redirections write \"sh -c '…'\". Its environment has CAESURA_HINT_EVENT (raised, updated or "
            "cleared), _KIND, _TEXT, _ADVICE, _STATION, _SESSION and _ACTIVE.",
        ),
    ] = None,
    endpoint: Connect = None,
    config: Config = None,
) -> None:
    """Show hints to the teacher as they are raised, updated and cleared. By default of all stations.

    A command drives a light or a tone: CAESURA_HINT_ACTIVE is 0 once no hint of the station is active. At the
    end every active hint counts as cleared.
    """
    with reported():
        named(station)
        words = _split(command)
        with connected(endpoint, config, patient=True) as caesura:
            changes = HintChanges()
            with (
                ended_by_sigterm(),
                suppress(KeyboardInterrupt),
                closing(events(caesura.transport, station or "*")) as happened,
            ):
                for event in happened:
                    _act(changes.receive(event), words)
            _act(changes.clear(), words)


def hint_line(change: HintChange) -> str:
    """Return a line on a change: station/session, time, event, kind, and message.

    The time is the end of a cleared hint, and otherwise the time at which the hint was raised.
    """
    hint = change.hint
    t = hint.since if change.event != "cleared" or hint.until is None else hint.until
    said = f" {at_command_line(hint.text)} {hint.advice}" if change.event != "cleared" else ""
    return f"{change.station}/{change.session} {t:.2f} {change.event} {hint.kind}{said}"


def _split(command: str | None) -> list[str]:
    """Return the words of a command. Raises BadParameter if there are none."""
    if command is None:
        return []
    try:
        words = shlex.split(command)
    except ValueError as error:
        raise typer.BadParameter(f"{command!r}: {error}", param_hint="--exec") from error
    if not words:
        raise typer.BadParameter("is empty, expected a command", param_hint="--exec")
    if shutil.which(words[0]) is None:
        raise typer.BadParameter(
            f"{words[0]}: no such command, or it may not be run (chmod +x); expected one to run at each hint",
            param_hint="--exec",
        )
    return words


def _act(changes: Iterable[HintChange], words: list[str]) -> None:
    """Print each change, and run the command for it. A command that fails is reported; the loop goes on."""
    for change in changes:
        typer.echo(hint_line(change))  # which flushes
        if words and (why := _failure(change, words)):
            typer.echo(f"--exec {words[0]}: {why}", err=True)


def _failure(change: HintChange, words: list[str]) -> str:
    """Run the command; return why it failed, empty if it did not."""
    hint = change.hint
    stated = {
        "EVENT": change.event,
        "KIND": hint.kind,
        "TEXT": hint.text,
        "ADVICE": hint.advice,
        "STATION": change.station,
        "SESSION": change.session,
        "ACTIVE": str(change.active),
    }
    environment = {f"CAESURA_HINT_{name}": value for name, value in stated.items()}
    try:
        child = subprocess.Popen(
            words, env={**os.environ, **environment}, stdin=subprocess.DEVNULL, process_group=0
        )
    except OSError as error:
        return error.strerror or str(error)
    with child:
        try:
            code = child.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            return f"ended after {PATIENCE_S:g} s, the limit"
        finally:
            if child.returncode is None:  # with what it started: a script would leave one process a hint
                os.killpg(child.pid, signal.SIGKILL)
    return f"exit code {code}" if code else ""
