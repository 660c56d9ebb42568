"""Checks of a station: its bridge, its samples, its losses, and its wrench source."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from caesura_clients.doctor.findings import Case, CheckResult, first_of, graded
from caesura_clients.doctor.probes import ProbeResult, ReceivedStatus
from caesura_clients.doctor.signal_checks import (
    CheckedSamples,
    check_bias,
    check_samples,
    check_units,
)
from caesura_clients.station_name_conflicts import REMEDY, in_words
from caesura_protocol.codec import signals_of, unpack_samples
from caesura_protocol.command_line_advice import at_command_line
from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import ESTIMATE, WRENCH_SOURCES, BridgeStatus, SampleBatch, SessionStatus
from caesura_protocol.number_words import counted

FEWEST_SAMPLES = 100  # that say something of a rate
UNWRITABLE = "cannot write its journal"
ROOM = "make room soon: the bridge keeps ten minutes at 1 kHz, and is asked for them again"
REFUSED = {  # whether for want of room: what to do
    True: "the service had no room for them and asked for them again: see journal and queue",
    False: "the bridge sends what the service cannot take: see docs/operations.md",
}
STILL_S = 1.0  # how long no sample may come while a session is open
NO_SAMPLES = (
    "the bridge hangs, or its source sends nothing: check the robot's controller and the bridge's "
    "terminal; restart the bridge with --session and a higher --epoch"
)


@dataclass(frozen=True)
class StationProbe:
    """The facts about one station. statuses: of its current session, in order; may be empty."""

    name: str
    connected: bool
    statuses: Sequence[ReceivedStatus]
    batches: Mapping[str, Sequence[SampleBatch]]  # by session
    listened_s: float
    open_sessions: frozenset[str] = frozenset()
    parallel: Sequence[str] = ()  # those that several bridges teach at once
    standby: BridgeStatus | None = None  # of its bridge, where that is in standby
    unwritable: str | None = None  # the instance that serves it and cannot write its journal

    @property
    def status(self) -> SessionStatus | None:
        """The newest status of the station's current session; None without one."""
        return self.statuses[-1].status if self.statuses else None

    @property
    def own(self) -> Sequence[SampleBatch]:
        """The batches of the station's current session; empty without one."""
        return self.batches.get(self.status.session, ()) if self.status else ()

    @property
    def strangers(self) -> Mapping[str, int]:
        """The number of batches of each session that is neither the current one nor open, by session."""
        known = {*self.open_sessions, self.status.session if self.status else ""}
        return {name: len(some) for name, some in sorted(self.batches.items()) if name not in known}


def stations_of(probed: ProbeResult) -> list[StationProbe]:
    """Every station that has a bridge or a session, by name."""
    names = {*probed.bridges, *(station for station, _ in (*probed.statuses, *probed.batches))}
    return [_station(probed, name) for name in sorted(names)]


def check_station(station: StationProbe) -> Iterator[CheckResult]:
    """Yield every check of one station, with its name."""
    return (replace(result, station=station.name) for result in _checks_of(station))


def _checks_of(station: StationProbe) -> Iterator[CheckResult]:
    status = station.status
    yield _check_bridge(station, status)
    if status is None:
        return
    if status.state == "open":
        yield from _check_flow(station, status)
    for check in (_check_rival_bridges, _check_losses, _check_refusals, _check_wrench):
        yield from check(station, status)
    for session, count in station.strangers.items() if status.state == "open" else ():
        remedy = "a bridge of a session that is over, or refused: see its terminal and the service's log"
        yield CheckResult(
            "warn", "bridge", f"{counted(count, 'batch')} of {session}, which is not open", remedy
        )


def _station(probed: ProbeResult, name: str) -> StationProbe:
    own = [statuses for (station, _), statuses in probed.statuses.items() if station == name and statuses]
    current = max(own, key=lambda statuses: _rank(statuses[-1].status), default=[])
    batches = {session: some for (station, session), some in probed.batches.items() if station == name}
    opened = frozenset(one[-1].status.session for one in own if one[-1].status.state == "open")
    # An open session has its instance; of a station without one it may be any.
    owner = {current[-1].status.instance} if opened else {one.status.instance for one in probed.reported}
    full = {
        one.status.instance for one in probed.reported if one.status.journal and one.status.journal.trouble
    }
    return StationProbe(
        name,
        connected=name in probed.bridges,
        statuses=current,
        batches=batches,
        listened_s=probed.listened_s,
        open_sessions=opened,
        parallel=[session for session in probed.parallel.at(name) if session in opened],
        standby=probed.standby.get(name),
        unwritable=min(owner, default=None) if owner <= full else None,
    )


def _rank(status: SessionStatus) -> tuple[bool, str]:
    """Return the sort key of a status: open before closed, then by name, which begins with the time."""
    return status.state == "open", status.session


