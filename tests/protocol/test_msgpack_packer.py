"""Packing: the bytes of msgpack, whatever was packed before."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor

import msgpack
import pytest

from caesura_protocol.msgpack_packer import KEPT_BYTES, Packing


@pytest.mark.parametrize("value", [(1, None, 2.5, "x"), {"a": b"b"}, b"c" * (KEPT_BYTES + 1)])
def test_a_packer_that_is_used_again_gives_the_bytes_of_a_new_one(value: object) -> None:
    packing = Packing()
    assert [packing.pack(value) for _ in range(3)] == 3 * [msgpack.packb(value)]


def test_what_cannot_be_packed_leaves_nothing_behind() -> None:
    packing = Packing()
    with pytest.raises(TypeError):
        packing.pack((1, 2, object()))
    assert packing.pack(3) == msgpack.packb(3)


def test_what_stands_for_a_value_is_packed_in_its_place() -> None:
    assert Packing(str).pack([1j]) == msgpack.packb(["1j"])


def test_a_thread_packs_while_another_one_is_in_the_middle_of_a_value() -> None:
    begun, go_on = threading.Event(), threading.Event()

    def slowly(_: object) -> str:
        begun.set()
        go_on.wait(5.0)
        return "late"

    packing = Packing(slowly)
    with ThreadPoolExecutor(1) as pool:
        slow = pool.submit(packing.pack, [1, object()])
        assert begun.wait(5.0)
        quick = packing.pack([2])
        go_on.set()
        assert slow.result(5.0) == msgpack.packb([1, "late"])
    assert quick == msgpack.packb([2])
