"""Versions of a program, decoded from what is new in each: the result is that of the codec."""

from __future__ import annotations

import tracemalloc

import msgpack
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from caesura_clients.program_decoder import BLOCK, ProgramDecoder, common_bytes
from caesura_protocol.codec import decode, encode, encoding_of
from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import App, Program
from clients.examples import example
from harness.heavy import FILLINGS, array_of

ENCODING = encoding_of(Program)


def program(version: int, confidences: list[float]) -> Program:
    """With an app for each of these."""
    app = example(App)
    apps = tuple(app.model_copy(update={"confidence": one}) for one in confidences)
    return example(Program).model_copy(update={"version": version, "apps": apps})


@settings(max_examples=50, deadline=None, derandomize=True)
@given(st.lists(st.lists(st.floats(0.0, 1.0), max_size=20), min_size=1, max_size=6))
def test_each_version_is_what_the_codec_reads(versions: list[list[float]]):
    decoder = ProgramDecoder()
    for number, confidences in enumerate(versions):
        sent = encode(program(number, confidences))
        assert decoder.decode(sent.payload) == decode(*sent, Program)


def test_apps_that_are_as_before_are_not_read_again():
    decoder = ProgramDecoder()
    first = decoder.decode(encode(program(1, [0.5, 0.25, 0.75])).payload)
    second = decoder.decode(encode(program(2, [0.5, 0.25, 0.125, 0.375])).payload)
    same = [one is other for one, other in zip(first.apps, second.apps, strict=False)]
    assert same == [True, True, False]


@pytest.mark.parametrize(
    "spoil",
    [
        lambda fields: fields.pop("apps"),
        lambda fields: fields.update(apps=7),
        lambda fields: fields["apps"].append({}),
        lambda fields: fields["apps"][0].update(kind="dance"),
        lambda fields: fields.update(version=-1),
    ],
)
def test_a_program_that_is_none_is_refused_as_the_codec_refuses_it_and_the_next_is_read(spoil):
    decoder, good = ProgramDecoder(), encode(program(1, [0.5, 0.25]))
    decoder.decode(good.payload)
    fields = msgpack.unpackb(good.payload)
    spoil(fields)
    with pytest.raises(ProtocolError) as refused:
        decode(msgpack.packb(fields), ENCODING, Program)
    with pytest.raises(ProtocolError, match=refused.value.code):
        decoder.decode(msgpack.packb(fields))
    assert decoder.decode(good.payload) == decode(*good, Program)


@pytest.mark.parametrize(
    "payload", [b"", b"\xc1", b"\x81", b"\x81\xa4apps\xdd\xff\xff\xff\xff", b"\xdf" * 40]
)
def test_bytes_that_are_no_message_are_refused(payload: bytes):
    with pytest.raises(ProtocolError):
        ProgramDecoder().decode(payload)


@pytest.mark.parametrize("same", [0, 1, BLOCK - 1, BLOCK, BLOCK + 1, 3 * BLOCK])
def test_the_first_other_byte_is_found_in_any_block(same: int):
    assert common_bytes(b"a" * same + b"b", b"a" * same + b"c") == same
    assert common_bytes(b"a" * same, b"a" * same + b"c") == same


def test_a_list_that_cannot_be_of_apps_is_refused_without_a_look_at_each():
    """A megabyte of integers took 98 MB, and a program may have 64 of these."""
    payload = b"\x81" + msgpack.packb("apps") + msgpack.packb([1] * 1_000_000)
    tracemalloc.start()
    with pytest.raises(ProtocolError, match="malformed"):
        ProgramDecoder().decode(payload)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 20_000_000


@pytest.mark.parametrize("filling", ["empty arrays", "empty maps", "empty extensions"])
def test_a_name_that_is_no_text_is_refused_before_it_is_unpacked(filling: str):
    """A megabyte of empty arrays in the place of a name took 0.4 s and 68 MB."""
    payload = b"\x81" + array_of(FILLINGS[filling], 1_000_000) + b"\x01"
    tracemalloc.start()
    with pytest.raises(ProtocolError, match="malformed"):
        ProgramDecoder().decode(payload)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 12_000_000
