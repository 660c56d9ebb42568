"""What tests of a bridge share: quick settings, sources, losses, and what arrived."""

import numpy as np

from caesura_clients.bridge import BridgeSettings
from caesura_clients.bridge.sources.file import FileSource
from caesura_clients.bridge.sources.paced_source import FAST
from caesura_protocol.codec import unpack_samples
from caesura_protocol.keys import ReplayRange, replay_parameters, station_key
from clients.conftest import FULL_S
from clients.examples import recording

QUICK = BridgeSettings(
    retry_s=0.02, heartbeat_s=0.1, stall_s=0.1, close_timeout_s=30.0, tick_s=0.005, max_latency_s=FULL_S
)
SAMPLES_KEY = station_key("cell-1", "samples")
REPLAY_KEY = station_key("cell-1", "replay")


def file_source(count=1000, **options):
    return FileSource(recording(count), **{"pace": FAST, **options})


def assert_everything_arrived(service, source):
    sent = np.concatenate(list(source.chunks()))
    assert [batch.seq for batch in service.batches] == list(range(len(service.batches)))
    assert np.array_equal(np.concatenate([unpack_samples(batch) for batch in service.batches]), sent)


class Losing:
    """Drops batches, as a full queue would: the numbers given, the first time that each is put."""

    def __init__(self, *numbers):
        self.numbers = set(numbers)
        self._puts = 0

    def __call__(self, delivery):
        if delivery.key != SAMPLES_KEY or "SampleBatch" not in delivery.encoding:
            return False
        self._puts += 1
        return self._puts - 1 in self.numbers


def replayed(transport, first, last, limit=100, session=""):
    wanted = ReplayRange(first, last, limit, session)
    return transport.query(REPLAY_KEY, parameters=replay_parameters(wanted))
