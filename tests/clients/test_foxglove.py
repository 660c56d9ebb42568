"""`caesura foxglove`: a viewer that speaks Foxglove's protocol, beside what was published."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np
import pytest
from jsonschema import Draft202012Validator

from caesura_clients.session_state_reader import SessionReader
from caesura_clients.viewer.feed import StationFeed
from caesura_clients.viewer.foxglove_server import BACKLOG, FoxgloveServer
from caesura_clients.viewer.live_mcap_messages import PATH_POINTS, LiveStation
from caesura_protocol.codec import Encoded, encode, pack_samples
from caesura_protocol.errors import CaesuraError
from caesura_protocol.formats.mcap_schemas import CHANNELS, schema_of
from caesura_protocol.keys import station_key
from caesura_protocol.messages import Segment
from caesura_protocol.transport.memory import MemoryNetwork, MemoryTransport
from clients.answering import Answering
from clients.examples import segments, snapshot
from clients.fake_service import eventually
from harness.foxglove import Viewer, viewing

STATION = "cell-1"
SESSION = snapshot(0).status.session
RATE_HZ, BATCH = 100, 20
COLUMNS = ("t", "px", "py", "pz", "fx", "fy", "fz", "gripper")
NS = 10**9
BEGAN = 1_773_480_413.0  # [s] time of day at session time 0
AHEAD = 4000  # samples that are sent before the viewer has them: fewer than its backlog holds


@dataclass
class ViewedStation:
    """A station in memory, with a viewer of it."""

    transport: MemoryTransport
    service: Answering
    server: FoxgloveServer

    def send(self, seq: int, rows: np.ndarray) -> None:
        batch = pack_samples(rows, COLUMNS, session=SESSION, epoch=0, seq=seq)
        self.transport.put(station_key(STATION, "samples"), encode(batch))


@pytest.fixture
def station() -> Iterator[ViewedStation]:
    network = MemoryNetwork()
    transport = network.transport()
    with Answering(network.transport()) as service:
        service.snapshots = [snapshot(0, "steady")]
        service.answers = {station_key(STATION, "program"): encode(service.snapshots[0].program)}
        server = FoxgloveServer("caesura test", "127.0.0.1", 0)
        feed = StationFeed(
            network.transport(), STATION, server, refresh_s=0.2, time_of_day=lambda: BEGAN + 0.19
        )
        server.on_subscribe = feed.subscribed
        with server, feed:
            yield ViewedStation(transport, service, server)


def rows_of(samples: int) -> np.ndarray:
    """(n, 8) samples, each with numbers of its own."""
    index = np.arange(samples, dtype=np.float64)
    t = index / RATE_HZ
    circle = [0.5 + 0.1 * np.cos(t), 0.1 * np.sin(t), 0.4 + 1e-6 * index]
    return np.column_stack([t, *circle, index, -index, index / 2, index % 2])


def subscribed(viewer: Viewer) -> None:
    """Wait until it has a result of the session: from then on every message goes to it."""
    eventually(lambda: viewer.count("/segments") >= 1)


@pytest.mark.slow
def test_minutes_at_100_hz_arrive_without_loss_beside_a_viewer_that_hangs_and_one_that_leaves(station):
    seconds = 100  # 30,000 messages to each viewer: nearly twice its backlog
    rows = rows_of(seconds * RATE_HZ)
    assert 3 * len(rows) > 1.5 * BACKLOG
    port = station.server.port
    with viewing(port, hangs=True), viewing(port) as viewer, ExitStack() as leaving:
        left = leaving.enter_context(viewing(port))
        subscribed(viewer)
        for seq, first in enumerate(range(0, len(rows), BATCH)):
            station.send(seq, rows[first : first + BATCH])
            eventually(lambda sent=first: viewer.count("/state") >= sent - AHEAD)
            if first == len(rows) // 10:
                eventually(lambda: left.count("/state") > 0)
                leaving.close()
        eventually(lambda: viewer.count("/tf") == viewer.count("/wrench") == len(rows))
        states, wrenches = viewer.of("/state"), viewer.of("/wrench")
        found = [[one["t"], *one["pos"], one["gripper"]] for one in states]
        assert np.array_equal(found, rows[:, [0, 1, 2, 3, 7]])
        assert np.array_equal([one["force"] for one in wrenches], rows[:, 4:7])
        times = np.array([when for when, _ in viewer.messages["/state"]])
        assert np.abs(times - BEGAN * NS - np.round(rows[:, 0] * NS)).max() <= 1000
        assert 0.75 * seconds <= viewer.count("/path") <= 1.25 * seconds
        last = json.loads(viewer.messages["/path"][-1][1])
        assert PATH_POINTS / 2 <= len(last["poses"]) <= PATH_POINTS
        assert viewer.statuses[-1] == f"session {SESSION}"


def test_channels_have_the_schemas_of_a_file_and_messages_keep_to_them(station):
    with viewing(station.server.port) as viewer:
        subscribed(viewer)
        for seq in range(3):
            station.send(seq, rows_of(60)[seq * BATCH : (seq + 1) * BATCH])
        eventually(lambda: viewer.count("/tf") == 60 and viewer.count("/path") >= 1)
        assert viewer.schemas == {topic: (name, schema_of(topic)) for topic, (name, _) in CHANNELS.items()}
        for topic in ("/state", "/wrench", "/tf", "/path", "/segments", "/changepoints", "/program"):
            validator = Draft202012Validator(schema_of(topic))
            for message in viewer.of(topic):
                validator.validate(message)


def kinds(viewer: Viewer) -> list[str]:
    return [one["kind"] for one in viewer.of("/segments")]


def test_results_go_out_when_they_are_new_or_have_changed_and_again_to_a_viewer_that_comes_late(station):
    with viewing(station.server.port) as first:
        subscribed(first)
        station.service.put(segments(1, 1, "motion", "contact"))
        eventually(lambda: kinds(first)[-2:] == ["motion", "contact"])
        sent = len(kinds(first))
        station.service.put(segments(2, 2, "sliding"))  # the last one is another after all
        eventually(lambda: kinds(first)[sent:] == ["sliding"])
        with viewing(station.server.port) as late:
            eventually(lambda: kinds(late)[:3] == ["steady", "motion", "sliding"])
            assert Segment.model_validate({**NOTHING, **late.of("/segments")[0]}).kind == "steady"
            eventually(lambda: late.count("/program") >= 1)


NOTHING = dict.fromkeys(("runner_up", "force_held", "load_kg", "load_sd_kg"))


def test_a_batch_that_was_dropped_is_named_and_one_that_comes_twice_is_not_shown_twice(station):
    with viewing(station.server.port) as viewer:
        subscribed(viewer)
        rows = rows_of(200)
        for seq in (0, 1, 1, 4, 0, 5):
            station.send(seq, rows[seq * BATCH : (seq + 1) * BATCH])
        eventually(lambda: viewer.count("/state") >= 80)
        eventually(lambda: f"session {SESSION}: 2 batches not received" in viewer.statuses)
        shown = [one["t"] for one in viewer.of("/state")]
        assert shown == np.concatenate([rows[:40, 0], rows[80:120, 0]]).tolist()


def test_samples_that_are_none_end_nothing(station):
    """Times and values that no robot reports, times before 1970, and bytes that are no batch."""
    rows = rows_of(120)
    with viewing(station.server.port) as viewer:
        subscribed(viewer)
        for seq, (column, value) in enumerate(((0, np.nan), (0, 1e300), (1, np.inf), (0, -1e9), (0, -5e8))):
            spoiled = rows[:BATCH].copy()
            spoiled[3, column] = value
            station.send(seq, spoiled)
        station.transport.put(station_key(STATION, "samples"), Encoded(b"no batch", "text/plain"))
        station.send(5, rows[100:])
        eventually(lambda: viewer.count("/state") > 0 and viewer.of("/state")[-1]["t"] == rows[-1, 0])


def test_a_port_in_use_is_an_error_that_names_it(station):
    with (
        pytest.raises(CaesuraError, match=rf"127.0.0.1:{station.server.port}: .*in use.*choose another"),
        FoxgloveServer("second", "127.0.0.1", station.server.port),
    ):
        pass


def layout() -> dict[str, Any]:
    return json.loads(files("caesura_clients.viewer").joinpath("foxglove_layout.json").read_text())


def test_the_layout_shows_fields_that_there_are():
    shown = re.findall(r'"(/[a-z_]+)((?:\.\w+)?)(\[\d\])?"', json.dumps(layout()))
    topics = {topic for topic, _, _ in shown}
    assert {"/state", "/wrench", "/segments", "/phases", "/changepoints", "/program", "/path"} == topics
    for topic, name, index in shown:
        if name:
            field = schema_of(topic)["properties"][name[1:]]
            assert (field["type"] == "array") == bool(index)


def test_every_panel_of_the_layout_is_placed():
    def placed(node: Any) -> list[str]:
        return [node] if isinstance(node, str) else placed(node["first"]) + placed(node["second"])

    assert sorted(placed(layout()["layout"])) == sorted(layout()["configById"])


def test_the_end_of_a_session_does_not_come_back_after_the_next_one_has_begun():
    """The journal is read for seconds. Meanwhile the station's next session may begin."""
    station, first, second = LiveStation(), SessionReader(), SessionReader()
    station.sampled(pack_samples(rows_of(BATCH), COLUMNS, session="first", epoch=0, seq=0), BEGAN)
    first.restart(snapshot(0, "motion", station=STATION, session="first", state="closed"))
    second.restart(snapshot(0, "motion", station=STATION, session="second"))
    assert first.update is not None
    assert second.update is not None
    station.updated(first.update, BEGAN)
    end = station.unreceived_end()
    assert end is not None
    station.updated(second.update, BEGAN)
    assert station.recovered(end, rows_of(2 * BATCH)[BATCH:], BEGAN) == []
    assert station.live is not None
    assert station.live.name == "second"
