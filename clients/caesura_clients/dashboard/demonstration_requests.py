"""Starts, stops and describes demonstrations at the request of a browser.

Requests of a browser are not trusted: names, texts and ids are validated as in messages.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field, TypeAdapter, ValidationError

from caesura_clients.dashboard.correction_requests import EditRefused, field_words, said
from caesura_clients.dashboard.edit_conflicts import ATTEMPTS, redescribed
from caesura_clients.dashboard.station_summary import DashboardState
from caesura_clients.demonstration_control import ask_bridge
from caesura_clients.query import snapshot
from caesura_clients.session_corrections import send
from caesura_protocol.errors import CaesuraError, ProtocolError
from caesura_protocol.messages import BridgeStatus, Describe, Description, Start, Stop
from caesura_protocol.transport.transport_interface import IncompleteAnswerError, Transport
from caesura_protocol.validation_words import first_finding

Request = Mapping[str, Any]
AUTHOR = "dashboard"  # of a description whose author gives no name
TAUGHT = ("starting", "teaching")  # states of a bridge that has a demonstration to stop
ACTIONS: TypeAdapter[Start | Stop | Describe] = TypeAdapter(
    Annotated[Start | Stop | Describe, Field(discriminator="type")]
)


class DemonstrationDesk:
    """Executes an operator's requests at a station; returns the outcome as text."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def carry_out(self, station: str, request: Request) -> str:
        """Start, stop or describe. Raises EditRefused with the reason as text, and EditConflict."""
        command = parse(request)
        try:
            if isinstance(command, Describe):
                self._describe(station, command)
                return _described(command)
            return self._pressed(station, command)
        except (ProtocolError, CaesuraError) as error:
            raise EditRefused(said(error)) from error

    def _pressed(self, station: str, command: Start | Stop) -> str:
        """Start or stop. Raises EditRefused where it may still be done, and where there is more to stop."""
        button = "Stop" if isinstance(command, Stop) else "Start"
        try:
            ack = ask_bridge(self._transport, station, command)
        except IncompleteAnswerError as error:  # the bridge has the command, and answers it later
            why = f"The bridge of {station} has not answered in {error.limit:g} s"
            again = f"If the state stays as it is, press {button} again."
            raise EditRefused(f"{why}, and may still {button.lower()}. {again}") from error
        if isinstance(command, Start):
            return f"{ack.session} has begun."
        if ack.state in TAUGHT:  # since the page of the operator was drawn
            why = f"{ack.session} is over, and {station} teaches another demonstration"
            raise EditRefused(f"{why}: press Stop again to end it.")
        return f"{ack.session} is over."

    def _describe(self, station: str, command: Describe) -> None:
        """Change the current description, unless another operator has changed the same field."""
        for attempt in range(1, ATTEMPTS + 1):
            try:
                send(self._transport, station, command)
            except ProtocolError as refusal:
                if attempt == ATTEMPTS or refusal.code != "conflict":
                    raise
                status = snapshot(self._transport, station, command.session).status
                if status.description == command.before:  # another conflict
                    raise
                command = redescribed(command, status)
            else:
                return


def parse(request: Request) -> Start | Stop | Describe:
    """Return the command of a browser's request {type, …}, checked. Raises EditRefused."""
    given = {"author": AUTHOR, **{name: value for name, value in request.items() if value != ""}}
    try:
        return ACTIONS.validate_python(given)
    except ValidationError as error:
        found = first_finding(error, named=field_words)
        raise EditRefused(said(found)) from error


def _described(command: Describe) -> str:
    if command.description.deleted != command.before.deleted:
        return "Deleted: lists leave it out." if command.description.deleted else "Restored."
    return "Saved."


