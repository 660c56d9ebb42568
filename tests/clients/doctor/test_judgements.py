"""Every judgement of stations and services, without a network."""

from __future__ import annotations

from dataclasses import replace

import pytest

from caesura_clients.doctor.probes import ReceivedStatus
from caesura_clients.doctor.run_checks import judge
from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import BridgeStatus, Budget, Gap, Refusal, ServiceStatus
from caesura_protocol.transport.transport_interface import unanswered
from clients.doctor.judged import NOW, batch_of, grades, received, said, service, status, well
from clients.examples import example


def test_a_station_that_was_held_back_is_named_with_its_budget():
    assert "no station was held back" in said(list(judge(well())), "budget")
    held = service(budgets=example(ServiceStatus).budgets)
    found = list(judge(replace(well(), reported=[held])))
    assert grades(found, "budget") == ["warn"]
    assert "commands 1000 of 1000 (500 a second), 17 held back" in said(found, "budget")


def test_queries_that_name_no_station_and_were_held_back_are_counted():
    held = service(queries=Budget(per_s=2000, at_once=4000, used=4000, refused=12))
    found = list(judge(replace(well(), reported=[held])))
    assert "queries that name no station were held back: 12" in said(found, "budget")
    assert "warn" in grades(found, "budget")


def test_where_all_is_well_nothing_is_to_be_done():
    found = list(judge(well()))
    assert {one.grade for one in found} == {"ok"}
    assert {one.remedy for one in found} == {""}
    assert "50.0 batches/s, 1000 samples/s" in said(found, "samples")


@pytest.mark.parametrize(
    ("changes", "check", "grade", "words"),
    [
        ({"version": "9.9"}, "service", "warn", "is version 9.9"),
        ({"time": NOW + 0.2}, "clock", "warn", "ahead of this machine"),
        ({"time": NOW - 7.0}, "clock", "warn", "7.0 s behind"),
        ({"time": NOW + 0.04}, "clock", "ok", "39.0 ms ahead"),
        ({"time": None}, "clock", "warn", "does not state its time"),
        ({"queue": 3000, "queue_capacity": 4096}, "queue", "bad", "3000 of 4096"),
        ({"overloaded": True}, "queue", "bad", "it is behind"),
        ({"dropped": 3}, "queue", "warn", "3 dropped"),
        ({"journal": None}, "journal", "warn", "does not report it"),
    ],
)
def test_what_a_service_reports_is_judged(changes, check, grade, words):
    found = list(judge(well(reported=[service(**changes)])))
    assert grades(found, check) == [grade]
    assert words in said(found, check)


def test_a_journal_in_trouble_in_memory_or_full_is_said():
    whole = service().status.journal
    for update, grade, words in (
        ({"trouble": "no space left on /var"}, "bad", "no space left on /var"),
        ({"kind": "memory"}, "warn", "--journal DIR"),
        ({"size": 95, "size_limit": 100}, "warn", "--journal-gb"),
        ({"disk_free": 640_000_000}, "warn", "its disk has 640 MB left"),
    ):
        found = list(judge(well(reported=[service(journal=whole.model_copy(update=update))])))
        assert grades(found, "journal") == [grade]
        assert words in said(found, "journal")


@pytest.mark.parametrize(
    ("changes", "grade", "words"),
    [
        ({}, "ok", "in standby, waits for a start; no session is open"),
        (
            {"last_session": "s1", "outcome": "is stored; the source has ended"},
            "ok",
            "s1 is stored; the source has ended",
        ),
        ({"problem": "the button was pressed, and nothing began"}, "warn", "in standby: the button"),
        (
            {"state": "failed", "problem": "the source is lost: no route"},
            "bad",
            "the source is lost: no route",
        ),
    ],
)
def test_a_bridge_in_standby_is_well_while_it_waits(changes, grade, words):
    """One that waited for a start was named as one that has just ended, or is beginning."""
    probed = received(well(), state="closed")
    station = probed.bridges[0]
    standby = BridgeStatus(station=station, bridge="host-1", state="ready", source="franky")
    found = list(judge(replace(probed, standby={station: standby.model_copy(update=changes)})))
    assert grades(found, "bridge") == [grade]
    assert words in said(found, "bridge")


FULL = "/var/caesura.sqlite cannot be written, there is no room left"


