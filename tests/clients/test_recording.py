import numpy as np
import pytest

from caesura_clients.recording import Recording, RecordingError, load_recording
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
        ({"length_unit": "inch"}, "inch.*'m', 'cm', 'mm'"),
    ],
    ids=str,
)
def test_what_is_no_recording_is_refused_by_name(changes, message):
    with pytest.raises(RecordingError, match=message):
        Recording(**{"t": np.zeros(2), "signals": {"pos": np.zeros((2, 3))}, **changes})


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.txt", b"", "suffix '.txt'"),
        ("a.npz", b"not a zip", "not a readable npz"),
        ("a.npz", b"", "not a readable npz"),
        ("a.csv", b"t,px,py,pz\n", "1 rows"),
        ("a.csv", b"t,px,py,pz\n0,1,2,x\n", "could not convert"),
        ("a.csv", b"t,px,py,pz\n0,1,2\n", "a.csv"),
        ("a.csv", b"t,px,py,pz\n0,1,2,3\n0,1,2\n", "a.csv"),
        ("a.csv", b"px,py,pz\n1,2,3\n", "expected t"),
        ("a.csv", b"t,px\n1,2\n", "at least one of pos and q"),
        ("a.csv", b"\xff\xfe\x00", "a.csv"),
    ],
)
def test_a_file_that_is_no_recording_says_why(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(RecordingError, match=message):
        load_recording(tmp_path / name)


def test_a_file_that_holds_code_is_not_run(tmp_path):
    np.savez(tmp_path / "a.npz", t=np.array([object()], dtype=object))
    with pytest.raises(RecordingError, match="not a readable npz"):
        load_recording(tmp_path / "a.npz")
