import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from caesura_clients.bridge.sources.file import FileSource
from caesura_clients.bridge.sources.paced_source import FAST, parse_pace
from caesura_clients.bridge.sources.registry import SourceOptions, open_source
from caesura_protocol.batching import Batcher
from caesura_protocol.errors import CaesuraError, SourceError
from caesura_protocol.recording import Recording
from clients.examples import recording
from harness.clock import Clock


def played(source, clock):
    return [(clock.now - 100.0, chunk) for chunk in source.chunks()]


@pytest.mark.parametrize("pace", [1.0, 2.0, 0.25])
def test_a_file_plays_at_its_pace(pace):
    clock = Clock(100.0)
    source = FileSource(recording(1000), pace=pace, clock=clock, sleep=clock.sleep)
    for when, chunk in played(source, clock):
        assert when == pytest.approx(chunk[-1, 0] / pace, abs=1e-9)
    assert clock.now - 100.0 == pytest.approx(0.999 / pace)


def test_a_fast_file_does_not_wait():
    clock = Clock(100.0)
    assert len(played(FileSource(recording(1000), pace=FAST, clock=clock, sleep=clock.sleep), clock)) == 50
    assert clock.now == 100.0


def test_a_file_that_was_held_up_makes_up_for_it():
    clock = Clock(100.0)
    for when, chunk in (
        (clock.now - 100.0, c) for c in FileSource(recording(), clock=clock, sleep=clock.sleep).chunks()
    ):
        if chunk[0, 0] == 0.0:
            clock.now += 0.5
        elif when > 0.6:
            assert when == pytest.approx(chunk[-1, 0], abs=1e-9)
    assert clock.now - 100.0 == pytest.approx(0.999)


def test_repeated_and_late_times_are_played_as_they_are():
    t = np.array([0.0, 0.01, 0.01, 0.005, 0.03, 2.0, 2.001])
    clock = Clock(100.0)
    source = FileSource(Recording(t=t, signals={"pos": np.zeros((7, 3))}), clock=clock, sleep=clock.sleep)
    pieces = played(source, clock)
    assert np.concatenate([chunk for _, chunk in pieces])[:, 0].tolist() == t.tolist()
    assert [len(chunk) for _, chunk in pieces] == [4, 1, 2]


@pytest.mark.parametrize("samples", [1, 2])
def test_the_shortest_recordings_play(samples):
    assert sum(map(len, FileSource(recording(samples), pace=FAST).chunks())) == samples


@pytest.mark.parametrize(("text", "pace"), [("real", 1.0), ("fast", FAST), ("2.0", 2.0), ("0.5", 0.5)])
def test_a_pace_has_a_name_or_a_number(text, pace):
    assert parse_pace(text) == pace


@pytest.mark.parametrize("text", ["", "slow", "0", "-1", "nan"])
def test_another_pace_is_refused(text):
    with pytest.raises(ValueError, match="expected real, fast or a number"):
        parse_pace(text)


@given(st.lists(st.integers(1, 60), max_size=20), st.integers(1, 50))
def test_batching_keeps_every_sample_in_order(sizes, batch_samples):
    batcher = Batcher(("t", "px"), batch_samples)
    rows = np.arange(2 * sum(sizes), dtype=float).reshape(-1, 2)
    starts = np.cumsum([0, *sizes])
    batches = [
        b
        for start, size in zip(starts, sizes, strict=False)
        for b in batcher.push(rows[start : start + size])
    ]
    assert all(len(batch) == batch_samples for batch in batches)
    batches += batcher.flush()
    assert np.array_equal(np.concatenate(batches) if batches else rows, rows)
    assert batcher.flush() == []


@pytest.mark.parametrize("step", [1, 7, 100])
def test_a_batch_ends_before_a_pause_longer_than_it_may_last(step):
    batcher = Batcher(("t", "px"), 20)
    t = 0.01 * np.arange(100) + 100.0 * (np.arange(100) >= 50)
    rows = np.column_stack([t, t])
    batches = [b for first in range(0, 100, step) for b in batcher.push(rows[first : first + step])]
    batches += batcher.flush()
    assert np.array_equal(np.concatenate(batches), rows)
    assert [len(b) for b in batches] == [20, 20, 10, 20, 20, 10]


def test_times_that_are_no_seconds_are_left_for_the_service_to_refuse():
    batcher = Batcher(("t", "px"), 20)
    rows = np.column_stack([1000.0 * np.arange(40)] * 2)
    assert [len(b) for b in batcher.push(rows)] == [20, 20]


@pytest.mark.parametrize("chunk", [[[0.0, 1.0]], np.array([["0", "1"]]), np.array([[0.0, 1j]])])
def test_a_chunk_that_is_no_array_of_numbers_is_refused(chunk):
    with pytest.raises(SourceError, match="expected an array of numbers"):
        Batcher(("t", "px"), 20).push(chunk)


def test_a_batch_does_not_share_memory_with_a_driver_that_reuses_its_buffer():
    batcher, buffer = Batcher(("t", "px"), 3), np.zeros((1, 2))
    for value in (1.0, 2.0):
        buffer[:] = value
        batcher.push(buffer)
    assert batcher.flush()[0][:, 0].tolist() == [1.0, 2.0]


@pytest.mark.parametrize("batch_samples", [0, 1001])
def test_a_batch_has_a_size_that_the_wire_allows(batch_samples):
    with pytest.raises(ValueError, match="1 to 1000"):
        Batcher(("t", "px"), batch_samples)


def test_sources_are_found_by_name(tmp_path):
    file = tmp_path / "recording.npz"
    recording(30).save(file)
    source = open_source("file", SourceOptions(file=file, pace=FAST, wrench_source="none", length_unit="mm"))
    assert (source.wrench_source, source.length_unit) == ("none", "mm")
    assert sum(map(len, source.chunks())) == 30


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("nothing", SourceOptions(), "expected one of file"),
        ("teacher", SourceOptions(scenario="juggling"), "juggling.*known"),
        ("teacher", SourceOptions(wrench_source="guess"), "guess.*flange_sensor"),
        ("file", SourceOptions(), "--file"),
        ("file", SourceOptions(file="missing.npz"), "no such file"),
        ("file", SourceOptions(file="missing.txt"), "suffix"),
    ],
)
def test_a_source_that_cannot_be_opened_says_why(name, options, message, tmp_path):
    if options.file:
        options = SourceOptions(file=tmp_path / options.file)
    with pytest.raises(CaesuraError, match=message):
        open_source(name, options)


def test_the_simulated_teacher_is_a_source():
    pytest.importorskip("pinocchio")
    source = open_source("teacher", SourceOptions(scenario="pick_and_place", seed=1, pace=FAST))
    chunk = next(source.chunks())
    assert chunk.shape == (20, len(source.columns))
    assert source.columns[0] == "t"
