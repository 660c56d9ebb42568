import doctest
import math
import random
import struct

import msgpack
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from caesura_protocol import codec
from caesura_protocol.codec import (
    MESSAGE_TYPES,
    decode,
    decode_error,
    encode,
    encode_error,
    encoding_of,
    pack_samples,
    unpack_samples,
)
from caesura_protocol.errors import ERROR_CODES, ProtocolError
from caesura_protocol.messages import (
    MAX_BATCH_SAMPLES,
    MAX_MESSAGE_BYTES,
    Ack,
    Close,
    Heartbeat,
    Open,
    SampleBatch,
)
from protocol.strategies import messages

CLOSE = {"type": "close", "session": "s1", "last_seq": 7}
COLUMNS = ("t", "px", "py")


def close_of(**changes):
    return msgpack.packb(CLOSE | changes)


def refusal_of(payload, encoding=None, *expected):
    with pytest.raises(ProtocolError) as refused:
        decode(payload, encoding or encoding_of(Close), *(expected or (Close,)))
    return refused.value


@pytest.mark.slow
@pytest.mark.parametrize("model", MESSAGE_TYPES.values(), ids=MESSAGE_TYPES)
@settings(max_examples=6, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_every_message_round_trips(model, data):
    message = data.draw(messages(model))
    content = encode(message)
    assert decode(*content, model) == message
    assert encode(decode(*content, model)) == content


def test_the_encoding_names_type_and_version():
    assert doctest.testmod(codec).failed == 0
    assert encode(Close(session="s1", last_seq=7)).encoding == "application/msgpack;caesura.Close.v1"


def test_unknown_fields_are_ignored():
    assert decode(close_of(colour="green", deep={"a": [1]}), encoding_of(Close), Close).last_seq == 7


def test_another_major_version_is_refused_and_both_are_named():
    refusal = refusal_of(close_of(), "application/msgpack;caesura.Close.v2")
    assert refusal.code == "unsupported_version"
    assert (refusal.value, refusal.expected) == (2, 1)
    assert "version 2" in str(refusal)
    assert "version 1" in str(refusal)


@pytest.mark.parametrize(
    "encoding",
    ["", "application/json", "application/msgpack", "application/msgpack;caesura.Close.v1;x", "x" * 10_000],
)
def test_an_unknown_encoding_is_refused(encoding):
    refusal = refusal_of(close_of(), encoding) if encoding else refusal_of(close_of(), " ")
    assert refusal.code == "unsupported_version"
    assert len(str(refusal)) < 400


def test_a_type_that_is_not_expected_is_refused_and_names_those_that_are():
    refusal = refusal_of(close_of(), encoding_of(Close), Open, Ack)
    assert (refusal.code, refusal.value, refusal.expected) == ("malformed", "Close", ["Open", "Ack"])


@pytest.mark.parametrize("size", [MAX_MESSAGE_BYTES + 1, 8 * MAX_MESSAGE_BYTES])
def test_a_large_message_is_refused_before_it_is_read(size):
    refusal = refusal_of(b"\xc1" * size)
    assert (refusal.code, refusal.value, refusal.limit) == ("too_large", size, MAX_MESSAGE_BYTES)


def test_a_large_message_is_not_written():
    with pytest.raises(ProtocolError, match="too_large"):
        encode(Heartbeat.model_construct(session="x" * MAX_MESSAGE_BYTES, epoch=0, seq=0))


@pytest.mark.parametrize(
    ("payload", "what"),
    [
        (b"", "empty"),
        (close_of()[:-3], "truncated"),
        (close_of() + b"\x00", "bytes behind the end"),
        (b"\xc1", "a byte that msgpack reserves"),
        (msgpack.packb([1, 2]), "an array"),
        (msgpack.packb(7), "a number"),
        (b"\x91" * 5000 + b"\x00", "deep nesting"),
        (b"\x81\xa1a" * 1200 + b"\x00", "deep maps"),
        (b"\xdf\xff\xff\xff\xff", "a map of four billion"),
        (b"\xc6\xff\xff\xff\xff", "a bin of four gigabytes"),
        (b"\x81\x01\x02", "a key that is no text"),
        (b"\x81\xa2\xff\xfe\x00", "a text that is no utf-8"),
        (msgpack.packb({"session": msgpack.ExtType(5, b"x")}), "an extension"),
        (b"\x81\xa7session\xc7\x00\x05", "an empty extension"),
        (b"\x81\xa7session\xd6\xff\x00\x00\x00\x01", "a timestamp"),
        (close_of(last_seq="7"), "a text for a number"),
        (close_of(last_seq=True), "a truth for a number"),
        (close_of(last_seq=7.5), "a fraction for a count"),
        (close_of(last_seq=-2), "a number under its bound"),
        (close_of(last_seq=None), "nothing"),
        (close_of(session=b"s1"), "bytes for a text"),
        (close_of(session="../../x"), "a hostile name"),
        (close_of(session="s" * 65), "a long name"),
        (close_of(type="open"), "another command's tag"),
        (msgpack.packb({}), "no field"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_rubbish_is_malformed(payload, what):
    refusal = refusal_of(payload)
    assert refusal.code == "malformed", what
    assert len(str(refusal)) < 600


@pytest.mark.parametrize("seq", [2**53, 2**63, 2**64 - 1, -1])
def test_a_number_that_a_float_cannot_count_is_refused(seq):
    payload = msgpack.packb({"session": "s1", "next_seq": seq, "state": "open"})
    refusal = refusal_of(payload, encoding_of(Ack), Ack)
    assert (refusal.code, refusal.value) == ("malformed", seq)
    assert "next_seq" in refusal.message


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_times_must_be_finite(value):
    batch = pack_samples(np.ones((2, 3)), COLUMNS, session="s1", epoch=0, seq=0)
    payload = msgpack.packb(batch.model_dump() | {"t0": value})
    assert refusal_of(payload, encoding_of(SampleBatch), SampleBatch).code == "malformed"


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_samples_round_trip_and_keep_their_precision(dtype):
    matrix = np.random.default_rng(1).normal(size=(20, 3)).astype(dtype)
    matrix[:, 0] = 1000 + np.arange(20) / 1024
    batch = pack_samples(matrix, COLUMNS, session="s1", epoch=0, seq=4)
    assert len(batch.samples) == 20 * 3 * np.dtype(dtype).itemsize
    assert np.array_equal(unpack_samples(decode(*encode(batch), SampleBatch)), matrix.astype(np.float64))


@given(
    st.lists(st.floats(-1e10, 1e10), min_size=1, max_size=20),
    st.sampled_from([1e-9, 1e-3, 0.005, 1.0]),
)
def test_times_are_the_same_to_the_last_bit_wherever_a_batch_begins(steps, unit):
    # Else how samples are cut into batches changed results in their last bits.
    matrix = np.column_stack([unit * np.array(steps)] * 3)
    batch = pack_samples(matrix, COLUMNS, session="s1", epoch=0, seq=0)
    assert np.array_equal(unpack_samples(batch), matrix)


def test_samples_are_little_endian_whatever_the_machine():
    matrix = np.array([[2.0, 0.5, 0.25]]).astype(">f8")
    batch = pack_samples(matrix, COLUMNS, session="s1", epoch=0, seq=0)
    assert batch.samples == struct.pack("<3d", 0.0, 0.5, 0.25)


@pytest.mark.parametrize("rows", [1, MAX_BATCH_SAMPLES])
def test_the_smallest_and_the_largest_batch_travel(rows):
    columns = ("t", *(f"c{i}" for i in range(63)))
    batch = pack_samples(np.ones((rows, 64)), columns, session="s1", epoch=0, seq=0)
    assert unpack_samples(decode(*encode(batch), SampleBatch)).shape == (rows, 64)


@pytest.mark.parametrize(
    "changes",
    [
        {"n": 0},
        {"n": MAX_BATCH_SAMPLES + 1},
        {"columns": ["t"]},
        {"columns": ["t"] * 65},
        {"samples": "text"},
    ],
    ids=str,
)
def test_a_batch_out_of_bounds_is_malformed(changes):
    batch = pack_samples(np.ones((2, 3)), COLUMNS, session="s1", epoch=0, seq=0)
    payload = msgpack.packb(batch.model_dump() | changes)
    assert refusal_of(payload, encoding_of(SampleBatch), SampleBatch).code == "malformed"


@pytest.mark.parametrize("size", [0, 1, 23, 25, 47, 49, 96])
def test_samples_of_another_size_are_malformed_and_both_sizes_are_named(size):
    batch = SampleBatch(session="s1", epoch=0, seq=0, n=2, columns=COLUMNS, t0=0.0, samples=bytes(size))
    with pytest.raises(ProtocolError) as refused:
        unpack_samples(batch)
    assert (refused.value.value, refused.value.expected) == (size, [24, 48])


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_sample_that_is_not_finite_is_named(value):
    matrix = np.ones((4, 3))
    matrix[2, 1] = value
    with pytest.raises(ProtocolError, match="sample 2 of batch 9: px is not finite"):
        unpack_samples(pack_samples(matrix, COLUMNS, session="s1", epoch=0, seq=9))


def test_the_first_column_must_be_the_time():
    batch = pack_samples(np.ones((1, 3)), ("px", "t", "py"), session="s1", epoch=0, seq=0)
    with pytest.raises(ProtocolError, match="first column is not t"):
        unpack_samples(batch)


@pytest.mark.parametrize("code", ERROR_CODES)
def test_errors_round_trip(code):
    error = ProtocolError(code, "no", value=[1, "a"], limit=2**70, expected={"b": b"\x00\xff"})
    back = decode_error(*encode_error(error))
    assert (back.code, back.message, back.value) == (code, "no", (1, "a"))
    assert str(back).startswith(f"{code}: no")


def test_an_error_carries_no_more_than_a_glimpse_of_what_was_wrong():
    error = ProtocolError(
        "malformed", "x" * 100_000, value=b"x" * 10_000_000, expected=[["x" * 9999] * 99] * 99
    )
    assert len(encode_error(error).payload) < 16384


def test_whatever_arrives_only_a_protocol_error_escapes():
    """2000 payloads, random or mutated from valid ones, against all types."""
    rng = random.Random(20260314)
    batch = pack_samples(np.ones((3, 3)), COLUMNS, session="s1", epoch=0, seq=0)
    seeds = [
        encode(batch),
        encode(Close(session="s1", last_seq=3)),
        encode(Open(session="s1", columns=COLUMNS)),
    ]
    models = list(MESSAGE_TYPES.values())
    survived = 0
    for _ in range(2000):
        payload, encoding = rng.choice(seeds)
        if rng.random() < 0.3:
            payload, encoding = rng.randbytes(rng.randrange(60)), encoding_of(rng.choice(models))
        mutated = bytearray(payload)
        for _ in range(rng.randrange(4)):
            if mutated:
                mutated[rng.randrange(len(mutated))] = rng.randrange(256)
        if rng.random() < 0.2:
            encoding = "".join(rng.choice(encoding + "é\x00;v9") for _ in range(len(encoding)))
        try:
            message = decode(bytes(mutated), encoding, *models)
            survived += 1
            if isinstance(message, SampleBatch):
                assert np.isfinite(unpack_samples(message)).all()
        except ProtocolError as refused:
            encode_error(refused)
    assert 0 < survived < 2000
