"""Replies to a replay: consecutive batches come in blocks, in order, and nothing else is held up."""

from __future__ import annotations

import numpy as np

from caesura_protocol.codec import encode, pack_samples
from caesura_service.server.inbound_events import RawPayload
from caesura_service.server.replay_reply_collector import MOST, ReplayBlocks

KEY = "caesura/v1/station/cell-1/samples"


def batch(seq: int) -> RawPayload:
    packed = pack_samples(np.full((2, 2), 0.1 * seq), ("t", "px"), session="s1", epoch=0, seq=seq)
    return RawPayload.of(KEY, *encode(packed))


def passed(replies: list[RawPayload]) -> list[object]:
    """Return the numbers of each block, and the payloads that come alone, after the end."""
    found: list[object] = []
    blocks = ReplayBlocks(
        lambda reply: found.append(reply.payload),
        lambda block: found.append([block.first + place for place in range(len(block.payloads))]),
    )
    for reply in replies:
        blocks.receive(reply)
    blocks.end()
    return found


def test_consecutive_replies_come_in_blocks_of_so_many_at_most():
    assert passed([batch(seq) for seq in range(200, 201 + MOST)]) == [
        [*range(200, 200 + MOST)],
        [200 + MOST],
    ]


def test_a_hole_and_what_is_no_batch_begin_anew_and_nothing_is_overtaken():
    rubbish = RawPayload.of(KEY, b"rubbish", batch(0).encoding)
    replies = [batch(3), batch(4), batch(6), rubbish, batch(7)]
    assert passed(replies) == [[3, 4], [6], b"rubbish", [7]]
