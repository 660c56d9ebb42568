"""`caesura start`, `stop` and `describe`."""

from __future__ import annotations

import getpass
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Annotated, Literal, NamedTuple

import typer

from caesura_clients import demonstration_control
from caesura_clients.cli.connection_options import Config, Connect
from caesura_clients.cli.options import connected, grouped, named, reported
from caesura_clients.client import Caesura
from caesura_clients.demonstration_control import CONTROL_TIMEOUT_S
from caesura_protocol.codec import decode
from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import station_key
from caesura_protocol.messages import BridgeStatus, Description
from caesura_protocol.number_words import counted
from caesura_protocol.transport.inbox import Inbox, ReceivedSample

PATIENCE_S = 2.0
MOST_STATUSES = 16  # of a bridge that are kept; the newest counts
WAITING = f"waiting, for {CONTROL_TIMEOUT_S:g} s at most"

Said = Literal["yes", "no"]
StationArgument = Annotated[str, typer.Argument(help="Teaching station.")]


class DescriptionOptions(NamedTuple):
    """Command-line options that describe a session: task, operator, note and tags."""

    task: Annotated[str | None, typer.Option(help="Name of the task, for lists and searches.")] = None
    operator: Annotated[str | None, typer.Option(help="Name of the person who teaches.")] = None
    note: Annotated[str | None, typer.Option(help="A remark about the session.")] = None
    tag: Annotated[list[str] | None, typer.Option(help="A label of the session; may be repeated.")] = None

    def description(self) -> Description:
        """Return the description that the options state. Raises CaesuraError for a value that is invalid."""
        return demonstration_control.changed(
            Description(), task=self.task, operator=self.operator, note=self.note, tags=tuple(self.tag or ())
        )


@grouped
def start(
    *,
    station: StationArgument,
    stated: DescriptionOptions,
    session: Annotated[str | None, typer.Option(help="Session name; by default made from the time.")] = None,
    endpoint: Connect = None,
    config: Config = None,
) -> None:
    """Start a demonstration at a bridge in standby."""
    with reported():
        named(station)
        named(session, "session")
        description = stated.description()
        with connected(endpoint, config) as caesura:
            ack = demonstration_control.start(caesura.transport, station, description, session=session)
    typer.echo(f"{station}/{ack.session} is being taught")


def stop(
    station: StationArgument,
    success: Annotated[Said | None, typer.Option(help="Did the demonstration succeed?")] = None,
    session: Annotated[
        str | None, typer.Option(help="The session to stop; by default the current one.")
    ] = None,
    without_bridge: Annotated[
        bool,
        typer.Option(
            "--without-bridge",
            help="Close a session whose bridge has ended and does not return. It ends with its last sample.",
        ),
    ] = False,
    endpoint: Connect = None,
    config: Config = None,
) -> None:
    """Stop the demonstration of a station. Returns once the service has all samples that are not lost."""
    stated = None if success is None else success == "yes"
    with reported():
        named(station)
        if without_bridge:
            with connected(endpoint, config) as caesura:
                found = demonstration_control.close_left_open(
                    caesura.transport, station, session=session, success=stated
                )
            for closed in found:
                typer.echo(f"{station}/{closed.session} is over")
            return
        with connected(endpoint, config) as caesura, _stating_what_lasts(caesura, station):
            ack = demonstration_control.stop(caesura.transport, station, session=session, success=stated)
    typer.echo(f"{station}/{ack.session} is over")
    if ack.lost:
        shown = f"caesura sessions show {ack.session} --station {station}"
        lost = f"{counted(ack.lost, 'batch')} of it lost"
        typer.echo(f"warning: {lost}: `{shown}` states when and why", err=True)


@contextmanager
def _stating_what_lasts(caesura: Caesura, station: str) -> Iterator[None]:
    """State on the error stream why a stop has not returned after `PATIENCE_S`."""
    received = Inbox(MOST_STATUSES)

    def state() -> None:
        typer.echo(f"{what_lasts(_newest(received))}: {WAITING}", err=True)

    timer = threading.Timer(PATIENCE_S, state)
    with caesura.transport.subscribe(station_key(station, "bridge_status"), received):
        timer.start()
        try:
            yield
        finally:
            timer.cancel()


def _newest(received: Inbox) -> BridgeStatus | None:
    """Return the last status that a bridge published; None if it published none, or access is denied."""
    status = None
    while (item := received.get(0.0)) is not None:
        if isinstance(item, ReceivedSample):
            with suppress(ProtocolError):
                status = decode(item.payload, item.encoding, BridgeStatus)
    return status


def what_lasts(status: BridgeStatus | None) -> str:
    """Return why a stop has not returned.

    status: the last status of its bridge, None if the bridge has published none.
    """
    if status is None:
        return "the bridge has not answered yet"
    if status.state != "stopping":
        return f"the bridge has not ended the demonstration yet, it is {status.state}"
    if status.problem is not None:
        return status.problem
    return "the service has not stored the whole demonstration yet"


@grouped
def describe(
    *,
    station: StationArgument,
    session: Annotated[str, typer.Argument(help="Session, as `caesura sessions` names it.")],
    stated: DescriptionOptions,
    success: Annotated[Said | None, typer.Option(help="Did the demonstration succeed?")] = None,
    deleted: Annotated[
        bool | None,
        typer.Option("--deleted/--restored", help="Hide it in lists, or show it again; its samples stay."),
    ] = None,
    author: Annotated[
        str | None,
        typer.Option(envvar="CAESURA_AUTHOR", help="Author of the change; by default the login name."),
    ] = None,
    endpoint: Connect = None,
    config: Config = None,
) -> None:
    """Change what is stated about a session, open or closed; what is not named stays."""
    given = {
        "task": stated.task,
        "operator": stated.operator,
        "note": stated.note,
        "tags": None if stated.tag is None else tuple(stated.tag),
        "success": None if success is None else success == "yes",
        "deleted": deleted,
    }
    changes = {name: value for name, value in given.items() if value is not None}
    if not changes:
        raise typer.BadParameter("nothing to change: name --task, --note, --tag, --success or another")
    with reported():
        named(station)
        with connected(endpoint, config) as caesura:
            demonstration_control.describe(
                caesura.transport, station, session, author=author or getpass.getuser(), **changes
            )
    typer.echo(f"{station}/{session}: {', '.join(changes)} changed")