def test_a_journal_that_cannot_be_written_is_the_cause_of_refusals_and_missing_batches_named_once():
    kept = service().status.journal.model_copy(update={"trouble": FULL})
    refused = {"overloaded": 6883}
    last = Refusal(code="overloaded", message=FULL)
    probed = received(
        well(reported=[service(journal=kept)]), waiting_for=133, refused=refused, last_refusal=last
    )
    found = list(judge(probed))
    text = "\n".join(f"{one.found} → {one.remedy}" for one in found)
    assert grades(found, "journal") == ["bad"]
    assert grades(found, "gaps") == []  # neither none nor some: the bridge still has them
    (one,) = [one for one in found if one.check == "refused"]
    assert (one.grade, one.found) == (
        "warn",
        f"6883 overloaded, batch 133 is missing: {probed.alive[0]} cannot write its journal",
    )
    assert one.remedy == "make room soon: the bridge keeps ten minutes at 1 kHz, and is asked for them again"
    assert text.count("no room left") == 1
    assert "the bridge sends what" not in text
    assert "whether the bridge answers" not in text


def test_beside_a_full_journal_what_the_bridge_sends_wrongly_is_still_its_own():
    kept = service().status.journal.model_copy(update={"trouble": FULL})
    probed = received(well(reported=[service(journal=kept)]), refused={"overloaded": 5, "malformed": 2})
    found = [one for one in judge(probed) if one.check == "refused"]
    assert [one.found.partition(":")[0] for one in found] == ["5 overloaded", "2 malformed"]
    assert found[1].remedy == "the bridge sends what the service cannot take: see docs/operations.md"


def test_refusals_of_a_service_without_room_are_not_the_bridges():
    last = Refusal(code="overloaded", message=FULL)
    found = list(judge(received(well(), refused={"overloaded": 7}, last_refusal=last)))
    (one,) = [one for one in found if one.check == "refused"]
    assert one.found == f"7 overloaded; the last: {FULL}"
    assert one.remedy == "the service had no room for them and asked for them again: see journal and queue"


def test_a_batch_that_is_missing_is_not_said_beside_no_gaps():
    found = list(judge(received(well(), waiting_for=7)))
    assert grades(found, "gaps") == ["warn"]


def test_where_no_session_opens_on_a_full_journal_it_is_the_cause():
    kept = service().status.journal.model_copy(update={"trouble": FULL})
    probed = received(well(reported=[service(journal=kept)]), state="closed")
    ((station, _),) = probed.statuses
    probed.batches = {(station, "other"): [batch_of("other")]}
    found = list(judge(probed))
    assert grades(found, "bridge") == ["bad"]
    assert "cannot write its journal, so no session opens → make room" in said(found, "bridge")


@pytest.mark.parametrize(
    ("changes", "check", "grade", "words"),
    [
        ({"gaps": (Gap(t0=1.0, tn=1.5, reason="evicted"),)}, "gaps", "warn", "1 of 0.50 s in all (evicted)"),
        ({"waiting_for": 7}, "gaps", "warn", "batch 7 is missing"),
        ({"duplicates": 3}, "duplicates", "ok", "were duplicates"),
        ({"refused": {"malformed": 2}}, "refused", "warn", "2 malformed"),
    ],
)
def test_what_a_session_reports_is_judged(changes, check, grade, words):
    found = list(judge(received(well(), **changes)))
    assert grade in grades(found, check)
    assert words in said(found, check)


def test_a_source_that_is_not_stated_is_asked_for():
    off = {"stated": False, "contact_models": False, "transport_models": False}
    found = list(judge(received(well(), wrench=status().wrench.model_copy(update=off))))
    (one,) = [one for one in found if one.check == "wrench"]
    assert one.grade == "warn"
    assert "flange_sensor, flange_sensor_with_hand, joint_torque_estimate, none" in one.remedy


@pytest.mark.parametrize(
    ("changes", "check", "words"),
    [
        ({"tare": (0.0, 0.0, -9.0)}, "wrench bias", "9.0 N in all"),
        ({"tare": None}, "wrench", "start in free space"),
        ({"contact_models": False, "transport_models": False}, "wrench", "neither contact nor load"),
    ],
)
def test_a_wrench_that_says_little_is_warned_of(changes, check, words):
    wrench = status().wrench.model_copy(update=changes)
    found = list(judge(received(well(), wrench=wrench)))
    assert grades(found, check) == ["warn"]
    assert words in said(found, check)


def test_a_service_that_says_nothing_to_us_is_a_matter_of_credentials():
    found = list(judge(well(reported=[], snapshots=[], statuses={}, bridges=[])))
    assert grades(found, "credentials") == ["warn"]
    assert "certificate or password of a dashboard" in said(found, "credentials")
    found = list(judge(well(snapshots=[])))
    assert "known sessions and none was shown" in said(found, "credentials")


def test_a_peer_of_another_protocol_is_named():
    found = list(judge(well(other_versions=["caesura/v2/service/new/alive"])))
    assert grades(found, "service") == ["bad", "ok"]
    assert "has protocol caesura/v2, this client has caesura/v1" in said(found, "service")


