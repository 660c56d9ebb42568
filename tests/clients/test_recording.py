import numpy as np
import pytest

from caesura_protocol.errors import CaesuraError
from caesura_protocol.formats.read import load_recording
from caesura_protocol.recording import Recording, RecordingError, did_you_mean
from clients.examples import recording


def test_a_recording_survives_its_file(tmp_path):
    written = recording(50)
    written.save(tmp_path / "a.npz")
    read = load_recording(tmp_path / "a.npz")
    assert np.array_equal(read.matrix(), written.matrix())
    assert (read.columns, read.name) == (("t", "px", "py", "pz", "fx", "fy", "fz"), "a.npz")


def test_what_the_file_declares_holds_unless_it_is_overridden(tmp_path):
    declared = Recording(
        t=np.zeros(2),
        signals={"pos": np.zeros((2, 3)), "force": np.zeros((2, 3)), "gripper": np.zeros((2, 1))},
        wrench_source="flange_sensor_with_hand",
        force_frame="flange",
        length_unit="mm",
    )
    declared.save(tmp_path / "a.npz")
    read = load_recording(tmp_path / "a.npz")
    assert (read.wrench_source, read.force_frame, read.length_unit) == (
        "flange_sensor_with_hand",
        "flange",
        "mm",
    )
    assert read.signals["gripper"].shape == (2, 1)
    assert load_recording(tmp_path / "a.npz", length_unit="cm").length_unit == "cm"


def test_what_an_option_replaces_is_named(tmp_path):
    """A Panda's joints were read as those of an iiwa14, which has as many, without a word."""
    stated = {
        "robot": "panda",
        "up": "z",
        "length_unit": "mm",
        "wrench_source": "none",
        "hand_on_robot": "no",
    }
    np.savez(tmp_path / "a.npz", t=np.arange(3.0), q=np.zeros((3, 7)), **stated)
    same = stated | {"up": "0,0,1"}
    assert load_recording(tmp_path / "a.npz", **same).cautions == ()
    others = {"robot": "iiwa14", "up": "-z", "length_unit": "m", "hand_on_robot": "yes"}
    read = load_recording(tmp_path / "a.npz", **others, wrench_source="flange_sensor")
    assert (read.setting.robot, read.setting.up, read.length_unit) == ("iiwa14", (0.0, 0.0, -1.0), "m")
    assert read.cautions == (
        "hand_on_robot 'no' of the file is not used: --hand-on-robot states yes",
        "length_unit 'mm' of the file is not used: --length-unit states m",
        "up 'z' of the file is not used: --up states 0,0,-1",
        "robot 'panda' of the file is not used: --robot states iiwa14",
    ), "the source is ignored, because there is no force"


def test_csv_carries_one_column_a_component_and_options_in_comments(tmp_path):
    file = tmp_path / "a.csv"
    file.write_text(
        "# length_unit: mm\n# by: nobody\nt, px, py, pz, fx, fy, fz\n0,1,2,3,4,5,6\n0.1,1,2,3,4,5,6\n"
    )
    read = load_recording(file)
    assert read.length_unit == "mm"
    assert read.matrix().tolist() == [[0, 1, 2, 3, 4, 5, 6], [0.1, 1, 2, 3, 4, 5, 6]]


def test_without_a_wrench_there_is_no_wrench_source(tmp_path):
    Recording(t=np.zeros(2), signals={"q": np.zeros((2, 7))}).save(tmp_path / "a.npz")
    assert load_recording(tmp_path / "a.npz", wrench_source="flange_sensor").wrench_source == "none"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"t": np.zeros((2, 1))}, r"shape \(2, 1\)"),
        ({"t": np.zeros(0)}, r"shape \(0,\)"),
        ({"signals": {"force": np.zeros((2, 3))}}, "at least one of pos and q"),
        ({"signals": {"pos": np.zeros((2, 3)), "mood": np.zeros((2, 1))}}, "unknown signal 'mood'"),
        ({"signals": {"pos": np.zeros((3, 3))}}, r"pos has shape \(3, 3\), expected \(2, 3\)"),
        ({"length_unit": "inch"}, "inch.*one of m, cm, mm$"),
        ({"t": np.array([0.0, np.nan])}, "sample 1: t is nan, expected a finite number"),
    ],
    ids=str,
)
def test_what_is_no_recording_is_refused_by_name(changes, message):
    with pytest.raises(RecordingError, match=message):
        Recording(**{"t": np.zeros(2), "signals": {"pos": np.zeros((2, 3))}, **changes})


