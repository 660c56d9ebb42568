"""Checks of the service: instances, permissions, clocks, versions, journal and queue."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator

from caesura_clients.damaged_session_words import damage_words, damaged_in, unlisted_words
from caesura_clients.doctor.findings import CheckResult, graded
from caesura_clients.doctor.probes import ProbeResult, TimedServiceStatus
from caesura_clients.station_budget_texts import budgets_in_words, held_back
from caesura_protocol.keys import ROOT
from caesura_protocol.messages import ServiceStatus, SessionStatus
from caesura_protocol.number_words import counted
from caesura_protocol.package_version_and_extras import installed_version
from caesura_protocol.transport.transport_interface import IncompleteAnswerError

CLOCK_LIMIT_S = 0.05
QUEUE_SHARE = 0.5  # of its capacity; a queue that is half full is behind
JOURNAL_SHARE = 0.9  # of the size past which closed sessions go
MB = 10**6
DISK_FREE = 10**9  # [bytes] an hour of a robot at 1 kHz with all columns in double precision
SILENT = "it is frozen, hangs, or has too much to do: see its log, and restart it within ten minutes"
SAME_RELEASE = "install the same release on both"


def check_services(probed: ProbeResult) -> Iterator[CheckResult]:
    """Report live instances, and whether their release equals this client's."""
    for key in probed.other_versions:
        found = f"{key} has protocol {'/'.join(key.split('/')[:2])}, this client has {ROOT}"
        yield CheckResult("bad", "service", found, SAME_RELEASE)
    if not probed.alive:
        remedy = (
            "start `caesura serve`, with --connect where the router is another process; where it runs, it is "
            "frozen or has no link to this router: see its log, and `/readyz`"
        )
        yield CheckResult("bad", "service", "none is alive behind this router", remedy)
    own, versions = installed_version(), {one.status.instance: one.status.version for one in probed.reported}
    for instance in probed.alive:
        version = versions.get(instance)
        found, other = f"{instance} is alive", version not in {None, own}
        # Others answered, or it did not in time: so it is not forbidden.
        silent = version is None and (probed.reported or _was_late(probed))
        if other:
            found = f"{instance} is version {version}, this is {own}"
        elif version or silent:
            found += " and does not answer" if silent else f": version {version} as here, {ROOT}"
        remedy = f"both speak {ROOT}; {SAME_RELEASE}"
        yield graded("service", found, (silent, "bad", SILENT), (other, "warn", remedy))


def check_credentials(probed: ProbeResult) -> Iterator[CheckResult]:
    """Check the permission to query: a forbidden query returns nothing."""
    if not probed.alive:
        return
    known = sum(one.status.sessions_open + one.status.sessions_closed for one in probed.reported)
    hidden = known and not probed.snapshots and not probed.others
    found, remedy = "status and snapshots may be asked for", "use the certificate or password of a dashboard"
    if not probed.reported and _was_late(probed):
        return  # of what may be asked a service that hangs says nothing
    if not probed.reported:
        found = "the service's status is not for these credentials"
        remedy += " (`caesura certs DIR --dashboard NAME`)"
    elif hidden:
        found = f"{counted(known, 'known session')} and none was shown"
    yield graded("credentials", found, (not probed.reported or hidden, "warn", remedy))
    said = (str(one) for one in probed.refusals if not isinstance(one, IncompleteAnswerError))
    for refusal, times in Counter(said).items():
        found = f"{counted(times, 'question')} refused: {refusal}"
        yield CheckResult("warn", "credentials", found, "see the service's log")


def _was_late(probed: ProbeResult) -> bool:
    """Return whether a query was received and not answered in time."""
    return any(isinstance(one, IncompleteAnswerError) for one in probed.refusals)


def check_owners(probed: ProbeResult) -> Iterator[CheckResult]:
    """Report which instance owns each station; warn if two instances answer for one open session."""
    owners: dict[tuple[str, str], dict[str, SessionStatus]] = defaultdict(dict)
    for one in probed.snapshots:
        if one.status.state == "open":
            owners[one.status.station, one.status.session][one.status.instance] = one.status
    held: dict[str, set[str]] = {instance: set() for instance in probed.alive}
    for (station, session), found in owners.items():
        newest = max(found.values(), key=lambda status: status.epoch)
        held.setdefault(newest.instance, set()).add(station)
        if len(found) > 1:
            both = f"{' and '.join(sorted(found))} both have {session}"
            remedy = "readers take the higher epoch; if it stays so, the network between them is cut"
            yield CheckResult("warn", "owner", both, remedy, station)
    if len(probed.alive) > 1:
        shares = (f"{name}: {', '.join(sorted(mine)) or 'none'}" for name, mine in sorted(held.items()))
        yield graded("owner", f"stations with an open session: {'; '.join(shares)}")