def test_two_owners_of_one_session_and_who_has_what_are_reported():
    one = well().snapshots[0]
    other = one.model_copy(
        update={"status": one.status.model_copy(update={"instance": "other", "epoch": 99})}
    )
    found = list(judge(well(alive=[one.status.instance, "other"], snapshots=[one, other])))
    assert grades(found, "owner") == ["warn", "ok"]
    assert "both have" in said(found, "owner")
    assert f"{one.status.instance}: none" in said(found, "owner")
    assert f"other: {one.status.station}" in said(found, "owner")
    assert "other is alive and does not answer" in said(found, "service")


def test_a_service_that_hangs_is_no_matter_of_credentials():
    """Of one that was frozen it said that its status is not for these credentials."""
    late = unanswered(2.0)
    found = list(judge(replace(well(), reported=[], snapshots=[], statuses={}, refusals=[late, late])))
    assert grades(found, "service") == ["bad"]
    assert "is alive and does not answer" in said(found, "service")
    assert "restart it within ten minutes" in said(found, "service")
    assert grades(found, "credentials") == []


def test_an_open_session_whose_bridge_is_gone_is_bad():
    found = list(judge(well(bridges=[])))
    assert grades(found, "bridge") == ["bad"]
    assert "--epoch N" in said(found, "bridge")


def test_a_bridge_that_is_connected_and_sends_nothing_is_bad():
    found = list(judge(received(well(), batches=50, samples=1000, t=1.0)))
    assert grades(found, "samples") == ["bad"]
    assert "the bridge hangs, or its source sends nothing" in said(found, "samples")


def test_batches_of_another_session_are_not_counted_as_sent_for_this_one():
    probed = received(well(), batches=50, samples=1000, t=1.0)
    ((station, _),) = probed.statuses
    probed.batches = {(station, "other"): [batch_of("other")]}
    assert said(list(judge(probed)), "samples").startswith("none in 1.0 s")


@pytest.mark.parametrize(
    ("first_at", "grade", "words"),
    [(0.0, "bad", "none in 3.0 s"), (1.5, "bad", "none in 1.5 s"), (2.8, "warn", "for 0.2 s only")],
)
def test_a_session_that_has_just_begun_does_not_hang(first_at, grade, words):
    begun = status(batches=1, samples=20, t=0.02)
    probed = well(
        statuses={(begun.station, begun.session): [ReceivedStatus(first_at, begun)]}, listened_s=3.0
    )
    found = list(judge(probed))
    assert grades(found, "samples") == [grade]
    assert words in said(found, "samples")


def test_a_refusal_of_the_doctors_queries_is_reported():
    found = list(judge(well(refusals=[ProtocolError("overloaded", "too many questions are waiting")] * 2)))
    assert "2 questions refused: overloaded: too many questions are waiting" in said(found, "credentials")


def test_samples_of_a_session_that_was_never_opened_are_bad_and_those_of_one_that_just_ended_are_not():
    probed = received(well(), state="closed")
    ((station, session),) = probed.statuses
    probed.batches = {(station, session): [batch_of(session)]}
    assert grades(list(judge(probed)), "bridge") == ["warn"]
    probed.batches = {(station, "other"): [batch_of("other")]}
    assert grades(list(judge(probed)), "bridge") == ["bad"]
    probed = well(batches={(station, "other"): [batch_of("other")]})
    assert grades(list(judge(probed)), "bridge") == ["ok", "warn"]


def test_samples_of_an_open_session_are_not_said_to_be_of_one_that_is_over():
    probed = well()
    (((station, session), _),) = probed.statuses.items()
    left = status(session="a-left", batches=50, samples=1000, t=1.0)
    assert left.session < session  # so that the other one is current
    probed.statuses[station, left.session] = [ReceivedStatus(0.0, left)]
    probed.batches = {(station, left.session): [batch_of(left.session)]}
    assert grades(list(judge(probed)), "bridge") == ["ok"]


def test_two_bridges_of_one_session_are_named_and_nothing_is_said_to_be_over():
    probed = well()
    ((station, session),) = probed.statuses
    sent = [batch_of(session).model_copy(update={"bridge": name}) for name in ("east-1", "west-2", "east-1")]
    probed.batches = {(station, session): sent}
    found = list(judge(probed))
    (rivals,) = [one for one in found if one.check == "bridge" and one.grade == "bad"]
    assert rivals.found == f"2 bridges publish {session}: east-1 (2 batches), west-2 (1 batch)"
    assert not [one for one in found if "over" in f"{one.found} {one.remedy}"]


def test_a_station_that_is_not_there_is_no_matter_of_credentials():
    found = list(judge(well(snapshots=[], statuses={}, bridges=[], others=["cell-1", "cell-7"]), "cell-9"))
    assert grades(found, "credentials") == ["ok"]
    assert "known stations: cell-1, cell-7" in said(found, "bridge")
