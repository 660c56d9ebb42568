"""What the action `Teach` does, without ROS 2: start a demonstration, follow it, stop it."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from caesura_clients import Caesura, CaesuraError, Update, demonstration_control
from caesura_protocol.messages import Description, Program

SILENCE_S = 1.0  # after which a silent session is looked at again, so that a cancellation is seen


class Taught(NamedTuple):
    """The result of a demonstration; program: None where nothing was received."""

    success: bool
    message: str
    session: str
    program: Program | None


def teach(
    caesura: Caesura,
    station: str,
    session: str,
    description: Description,
    report: Callable[[Update], None],
    is_cancelled: Callable[[], bool],
) -> Taught:
    """Teach at a bridge in standby until it is stopped, here or elsewhere; `report` gets each change.

    Once a demonstration has begun, its name and newest program are in the result, whatever happens after.
    """
    program = None
    try:
        session = demonstration_control.start(
            caesura.transport, station, description, session=session or None
        ).session
        stopped = False
        while True:
            for update in caesura.results(station, session, silence_s=SILENCE_S):
                report(update)
                program = update.program
                if update.closed:
                    return Taught(True, "stopped" if stopped else "closed", session, program)
                if is_cancelled() and not stopped:
                    break
            if is_cancelled() and not stopped:
                demonstration_control.stop(caesura.transport, station, session=session)
                stopped = True
    except CaesuraError as error:
        return Taught(False, str(error), session, program)
