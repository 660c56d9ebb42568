"""Why a session of the journal has no results, in words for an operator."""

from __future__ import annotations

from collections.abc import Iterable

from caesura_protocol.messages import DamagedSession, ServiceStatus
from caesura_protocol.number_words import counted


def damaged_in(services: Iterable[ServiceStatus]) -> list[tuple[str, DamagedSession]]:
    """Return the damaged sessions that the instances list, with the instance; the newest first."""
    found = [(one.instance, damaged) for one in services if one.journal for damaged in one.journal.damaged]
    return sorted(found, key=lambda one: one[1].opened or 0.0, reverse=True)


def damage_words(one: DamagedSession) -> str:
    """Return the damage of a session, and how to get its samples."""
    if one.set_aside:
        return f"{one.why}; the journal has set it aside"
    export = f"`caesura sessions export {one.session} --station {one.station}`"
    return f"{one.why}; on the service's machine, {export} writes its samples"


def unlisted_words(services: Iterable[ServiceStatus]) -> str:
    """Return how many damaged sessions are not listed; empty without one."""
    count = sum(one.journal.damaged_before for one in services if one.journal)
    return f"{counted(count, 'older session')} with damage: the service's log names them" if count else ""
