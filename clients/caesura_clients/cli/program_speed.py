"""`--speed` of a program: as taught, a factor, or the name of an entry point that re-times programs."""

from __future__ import annotations

from collections.abc import Callable, Collection
from importlib.metadata import entry_points
from typing import Annotated

import typer

from caesura_protocol.errors import CaesuraError
from caesura_protocol.messages import LEAST_SPEED, MOST_SPEED
from caesura_protocol.package_version_and_extras import import_extra
from caesura_protocol.programs.document import ProgramFile
from caesura_protocol.programs.program_speed import at_factor, factor_of

GROUP = "caesura.retiming"  # entry points, each a function of a program and the apps that keep their pause
TAUGHT = "taught"

Retiming = Callable[[ProgramFile, Collection[int]], ProgramFile]
Speed = Annotated[
    str,
    typer.Option(
        metavar="SPEED",
        help="Speed of movements without contact: taught, optimal (within the robot's limits, no pauses), "
        f"or a factor from {LEAST_SPEED:g} to {MOST_SPEED:g}.",
    ),
]
KeepPause = Annotated[
    list[int] | None,
    typer.Option(metavar="APP", help="Keep the pause before the app with this number; may be repeated."),
]


def at_speed(program: ProgramFile, speed: str, keeps_pause: Collection[int]) -> ProgramFile:
    """Return the program at a speed. Raises CaesuraError for an unknown speed or a missing extra."""
    if speed == TAUGHT:
        if keeps_pause:
            raise CaesuraError("--keep-pause needs --speed optimal: as taught, every pause is kept")
        return program
    for found in entry_points(group=GROUP, name=speed):
        with import_extra("retiming", f"the speed {speed}"):
            time_it: Retiming = found.load()
        return time_it(program, keeps_pause)
    return at_factor(program, factor_of(speed), keeps_pause)
