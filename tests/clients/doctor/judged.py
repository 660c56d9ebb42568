"""What the tests of `caesura doctor` judge: a network where all is well, and its findings."""

from __future__ import annotations

from caesura_clients.doctor.findings import CheckResult, Grade
from caesura_clients.doctor.probes import ProbeResult, ReceivedStatus, TimedServiceStatus
from caesura_protocol.messages import SampleBatch, ServiceStatus, SessionStatus, WrenchReport
from caesura_protocol.package_version_and_extras import installed_version
from clients.examples import example, snapshot

NOW = 1000.0


def grades(found: list[CheckResult], check: str) -> list[Grade]:
    return [one.grade for one in found if one.check == check]


def said(found: list[CheckResult], check: str) -> str:
    return "\n".join(f"{one.found} → {one.remedy}" for one in found if one.check == check)


def service(**changes: object) -> TimedServiceStatus:
    held = example(ServiceStatus).budgets[0]
    none = held.model_copy(update={"commands": held.commands.model_copy(update={"refused": 0})})
    well = {"version": installed_version(), "time": NOW + 0.001, "overloaded": False, "budgets": (none,)}
    status = example(ServiceStatus).model_copy(update={**well, **changes})
    return TimedServiceStatus(status, NOW, NOW + 0.002)


def status(**changes: object) -> SessionStatus:
    well = {"gaps": (), "refused": {}, "last_refusal": None, "waiting_for": None, "state": "open"}
    wrench = WrenchReport(
        source="flange_sensor", contact_models=True, transport_models=True, tare=(0.5, 0.0, 1.0), note=""
    )
    return example(SessionStatus).model_copy(update={**well, "wrench": wrench, **changes})


def well(**changes: object) -> ProbeResult:
    """One service, one station that is taught at 1 kHz."""
    first, last = (status(batches=50 * i, samples=1000 * i, t=float(i), seq=i) for i in range(1, 3))
    one = snapshot(3, "motion").model_copy(update={"status": last})
    probed = ProbeResult(
        alive=[example(ServiceStatus).instance],
        reported=[service()],
        bridges=[last.station],
        snapshots=[one],
        statuses={(last.station, last.session): [ReceivedStatus(0.0, first), ReceivedStatus(1.0, last)]},
        listened_s=1.0,
    )
    for name, value in changes.items():
        assert hasattr(probed, name)
        setattr(probed, name, value)
    return probed


def received(probed: ProbeResult, **changes: object) -> ProbeResult:
    """The same, with the station's last status changed."""
    ((key, (first, last)),) = probed.statuses.items()
    changed = ReceivedStatus(last.at, last.status.model_copy(update=changes))
    probed.statuses = {key: [first, changed]}
    return probed


def batch_of(session: str) -> SampleBatch:
    return SampleBatch(session=session, epoch=0, seq=0, n=1, columns=("t", "px"), t0=0.0, samples=bytes(8))
