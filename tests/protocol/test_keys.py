import contextlib
import doctest
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from caesura_protocol import keys
from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import (
    ReplayRange,
    ServicePart,
    SessionPart,
    StationPart,
    parse_replay_parameters,
    parse_service_key,
    parse_session_key,
    parse_station_key,
    replay_parameters,
    service_key,
    session_key,
    station_key,
)
from protocol.strategies import NAMES

HOSTILE = [
    "",
    "-a",
    "_a",
    "A",
    "a b",
    "a/b",
    "a\n",
    "..",
    "a.b",
    "**",
    "a*",
    "$*",
    "a?b",
    "a#b",
    "ä",
    "a\x00",
    "x" * 65,
    "٣",
]


def test_the_worked_examples_hold():
    assert doctest.testmod(keys).failed == 0


@given(NAMES, st.sampled_from(get_args(StationPart)))
def test_station_keys_round_trip(station, part):
    assert parse_station_key(station_key(station, part)) == (station, part)


@given(NAMES, NAMES, st.sampled_from(get_args(SessionPart)))
def test_session_keys_round_trip(station, session, part):
    assert parse_session_key(session_key(station, session, part)) == (station, session, part)


@given(NAMES, st.sampled_from(get_args(ServicePart)))
def test_service_keys_round_trip(instance, part):
    assert parse_service_key(service_key(instance, part)) == (instance, part)


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_name_enters_no_key(name):
    for build in (
        lambda: station_key(name, "samples"),
        lambda: session_key(name, "s1", "status"),
        lambda: session_key("cell-1", name, "status"),
        lambda: service_key(name, "alive"),
    ):
        with pytest.raises(ProtocolError) as refused:
            build()
        assert refused.value.code == "malformed"
        assert refused.value.value == name


@pytest.mark.parametrize("name", [*HOSTILE, "*"])
def test_a_hostile_name_leaves_no_key(name):
    for parse in (
        lambda: parse_station_key(f"caesura/v1/station/{name}/samples"),
        lambda: parse_session_key(f"caesura/v1/session/cell-1/{name}/status"),
        lambda: parse_service_key(f"caesura/v1/service/{name}/alive"),
    ):
        with pytest.raises(ProtocolError, match="malformed"):
            parse()


@given(st.text())
def test_parsing_any_text_refuses_or_names_a_key_that_builds_it_again(text):
    for parse, build in (
        (parse_station_key, station_key),
        (parse_session_key, session_key),
        (parse_service_key, service_key),
    ):
        with contextlib.suppress(ProtocolError):
            assert build(*parse(text)) == text


def test_unknown_parts_and_foreign_roots_are_refused():
    for key in ("caesura/v1/station/a/nothing", "caesura/v2/station/a/samples", "other/station/a/samples"):
        with pytest.raises(ProtocolError):
            parse_station_key(key)


@given(st.integers(0, 10**12), st.integers(0, 10**6), st.integers(0, 10**6))
def test_replay_parameters_round_trip(first, more, limit):
    wanted = ReplayRange(first, first + more, limit)
    assert parse_replay_parameters(replay_parameters(wanted)) == wanted


@pytest.mark.parametrize(
    "text",
    [
        "",
        "from=1",
        "from=1;to=2",
        "from=-1;to=2;max=3",
        "from=1&to=2&max=3",
        "from=5;to=4;max=1",
        "from=x;to=2;max=3",
    ],
)
def test_other_replay_parameters_are_refused(text):
    with pytest.raises(ProtocolError) as refused:
        parse_replay_parameters(text)
    assert refused.value.code == "malformed"


def test_unknown_replay_parameters_are_ignored():
    assert parse_replay_parameters("later=1;from=1;to=2;max=3") == ReplayRange(1, 2, 3)