def _check_bridge(station: StationProbe, status: SessionStatus | None) -> CheckResult:
    """Check that one bridge is connected, and that it is the one of an open session."""
    if status is None or status.state == "closed":
        last = f"no session is open, the last was {status.session}" if status else "no session yet"
        full = f"samples come, and {station.unwritable} {UNWRITABLE}, so no session opens"
        refused = (
            "the service refused it or has not answered: see the bridge's terminal and the service's log"
        )
        passing = "one has just ended, or is beginning; if it stays so, see the bridge's terminal"
        return first_of(
            "bridge",
            (station.strangers and station.unwritable, "bad", full, ROOM),
            (station.strangers, "bad", f"samples come, and {last}", refused),
            *_standby_cases(station.standby, last),
            (station.connected, "warn", f"connected, and {last}", passing),
            (True, "ok", f"not connected, and {last}", ""),
        )
    again = (
        "check its machine first: while its process lives, it sends what is missing by itself, up to ten "
        f"minutes at 1 kHz; if it has ended, start it again with --station {station.name} "
        f"--session {status.session} --epoch N, N above the last one (0 at first); if it has ended for good: "
        f"`caesura stop {station.name} --without-bridge`"
    )
    return first_of(
        "bridge",
        (len(station.parallel) > 1, "bad", in_words(station.name, station.parallel), REMEDY),
        (station.connected, "ok", f"connected, session {status.session} on {status.instance}", ""),
        (True, "bad", f"session {status.session} is open and no bridge is connected", again),
    )


def _standby_cases(standby: BridgeStatus | None, last: str) -> tuple[Case, ...]:
    """Return the cases to check of a bridge in standby while no session is open; none without one.

    last: text on the last session of the bridge.
    """
    if standby is None:
        return ()
    failed = f"in standby, and cannot teach: {standby.problem or standby.state}"
    if standby.outcome:
        last = f"{standby.last_session} {standby.outcome}"
    return (
        (standby.state == "failed", "bad", failed, "look at the robot, and at the bridge's terminal"),
        (standby.problem, "warn", f"in standby: {standby.problem}", "see the bridge's terminal"),
        (standby.state == "ready", "ok", f"in standby, waits for a start; {last}", ""),
    )


def _check_flow(station: StationProbe, status: SessionStatus) -> Iterator[CheckResult]:
    """Check that samples arrive: their rate and their regularity."""
    first, last = station.statuses[0], station.statuses[-1]
    took_s = max(station.listened_s, last.at) - first.at  # it was looked at once more in the end
    batches, sent = last.status.batches - first.status.batches, len(station.own)
    if not (batches or sent or station.connected):
        return
    count, passed_s = last.status.samples - first.status.samples, last.status.t - first.status.t
    over_s = max(took_s, STILL_S)
    found = f"{batches / over_s:.1f} batches/s, {count / over_s:.0f} samples/s"
    if passed_s > 0:
        found += f", {passed_s / over_s:.2f} s of the demonstration a second"
    unprocessed = f"{counted(sent, 'batch')} sent and none processed in {took_s:.1f} s"
    why = "a batch before them is missing, the queue is long or they are refused: see below and the log"
    begun = f"listened to for {took_s:.1f} s only"
    result = first_of(
        "samples",
        (took_s < STILL_S, "warn", begun, "the session has just begun: look again"),
        (not batches and not sent, "bad", f"none in {took_s:.1f} s", NO_SAMPLES),
        (not batches, "bad", unprocessed, why),
        (True, "ok", found, ""),
    )
    yield result
    if result.grade != "ok":
        return
    samples = _samples(station, status)
    if samples is None:
        yield _counted_rate(station)
        return
    if status.refused:  # what the service takes is plausible, or its unit was declared
        yield from check_units(samples)
    yield from check_samples(samples)


def _counted_rate(station: StationProbe) -> CheckResult:
    """Return the check of the sample rate by the service's counts.

    It is used when the credentials do not allow reading the samples.
    """
    steps = [
        (after.status.samples - before.status.samples) / (after.status.t - before.status.t)
        for before, after in zip(station.statuses, station.statuses[1:], strict=False)
        if after.status.t - before.status.t >= STILL_S / 2
    ]
    found = f"about {np.median(steps or [0.0]):.0f} Hz, as the service counts"
    few, longer = "too few statuses in this time for a rate", "listen for longer with --seconds"
    return first_of("rate", (not steps, "warn", few, longer), (True, "ok", found, ""))


def _samples(station: StationProbe, status: SessionStatus) -> CheckedSamples | None:
    """Return the received batches, in order and without repeats; None if they are too few to judge."""
    own = {one.seq: one for one in station.own}
    columns = {one.columns for one in own.values()}
    if len(columns) != 1:
        return None
    try:
        matrix = np.concatenate([unpack_samples(own[seq]) for seq in _longest_run(sorted(own))])
    except ProtocolError:
        return None  # the service refuses them, and says so
    if len(matrix) < FEWEST_SAMPLES:
        return None
    signals = signals_of(columns.pop(), matrix)
    return CheckedSamples(matrix[:, 0], signals, status.length_unit)


