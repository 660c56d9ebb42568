"""Long work in slices: others have their turn in between, and nothing comes out otherwise."""

from __future__ import annotations

import gc
import time
import weakref
from collections.abc import Callable
from contextlib import nullcontext
from functools import cache, partial
from typing import Any

import numpy as np
import pytest
from greenlet import getcurrent

from caesura_protocol.codec import pack_samples
from caesura_protocol.messages import Ack, Edit, Insert, Open, SampleBatch
from caesura_service.cooperative_scheduler import Slices, give_way, stand_aside
from caesura_service.journal import MemoryJournal
from caesura_service.ownership.registry import Registry
from caesura_service.publishing.events import Output, Owner, Publish
from caesura_service.publishing.session_state import SessionState
from caesura_service.segmentation.pipeline import make_pipeline
from caesura_service.sessions.limits import Limits
from harness.demonstrations import taught
from harness.sessions import answer

STATION, NAME = "cell-1", "s1"


def counting(seen: list[str], name: str, to: int) -> Callable[[], None]:
    def work() -> None:
        for number in range(to):
            seen.append(f"{name}{number}")
            give_way()

    return work


def test_work_goes_on_where_it_stopped_and_others_have_their_turn_in_between():
    slices, seen = Slices(slice_s=0.0), list[str]()
    give_way()  # no work is under way: it does nothing
    assert not slices.begin("a", counting(seen, "a", 2))
    assert not slices.begin("b", counting(seen, "b", 1))
    assert not slices.go_on("a")
    assert slices.go_on("b")
    assert slices.go_on("a")
    assert seen == ["a0", "b0", "a1"]
    assert slices.go_on("a"), "nothing is left"


def test_a_slice_that_is_long_enough_is_the_whole_work():
    seen: list[str] = []
    assert Slices(slice_s=60.0).begin("a", counting(seen, "a", 100))
    assert len(seen) == 100


def test_work_is_finished_at_once_from_anywhere_and_the_caller_goes_on():
    slices, seen = Slices(slice_s=0.0), list[str]()
    slices.begin("a", counting(seen, "a", 3))

    def asking() -> None:
        slices.finish("a")
        seen.append("asked")

    assert slices.begin("b", asking)
    assert seen == ["a0", "a1", "a2", "asked"]


def test_work_that_stands_aside_is_finished_too():
    """A takeover began although the station's program was still to be made."""
    slices, seen = Slices(slice_s=0.0), list[str]()

    def work() -> None:
        give_way()
        seen.append("segments")
        stand_aside()
        seen.append("program")

    assert not slices.begin("a", work)
    slices.finish("a")
    assert seen == ["segments", "program"]
    assert not slices.is_under_way("a")


def test_work_stands_aside_before_its_slice_is_over_and_the_next_work_does_not():
    slices, seen = Slices(slice_s=60.0), list[str]()
    stand_aside()  # no work is under way: it does nothing

    def work() -> None:
        seen.append("segments")
        stand_aside()
        seen.append("program")

    assert not slices.begin("a", work)
    assert slices.stands_aside("a")
    assert seen == ["segments"]
    assert slices.go_on("a")
    assert seen == ["segments", "program"]
    assert not slices.stands_aside("a")

    slices.slice_s = 0.0
    assert not slices.begin("a", counting(seen, "a", 2)), "on the same stack"
    assert not slices.stands_aside("a")
    slices.finish("a")


def test_an_error_ends_the_work_and_reaches_the_caller_of_the_slice():
    def breaking() -> None:
        give_way()
        raise RuntimeError("broken")

    slices = Slices(slice_s=0.0)
    assert not slices.begin("a", breaking)
    with pytest.raises(RuntimeError, match="broken"):
        slices.go_on("a")
    assert not slices.is_under_way("a")


def test_a_stack_is_used_again_also_after_an_error_and_keeps_nothing_of_its_work():
    slices, stacks = Slices(), set[int]()

    class Held:
        pass

    def work(held: Held, *, breaks: bool) -> None:
        stacks.add(id(getcurrent()))
        if breaks:
            raise RuntimeError(str(held))

    for number in range(6):
        held = Held()
        known = weakref.ref(held)
        with pytest.raises(RuntimeError) if number % 2 else nullcontext():
            slices.begin("a", partial(work, held, breaks=bool(number % 2)))
        del held
        assert known() is None
    assert len(stacks) == 1


def test_what_is_left_off_closes_what_it_had_opened():
    slices, closed = Slices(slice_s=0.0), list[bool]()

    def work() -> None:
        try:
            give_way()
        finally:
            closed.append(True)

    slices.begin("a", work)
    slices.stop()
    assert closed == [True]


# --- sessions -------------------------------------------------------------------------------------------


