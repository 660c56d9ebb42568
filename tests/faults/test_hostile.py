"""A short part of the fuzzer; `make faults` sends 105,000 inputs."""

from __future__ import annotations

import random
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from caesura_clients.recorder import record
from caesura_protocol.codec import Encoded, encode, encoding_of, pack_samples
from caesura_protocol.keys import station_key
from caesura_protocol.messages import SampleBatch
from caesura_protocol.transport.memory import MemoryNetwork
from caesura_service.segmentation.pipeline import make_pipeline
from harness.hostile import Hostile, Target, read_everything
from harness.processes import DEADLINE_S, eventually
from harness.sessions import BATCH, RATE_HZ, batch

ATTACKS = 25
QUICKLY = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])
RANDOM = st.randoms(use_true_random=True)
UNDECODABLE = (b"", b"\xc1", b"\x91" * 1000 + b"\x00", b"\xdf\xff\xff\xff\xff", bytes(1 << 20))


@pytest.mark.slow
@settings(QUICKLY, max_examples=100)
@given(RANDOM)
def test_nothing_but_a_protocol_error_leaves_the_codec(rng):
    for _ in range(ATTACKS):
        read_everything(Hostile(rng).payload())


@pytest.mark.slow
@settings(QUICKLY, max_examples=100)
@given(RANDOM)
def test_nothing_raises_out_of_the_registry_and_no_other_station_notices(rng):
    target = Target()
    for _ in range(ATTACKS):
        target.attack(Hostile(rng))


@settings(QUICKLY, max_examples=8)
@given(RANDOM)
def test_the_real_models_survive_too(rng):
    target = Target(make_pipeline, "default")
    for _ in range(ATTACKS):
        target.attack(Hostile(rng))


def test_a_recorder_passes_over_what_cannot_be_decoded():
    """On each key that it subscribes to, and before it knows its session; nothing of it is a gap."""
    network, over, key = MemoryNetwork(), threading.Event(), station_key("cell-1", "samples")
    noise = [Encoded(payload, encoding_of(SampleBatch)) for payload in UNDECODABLE]
    noise += [Encoded(encode(batch(0)).payload, "text/plain"), *hostile_messages()]
    rows = np.zeros((BATCH, 4))
    with ThreadPoolExecutor(1) as pool:
        future = pool.submit(record, network.transport(), "cell-1", "mine", over=over)
        eventually(lambda: len(network.subscribers) == 2 or future.done())
        sender = network.transport()
        for seq in range(3):
            rows[:, 0] = (seq * BATCH + np.arange(BATCH)) / RATE_HZ
            for made in noise:
                sender.put(key, made)
            sender.put(
                key, encode(pack_samples(rows, ("t", "px", "py", "pz"), session="mine", epoch=0, seq=seq))
            )
        over.set()
        found = future.result(DEADLINE_S)
    assert (found.recording.t.size, found.recorder.lost, found.recorder.spoiled) == (3 * BATCH, 0, 0)


def hostile_messages() -> list[Encoded]:
    """Of other sessions, whatever they state."""
    hostile = Hostile(random.Random(8))
    return [hostile.payload() for _ in range(200)]
