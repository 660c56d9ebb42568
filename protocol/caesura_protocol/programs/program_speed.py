"""A program at another speed: by a factor, or with movements that another package has timed.

Rules: only movements in free space and movements that carry are re-timed, along the same path. Presses,
slides, turns, holds and gripper actions keep their taught times.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from types import MappingProxyType

import numpy as np

from caesura_protocol.errors import CaesuraError
from caesura_protocol.messages import LEAST_SPEED, MOST_SPEED
from caesura_protocol.programs.app_time_shifts import SHIFT_S, earlier, may_retime, scaled
from caesura_protocol.programs.document import ProgramFile, ProgramStep
from caesura_protocol.programs.document_timing import ProgramTiming, ShorterPause, Speed

NAMED_PAUSE_S = 0.3  # less of a pause is not named where it is left out: no movement is shorter

UNITS: Mapping[str, str] = MappingProxyType(
    {
        "path": "as target and orientation; its times are those of the program",
        "time": "s of the program as it is timed",
    }
)


def factor_of(text: str) -> float:
    """Return the factor of the taught speed in a text. Raises CaesuraError if it is out of its range."""
    try:
        factor = float(text)
    except ValueError:
        factor = math.nan
    if not LEAST_SPEED <= factor <= MOST_SPEED:
        expected = f"taught, optimal or a factor from {LEAST_SPEED:g} to {MOST_SPEED:g}"
        raise CaesuraError(f"speed {text!r:.80} is not possible, expected {expected}")
    return factor


def at_factor(program: ProgramFile, factor: float, keeps_pause: Collection[int] = ()) -> ProgramFile:
    """Return the program with its movements at a factor of the taught speed, and its taught pauses.

    Raises CaesuraError as `retimed`.
    """
    steps = {index: scaled(app, factor) for index, app in enumerate(program.apps) if may_retime(app)}
    return retimed(program, steps, factor, lambda _, taught_s: taught_s, keeps_pause)


def retimed(
    program: ProgramFile,
    steps: Mapping[int, ProgramStep],
    speed: Speed,
    pause_s: Callable[[int, float], float],
    keeps_pause: Collection[int] = (),
) -> ProgramFile:
    """Return the program with some apps replaced, and the times of the others shifted.

    steps: by index of the app, each from its taught `t0` on; pause_s: returns the pause [s] before an app,
    from the app's index and the taught pause [s]; keeps_pause: indices of the apps before which the taught
    pause stays. Raises CaesuraError if the program is re-timed already, or if `keeps_pause` has an app
    without a pause.
    """
    _check(program, keeps_pause)
    made: list[ProgramStep] = []
    shorter: list[ShorterPause] = []
    for index, app in enumerate(program.apps):
        t0 = app.t0
        if made:
            taught_s = max(app.t0 - program.apps[index - 1].tn, 0.0)
            seconds = taught_s if index in keeps_pause else pause_s(index, taught_s)
            if taught_s - seconds >= NAMED_PAUSE_S:
                shorter.append(ShorterPause(app=index, taught_s=taught_s, seconds=seconds))
            t0 = made[-1].tn + seconds
        made.append(earlier(steps.get(index, app), math.floor((app.t0 - t0) / SHIFT_S) * SHIFT_S))
    taught_t = [t for app in program.apps for t in (app.t0, app.tn)]
    new_t = [t for app in made for t in (app.t0, app.tn)]

    def when(t: float) -> float:
        """Return the time [s] in the re-timed program that belongs to a taught time [s]."""
        if not taught_t or t <= taught_t[0]:
            return t
        return float(np.interp(t, taught_t, new_t)) + max(t - taught_t[-1], 0.0)

    timing = ProgramTiming(
        speed=speed,
        retimed=tuple(sorted(steps)),
        keeps_pause=tuple(sorted(keeps_pause)),
        shorter_pauses=tuple(shorter),
        taught_s=taught_t[-1] - taught_t[0] if taught_t else 0.0,
        seconds=new_t[-1] - new_t[0] if new_t else 0.0,
    )
    gaps = [gap.model_copy(update={"t0": when(gap.t0), "tn": when(gap.tn)}) for gap in program.gaps]
    update = {"apps": tuple(made), "gaps": tuple(gaps), "t": when(program.t), "timing": timing}
    return program.model_copy(update=update | {"units": {**program.units, **UNITS}})


def _check(program: ProgramFile, keeps_pause: Collection[int]) -> None:
    if program.timing is not None:
        raise CaesuraError(
            f"{program.station}/{program.session} is re-timed already (speed {program.timing.speed}): "
            "begin with the program as it was taught"
        )
    for index in keeps_pause:
        if not 0 < index < len(program.apps):
            last = len(program.apps)
            raise CaesuraError(f"there is no pause before app {index + 1}, expected an app from 2 to {last}")