def controls(world: DashboardState, station: str, *, may_operate: bool) -> dict[str, Any]:
    """Return the payload of Start and Stop: which can be pressed, and the reason if Start cannot.

    The payload also states the last outcome, and the tasks that an operator can choose.
    """
    status = world.bridge_status(station)
    why = _why_not_start(world, station, status, may_operate)
    is_teaching = status is not None and status.state == "teaching"
    return {
        "station": station,
        "state": status.state if status else "",
        "session": (status.session or "") if status else "",
        "canStart": not why,
        "canStop": is_teaching and may_operate,
        "why": why,
        "outcome": _outcome(status),
        "task": _last_task(world, station),
        "tasks": _stated(world, "task"),
    }


def read_only_reason(what: str) -> str:
    """Return why a read-only dashboard refuses an act. what: the act, with `need` or `needs`."""
    return f"This dashboard only reads: {what} an operator's credentials."


def _why_not_start(
    world: DashboardState, station: str, status: BridgeStatus | None, may_operate: bool
) -> str:
    """Return why a demonstration cannot be started now; empty if it can."""
    waits = {
        "starting": "A demonstration is just starting.",
        "teaching": "Stop ends this demonstration; then the next one can start.",
        "stopping": f"The last demonstration is being stored. {status.problem or ''}" if status else "",
        "failed": f"The robot is not ready: {status.problem}." if status else "",
    }
    reasons = (
        (station not in world.stations(), _unknown(world, station)),
        (not may_operate, read_only_reason("start and stop need")),
        (station not in world.bridges, _without_bridge(world, station)),
        (
            status is None,
            f"The bridge of {station} is not in standby: it starts and ends its demonstrations itself.",
        ),
        (not world.alive, "No service answers: nothing would be recorded."),
        (status is not None and status.state != "ready", waits.get(status.state, "") if status else ""),
    )
    return next((why for true, why in reasons if true), "")


def _unknown(world: DashboardState, station: str) -> str:
    known = ", ".join(world.stations()) or "none yet"
    if why := _without_service(world):
        return f"Which bridge and which sessions {station} has is not known: {why}."
    return f"No bridge is connected at {station}, and it has no session. Stations: {known}."


def _without_bridge(world: DashboardState, station: str) -> str:
    """Return that a station has no bridge, or that this is not known, as without the router."""
    if why := _without_service(world):
        return f"Whether a bridge is connected at {station} is not known: {why}."
    return f"No bridge is connected at {station}."


def _without_service(world: DashboardState) -> str:
    """Return why no service answers; empty if one does."""
    return world.trouble.removesuffix(".") or ("" if world.alive else "no service answers")


def _outcome(status: BridgeStatus | None) -> str:
    """Return text on a last demonstration that did not end normally, or on why a button press began none.

    Empty without either.
    """
    if status is not None and status.state == "ready" and status.problem:
        return f"{status.problem[:1].upper()}{status.problem[1:]}."
    if status is None or not status.outcome or ";" not in status.outcome:
        return ""
    return f"{status.last_session} {status.outcome}."


def _last_task(world: DashboardState, station: str) -> str:
    """Return the task of the station's last session: the default for the next one."""
    for session in world.sessions(station):
        update = world.update(station, session)
        if update is not None and update.status.description.task:
            return update.status.description.task
    return ""


def _stated(world: DashboardState, field: str) -> list[str]:
    """Return the distinct values of a field in all descriptions, sorted."""
    found = {getattr(one.status.description, field) for one in world.updates.values()}
    return sorted(value for value in found if value)


def description_of(world: DashboardState, station: str, session: str | None) -> dict[str, Any]:
    """Return the payload of a session's description form; its `session` is empty if there is none."""
    update = world.update(station, session)
    if update is None:
        return {
            "session": "",
            "description": Description().model_dump(),
            "tasks": [],
            "opened": None,
            "closed": True,
        }
    status = update.status
    return {
        "session": update.session,
        "description": status.description.model_dump(),
        "opened": status.opened,
        "tasks": _stated(world, "task"),
        "closed": update.closed,
    }