def registry(slice_s: float) -> Registry:
    made = Registry(
        owner=Owner("test-1", 1),
        pipeline_factory=make_pipeline,
        default_preset="default",
        journal=MemoryJournal(),
        limits=Limits(),
    )
    made.slices.slice_s = slice_s
    return made


@cache
def sparse(seconds: float = 60.0) -> tuple[Open, list[SampleBatch]]:
    """A demonstration of 20 samples a second in two batches: hundreds of observations each."""
    recording = taught(3, seconds)
    rows = recording.matrix()[::10]
    opening = Open(session=NAME, columns=recording.columns, wrench_source="flange_sensor")
    halves = enumerate(np.array_split(rows, 2))
    return opening, [
        pack_samples(half, recording.columns, session=NAME, epoch=0, seq=seq) for seq, half in halves
    ]


def in_slices(
    registry: Registry, work: Callable[[], list[Output]], between: Callable[[], Any]
) -> tuple[list[Output], int]:
    """What a piece of work says, and how many slices it took."""
    said: list[Output] = []
    done, count = registry.slices.begin(STATION, lambda: said.extend(work())), 1
    while not done:
        between()
        done, count = registry.slices.go_on(STATION), count + 1
    return said, count


def standing(registry: Registry) -> SessionState:
    (only,) = registry.index.sessions[STATION]
    return only.state


def messages(said: list[Output]) -> list[Any]:
    return [one.message for one in said if isinstance(one, Publish)]


def test_a_dense_batch_and_an_edit_in_slices_say_what_they_say_at_once_and_no_view_has_half_of_them():
    opening, sent = sparse()
    insert = Edit(session=NAME, revision=0, author="Ann", action=Insert(t=20.4))
    whole, sliced = registry(60.0), registry(0.0)
    for made in (whole, sliced):
        made.handle_command(STATION, opening, 0.0)
    for act in (
        lambda made: made.handle_samples(STATION, sent[0], 1.0),
        lambda made: made.handle_command(STATION, insert, 2.0),
        lambda made: made.handle_samples(STATION, sent[1], 3.0),
    ):
        before, seen = standing(sliced), list[SessionState]()
        expected = act(whole)
        said, count = in_slices(
            sliced, lambda act=act: act(sliced), lambda seen=seen: seen.append(standing(sliced))
        )
        assert count > 100, "observations, each a slice of its own"
        assert all(one == before for one in seen)
        assert messages(said) == messages(expected)
    assert isinstance(answer(sliced.handle_command(STATION, opening, 4.0)), Ack)


@pytest.mark.slow
def test_no_piece_of_a_batch_in_which_everything_is_a_segment_is_a_large_part_of_it():
    columns, rng = ("t", "px", "py", "pz"), np.random.default_rng(0)
    t = 0.059 * np.arange(2 * 1000)
    rows = np.column_stack([t, np.sin(t)[:, None] + 0.01 * rng.standard_normal((len(t), 3))])
    opening = Open(
        session=NAME,
        columns=columns,
        wrench_source="none",
        preset="constant_velocity",
        declared_units=("length",),
    )
    first, second = (
        pack_samples(half, columns, session=NAME, epoch=0, seq=seq)
        for seq, half in enumerate(np.array_split(rows, 2))
    )
    made, at = registry(0.0), list[float]()
    made.handle_command(STATION, opening, 0.0)
    made.handle_samples(STATION, first, 1.0)
    gc.disable()  # what others have left behind is no part of it
    try:
        at.append(time.thread_time())
        in_slices(
            made, lambda: made.handle_samples(STATION, second, 2.0), lambda: at.append(time.thread_time())
        )
        at.append(time.thread_time())
    finally:
        gc.enable()
    assert len(standing(made).view.segments) > 1000
    longest, whole = max(np.diff(at)), at[-1] - at[0]
    assert longest < whole / 10, f"a piece takes {1e3 * longest:.0f} of {1e3 * whole:.0f} ms"


def test_what_is_said_of_a_session_between_two_slices_is_not_taken_back():
    opening, sent = sparse()
    made = registry(0.0)
    made.handle_command(STATION, opening, 0.0)
    said, _ = in_slices(
        made, lambda: made.handle_samples(STATION, sent[0], 1.0), lambda: made.report_dropped(STATION, 1)
    )
    assert said
    assert standing(made).counters.dropped > 100
    assert standing(made).counters.batches == 1


def test_before_a_station_changes_hands_its_work_is_done():
    opening, sent = sparse()
    made = registry(0.0)
    made.handle_command(STATION, opening, 0.0)
    said: list[Output] = []
    assert not made.slices.begin(STATION, lambda: said.extend(made.handle_samples(STATION, sent[0], 1.0)))
    for _ in made.take_over(STATION, 2.0):
        pass
    assert messages(said)
    assert standing(made).counters.batches == 1
    assert made.slices.go_on(STATION)