def _longest_run(numbers: Sequence[int]) -> Sequence[int]:
    """Return the longest run of consecutive numbers; across a gap there is no interval to judge."""
    runs = np.split(np.array(numbers), np.flatnonzero(np.diff(numbers) != 1) + 1)
    return [int(number) for number in max(runs, key=len)]


GAP_CAUSES = {
    "evicted": "evicted: the samples were refused, were lost with their bridge, or the service was away for "
    "longer than the bridge's ring",
    "source": "source: the robot's samples paused",
}


def _check_losses(station: StationProbe, status: SessionStatus) -> Iterator[CheckResult]:
    missing = _missing(status)
    if status.gaps:
        lost_s = sum(gap.tn - gap.t0 for gap in status.gaps)
        reasons = sorted({gap.reason for gap in status.gaps})
        remedy = f"{'; '.join(GAP_CAUSES[reason] for reason in reasons)}. Teach that part again"
        unknown = sum(gap.t0 == gap.tn for gap in status.gaps)
        known = len(status.gaps) - unknown
        parts = [f"{known} of {lost_s:.2f} s in all"] * (known > 0)
        parts += [f"{unknown} at the beginning or end, of unknown length"] * (unknown > 0)
        found = f"{', '.join(parts)} ({', '.join(reasons)})"
        yield CheckResult("warn", "gaps", found, remedy)
    elif missing is None:
        yield graded("gaps", "none")
    if missing is not None and station.unwritable is None:
        remedy = "it is requested repeatedly; if it stays missing, check whether the bridge answers"
        yield CheckResult("warn", "gaps", missing, remedy)
    if status.duplicates:
        found = f"{status.duplicates} of {status.batches + status.duplicates} batches were duplicates"
        yield graded("duplicates", f"{found} and were ignored")


def _missing(status: SessionStatus) -> str | None:
    waiting = status.waiting_for is not None and status.state == "open"
    return f"batch {status.waiting_for} is missing" if waiting else None


def _check_refusals(station: StationProbe, status: SessionStatus) -> Iterator[CheckResult]:
    """Check for refused batches: without room in the service, or invalid."""
    last, missing = status.last_refusal, _missing(status)
    for no_room, remedy in REFUSED.items():
        parts = [f"{n} {code}" for code, n in status.refused.items() if (code == "overloaded") is no_room]
        if no_room and station.unwritable and status.state == "open":
            parts += [missing] if missing else []
            found, remedy = f"{', '.join(parts)}: {station.unwritable} {UNWRITABLE}", ROOM
        else:
            is_last = last is not None and (last.code == "overloaded") is no_room
            found = ", ".join(parts) + (f"; the last: {last.message}" if last and is_last else "")
        if parts:
            yield CheckResult("warn", "refused", found, remedy)


def shows_contact(source: str, hand_on_robot: str) -> bool:
    """Return whether a stated wrench source shows contact and load."""
    return source == "flange_sensor" or (source, hand_on_robot) == (ESTIMATE, "no")


def wrench_remedy(source: str, hand_on_robot: str) -> str:
    """Return the remedy for a wrench source without contact and load."""
    if shows_contact(source, hand_on_robot):
        return "choose a preset with models of contact and load, such as default; else there are only moves"
    if source == ESTIMATE:
        return "where no hand is on the robot, state --hand-on-robot no; else there are only moves"
    return "with a sensor below the hand, state --wrench-source flange_sensor; else there are only moves"


def _check_wrench(station: StationProbe, status: SessionStatus) -> Iterator[CheckResult]:
    wrench = status.wrench
    can = [
        name
        for name, there in (("contact", wrench.contact_models), ("load", wrench.transport_models))
        if there
    ]
    note = at_command_line(wrench.note)
    found = f"{wrench.source}: {' and '.join(can) or 'neither contact nor load'} can be found. {note}"
    remedy = wrench_remedy(wrench.source, wrench.hand_on_robot)
    if not wrench.stated:
        remedy = f"state where it is measured: {', '.join(WRENCH_SOURCES)}"
    untared = wrench.tare is None and status.observations
    rest = "start in free space and at rest for 0.4 s"
    yield graded("wrench", found, (not can, "warn", remedy), (untared, "warn", rest))
    yield from check_bias(None if wrench.tare is None else np.array(wrench.tare))


def _check_rival_bridges(station: StationProbe, status: SessionStatus) -> Iterator[CheckResult]:
    """Check that only one bridge sends the session."""
    senders = Counter(one.bridge for one in station.own if one.bridge is not None)
    if len(senders) > 1:
        each = ", ".join(f"{name} ({counted(count, 'batch')})" for name, count in sorted(senders.items()))
        remedy = (
            "the service takes those of the one that opened it: stop the other, or give it another --session"
        )
        found = f"{len(senders)} bridges publish {status.session}: {each}"
        yield CheckResult("bad", "bridge", found, remedy)
