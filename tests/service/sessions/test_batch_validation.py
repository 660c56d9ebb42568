"""Refusing a batch for its numbers takes less memory than a megabyte, whatever they are."""

from __future__ import annotations

import math
import tracemalloc

import numpy as np
import pytest

from caesura_protocol.codec import decode, encoding_of
from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import MAX_BATCH_SAMPLES, MAX_COLUMNS, SampleBatch
from caesura_service.sessions.batch_validation import validated_samples
from caesura_service.sessions.limits import Limits
from harness.heavy import full_batches

LIMITS = Limits()
BATCHES = dict(full_batches(math.nan, -math.inf, 1e30))


@pytest.mark.parametrize("what", BATCHES)
def test_refusing_a_full_batch_for_its_numbers_takes_less_than_a_megabyte(what):
    tracemalloc.start()
    try:
        batch = decode(BATCHES[what], encoding_of(SampleBatch), SampleBatch)
        with pytest.raises(ProtocolError):
            validated_samples(batch, batch.columns, LIMITS)
        assert tracemalloc.get_traced_memory()[1] < 1_000_000
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("kind", ["f4", "f8"])
@pytest.mark.parametrize("sign", [1, -1])
def test_the_greatest_value_beyond_the_limit_is_named(kind, sign):
    cells = np.zeros((MAX_BATCH_SAMPLES, MAX_COLUMNS), kind)
    cells[7, 3], cells[8, 5] = 2 * LIMITS.value, sign * 3 * LIMITS.value
    columns = ("t", *(f"c{number}" for number in range(1, MAX_COLUMNS)))
    batch = SampleBatch(
        session="s1",
        epoch=0,
        seq=4,
        n=MAX_BATCH_SAMPLES,
        columns=columns,
        t0=0.0,
        samples=cells.tobytes(),
    )
    with pytest.raises(ProtocolError, match="sample 8 of batch 4: c5 is out of range") as refused:
        validated_samples(batch, columns, LIMITS)
    assert refused.value.value == pytest.approx(sign * 3 * LIMITS.value)
