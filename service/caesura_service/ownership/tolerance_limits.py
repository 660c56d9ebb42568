"""The upper limits of the tolerances in new commands.

The messages have no such limit: journals with larger tolerances, of an older version, stay readable.
"""

from __future__ import annotations

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import MOST_TOLERANCE_M, MOST_TOLERANCE_RAD, ChangeApp, EditProgram, Open


def check_tolerances(command: Open | EditProgram) -> None:
    """Raise ProtocolError for a tolerance above its limit, which is probably in another unit."""
    if isinstance(command, Open):
        _check("path_tolerance_m", command.path_tolerance_m, MOST_TOLERANCE_M)
        _check("path_tolerance_rad", command.path_tolerance_rad, MOST_TOLERANCE_RAD)
    elif isinstance(command.action, ChangeApp):
        _check("tolerance_m", command.action.tolerance_m, MOST_TOLERANCE_M)


def _check(field: str, value: float | None, limit: float) -> None:
    if value is not None and value > limit:
        message = f"{field} is {value:g}, expected a number above 0 and at most {limit:g}: is its unit right?"
        raise ProtocolError("malformed", message, value=value, limit=limit)
