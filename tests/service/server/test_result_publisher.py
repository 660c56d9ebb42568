"""Questions to bridges: each ends once, however it fails, and makes room for the next one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import zenoh

from caesura_service.publishing.events import RequestReplay
from caesura_service.server.budgets import Budgets
from caesura_service.server.inbound_events import Arrival, ReplayFinished
from caesura_service.server.key_publishers import KeyPublishers
from caesura_service.server.outbound import REPLAYS, ResultPublisher
from caesura_service.server.rate_limit_settings import RateLimits
from caesura_service.server.station_send_threads import StationSendThreads
from caesura_service.server.work_queue import QueueSettings, WorkQueue
from caesura_service.server.zenoh_network import ZenohNetwork

DEADLINE_S = 5.0
ASKED = 3 * REPLAYS


class Broken:
    """A network session of which no question leaves: of Zenoh's errors not every one is a ZError."""

    def request(self, *_: Any, **__: Any) -> None:
        raise RuntimeError("no runtime")


def closed() -> ZenohNetwork:
    """A real one, which ends the question, and raises as well."""
    config = zenoh.Config()
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("mode", '"peer"')
    config.insert_json5("listen/endpoints", "[]")
    session = zenoh.open(config)
    session.close()
    return ZenohNetwork(session)


@pytest.mark.parametrize("network", [Broken, closed])
def test_a_question_that_fails_ends_once_and_the_next_ones_go(network: Callable[[], Any]):
    inbox: WorkQueue[Arrival] = WorkQueue(QueueSettings())
    with StationSendThreads() as lanes:
        session = network()
        publishers = KeyPublishers(session, lanes)
        outgoing = ResultPublisher(session, inbox, Budgets(RateLimits()), lanes, publishers)
        for number in range(ASKED):
            outgoing.request_replay(RequestReplay(f"cell-{number}", "s1", 0, 9))
        ended: list[str] = []
        while len(ended) < ASKED and isinstance(arrival := inbox.get(DEADLINE_S), ReplayFinished):
            ended.append(arrival.replay.request.station)
            outgoing.replay_finished()
    assert sorted(ended) == sorted(f"cell-{number}" for number in range(ASKED))
    assert not len(inbox), "each has ended once"
