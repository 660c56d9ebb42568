"""Runs all checks in order, so that earlier findings explain later ones."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from caesura_clients.doctor import service_checks, signal_checks, station_checks
from caesura_clients.doctor.endpoint_check import check_certificate, check_endpoint, no_session
from caesura_clients.doctor.findings import CheckResult, graded
from caesura_clients.doctor.probes import ProbeResult, probe_network
from caesura_protocol.errors import CaesuraError, Unreachable
from caesura_protocol.formats.sample_checks import check_clock, check_time_steps
from caesura_protocol.messages import WRENCH_SOURCES
from caesura_protocol.recording import ASSUMED_ORDER, Recording, RecordingError
from caesura_protocol.sample_limits import TARE_S
from caesura_protocol.transport.transport_interface import Transport
from caesura_protocol.transport.zenoh_transport import ZenohTransport, certificate_end_at, endpoint_of

CONNECT_S = 3.0
LISTEN_S = 3.0
COMPARED = "`caesura segment` compares it with the joints."
ASSUMED = (
    "assumed: the recording does not state its wrench source; contact and load are off. "
    "State it with --wrench-source"
)


def examine(
    endpoint: str | None, config_file: Path | None = None, *, station: str = "*", seconds: float = LISTEN_S
) -> Iterator[CheckResult]:
    """Yield all checks in order; stop if the endpoint is unreachable or refuses a session."""
    try:
        found = check_endpoint(endpoint or endpoint_of(None, config_file))
        yield found
        if found.grade == "bad":
            return
        transport = ZenohTransport(endpoint, config_file=config_file, timeout_s=CONNECT_S)
    except CaesuraError as error:
        yield no_session(error)
        return
    with transport:
        if (end := certificate_end_at(endpoint, config_file)) is not None:
            yield check_certificate(end, time.time())
        yield from examine_network(transport, station, seconds=seconds)


def examine_network(transport: Transport, station: str = "*", *, seconds: float) -> Iterator[CheckResult]:
    """Yield the checks of the services and stations behind a router. seconds: how long to observe them."""
    try:
        probed = probe_network(transport, station, seconds=seconds)
    except Unreachable as error:
        remedy = "the router went away while it was looked at: see its log"
        yield CheckResult("bad", "session", str(error), remedy)
    else:
        yield from judge(probed, station)


def judge(probed: ProbeResult, station: str = "*") -> Iterator[CheckResult]:
    """Yield every check on a probe's result. station: whose absence is a fault; `*`: none."""
    yield from service_checks.check_services(probed)
    yield from service_checks.check_credentials(probed)
    yield from service_checks.check_owners(probed)
    for reported in probed.reported:
        yield from service_checks.check_instance(reported)
    known = station_checks.stations_of(probed)
    for one in known:
        yield from station_checks.check_station(one)
    if station != "*" and not known:
        remedy = f"start its bridge: caesura bridge --station {station} …; or check the name"
        found = f"no bridge and no session; known stations: {', '.join(probed.others) or 'none'}"
        yield CheckResult("bad", "bridge", found, remedy, station)
    elif not known and probed.alive:
        yield graded("stations", "none yet: no bridge is connected and no session known")


def examine_recording(recording: Recording) -> Iterator[CheckResult]:
    """Yield the checks of a recording, with its samples in file order."""
    unordered = _refused(recording, check_time_steps)  # whose steps are no sign of a unit
    units = [] if unordered else list(signal_checks.check_units(recording))
    yield from units
    if units:
        return  # figures in a wrong unit mean nothing
    for doubt in recording.doubts:
        yield CheckResult("warn", "units", doubt, "compare the values with the units that are declared")
    for assumed in recording.assumed:
        compared = " " + COMPARED if assumed == ASSUMED_ORDER and "q" in recording.signals else ""
        yield graded("reading", assumed + compared)
    if (refused := unordered or _refused(recording, check_clock)) is not None:
        yield refused  # no sample is left out of a file that is refused, and its rate means nothing
    else:
        for caution in recording.cautions:
            yield CheckResult("warn", "reading", caution, "look at the values, and at what wrote them")
        yield from signal_checks.check_rate(recording)
    yield signal_checks.check_signals(recording)
    yield from _check_wrench(recording)
    yield from signal_checks.check_noise(recording)
    force = recording.signals.get("force")
    start = recording.t <= recording.t[0] + TARE_S
    yield from signal_checks.check_bias(None if force is None else np.asarray(force[start].mean(axis=0)))


def _refused(recording: Recording, check: Callable[[Recording], None]) -> CheckResult | None:
    """Return the failed check of a recording whose times `segment` and `bridge` refuse; None if accepted."""
    try:
        check(recording)
    except RecordingError as error:
        found, _, remedy = str(error).removeprefix(f"{recording.name}: ").partition("; ")
        return CheckResult("bad", "clock", found, f"{remedy}: the file is refused as it is")
    return None


def _check_wrench(recording: Recording) -> Iterator[CheckResult]:
    """Yield the check of the stated wrench source and hand, with their consequences."""
    if not recording.has_wrench:
        return
    source, hand = recording.wrench_source, recording.hand_on_robot
    if source is None:
        yield CheckResult("warn", "wrench", ASSUMED, f"expected one of {', '.join(WRENCH_SOURCES)}")
    else:
        remedy = station_checks.wrench_remedy(source, hand)
        shown = station_checks.shows_contact(source, hand)
        found = f"source {source}, hand on the robot: {hand}; contact and load are {'on' if shown else 'off'}"
        yield graded("wrench", found, (not shown, "warn", remedy))