def written(path, **arrays):
    np.savez(path, **arrays)
    return path.read_bytes()


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.txt", b"", "suffix '.txt'"),
        ("a.npz", b"not a zip", "not a readable npz"),
        ("a.npz", b"", "not a readable npz"),
        ("a.csv", b"", "0 rows"),
        ("a.csv", b"t,px,py,pz\n", "1 row,"),
        ("a.csv", b"t,px,py,pz\n0,1,2,x\n", "line 2: pz is 'x', expected a number"),
        (
            "a.csv",
            b"# of a day\n\nt,px,py,pz\n0,1,2,3\n1,2,,3\n",
            "line 5: py is '', expected a number",
        ),
        (
            "a.csv",
            b"t,px,py,pz\n1.5.2024 10:00,1,2,3\n",
            "line 2: t is '1.5.2024 10:00', expected a number of seconds, or a date with a time",
        ),
        ("a.csv", b"t,px,py,pz\n0,1,2\n", "line 2 has 3 values, expected 4"),
        ("a.csv", b"t,px,py,pz\n0,1,2,3\n0,1,2\n", "line 3 has 3 values, expected 4"),
        ("a.csv", b"px,py,pz\n1,2,3\n", "expected t"),
        ("a.csv", b"t,px\n1,2\n", "has px but not py, pz"),
        ("a.csv", b"t,px,py,pz,fx,fy\n0,1,2,3,4,5\n", "has fx, fy but not fz"),
        ("a.csv", b"t,px,py,pz,px\n0,1,2,3,4\n", "column px comes twice"),
        ("a.csv", b"t,fx,fy,fz\n1,2,3,4\n", "expected t, and px py pz or q1 to q7"),
        ("a.csv", b"\xff\xfe\x00", "a.csv"),
        ("a.csv", b"t,px,py,pz\nnan,1,2,3\n", r"sample 0 \(line 2\): t is nan"),
        ("a.csv", b"# wrench_source: guess\nt,px,py,pz\n0,1,2,3\n", "wrench_source is 'guess'"),
    ],
)
def test_a_file_that_is_no_recording_says_why_in_one_line(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(CaesuraError, match=message) as caught:
        load_recording(tmp_path / name)
    assert isinstance(caught.value, RecordingError)
    assert "\n" not in str(caught.value)


def test_an_npz_that_was_cut_short_spoilt_or_renamed_is_refused(tmp_path):
    # A renamed .npy once raised "TypeError: ndarray does not support the context manager protocol".
    whole = written(tmp_path / "whole.npz", t=np.arange(100.0), pos=np.ones((100, 3)))
    np.save(tmp_path / "bare.npy", np.arange(3.0))
    spoilt = whole.replace(np.ones(3).tobytes(), np.zeros(3).tobytes(), 1)
    contents = [whole[:500], whole[: len(whole) // 2], spoilt, (tmp_path / "bare.npy").read_bytes()]
    for content in contents:
        (tmp_path / "a.npz").write_bytes(content)
        with pytest.raises(RecordingError, match=r"a\.npz: not a readable npz"):
            load_recording(tmp_path / "a.npz")


def test_arrays_of_the_wrong_width_are_named(tmp_path):
    written(tmp_path / "a.npz", t=np.zeros(4), pos=np.zeros((4, 2)))
    with pytest.raises(RecordingError, match=r"pos has shape \(4, 2\), expected \(4, 3\)"):
        load_recording(tmp_path / "a.npz")


def test_a_directory_and_a_missing_file_are_named(tmp_path):
    with pytest.raises(RecordingError, match="a directory"):
        load_recording(tmp_path)
    with pytest.raises(RecordingError, match="no such file"):
        load_recording(tmp_path / "a.npz")


@pytest.mark.parametrize("override", [{"length_unit": "inch"}, {"wrench_source": "guess"}])
def test_an_override_that_does_not_exist_is_refused_even_where_nothing_needs_it(tmp_path, override):
    # A wrench source that does not exist once passed where the file holds no wrench.
    Recording(t=np.zeros(2), signals={"q": np.zeros((2, 7))}).save(tmp_path / "a.npz")
    with pytest.raises(RecordingError, match=r"inch|guess"):
        load_recording(tmp_path / "a.npz", **override)


def test_a_csv_from_a_spreadsheet_begins_with_a_byte_order_mark(tmp_path):
    # Its first column was once called "\ufefft", and "expected t" was the answer.
    (tmp_path / "a.csv").write_bytes("\ufefft,px,py,pz\r\n0,1,2,3\r\n \r\n".encode())
    assert load_recording(tmp_path / "a.csv").matrix().tolist() == [[0, 1, 2, 3]]


def test_what_is_not_read_is_named(tmp_path):
    # "length_units" was once passed over in silence, and millimetres taken for metres.
    Recording(t=np.zeros(2), signals={"q": np.zeros((2, 7))}).save(tmp_path / "a.npz")
    assert load_recording(tmp_path / "a.npz").ignored == ()
    extra = {"vel": np.zeros((2, 3)), "label": np.array(["a", "b"]), "length_units": np.array("mm")}
    written(tmp_path / "a.npz", t=np.zeros(2), pos=np.zeros((2, 3)), **extra)
    assert load_recording(tmp_path / "a.npz").ignored == ("vel", "label", "length_units")
    (tmp_path / "a.csv").write_text("# length_units: mm\n# by: nobody\n# hello\nt,px,py,pz,Fz\n0,1,2,3,4\n")
    assert load_recording(tmp_path / "a.csv").ignored == ("length_units", "Fz")


def test_a_torque_beside_a_force_in_the_base_frame_is_not_read(tmp_path):
    """It has the frame of `force`, so that r × F with `force_base` would mix two frames."""
    arrays = {name: np.ones((2, 3)) for name in ("pos", "force", "torque")}
    written(tmp_path / "a.npz", t=np.arange(2.0), force_base=np.full((2, 3), 2.0), **arrays)
    read = load_recording(tmp_path / "a.npz", wrench_source="flange_sensor")
    assert (read.force_frame, float(read.signals["force"][0, 0])) == ("base", 2.0)
    assert "torque" not in read.signals
    assert read.ignored == ("torque, because it has the frame of force, and force_base is read",)


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("length_units", "length_unit"),
        ("Force", "force"),
        ("forces", "force"),
        ("wrench-source", "wrench_source"),
        ("vel", None),
        ("label", None),
        ("t_nominal", None),
        ("wrench_fresh", None),
        ("torque", None),
    ],
)
def test_a_typo_is_distinguished_from_what_is_merely_more(name, meant):
    assert did_you_mean(name) == meant


def test_a_file_that_holds_code_is_not_run(tmp_path):
    np.savez(tmp_path / "a.npz", t=np.array([object()], dtype=object))
    with pytest.raises(
        RecordingError, match="t is an array of Python objects, which are never loaded: save it"
    ):
        load_recording(tmp_path / "a.npz")


@pytest.mark.parametrize("first", ["time,x,y,z,Fx", "t,x,y,z,Fx"])
def test_a_csv_with_other_columns_names_them_and_the_mapping(tmp_path, first):
    # It once said "has []".
    (tmp_path / "odd.csv").write_text(f"{first}\n0,1,2,3,text\n")
    with pytest.raises(RecordingError) as refused:
        load_recording(tmp_path / "odd.csv")
    for word in (first.replace(",", ", "), "px py pz", "--mapping FILE", "docs/recordings.md"):
        assert word in str(refused.value)


def test_a_wrench_source_without_a_force_is_named_as_ignored(tmp_path):
    # A file of a flange sensor whose force columns were lost passed for one without a wrench.
    written(
        tmp_path / "a.npz", t=np.arange(3.0), pos=np.ones((3, 3)), wrench_source=np.array("flange_sensor")
    )
    recording = load_recording(tmp_path / "a.npz")
    assert recording.wrench_source == "none"
    assert recording.ignored == ("wrench_source flange_sensor, because there is no force and no tau",)
