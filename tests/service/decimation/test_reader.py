"""Every point is a sample of the journal, every bin keeps its extremes, and what is missing is said."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from caesura_protocol.codec import pack_samples
from caesura_protocol.derived_columns import ROTATION
from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import MAX_BINS, SampleRange
from caesura_protocol.messages import MAX_COLUMNS
from caesura_protocol.minmax_decimation import unpack_points
from caesura_service.decimation import SampleReader, overview
from caesura_service.decimation.batch_decoder import BatchDecoder
from caesura_service.decimation.overview import SAMPLES_PER_BIN
from caesura_service.decimation.reader import Owned
from caesura_service.journal import FileBatches, JournalBatches, MemoryJournal, Record, SqliteJournal
from harness.journals import COLUMNS, TURNING_COLUMNS, ended, taught, turning, written
from harness.processes import eventually
from harness.sessions import opening
from service.decimation.oracle import check

CLOSED = Owned("cell-1", "s1", "caesura-1", 1, is_open=False)
OPEN = CLOSED._replace(is_open=True)


@pytest.fixture
def hurdles() -> np.ndarray:
    """A minute at 500 Hz with a pause of 4 s, samples that repeat, and one time that goes back."""
    matrix = taught(60.0, 500.0)
    matrix[10_000:, 0] += 4.0
    matrix[15_000, 0] = matrix[14_998, 0]
    return matrix


def advancing(matrix: np.ndarray) -> np.ndarray:
    highest = np.maximum.accumulate(np.concatenate([[-np.inf], matrix[:-1, 0]]))
    return matrix[matrix[:, 0] > highest]


@pytest.mark.slow
@pytest.mark.parametrize(
    "wanted",
    [
        SampleRange(0.0, 64.0, 100),
        SampleRange(0.0, 64.0, 7),
        SampleRange(-10.0, 100.0, 333),
        SampleRange(12.34, 15.0, 1200),
        SampleRange(19.5, 24.5, 40),
        SampleRange(33.9, 34.1, 4096),
    ],
)
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_every_point_is_a_sample_and_every_bin_keeps_its_extremes(tmp_path, hurdles, wanted, dtype):
    sent = hurdles.astype(dtype)
    written(tmp_path, sent)
    recorded = SampleReader(FileBatches(tmp_path)).read(CLOSED, wanted)
    kept = unpack_points(SampleReader(FileBatches(tmp_path)).read(CLOSED, SampleRange(0.0, 0.001, 1)))
    assert set(kept) == {*COLUMNS[1:], "speed"}
    if dtype is np.float64:
        assert check(recorded, advancing(hurdles), COLUMNS) > 0
    else:
        samples = set(sent[:, 6].astype(float).tolist())
        assert {value for _, value in unpack_points(recorded)["fz"]} <= samples


def test_holes_are_stated_with_their_reason_and_nothing_is_drawn_in_them(tmp_path, hurdles):
    written(tmp_path, hurdles, lost=(50, 51, 900))
    recorded = SampleReader(FileBatches(tmp_path)).read(CLOSED, SampleRange(0.0, 64.0, 500))
    stated = [(round(hole.t0, 3), round(hole.tn, 3), hole.reason) for hole in recorded.holes]
    assert stated == [(1.998, 2.08, "evicted"), (19.998, 24.0, "source"), (39.998, 40.04, "evicted")]
    for found in unpack_points(recorded).values():
        for hole in recorded.holes:
            assert not ((found[:, 0] > hole.t0) & (found[:, 0] < hole.tn)).any()
    assert (recorded.first, recorded.last) == (0.0, pytest.approx(63.998))
    nothing = SampleReader(FileBatches(tmp_path)).read(CLOSED, SampleRange(20.5, 23.5, 100))
    assert set(nothing.counts) == {0}


def test_the_speed_is_that_between_two_means_and_absent_behind_a_hole(tmp_path, hurdles):
    written(tmp_path, hurdles)
    recorded = SampleReader(FileBatches(tmp_path)).read(
        CLOSED, SampleRange(19.0, 25.0, 4096, columns=("speed", "fz", "q1"))
    )
    assert recorded.columns == ("fz", "speed")
    t, place = hurdles[:, 0], hurdles[:, 1:4]
    for at, speed in unpack_points(recorded)["speed"][::50]:
        newer, older = ((t > at - back) & (t <= at - back + 0.04) for back in (0.04, 0.08))
        moved = place[newer].mean(axis=0) - place[older].mean(axis=0)
        assert speed == pytest.approx(np.linalg.norm(moved) / (t[newer].mean() - t[older].mean()), rel=1e-6)
    times = unpack_points(recorded)["speed"][:, 0]
    assert not ((times > 20.0) & (times < 24.07)).any()


def rotated(matrix: np.ndarray) -> np.ndarray:
    """The rotation vectors (n, 3) of samples with TURNING_COLUMNS, from the first of them on."""
    there = Rotation.from_quat(matrix[:, 7:])
    return (there * there[0].inv()).as_rotvec()


def test_rotations_are_relative_to_the_first_orientation_and_the_same_at_every_zoom(tmp_path):
    """The tool turns beyond a half turn, where the vector jumps; quaternions change their sign."""
    sent = turning(60.0, 500.0)
    sent[:10, 7:] = 0.0  # none yet
    sent[10_000:, 0] += 4.0
    written(tmp_path, sent, columns=TURNING_COLUMNS, lost=(900,))
    expected = dict(zip(sent[10:, 0].tolist(), rotated(sent[10:]), strict=True))
    jumps = np.linalg.norm(np.diff(rotated(sent[10:]), axis=0), axis=1) > np.pi
    assert jumps.any()
    reader, seen = SampleReader(FileBatches(tmp_path)), dict[float, list[float]]()
    for wanted in (
        SampleRange(0.0, 64.0, 100, ROTATION),
        SampleRange(12.0, 30.0, 900, ROTATION),
        SampleRange(15.0, 17.0, 4096, ROTATION),
        SampleRange(39.9, 40.1, 4096, ROTATION),
    ):
        recorded = reader.read(CLOSED, wanted)
        assert recorded.columns == ROTATION
        assert recorded.first_orientation == tuple(sent[10, 7:].tolist())
        for axis, (name, points) in enumerate(unpack_points(recorded).items()):
            assert len(points) > 50
            for t, value in points.tolist():
                assert value == pytest.approx(expected[t][axis], abs=1e-9)
                assert seen.setdefault((name, t), value) == value, "the bits of the other zooms"
    points = unpack_points(reader.read(CLOSED, SampleRange(0.0, 64.0, 4096, ROTATION)))
    for axis, name in enumerate(ROTATION):
        values = rotated(sent[10:])[:, axis]
        assert points[name][:, 1].min() == pytest.approx(values.min(), abs=1e-9)
        assert points[name][:, 1].max() == pytest.approx(values.max(), abs=1e-9)


def test_rotations_are_the_same_from_a_kept_overview_and_while_the_session_goes_on(tmp_path):
    sent, ranges = turning(30.0, 500.0), (SampleRange(0.0, 30.0, 50), SampleRange(20.0, 22.0, 900))
    written(tmp_path, sent[:7500], columns=TURNING_COLUMNS)
    reader = SampleReader(FileBatches(tmp_path))
    reader.read(OPEN, ranges[0])
    with SqliteJournal(tmp_path / "caesura-1.sqlite") as journal:
        for seq in range(375, 750):
            rows = sent[seq * 20 : (seq + 1) * 20]
            batch = pack_samples(rows, TURNING_COLUMNS, session="s1", epoch=0, seq=seq)
            journal.append(Record("cell-1", "s1", 3.0, batch))
    live = [reader.read(OPEN, wanted) for wanted in ranges]
    with SqliteJournal(tmp_path / "caesura-1.sqlite") as journal:
        SampleReader(FileBatches(tmp_path, journal)).read(CLOSED, ranges[0])  # keeps its overview
    again = SampleReader(FileBatches(tmp_path))
    for wanted, before in zip(ranges, live, strict=True):
        recorded = again.read(CLOSED, wanted)
        assert recorded.first_orientation == before.first_orientation == tuple(sent[0, 7:].tolist())
        assert all(
            np.array_equal(unpack_points(recorded)[name], unpack_points(before)[name]) for name in ROTATION
        )


def test_an_overview_of_an_older_version_is_made_anew(tmp_path, monkeypatch):
    written(tmp_path, turning(20.0), columns=TURNING_COLUMNS, closed=ended("motion", t=20.0))
    wanted = SampleRange(0.0, 20.0, 10)
    monkeypatch.setattr(overview, "VERSION", overview.VERSION - 1)
    with SqliteJournal(tmp_path / "caesura-1.sqlite") as journal:
        before = SampleReader(FileBatches(tmp_path, journal)).read(CLOSED, wanted)
    monkeypatch.undo()
    source, reads = FileBatches(tmp_path), []
    pages = source.pages
    source.pages = lambda *args: reads.append(args) or pages(*args)
    assert SampleReader(source).read(CLOSED, wanted) == before
    assert len(reads) == 1


def test_a_session_without_orientation_has_no_rotations(tmp_path):
    columns = (*COLUMNS, "qx", "qy", "qz")  # an incomplete quaternion is none
    written(tmp_path, turning(5.0)[:, :10], columns=columns)
    recorded = SampleReader(FileBatches(tmp_path)).read(CLOSED, SampleRange(0.0, 5.0, 10))
    assert recorded.available == (*columns[1:], "speed")
    assert recorded.first_orientation is None


def test_a_quaternion_of_zeros_is_no_orientation(tmp_path):
    sent = turning(5.0)
    sent[:, 7:] = 0.0
    written(tmp_path, sent, columns=TURNING_COLUMNS)
    recorded = SampleReader(FileBatches(tmp_path)).read(CLOSED, SampleRange(0.0, 5.0, 10, ROTATION))
    assert (recorded.counts, recorded.first_orientation) == ((0, 0, 0), None)


def test_a_session_of_as_many_columns_as_there_may_be_is_answered(tmp_path):
    sent = turning(1.0)
    columns = (*TURNING_COLUMNS, *(f"c{number}" for number in range(MAX_COLUMNS - len(TURNING_COLUMNS))))
    sent = np.hstack([sent, np.zeros((len(sent), MAX_COLUMNS - len(TURNING_COLUMNS)))])
    written(tmp_path, sent, columns=columns)
    recorded = SampleReader(FileBatches(tmp_path)).read(CLOSED, SampleRange(0.0, 1.0, 10))
    assert recorded.available == (*columns[1:], "speed", *ROTATION)


def test_batches_that_came_out_of_turn_are_read_in_order(tmp_path):
    matrix = taught(20.0, 500.0)
    journal, reader = MemoryJournal(), None
    journal.append(Record("cell-1", "s1", 1.0, opening(columns=COLUMNS)))
    order = np.arange(500)
    order[100:140] = order[100:140][::-1]

    reader = SampleReader(JournalBatches(journal))
    for count, seq in enumerate(order):
        rows = matrix[seq * 20 : (seq + 1) * 20]
        batch = pack_samples(rows, COLUMNS, session="s1", epoch=0, seq=int(seq))
        journal.append(Record("cell-1", "s1", 2.0, batch))
        if count % 90 == 0:
            reader.read(OPEN, SampleRange(0.0, 20.0, 50))
    whole = reader.read(OPEN, SampleRange(0.0, 20.0, 50))
    assert check(whole, matrix, COLUMNS) > 0
    assert whole.holes == ()
    assert check(reader.read(OPEN, SampleRange(3.9, 5.7, 900)), matrix, COLUMNS) > 0


def test_a_session_that_grows_is_read_on_and_not_again(tmp_path):
    matrix = taught(30.0, 500.0)
    reader, reads = SampleReader(FileBatches(tmp_path)), []
    source = reader._source
    pages = source.pages
    source.pages = lambda key, extent, beyond, last: reads.append(beyond) or pages(key, extent, beyond, last)
    written(tmp_path, matrix[:7500])
    reader.read(OPEN, SampleRange(0.0, 30.0, 10))

    with SqliteJournal(tmp_path / "caesura-1.sqlite") as journal:
        for seq in range(375, 750):
            batch = pack_samples(matrix[seq * 20 : (seq + 1) * 20], COLUMNS, session="s1", epoch=0, seq=seq)
            journal.append(Record("cell-1", "s1", 3.0, batch))
    assert check(reader.read(OPEN, SampleRange(0.0, 30.0, 10)), matrix, COLUMNS) > 0
    assert reads == [-1, 376]


def test_lengths_are_metres_whatever_the_bridge_sends():
    journal = MemoryJournal()
    journal.append(Record("cell-1", "s1", 1.0, opening(columns=("t", "px", "py", "pz"), length_unit="mm")))

    rows = np.column_stack([np.arange(20) / 100, *np.full((3, 20), 250.0)])
    journal.append(
        Record("cell-1", "s1", 2.0, pack_samples(rows, ("t", "px", "py", "pz"), session="s1", epoch=0, seq=0))
    )
    recorded = SampleReader(JournalBatches(journal)).read(CLOSED, SampleRange(0.0, 1.0, 100))
    assert unpack_points(recorded)["px"][0, 1] == 0.25


def test_no_answer_reads_a_whole_session_whose_rate_rises(tmp_path):
    """Its overview has wide bins, so that each view of all of it read every sample: 5 s for ten minutes."""
    slow, fast = taught(1600.0, 5.0), taught(250.0, 1000.0)
    fast[:, 0] += 1600.0
    sent = np.concatenate([slow, fast])
    written(tmp_path, sent)
    reader, decoded = SampleReader(FileBatches(tmp_path)), []
    whole = SampleRange(0.0, 1850.0, MAX_BINS)
    reader.read(CLOSED, SampleRange(0.0, 1850.0, 1))
    push = BatchDecoder.push

    def counting(self, batches):
        decoded.append(sum(one.n for one in batches))
        return push(self, batches)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(BatchDecoder, "push", counting)
        recorded = reader.read(CLOSED, whole)
        near = reader.read(CLOSED, SampleRange(1700.0, 1740.0, MAX_BINS))
    assert sum(decoded) < 2 * MAX_BINS * SAMPLES_PER_BIN
    assert recorded.bin_s == pytest.approx(10.0)
    assert near.bin_s == pytest.approx(40.0 / MAX_BINS)
    for answer in (recorded, near):
        assert check(answer, sent, COLUMNS) > 0


def test_a_session_without_records_is_refused_by_name(tmp_path):
    written(tmp_path, taught(1.0))
    with pytest.raises(ProtocolError, match="unknown_session") as refused:
        SampleReader(FileBatches(tmp_path)).read(CLOSED._replace(session="s2"), SampleRange(0.0, 1.0, 10))
    assert refused.value.value == "cell-1/s2"


def test_a_session_that_is_read_in_slices_is_answered_alike(tmp_path, hurdles):
    written(tmp_path, hurdles, lost=(50, 51, 900))
    wanted = SampleRange(0.0, 64.0, 100)
    source, finds = FileBatches(tmp_path), []
    find = source.find
    source.find = lambda key: finds.append(key) or find(key)
    reader, slices = SampleReader(source), 1
    while (reply := reader.read(CLOSED, wanted, slice_s=0.0)) is None:
        slices += 1
    assert slices > 5
    assert len(finds) == slices, "the journals are searched once for a slice"
    assert reply == SampleReader(FileBatches(tmp_path)).read(CLOSED, wanted)


@pytest.mark.parametrize("spoilt", [False, True])
def test_a_kept_overview_answers_alike_and_a_damaged_one_is_made_again(tmp_path, hurdles, spoilt):
    written(tmp_path, hurdles, lost=(50, 51, 900), closed=ended("motion", t=64.0))
    ranges = (SampleRange(0.0, 64.0, 100), SampleRange(19.0, 25.0, 900))
    with SqliteJournal(tmp_path / "caesura-1.sqlite") as journal:
        made = SampleReader(FileBatches(tmp_path, journal))
        before = [made.read(CLOSED, wanted) for wanted in ranges]
        if spoilt:
            journal._database.execute("UPDATE overviews SET payload = zeroblob(length(payload))")
    source, reads = FileBatches(tmp_path), []
    pages = source.pages
    source.pages = lambda *args: reads.append(args) or pages(*args)
    again = SampleReader(source)
    assert [again.read(CLOSED, wanted) for wanted in ranges] == before
    assert len(reads) == (2 if spoilt else 1), "the whole session only where no overview can be used"


def test_an_overview_goes_with_its_session(tmp_path):
    written(tmp_path, taught(20.0), closed=ended("motion", t=20.0))
    with SqliteJournal(tmp_path / "caesura-1.sqlite") as journal:
        SampleReader(FileBatches(tmp_path, journal)).read(CLOSED, SampleRange(0.0, 20.0, 10))
        count = "SELECT count(*) FROM overviews"
        assert journal._database.execute(count).fetchone() == (1,)
        journal.delete("cell-1", "s1")
        eventually(lambda: journal._database.execute(count).fetchone() == (0,))


def test_of_many_overviews_only_the_newest_are_kept(tmp_path):
    for session in ("s1", "s2", "s3"):
        written(tmp_path, taught(20.0, 500.0), session=session, closed=ended("motion", t=20.0))
    reader = SampleReader(FileBatches(tmp_path), held_bytes=40_000)
    for session in ("s1", "s2", "s3"):
        reader.read(CLOSED._replace(session=session), SampleRange(0.0, 20.0, 10))
    assert [key[1] for key in reader._overviews] == ["s3"]
