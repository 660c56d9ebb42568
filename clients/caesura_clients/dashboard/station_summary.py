"""The summary of a station: its state, and whether the displayed results are still current.

A station is stale if its demonstration is open and the display may be out of date: no message for STALE_S, a
service that cannot store it, or a bridge that is gone. The summary states the reason, so that the operator
stops teaching.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from caesura_clients.session_state_reader import Update
from caesura_clients.station_name_conflicts import REMEDY, in_words
from caesura_protocol.messages import BridgeStatus, Program, ServiceStatus
from caesura_protocol.number_words import counted
from caesura_protocol.session_time_display import SessionClock, clock_from, clock_of

STALE_S = 2.0
IN_MINUTES_S = 120.0  # a length from which on seconds alone are hard to grasp
BEGINS_S = 60.0  # a session of its own clock has its first segment by then; `begin` of session_view.js
State = Literal["teaching", "stale", "done", "ready", "standby", "failed", "gone"]
SAID: Mapping[State, str] = {
    "teaching": "teaching",
    "stale": "stale",
    "done": "ended",
    "ready": "connected, nothing taught yet",
    "standby": "ready to start",
    "failed": "robot not ready",
    "gone": "not connected",
}


@dataclass(frozen=True)
class DashboardState:
    """The state that the network follower has received, at one moment. Times: its monotonic clock [s]."""

    updates: Mapping[tuple[str, str], Update] = field(default_factory=dict)  # by station and session
    stored: Mapping[tuple[str, str], Update] = field(default_factory=dict)  # read from the journal
    closed: int = 0  # how often a session that is over came, changed or went
    current: Mapping[str, str] = field(default_factory=dict)  # the session of each station's program
    bridges: frozenset[str] = frozenset()  # stations whose bridge is connected
    standby: Mapping[str, BridgeStatus] = field(default_factory=dict)  # newest status of a bridge, by station
    first_seen: Mapping[tuple[str, str], float] = field(default_factory=dict)  # [s] each session of `updates`
    parallel: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # taught at once, by station
    alive: frozenset[str] = frozenset()  # instances that are alive
    services: tuple[ServiceStatus, ...] = ()
    rates: Mapping[str, float] = field(default_factory=dict)  # [messages/s] by instance
    troubles: Mapping[str, str] = field(default_factory=dict)  # why the network cannot be asked, by who asks

    @property
    def trouble(self) -> str:
        """The reason why the content may be out of date; empty if there is none."""
        return next(iter(self.troubles.values()), "")

    @property
    def answers(self) -> bool:
        """Whether an instance of the service is alive and can be reached."""
        return bool(self.alive) and not self.trouble

    def stations(self) -> list[str]:
        """Return all stations with a bridge or a session, sorted."""
        return sorted({station for station, _ in self.updates} | self.bridges)

    def bridge_status(self, station: str) -> BridgeStatus | None:
        """Return the status of a connected bridge in standby; None without one.

        A status may arrive after the bridge's token has gone: it does not count until the token is back.
        """
        return self.standby.get(station) if station in self.bridges else None

    def is_left_open(self, update: Update) -> bool:
        """Return whether a session is open and its bridge is gone, or has begun a later session.

        False while the network cannot be asked: then neither is known.
        """
        if update.closed or self.trouble or not self.alive:
            return False
        if update.station not in self.bridges:
            return True
        opened = update.status.opened or 0.0
        is_last = all(
            (one.status.opened or 0.0) <= opened
            for (station, _), one in self.updates.items()
            if station == update.station
        )
        return not is_last and update.session not in self.parallel.get(update.station, ())

    def sessions(self, station: str) -> list[str]:
        """Return the station's sessions, the newest first."""
        return sorted((name for where, name in self.updates if where == station), reverse=True)

    def other_programs(self, program: Program | None) -> list[Program]:
        """Return the programs of all other sessions that are known."""
        known = [update.program for update in {**self.stored, **self.updates}.values()]
        mine = None if program is None else (program.station, program.session)
        return [one for one in known if (one.station, one.session) != mine]

    def update(self, station: str, session: str | None = None) -> Update | None:
        """Return the newest state of a session; None if it is unknown.

        Without a name: the current session, or else an open one, or else the newest.
        """
        name = session or self.current.get(station)
        if (station, name or "") in self.updates:
            return self.updates[station, name or ""]
        if session is not None:
            return self.stored.get((station, session))
        known = [update for (where, _), update in self.updates.items() if where == station]
        return max(known, key=lambda one: (not one.closed, one.session), default=None)


