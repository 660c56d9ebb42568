"""Force limits of a cell or an operator, applied to the forces of a program."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from caesura_protocol.messages import App, RestForce
from caesura_protocol.number_words import fixed

LEAST_FORCE_N = 1e-3  # of a press, for it to have a direction: scripts state forces in such steps
LEAST_PRESS_N = 1.0  # of a press that a robot holds
CUT_SHARE = 1e-9  # of a force that may be missing where nothing was cut


class ExertedForce(NamedTuple):
    """A force of an app [N], exerted and taught. when: `before` or `after` the app's path; empty along it."""

    when: str
    newton: float
    newton_taught: float

    @property
    def is_cut(self) -> bool:
        """Whether the exerted force is below the taught one."""
        return self.newton < self.newton_taught * (1.0 - CUT_SHARE)

    @property
    def is_raised(self) -> bool:
        """Whether the exerted force is above the taught one, such as that of a rest below LEAST_PRESS_N."""
        return self.newton > self.newton_taught * (1.0 + CUT_SHARE)


def is_press(newton: float) -> bool:
    """Return whether a force [N] is large enough for a press.

    The size of a vector of LEAST_FORCE_N may be rounded down, and still counts.
    """
    return newton >= LEAST_FORCE_N * (1.0 - CUT_SHARE)


def with_force_limit(app: App, limit_n: float) -> App:
    """Return the app with each of its forces limited to `limit_n` [N].

    An app below the limit, or without a force, is unchanged.
    """
    cut: dict[str, object] = {}
    exerted = 0.0 if app.force is None else math.hypot(*app.force)
    if app.force is not None and exerted > limit_n:
        x, y, z = (limit_n / exerted * component for component in app.force)
        cut = {"force": (x, y, z), "force_taught": app.force_taught or app.force}
    for name, rest in (("rest_before", app.rest_before), ("rest_after", app.rest_after)):
        if rest is not None and rest.newton > limit_n:
            cut[name] = rest.model_copy(update={"newton": limit_n})
    return app.model_copy(update=cut) if cut else app


def exerted_forces(app: App) -> Iterator[ExertedForce]:
    """Yield the force of an app, then those of its rests with a force of their own, in time order."""
    if app.force is None:
        return
    exerted = math.hypot(*app.force)
    yield ExertedForce("", exerted, exerted if app.force_taught is None else math.hypot(*app.force_taught))
    rests: tuple[tuple[str, RestForce | None], ...] = (("before", app.rest_before), ("after", app.rest_after))
    for when, rest in rests:
        if rest is not None:
            yield ExertedForce(when, rest.newton, rest.newton_taught)


def force_in_words(app: App) -> str:
    """Return text on an app's force, with the taught one if a limit has changed it; empty without a force.

    The forces of the rests beside its path are in brackets.
    """
    path, rests = path_force_in_words(app), rests_in_words(app)
    return f"{path} ({rests})" if rests else path


def path_force_in_words(app: App) -> str:
    """Return text on the force of an app along its path, without its rests; empty without a force."""
    return ", ".join(_in_words(force) for force in exerted_forces(app) if not force.when)


def rests_in_words(app: App) -> str:
    """Return text on the forces of the rests beside a path; empty if none has a force of its own."""
    return ", ".join(_in_words(force) for force in exerted_forces(app) if force.when)


def is_limited(app: App) -> bool:
    """Return whether any force of an app, including its rests, is below the taught one."""
    return any(force.is_cut for force in exerted_forces(app))


def is_path_limited(app: App) -> bool:
    """Return whether the force of an app along its path is below the taught one; rests do not count."""
    return any(force.is_cut for force in exerted_forces(app) if not force.when)


def _in_words(force: ExertedForce) -> str:
    taught = f" of {fixed(force.newton_taught, 1)} N taught" if force.is_cut or force.is_raised else ""
    return f"{fixed(force.newton, 1)} N{taught}{f' {force.when}' if force.when else ''}"
