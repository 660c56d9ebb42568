"""Checks of the service: instances, permissions, clocks, versions, journal and queue."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator

from caesura_clients.budget_texts import budgets_in_words, held_back
from caesura_clients.doctor.findings import CheckResult, bad, ok, warn, warn_if
from caesura_clients.doctor.probes import ProbeResult, TimedServiceStatus
from caesura_protocol.keys import ROOT
from caesura_protocol.messages import ServiceStatus, SessionStatus

CLOCK_LIMIT_S = 0.05
QUEUE_SHARE = 0.5  # of its capacity; a queue that is half full is behind
JOURNAL_SHARE = 0.9  # of the size past which closed sessions go
MB = 10**6


def check_services(probed: ProbeResult, version: str) -> Iterator[CheckResult]:
    """Report live instances, and whether their release is this client's. version: of this client."""
    for key in probed.other_versions:
        major = "/".join(key.split("/")[:2])
        yield bad("service", f"{key} speaks {major}, we speak {ROOT}", "install the same release on both")
    if not probed.alive:
        remedy = "start `caesura serve`, with --connect where the router is another process"
        yield bad("service", "none is alive behind this router", remedy)
        return
    versions = {one.status.instance: one.status.version for one in probed.reported}
    for instance in probed.alive:
        if instance not in versions:
            yield _check_silent(probed, instance)
        elif versions[instance] != version:
            found = f"{instance} is version {versions[instance]}, this is {version}"
            yield warn("service", found, f"both speak {ROOT}; install the same release on both")
        else:
            yield ok("service", f"{instance} is alive: version {version} as here, {ROOT}")


def check_credentials(probed: ProbeResult) -> Iterator[CheckResult]:
    """Check the permission to query: a forbidden query returns nothing."""
    if not probed.alive:
        return
    known = sum(one.status.sessions_open + one.status.sessions_closed for one in probed.reported)
    if not probed.reported:
        remedy = "use the certificate or password of a dashboard (`caesura certs DIR --dashboard NAME`)"
        yield warn("credentials", "the service's status is not for these credentials", remedy)
    elif known and not probed.snapshots:
        remedy = "use the certificate or password of a dashboard; with --station, check its name"
        yield warn("credentials", f"{known} sessions are known and none was shown", remedy)
    else:
        yield ok("credentials", "status and snapshots may be asked for")
    for code, times in _refusal_counts(probed).items():
        yield warn("credentials", f"{times} questions refused: {code}", "see the service's log")


def check_instance(reported: TimedServiceStatus) -> Iterator[CheckResult]:
    """Clock, journal, queue and budgets of one instance."""
    yield _check_clock(reported)
    for check in (_check_journal, _check_queue):
        yield check(reported.status)
    yield from _check_budgets(reported.status)


def check_owners(probed: ProbeResult) -> Iterator[CheckResult]:
    """Which instance has which station; two that answer for one open session."""
    owners: dict[tuple[str, str], dict[str, SessionStatus]] = defaultdict(dict)
    for one in probed.snapshots:
        if one.status.state == "open":
            owners[one.status.station, one.status.session][one.status.instance] = one.status
    for (station, session), found in owners.items():
        if len(found) > 1:
            found_text = f"{' and '.join(sorted(found))} both have {session}"
            remedy = "readers take the higher epoch; if it stays so, the network between them is cut"
            yield warn("owner", found_text, remedy, station=station)
    if len(probed.alive) > 1:
        held: dict[str, set[str]] = {instance: set() for instance in probed.alive}
        for (station, _), found in owners.items():
            newest = max(found.values(), key=lambda status: status.epoch)
            held.setdefault(newest.instance, set()).add(station)
        shares = (f"{name}: {', '.join(sorted(mine)) or 'none'}" for name, mine in sorted(held.items()))
        yield ok("owner", f"stations with an open session: {'; '.join(shares)}")


def _check_silent(probed: ProbeResult, instance: str) -> CheckResult:
    """Alive, and its status did not come."""
    if probed.reported:  # others answered, so it is not forbidden
        return bad("service", f"{instance} is alive and does not answer", "see its log; restart it")
    return ok("service", f"{instance} is alive")


def _check_clock(reported: TimedServiceStatus) -> CheckResult:
    """A status is from between question and answer, which is how sure its time can be."""
    status = reported.status
    if status.time is None:
        return warn("clock", f"{status.instance} does not state its time", "install the same release on both")
    half_s = (reported.answered - reported.asked) / 2
    ahead_s = status.time - (reported.asked + reported.answered) / 2
    way = "ahead of" if ahead_s > 0 else "behind"
    found = f"{status.instance} is {_duration(abs(ahead_s))} {way} this machine (± {_duration(half_s)})"
    remedy = (
        "set both by NTP; segments are not touched, they run on the robot's own clock, but the times "
        "in logs and in the journal are"
    )
    return warn_if(abs(ahead_s) - half_s > CLOCK_LIMIT_S, "clock", found, remedy)


def _check_journal(status: ServiceStatus) -> CheckResult:
    journal, name = status.journal, status.instance
    if journal is None:
        return warn("journal", f"{name} does not report it", "install the same release on both")
    if journal.trouble is not None:
        remedy = "make room or repair the disk: samples are refused meanwhile, and asked for again after"
        return bad("journal", f"{name}: {journal.trouble}", remedy)
    if journal.kind == "memory":
        remedy = "start it with --journal DIR, or a restart loses earlier sessions"
        return warn("journal", f"{name} keeps sessions in memory", remedy)
    found = f"{name}: {journal.size / MB:.1f} of {journal.size_limit / MB:.0f} MB"
    if journal.size > JOURNAL_SHARE * journal.size_limit:
        return warn("journal", found, "closed sessions go, oldest first: export them, or raise --journal-gb")
    return ok("journal", f"{found}, written every {journal.commit_s:g} s")


def _check_queue(status: ServiceStatus) -> CheckResult:
    found = f"{status.instance}: {status.queue} of {status.queue_capacity} wait, {status.dropped} dropped"
    remedy = "it is behind: more instances (`--instances N`), or fewer stations on this one"
    if status.overloaded or status.queue > QUEUE_SHARE * status.queue_capacity:
        return bad("queue", found, remedy)
    if status.dropped:
        return warn("queue", found, f"{remedy}; what was dropped was asked for again")
    return ok("queue", found)


def _check_budgets(status: ServiceStatus) -> Iterator[CheckResult]:
    """Which stations were held back; without any, what the busiest one has used of what it may."""
    held = [one for one in status.budgets if held_back(one)]
    for one in held:
        found = f"{status.instance}: {' · '.join(budgets_in_words(one))}"
        remedy = "this station alone is held back: look for a bridge or a script that sends in a loop"
        yield warn("budget", found, remedy, station=one.station)
    if status.budgets and not held:
        busiest = status.budgets[0]
        used = " · ".join(budgets_in_words(busiest, least=0.0))
        found = f"{status.instance}: no station was held back; the busiest is {busiest.station}: {used}"
        yield ok("budget", found)


def _refusal_counts(probed: ProbeResult) -> dict[str, int]:
    counts: dict[str, int] = defaultdict(int)
    for error in probed.refusals:
        counts[str(error)] += 1
    return dict(counts)


def _duration(seconds: float) -> str:
    return f"{seconds:.1f} s" if seconds >= 1 else f"{1000 * seconds:.1f} ms"


CHECKS: tuple[Callable[[ProbeResult], Iterator[CheckResult]], ...] = (check_credentials, check_owners)
