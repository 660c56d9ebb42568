"""A payload that is alike is what decoding it says, whatever its bytes; joined samples are those of each."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from caesura_protocol.codec import decode, encode, matrix_of, pack_samples
from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import SampleBatch
from caesura_service.sessions.same_layout_batches import ENCODING, BatchBlock, BatchLayout

COLUMNS = ("t", "px", "py", "pz", "fx")


def payload_of(
    seq: int, *, dtype: type = np.float64, count: int = 4, t0: float = 1.0, **fields: object
) -> bytes:
    rows = (np.arange(count * len(COLUMNS), dtype=np.float64).reshape(count, -1) + seq).astype(dtype)
    rows[:, 0] = t0 + 0.001 * np.arange(count)
    batch = pack_samples(rows, COLUMNS, session="s1", epoch=0, seq=seq)
    return encode(batch.model_copy(update=fields)).payload


def layout_of(payload: bytes) -> BatchLayout:
    layout = BatchLayout.of(payload)
    assert layout is not None
    return layout


@pytest.mark.parametrize("seq", [0, 127, 128, 255, 256, 65535, 65536, (1 << 32) - 2, (1 << 53) - 2])
@pytest.mark.parametrize("bridge", [None, "b-1"])
@pytest.mark.parametrize(("dtype", "count"), [(np.float64, 1), (np.float32, 4), (np.float64, 200)])
def test_the_next_batch_is_alike_unless_its_number_takes_more_bytes(seq, bridge, dtype, count):
    layout = layout_of(payload_of(seq, dtype=dtype, count=count, bridge=bridge))
    after = payload_of(seq + 1, dtype=dtype, count=count, t0=2.5, bridge=bridge)
    if len(after) != layout.size:
        assert layout.seq_of(after) is None
        layout = layout_of(after)
    batch = decode(after, ENCODING, SampleBatch)
    assert layout.seq_of(after) == seq + 1 == batch.seq
    assert layout.t0_of(after) == batch.t0
    assert layout.t_last_of(after) == matrix_of(batch)[-1, 0]
    block = BatchBlock(layout, seq + 1, [after])
    np.testing.assert_array_equal(block.samples(), matrix_of(batch), strict=True)


def test_joined_samples_are_those_of_each_one():
    payloads = [payload_of(seq, t0=0.1 * seq + 1e-9) for seq in range(5)]
    block = BatchBlock(layout_of(payloads[0]), 0, payloads)
    each = [matrix_of(decode(payload, ENCODING, SampleBatch)) for payload in payloads]
    np.testing.assert_array_equal(block.samples(), np.concatenate(each), strict=True)
    assert block.after(2) == BatchBlock(block.layout, 2, payloads[2:])


@pytest.mark.parametrize(
    "fields",
    [
        {"session": "s2"},
        {"epoch": 1},
        {"bridge": "b-2"},
        {"columns": ("t", "px", "py", "pz", "fy")},
        {"n": 2, "samples": bytes(2 * 8 * len(COLUMNS))},
    ],
)
def test_one_that_differs_in_anything_else_is_not_alike(fields):
    layout = layout_of(payload_of(1, bridge="b-1"))
    assert layout.seq_of(payload_of(2, bridge="b-1")) == 2
    assert layout.seq_of(payload_of(2, **({"bridge": "b-1"} | fields))) is None


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"rubbish",
        payload_of(1)[:-1],
        payload_of(1, n=3),  # samples that do not fit
        payload_of(1).replace(b"\x88", b"\x89", 1) + b"\xa5other\x01",  # a field of a newer peer
    ],
)
def test_what_is_no_batch_as_it_is_packed_has_no_layout(payload):
    assert BatchLayout.of(payload) is None


@given(
    st.sampled_from([1, 126, 130, 300, 70_000]),
    st.lists(st.tuples(st.floats(0.0, 1.0, exclude_max=True), st.integers(0, 255)), max_size=4),
)
def test_whatever_bytes_flip_what_is_alike_decodes_to_the_same(seq, flips):
    layout = layout_of(payload_of(seq))
    flipped = bytearray(payload_of(seq + 1))
    for place, value in flips:
        flipped[int(place * len(flipped))] = value
    found = layout.seq_of(bytes(flipped))
    if found is None:
        return
    if not math.isfinite(layout.t0_of(bytes(flipped))):
        with pytest.raises(ProtocolError, match="t0"):
            decode(bytes(flipped), ENCODING, SampleBatch)
        return
    batch = decode(bytes(flipped), ENCODING, SampleBatch)
    same = {"seq": found, "t0": layout.t0_of(bytes(flipped)), "samples": batch.samples}
    assert batch == layout.message.model_copy(update=same)
    np.testing.assert_array_equal(
        BatchBlock(layout, found, [bytes(flipped)]).samples(), matrix_of(batch), strict=True
    )


@given(st.integers(0, 255), st.integers(0, 40))
def test_every_single_byte_of_the_header_counts(value, place):
    layout, payload = layout_of(payload_of(1)), bytearray(payload_of(2))
    before = payload[place]
    payload[place] = value
    found = layout.seq_of(bytes(payload))
    assert found in {None, 2 if value == before else value}
    if found is not None:
        assert decode(bytes(payload), ENCODING, SampleBatch).seq == found
