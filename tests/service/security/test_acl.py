"""What each role may do with each key, over real TLS links through a real router.

The table below is written by hand and knows nothing of the one that the rules are made from.
"""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import zenoh

from caesura_protocol.messages import MAX_MESSAGE_BYTES
from caesura_protocol.transport.zenoh_transport import direct
from caesura_service.security.roles import ROLES as TABLE
from caesura_service.security.zenoh_files import ROUTER_MAX_BYTES
from service.security.acl_world import KEYS, ROLES, STRANGER, World, certificates

STREAMS = ("changepoints", "segments", "posterior", "hints", "status")
RESULTS = {f"caesura/v1/session/{station}/s1/{part}" for station in ("cell-1", "cell-2") for part in STREAMS}
SNAPSHOTS = {"caesura/v1/session/cell-1/s1/snapshot", "caesura/v1/session/cell-2/s1/snapshot"}
PAST_SAMPLES = {"caesura/v1/session/cell-1/s1/samples", "caesura/v1/session/cell-2/s1/samples"}
PROGRAMS = {"caesura/v1/station/cell-1/program", "caesura/v1/station/cell-2/program"}
SAMPLES = {"caesura/v1/station/cell-1/samples", "caesura/v1/station/cell-2/samples"}
CONTROLS = {"caesura/v1/station/cell-1/control", "caesura/v1/station/cell-2/control"}
BRIDGE_STATES = {"caesura/v1/station/cell-1/bridge_status", "caesura/v1/station/cell-2/bridge_status"}
STARTS = {"caesura/v1/station/cell-1/bridge_control", "caesura/v1/station/cell-2/bridge_control"}
STATIONS_ALIVE = {"caesura/v1/station/cell-1/alive", "caesura/v1/station/cell-2/alive"}
SERVICES_ALIVE = {"caesura/v1/service/west/alive", "caesura/v1/service/east/alive"}
STATUSES = {"caesura/v1/service/west/status", "caesura/v1/service/east/status"}

ALLOWED: dict[str, dict[str, set[str]]] = {
    "service.west": {
        "put": RESULTS | PROGRAMS | {"caesura/v1/service/west/status"},
        "subscribe": SAMPLES,
        "query": {"caesura/v1/station/cell-1/replay", "caesura/v1/station/cell-2/replay"},
        "answer": CONTROLS | PROGRAMS | SNAPSHOTS | PAST_SAMPLES | {"caesura/v1/service/west/status"},
        "hold": {"caesura/v1/service/west/alive"},
        "watch": SERVICES_ALIVE | STATIONS_ALIVE,
    },
    "bridge.cell-1": {
        "put": {"caesura/v1/station/cell-1/samples", "caesura/v1/station/cell-1/bridge_status"},
        "subscribe": set(),
        "query": {
            "caesura/v1/station/cell-1/control",
            "caesura/v1/station/cell-1/bridge_control",
            "caesura/v1/station/cell-1/program",
            "caesura/v1/session/cell-1/s1/snapshot",
        },
        "answer": {"caesura/v1/station/cell-1/replay", "caesura/v1/station/cell-1/bridge_control"},
        "hold": {"caesura/v1/station/cell-1/alive"},
        "watch": SERVICES_ALIVE | {"caesura/v1/station/cell-1/alive"},
    },
    "dashboard.wall": {
        "put": set(),
        "subscribe": RESULTS | PROGRAMS | SAMPLES | STATUSES | BRIDGE_STATES,
        "query": SNAPSHOTS | PAST_SAMPLES | PROGRAMS | STATUSES,
        "answer": set(),
        "hold": set(),
        "watch": SERVICES_ALIVE | STATIONS_ALIVE,
    },
    "operator.boss": {
        "put": set(),
        "subscribe": RESULTS | PROGRAMS | SAMPLES | STATUSES | BRIDGE_STATES,
        "query": SNAPSHOTS | PAST_SAMPLES | PROGRAMS | STATUSES | CONTROLS | STARTS,
        "answer": set(),
        "hold": set(),
        "watch": SERVICES_ALIVE | STATIONS_ALIVE,
    },
    STRANGER: {verb: set() for verb in ("put", "subscribe", "query", "answer", "hold", "watch")},
}
VERBS = ("put", "delete", "subscribe", "query", "answer", "hold", "watch")
WIDE = ("**", "caesura/**", "caesura/v1/**", "caesura/v1/station/*/*", "caesura/v1/session/cell-2/**")


@pytest.fixture(scope="module")
def directory(tmp_path_factory):
    path = tmp_path_factory.mktemp("certs")
    certificates(path)
    return path