@dataclass(frozen=True)
class NewestSamples:
    """The newest samples of a station: their time of arrival, and the session time that they reach."""

    at: float  # [s] monotonic
    t: float  # [s] session time
    session: str
    first: float = 0.0  # [s] session time of the first one received; a robot's clock may begin anywhere


@dataclass(frozen=True)
class StationSummary:
    """The content of a station's card."""

    station: str
    state: State
    said: str  # the state in words
    why: str  # it is stale, or in trouble otherwise; empty where all is well
    session: str
    task: str  # its name; empty without one
    t: float  # [s] of the session
    age_s: float | None  # of the newest sample; None: none came
    kind: str  # of the current segment; empty where none is, as after the end
    probability: float | None
    segments: int
    apps: int
    gaps: int
    overloaded: bool
    kinds: tuple[tuple[float, float, str, float], ...]  # the newest segments: t0, tn, kind, probability

    def drawn(self) -> dict[str, Any]:
        """Return the payload for the browser; an age is in tenths of a second, and empty below 1 s."""
        age = "" if self.age_s is None or self.age_s < 1.0 else f"{self.age_s:.1f} s"
        rows = [[round(t0, 2), round(tn, 2), kind, round(p, 2)] for t0, tn, kind, p in self.kinds]
        return {**self.__dict__, "age_s": age, "kinds": rows, "t": round(self.t, 1)}


SHOWN_SEGMENTS = 40  # in a card's strip


def glances(
    world: DashboardState, received: Mapping[str, NewestSamples], now: float, began: float
) -> list[StationSummary]:
    """Return the summary of each station. now, began: current time and start of the follower, monotonic [s].

    No silence counts from before `began`, when nothing could be received.
    """
    return [glance(world, station, received.get(station), now, began) for station in world.stations()]


def glance(
    world: DashboardState, station: str, received: NewestSamples | None, now: float, began: float
) -> StationSummary:
    """Return the summary of one station. now, began: current time and the follower's start, monotonic [s].

    Silence counts from the newest sample, or from the beginning of a session that has none yet.
    """
    update = world.update(station)
    bridge = station in world.bridges
    seen_s = began if update is None else max(began, world.first_seen.get((station, update.session), began))
    silent_s = now - (seen_s if received is None else max(seen_s, received.at))
    why = stale(world, update, bridge, received, silent_s)
    status = world.bridge_status(station)
    state = _state(update, bridge, why, status)
    if state in {"failed", "teaching"} and status is not None and not why:
        why = status.problem or ""
    if state == "teaching" and (both := world.parallel.get(station)):
        why = f"{in_words(station, both)}: {REMEDY}"
    last = update.segments[-1] if update and update.segments and not update.closed else None
    newest = update.segments[-SHOWN_SEGMENTS:] if update else ()
    return StationSummary(
        station=station,
        state=state,
        said=SAID[state],
        why=why,
        session=update.session if update else "",
        task=(update.status.description.task or "") if update else "",
        t=lasted(update) if update else 0.0,
        age_s=None if received is None or (update and update.closed) else max(0.0, silent_s),
        kind=last.kind if last else "",
        probability=last.probability if last else None,
        segments=len(update.segments) if update else 0,
        apps=len(update.program.apps) if update else 0,
        gaps=gaps(update),
        overloaded=bool(update and update.status.overloaded),
        kinds=tuple((one.t0, one.tn, one.kind, one.probability) for one in newest),
    )


