"""Apps grouped by the phase that they were taught in, each group with a name that may be changed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from caesura_protocol.messages import App, Phase

AppNumber = Annotated[int, Field(ge=0)]


class Group(BaseModel):
    """Apps `first` to `last` of a program, counted from 0, and what the skill is called."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    first: AppNumber
    last: AppNumber
    name: Annotated[str, Field(min_length=1, max_length=64)]


def groups_of(apps: Sequence[App], phases: Sequence[Phase]) -> tuple[Group, ...]:
    """Return a group for each phase that has apps, named by its kind and number: `free 1`, `contact 1`, ….

    An app belongs to the phase of its first segment; one without segments to the phase in whose time it lies.
    A single phase makes no group.
    """
    groups: list[Group] = []
    if len(phases) < 2:
        return ()
    counts: Counter[str] = Counter()
    owners = [_phase_of(app, phases) for app in apps]
    for number, phase in enumerate(phases):
        members = [index for index, owner in enumerate(owners) if owner == number]
        if members:
            counts[phase.kind] += 1
            name = f"{phase.kind} {counts[phase.kind]}"
            groups.append(Group(first=members[0], last=members[-1], name=name))
    return tuple(groups)


def _phase_of(app: App, phases: Sequence[Phase]) -> int:
    """The number of the last phase that begins no later than the app."""
    begun = (
        phase.first_segment <= app.segments[0] if app.segments else phase.t0 <= app.t0 for phase in phases
    )
    return max(sum(begun) - 1, 0)