@pytest.fixture(scope="module", params=["certificates", "passwords"])
def world(request, directory) -> Iterator[World]:
    with World(directory, request.param) as opened:
        yield opened


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize("role", [*ROLES, STRANGER])
def test_a_role_may_do_what_the_table_says_and_nothing_else(world, role, verb):
    done = getattr(world.outsider(role), verb)(world.router)
    assert done == ALLOWED[role].get(verb, set())


@pytest.mark.parametrize("wide", WIDE)
@pytest.mark.parametrize("role", [*ROLES, STRANGER])
def test_a_wider_expression_than_the_rules_have_lets_nothing_through(world, role, wide):
    outsider = world.outsider(role)
    assert outsider.subscribe_to(wide, world.router) == set()
    assert outsider.query(world.router, (wide,)) == set()


@pytest.mark.parametrize("role", [*ROLES, STRANGER])
def test_nothing_is_put_with_a_wider_expression_than_the_rules_have(world, role):
    wide = (*WIDE, "caesura/v1/station/cell-$*/samples", "caesura/v1/station/cell-1/samples/@adv/pub/**")
    assert world.outsider(role).put(world.router, wide) == set()


@pytest.mark.parametrize(
    ("role", "wide", "received"),
    [
        ("service.west", "caesura/v1/station/*/samples", ALLOWED["service.west"]["subscribe"]),
        ("dashboard.wall", "caesura/v1/session/*/*/segments", {key for key in RESULTS if "segments" in key}),
        ("operator.boss", "caesura/v1/station/*/program", PROGRAMS),
    ],
)
def test_the_expressions_that_clients_and_service_use_are_let_through(world, role, wide, received):
    assert world.outsider(role).subscribe_to(wide, world.router) == received


def test_the_questions_that_clients_ask_of_all_instances_are_answered(world):
    asked = ("caesura/v1/session/*/*/snapshot", "caesura/v1/station/*/program", "caesura/v1/service/*/status")
    assert world.outsider("dashboard.wall").query(world.router, asked) == set(asked)


@pytest.mark.parametrize(
    ("role", "wide", "answered"),
    [
        ("service.west", "caesura/v1/service/*/status", {"caesura/v1/service/west/status"}),
        ("service.west", "caesura/v1/station/*/program", PROGRAMS),
        ("service.west", "caesura/v1/session/*/*/snapshot", SNAPSHOTS),
        ("service.west", "caesura/v1/session/cell-1/*/snapshot", SNAPSHOTS - {max(SNAPSHOTS)}),
        ("service.west", "caesura/v1/station/*/replay", set()),
        ("bridge.cell-1", "caesura/v1/station/*/replay", set()),
        ("bridge.cell-1", "caesura/v1/session/*/*/snapshot", set()),
        ("dashboard.wall", "caesura/v1/service/*/status", set()),
        ("operator.boss", "caesura/v1/station/*/control", set()),
    ],
)
def test_wide_questions_are_answered_by_those_who_may_and_no_others(world, role, wide, answered):
    assert world.outsider(role).answer_to(wide, world.router)[0] == answered


@pytest.mark.parametrize(
    ("wide", "received"),
    [
        ("caesura/v1/station/*/program", True),
        ("caesura/v1/session/*/*/snapshot", True),
        ("caesura/v1/service/*/status", False),  # or one instance could answer for another
    ],
)
def test_a_refusal_is_received_where_all_that_was_asked_may_be_answered(world, wide, received):
    assert world.outsider("service.west").answer_to(wide, world.router)[1] == received


def test_a_message_over_the_routers_limit_is_dropped_and_the_link_lives_on(world):
    outsider, received = world.outsider("bridge.cell-1"), []
    subscriber = world.router.declare_subscriber(
        "**", direct(lambda sample: received.append(len(sample.payload)))
    )
    for size in (MAX_MESSAGE_BYTES, ROUTER_MAX_BYTES + 1, 5 * ROUTER_MAX_BYTES, 1):
        outsider.session.put(
            "caesura/v1/station/cell-1/samples", bytes(size), congestion_control=zenoh.CongestionControl.BLOCK
        )
    outsider.barrier()
    subscriber.undeclare()
    assert received == [MAX_MESSAGE_BYTES, 1]


def test_this_suite_would_see_what_gets_through(directory):
    with World(directory, "certificates", rules=False) as unruled:
        for verb in VERBS:
            assert getattr(unruled.outsider(STRANGER), verb)(unruled.router) == set(KEYS), verb
        assert unruled.outsider(STRANGER).put(unruled.router, WIDE) == set(WIDE)


def test_every_role_has_its_row_above():
    assert {label.partition(".")[0] for label in ROLES} == set(TABLE)