def stale(
    world: DashboardState,
    update: Update | None,
    bridge: bool,
    received: NewestSamples | None,
    silent_s: float,
) -> str:
    """Return why the shown state may no longer be true; empty if it is current.

    silent_s: time [s] without a sample.
    """
    if update is None or update.closed:
        return world.trouble
    unstored = unwritten(world, update.status.instance)
    behind_s = _behind_s(update, received)
    found = (
        (bool(world.trouble), world.trouble),
        (not world.alive, "no service answers"),
        (bool(unstored), f"the service cannot store it: {unstored}"),
        (not bridge, "its bridge is gone"),
        (silent_s > STALE_S, f"no sample for {silent_s:.0f} s"),
        (behind_s > STALE_S, f"results are {behind_s:.0f} s behind the samples"),
    )
    return next((why for true, why in found if true), "")


def _behind_s(update: Update, received: NewestSamples | None) -> float:
    """Return the delay [s] of results behind the samples; before the first one, behind the first sample."""
    if received is None or received.session != update.session:
        return 0.0
    return received.t - max(reached(update), received.first)


def unwritten(world: DashboardState, instance: str) -> str:
    """Return why an instance of the service cannot write its journal; empty if it can."""
    found = (one.journal.trouble for one in world.services if one.instance == instance and one.journal)
    return next((trouble for trouble in found if trouble), "")


def reached(update: Update) -> float:
    """Return the time [s] up to which there are results.

    A status is published once a second, so the other results are newer.
    """
    last = update.segments[-1].tn if update.segments else update.t
    return max(update.t, last)


def session_clock(update: Update) -> SessionClock:
    """Return the clock of a session, from its first segment, or else from the time reached."""
    return clock_of(update.segments) if update.segments else clock_from(update.t)


def lasted(update: Update) -> float:
    """Return the length [s] of the session so far.

    Most sessions begin at 0; one whose clock is the time of day begins with its first segment.
    """
    first = update.segments[0].t0 if update.segments else session_clock(update).start_s
    return reached(update) - (first if not 0.0 <= first <= BEGINS_S else 0.0)


def length_words(update: Update) -> str:
    """Return the session's length as text; a long one also in minutes."""
    seconds = lasted(update)
    minutes = f" ({seconds / 60:.0f} min)" if seconds >= IN_MINUTES_S else ""
    return f"{seconds:.1f} s{minutes}"


def gaps(update: Update | None) -> int:
    """Return the number of gaps of a session."""
    return 0 if update is None else len(update.status.gaps) + update.status.gaps_before


def summary(world: DashboardState, found: Sequence[StationSummary]) -> str:
    """Return the line above the cards."""
    state = f"{troubled(found) or 'none'} in trouble" if world.alive else "no service answers"
    return f"{counted(len(found), 'station')}, {state}"


def warning_of(seen: StationSummary, world: DashboardState) -> str:
    """Return the warning above the page of a station; empty if there is none."""
    if seen.state == "teaching":
        return seen.why
    if seen.state == "failed":  # nothing is old; beside Start the page states what the robot lacks
        return world.trouble
    return f"Stale: {seen.why.removesuffix('.')}. What is shown is old." if seen.why else world.trouble


def troubled(found: Iterable[StationSummary]) -> int:
    """Return the number of stations that need an operator."""
    return sum(one.state in {"stale", "failed"} or one.overloaded or _has_warning(one) for one in found)


def _has_warning(one: StationSummary) -> bool:
    return one.state == "teaching" and one.why != ""


def _state(update: Update | None, bridge: bool, why: str, status: BridgeStatus | None) -> State:
    if status is not None and (update is None or update.closed):
        return "failed" if status.state == "failed" else "standby"
    if update is None:
        return "ready" if bridge else "gone"
    if update.closed:
        return "done"
    return "stale" if why else "teaching"
