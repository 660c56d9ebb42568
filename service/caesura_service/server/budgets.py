"""What each station may use of an instance, what it has used, and what was refused because of that.

Work, which is the worker's time, messages and bytes that a station puts, and commands have a budget each; the
rates are in `rates`. Stations are distinguished by name; keys that name no station count as one. Any thread
may ask.
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
from caesura_service.server.rates import SENDERS, Rate, RateLimit, RateSettings, WorkBudget

Use = Literal["work", "messages", "bytes", "commands"]
USES: tuple[Use, ...] = get_args(Use)
UNITS: dict[Use, str] = {
    "work": "s of the worker's time",
    "messages": "messages",
    "bytes": "bytes",
    "commands": "commands",
}
LIST_S = 0.25  # how long a list of stations is given again before it is made anew
FULL = 1.0


class Budgets:
    """Of all stations of an instance."""

    def __init__(self, rates: RateSettings, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._put = RateLimit(rates.samples, rates.volume, clock=clock)
        self._commands = RateLimit(rates.commands, clock=clock)
        self._work = WorkBudget(rates.work, clock=clock)
        self._rates: dict[Use, Rate] = {
            "work": rates.work,
            "messages": rates.samples,
            "bytes": rates.volume,
            "commands": rates.commands,
        }
        self._refused: dict[str, dict[Use, int]] = {}  # the station that was refused last stands last
        self._list: tuple[StationBudgets, ...] = ()
        self._list_until = float("-inf")  # [s]
        self._lock = threading.Lock()

    def refuse_put(self, station: str, size: int) -> ProtocolError | None:
        """Count a message of so many bytes against the budgets; why it is dropped, where it is."""
        lacking = self._put.lacking(station, 1.0, size)
        if lacking is not None:
            return self._refusal(station, ("messages", "bytes")[lacking])
        return self.refuse_work(station)

    def refuse_command(self, station: str) -> ProtocolError | None:
        """Count a command; why it is refused, where it is."""
        if not self._commands.allows(station):
            return self._refusal(station, "commands")
        return self.refuse_work(station)

    def refuse_work(self, station: str) -> ProtocolError | None:
        """Count a message that is dropped or refused because it would cause work; why, where it is."""
        if (refusal := self.exhausted(station)) is not None:
            self._count(station, "work")
        return refusal

    def exhausted(self, station: str) -> ProtocolError | None:
        """Why a message that causes work is refused now, where it is. Counts nothing."""
        return self._words(station, "work") if self._work.is_spent(station) else None

    def spend(self, station: str, seconds: float) -> None:
        """So much of the worker's time was used for a station."""
        self._work.spend(station, seconds)

    def of(self, station: str) -> StationBudgets:
        """Of one station, as of now."""
        refused, used = self._refused.get(station, {}), self._used(station)
        return StationBudgets(
            station=station,
            **{
                use: Budget(per_s=per_s, at_once=at_once, used=used[use], refused=refused.get(use, 0))
                for use, (per_s, at_once) in self._rates.items()
            },
        )

    def busiest(self) -> tuple[StationBudgets, ...]:
        """Of the stations that come nearest to a limit or were refused something, at most MAX_BUDGETS."""
        now = self._clock()
        if now >= self._list_until:
            known = {*self._put.senders(), *self._commands.senders(), *self._work.stations()}
            with self._lock:
                known |= self._refused.keys()
            ranked = nlargest(MAX_BUDGETS, ((self._share(name), name) for name in known if is_name(name)))
            self._list = tuple(self.of(name) for share, name in ranked if share > 0.0)
            self._list_until = now + LIST_S
        return self._list

    def _used(self, station: str) -> dict[Use, float]:
        messages, size = self._put.used(station)
        (commands,) = self._commands.used(station)
        return {"work": self._work.used(station), "messages": messages, "bytes": size, "commands": commands}

    def _share(self, station: str) -> float:
        """Of the budget of which most is used; a station that was refused something comes first."""
        shares = (used / self._rates[use].burst for use, used in self._used(station).items())
        return max(shares) + (FULL if station in self._refused else 0.0)

    def _refusal(self, station: str, use: Use) -> ProtocolError:
        self._count(station, use)
        return self._words(station, use)

    def _count(self, station: str, use: Use) -> None:
        with self._lock:
            counts = self._refused.pop(station, {})
            self._refused[station] = {**counts, use: counts.get(use, 0) + 1}
            if len(self._refused) > SENDERS:
                del self._refused[next(iter(self._refused))]

    def _words(self, station: str, use: Use) -> ProtocolError:
        """What was used, the limit, and when more may be."""
        (per_s, at_once), used = self._rates[use], self._used(station)[use]
        if used == 0.0:  # a name that finds no room among those with a budget of their own
            why = f"{SENDERS} other stations send: station {station} has to wait; try again"
            return ProtocolError("overloaded", why, value=station, limit=SENDERS)
        why = (
            f"station {station} has used up its budget of {use}: {used:.4g} of {at_once:g} "
            f"{UNITS[use]}, of which {per_s:g} come back every second; try again"
        )
        return ProtocolError("overloaded", why, value=float(f"{used:.4g}"), limit=at_once)