def check_instance(reported: TimedServiceStatus) -> Iterator[CheckResult]:
    """Check clock, journal, queue and budgets of one instance."""
    status = reported.status
    yield _check_clock(reported)
    yield _check_journal(status)
    yield from _check_damage(status)
    found = f"{status.instance}: {status.queue} of {status.queue_capacity} wait, {status.dropped} dropped"
    remedy = "it is behind: more instances (`--instances N`), or fewer stations on this one"
    behind = status.overloaded or status.queue > QUEUE_SHARE * status.queue_capacity
    dropped = f"{remedy}; dropped batches were requested again"
    yield graded("queue", found, (behind, "bad", remedy), (status.dropped, "warn", dropped))
    yield from _check_budgets(status)


def _check_clock(reported: TimedServiceStatus) -> CheckResult:
    """Return the check of an instance's clock.

    Its status was made between query and reply; half of that interval is the uncertainty.
    """
    status = reported.status
    if status.time is None:
        found = f"{status.instance} does not state its time"
        return CheckResult("warn", "clock", found, SAME_RELEASE)
    half_s = (reported.answered - reported.asked) / 2
    ahead_s = status.time - (reported.asked + reported.answered) / 2
    way = "ahead of" if ahead_s > 0 else "behind"
    found = f"{status.instance} is {_duration(abs(ahead_s))} {way} this machine (± {_duration(half_s)})"
    remedy = (
        "set both by NTP; segments are right, because they use the robot's own clock; times in logs and in "
        "the journal are not"
    )
    return graded("clock", found, (abs(ahead_s) - half_s > CLOCK_LIMIT_S, "warn", remedy))


def _duration(seconds: float) -> str:
    return f"{seconds:.1f} s" if seconds >= 1 else f"{1000 * seconds:.1f} ms"


def _check_journal(status: ServiceStatus) -> CheckResult:
    journal, name = status.journal, status.instance
    if journal is None:
        return CheckResult("warn", "journal", f"{name} does not report it", SAME_RELEASE)
    if journal.trouble is not None:
        remedy = (
            "make room or repair the disk: samples are refused until then, and requested again afterwards"
        )
        return CheckResult("bad", "journal", f"{name}: {journal.trouble}", remedy)
    if journal.kind == "memory":
        remedy = "start it with --journal DIR, or a restart loses earlier sessions"
        return CheckResult("warn", "journal", f"{name} keeps sessions in memory", remedy)
    found = f"{name}: {journal.size / MB:.1f} of {journal.size_limit / MB:.0f} MB"
    full = journal.size > JOURNAL_SHARE * journal.size_limit
    remedy = "closed sessions go, oldest first: export them, or raise --journal-gb"
    every = "" if full else f", written every {journal.commit_s:g} s"
    crowded = journal.disk_free is not None and journal.disk_free < DISK_FREE
    if crowded and journal.disk_free is not None:
        found += f"; its disk has {journal.disk_free / MB:.0f} MB left"
    room = (
        "make room before it is full (`caesura sessions delete NAME` on its machine, another disk), or lower "
        "--journal-gb: once it is full, samples are refused, and lost after ten minutes at 1 kHz"
    )
    return graded("journal", f"{found}{every}", (crowded, "warn", room), (full, "warn", remedy))


def _check_damage(status: ServiceStatus) -> Iterator[CheckResult]:
    """Yield a warning for each session of the journal whose results cannot be read."""
    for _, one in damaged_in([status]):
        damage = f"{status.instance}: {one.station}/{one.session}: {damage_words(one)}"
        remedy = "check the disk of the journal; after an upgrade, the release before may read it"
        yield CheckResult("warn", "journal", damage, remedy)
    if unlisted := unlisted_words([status]):
        yield CheckResult(
            "warn", "journal", f"{status.instance}: {unlisted}", "check the disk of the journal"
        )


def _check_budgets(status: ServiceStatus) -> Iterator[CheckResult]:
    """Yield a warning for each station that was held back, and for queries without a station.

    If no station was held back, yield the use of the budgets by the busiest one.
    """
    held = [one for one in status.budgets if held_back(one)]
    for one in held:
        found = f"{status.instance}: {' · '.join(budgets_in_words(one))}"
        remedy = "this station alone is held back: look for a bridge or a script that sends in a loop"
        yield CheckResult("warn", "budget", found, remedy, one.station)
    if status.queries is not None and status.queries.refused:
        found = f"{status.instance}: queries that name no station were held back: {status.queries.refused}"
        remedy = "readers of all stations wait: look for a script that asks in a loop"
        yield CheckResult("warn", "budget", found, remedy)
    if status.budgets and not held:
        busiest = status.budgets[0]
        used = " · ".join(budgets_in_words(busiest, least=0.0))
        found = f"{status.instance}: no station was held back; the busiest is {busiest.station}: {used}"
        yield graded("budget", found)
