"""The budgets of a station as text for an operator."""

from __future__ import annotations

from caesura_protocol.messages import Budget, StationBudgets

MUCH_USED = 0.5  # of a budget: from there on it is shown
_NAMES = {"work": "seconds of work", "previews": "seconds of previews"}


def budgets_in_words(budgets: StationBudgets | None, *, least: float = MUCH_USED) -> list[str]:
    """Return a text for each budget that is used to the share `least` or more, or caused a refusal.

    >>> commands = Budget(per_s=500, at_once=1000, used=1000, refused=17)
    >>> idle = Budget(per_s=0.5, at_once=60, used=0.01, refused=0)
    >>> budgets_in_words(StationBudgets(station="a", work=idle, messages=idle, bytes=idle, commands=commands))
    ['commands 1000 of 1000 (500 a second), 17 held back']
    """
    named = [] if budgets is None else [(name, one) for name, one in budgets if isinstance(one, Budget)]
    return [
        f"{_NAMES.get(name, name)} {one.used:.4g} of {one.at_once:.4g} ({one.per_s:.4g} a second)"
        + (f", {one.refused} held back" if one.refused else "")
        for name, one in named
        if one.refused or one.used >= least * one.at_once
    ]


def held_back(budgets: StationBudgets) -> int:
    """Return how many messages of the station were dropped or refused because a budget was used up."""
    return sum(one.refused for _, one in budgets if isinstance(one, Budget))
