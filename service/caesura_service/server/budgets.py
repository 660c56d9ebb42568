"""Budgets of each station: the resources of an instance that it may use, their use, and the resulting
refusals.

There are separate budgets for work (the worker's time), for messages and bytes that a station publishes, for
commands, for the work on previews, for queries, and for changes of the token; the rates are in
`rate_limit_settings`. Previews and queries come from readers, and do not count for the station's samples and
commands. Stations are distinguished by name; keys without a station count as one. Any thread may call the
methods.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from heapq import nlargest
from typing import Literal, get_args

from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import is_name
from caesura_protocol.messages import MAX_BUDGETS, Budget, StationBudgets
from caesura_protocol.token_bucket import SENDERS, Rate, RateLimit
from caesura_service.server.rate_limit_settings import RateLimits

Use = Literal["work", "messages", "bytes", "commands", "previews", "queries", "tokens"]
USES: tuple[Use, ...] = get_args(Use)
UNITS: dict[Use, str] = {
    "work": "s of the worker's time",
    "messages": "messages",
    "bytes": "bytes",
    "commands": "commands",
    "previews": "s of the worker's time",
    "queries": "queries",
    "tokens": "changes of the token",
}
CACHE_S = 0.25  # how long the list of stations is cached
FULL = 1.0


class Budgets:
    """The budgets of all stations of an instance."""

    def __init__(self, rates: RateLimits, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._put = RateLimit(rates.samples, rates.bytes, clock=clock)
        self._rates: dict[Use, Rate] = {
            "work": rates.work,
            "messages": rates.samples,
            "bytes": rates.bytes,
            "commands": rates.commands,
            "previews": rates.previews,
            "queries": rates.queries,
            "tokens": rates.tokens,
        }
        self._limits = {
            use: RateLimit(rate, clock=clock)
            for use, rate in self._rates.items()
            if use not in {"messages", "bytes"}
        }
        self._refused: dict[str, dict[Use, int]] = {}  # the last refused station is last
        self._busiest: tuple[StationBudgets, ...] = ()
        self._busiest_until_s = float("-inf")  # [s]
        self._lock = threading.Lock()

    def reject_put(self, station: str, size: int, messages: int = 1) -> ProtocolError | None:
        """Count `messages` messages of `size` bytes in all; return why they are dropped, or None."""
        lacking = self._put.lacking(station, messages, size)
        if lacking is not None:
            return self._count_and_explain(station, ("messages", "bytes")[lacking], messages)
        return self.reject_work(station, messages)

    def reject_command(self, station: str) -> ProtocolError | None:
        """Count a command; return why it is refused, or None."""
        if not self._limits["commands"].allows(station):
            return self._count_and_explain(station, "commands")
        return self.reject_work(station)

    def reject_query(self, station: str) -> ProtocolError | None:
        """Count a query on a station; return why it is refused, or None."""
        return (
            None if self._limits["queries"].allows(station) else self._count_and_explain(station, "queries")
        )

    def tokens_exhausted(self, station: str) -> bool:
        """Return whether a change of a station's token must wait; counts nothing."""
        return self._limits["tokens"].is_spent(station)

    def charge_token(self, station: str) -> None:
        """Charge a station for a change of its token."""
        self._limits["tokens"].charge(station, 1.0)

    def reject_work(self, station: str, messages: int = 1) -> ProtocolError | None:
        """Count messages that are refused because the work is used up; return why, or None."""
        if (refusal := self.work_exhausted(station)) is not None:
            self.count_refused(station, "work", messages)
        return refusal

    def work_exhausted(self, station: str) -> ProtocolError | None:
        """Return why a message that causes work is refused now, or None; counts nothing."""
        return self._error(station, "work") if self._limits["work"].is_spent(station) else None

    def charge_work(self, station: str, seconds: float) -> None:
        """Charge a station for the worker's time [s]."""
        self._limits["work"].charge(station, seconds)

    def reject_preview(self, station: str) -> ProtocolError | None:
        """Count a preview that is refused because its budget is used up; return why, or None."""
        spent = self._limits["previews"].is_spent(station)
        return self._count_and_explain(station, "previews") if spent else None

    def charge_preview(self, station: str, seconds: float) -> None:
        """Charge a station's budget of previews for the worker's time [s]."""
        self._limits["previews"].charge(station, seconds)

    def budgets_of(self, station: str) -> StationBudgets:
        """Return the current budgets of one station."""
        used = self._used(station)
        return StationBudgets(
            station=station, **{use: self._budget(station, use, used[use]) for use in self._rates}
        )

    def queries_of(self, lane: str) -> Budget:
        """Return the current budget of queries of a lane, which need not be a station's."""
        return self._budget(lane, "queries", self._limits["queries"].used(lane)[0])

    def busiest(self) -> tuple[StationBudgets, ...]:
        """Return the at most MAX_BUDGETS stations nearest to a limit or with refusals; cached for CACHE_S."""
        now = self._clock()
        if now >= self._busiest_until_s:
            limits = self._put, *self._limits.values()
            known = {name for limit in limits for name in limit.senders()}
            with self._lock:
                known |= self._refused.keys()
            ranked = nlargest(MAX_BUDGETS, ((self._share(name), name) for name in known if is_name(name)))
            self._busiest = tuple(self.budgets_of(name) for share, name in ranked if share > 0.0)
            self._busiest_until_s = now + CACHE_S
        return self._busiest

    def _budget(self, station: str, use: Use, used: float) -> Budget:
        (per_s, at_once), refused = self._rates[use], self._refused.get(station, {})
        return Budget(per_s=per_s, at_once=at_once, used=used, refused=refused.get(use, 0))

    def _used(self, station: str) -> dict[Use, float]:
        messages, size = self._put.used(station)
        single = {use: limit.used(station)[0] for use, limit in self._limits.items()}
        return {**single, "messages": messages, "bytes": size}

    def _share(self, station: str) -> float:
        """Return the used share of the fullest budget; a station with refusals comes first."""
        shares = (used / self._rates[use].burst for use, used in self._used(station).items())
        return max(shares) + (FULL if station in self._refused else 0.0)

    def _count_and_explain(self, station: str, use: Use, times: int = 1) -> ProtocolError:
        self.count_refused(station, use, times)
        return self._error(station, use)

    def count_refused(self, station: str, use: Use, times: int = 1) -> None:
        """Count refusals of a use.

        Also those without a check of the budget, such as messages dropped unread.
        """
        with self._lock:
            counts = self._refused.pop(station, {})
            self._refused[station] = {**counts, use: counts.get(use, 0) + times}
            if len(self._refused) > SENDERS:
                del self._refused[next(iter(self._refused))]

    def _error(self, station: str, use: Use) -> ProtocolError:
        """Return the error with the used amount, the limit and the rate."""
        (per_s, at_once), used = self._rates[use], self._used(station)[use]
        if used == 0.0:  # a name that finds no room among those with a budget of their own
            why = f"{SENDERS} other stations send: station {station} has to wait; try again"
            return ProtocolError("overloaded", why, value=station, limit=SENDERS)
        sender = f"station {station}" if is_name(station) else "what names no station"
        why = (
            f"{sender} has used up its budget of {use}: {used:.4g} of {at_once:g} "
            f"{UNITS[use]}, of which {per_s:g} come back every second; try again"
        )
        return ProtocolError("overloaded", why, value=float(f"{used:.4g}"), limit=at_once)
