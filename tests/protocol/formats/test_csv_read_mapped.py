"""Csv files of somebody else: what a mapping may say, and what an error says."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from caesura_protocol.formats.csv_layout_detection import guessed, read_layout, with_turns
from caesura_protocol.formats.csv_read_mapped import SIGNAL_OF_COLUMN
from caesura_protocol.formats.read import load_recording
from caesura_protocol.recording import RecordingError, UnknownColumnsError

MAPPING = """
delimiter = ";"
decimal = ","
wrench_source = "flange_sensor"
force_frame = "flange"

[time]
column = "Zeit [ms]"
unit = "ms"

[columns]
px = { column = "X", unit = "mm" }
py = { column = "Y", unit = "mm" }
pz = { column = "Z", unit = "mm" }
fx = "F1"
fy = "F2"
fz = { column = "F3", scale = -1.0 }
q1 = { column = "A1", unit = "deg" }
q2 = { column = "A1", unit = "deg" }
q3 = { column = "A1", unit = "deg" }
q4 = { column = "A1", unit = "deg" }
q5 = { column = "A1", unit = "deg" }
q6 = { column = "A1", unit = "deg" }
q7 = { column = "A1", unit = "deg" }
"""
TABLE = """# from the sensor's own software
Zeit [ms];X;Y;Z;F1;F2;F3;A1;Temp

1000;500,5;0;250;1,5;0;-9,81;180;21
1010;501;0;250;1,5;0;-9,81;90;21
"""


@pytest.fixture
def files(tmp_path):
    def write(table: str = TABLE, mapping: str = MAPPING) -> tuple[Path, Path]:
        (tmp_path / "log.csv").write_text(table, encoding="utf-8")
        (tmp_path / "map.toml").write_text(mapping, encoding="utf-8")
        return tmp_path / "log.csv", tmp_path / "map.toml"

    return write


def read(files, table=TABLE, mapping=MAPPING):
    log, how = files(table, mapping)
    return load_recording(log, mapping=how)


def test_units_signs_and_marks_are_as_the_mapping_says(files):
    recording = read(files)
    np.testing.assert_allclose(recording.t, [1.0, 1.01])
    np.testing.assert_allclose(recording.signals["pos"], [[0.5005, 0.0, 0.25], [0.501, 0.0, 0.25]])
    np.testing.assert_allclose(recording.signals["force"], [[1.5, 0.0, 9.81]] * 2)
    np.testing.assert_allclose(recording.signals["q"][:, 3], [np.pi, np.pi / 2])
    assert (recording.wrench_source, recording.force_frame) == ("flange_sensor", "flange")
    assert recording.ignored == ("Temp",)


def test_positions_without_a_unit_stay_in_the_unit_of_the_file(files):
    mapping = 'length_unit = "mm"\n' + MAPPING.replace('{ column = "X", unit = "mm" }', '"X"').replace(
        '{ column = "Y", unit = "mm" }', '{ column = "Y", unit = "m" }'
    )
    recording = read(files, mapping=mapping)
    assert recording.length_unit == "mm"
    assert recording.signals["pos"][1].tolist() == [501.0, 0.0, 250.0]


@pytest.mark.parametrize(
    ("option", "unit"),
    [("length_unit", "mm"), ("time_unit", "ms"), ("angle_unit", "deg")],
)
def test_a_unit_that_the_mapping_states_is_not_stated_again(files, option, unit):
    """Positions were read as 1000 times smaller with `--length-unit mm`, and times as ms of seconds."""
    log, how = files()
    words = rf"--{option.replace('_', '-')} {unit} does not fit log\.csv: the mapping states the unit of"
    with pytest.raises(RecordingError, match=words):
        load_recording(log, mapping=how, **{option: unit})


def test_the_unit_that_the_mapping_converts_to_may_be_stated(files):
    log, how = files()
    found, stated = (load_recording(log, mapping=how, **given) for given in ({}, {"length_unit": "m"}))
    np.testing.assert_array_equal(found.signals["pos"], stated.signals["pos"])


def test_a_unit_that_the_mapping_leaves_open_is_stated_by_an_option(files):
    log, how = files()
    found = load_recording(log, mapping=how, force_unit="kN")
    np.testing.assert_allclose(found.signals["force"], [[1500.0, 0.0, 9810.0]] * 2)


def test_without_a_header_columns_have_numbers(files):
    recording = read(files, "0,1,2,3\n1,4,5,6\n", "[time]\ncolumn = 1\n[columns]\npx = 2\npy = 3\npz = 4\n")
    assert recording.t.tolist() == [0.0, 1.0]
    assert recording.signals["pos"].tolist() == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    assert recording.wrench_source == "none"


@pytest.mark.parametrize(
    ("table", "mapping", "message"),
    [
        (TABLE, MAPPING.replace('"Z"', '"Zz"'), r"no column 'Zz'.* takes pz.*'X', 'Y', 'Z'.*'Temp'"),
        (TABLE.replace("F2", "F1"), MAPPING, "2 columns 'F1'"),
        (TABLE, MAPPING.replace('";"', '","'), "is the delimiter ';'"),
        (
            TABLE,
            MAPPING.replace('unit = "deg"', 'unit = "grad"'),
            "q1: unit 'grad', expected one of rad",
        ),
        (TABLE, MAPPING.replace("-1.0", "0"), r"fz: scale is 0"),
        (TABLE, MAPPING.replace("fy = ", "fi = "), r"unknown 'fi', known: px"),
        (TABLE, MAPPING.replace('fy = "F2"', ""), r"force needs fx, fy, fz; fy is not in \[columns\]"),
        (TABLE, MAPPING.replace("[time]", "[tiem]"), r"the top: unknown 'tiem'"),
        (TABLE, MAPPING.replace("flange_sensor", "guess"), r"wrench_source is 'guess', expected one of"),
        (TABLE, "[columns]\npx = 1", r"has no \[time\]"),
        (TABLE, "columns = 3\n[time]\ncolumn = 1", r"columns is 3, expected a table"),
        (TABLE, "[time]\ncolumn = ", "not a readable mapping file"),
        (TABLE.replace("1000;", "25.11.2026;"), MAPPING, r"'25\.11\.2026', .*or a date such as 2026-11-26T"),
        (TABLE.replace("501;", "oops;"), MAPPING, r"line 5: column 'X' has 'oops', expected a number.*','"),
        (TABLE.replace("90;21", ""), MAPPING, r"line 5: column 'A1' has ''"),
        ("", MAPPING, "no rows"),
    ],
)
def test_an_error_names_the_column_and_what_there_is(files, table, mapping, message):
    with pytest.raises(RecordingError, match=message) as caught:
        read(files, table, mapping)
    assert "\n" not in str(caught.value)


def test_a_mapping_is_for_files_that_do_not_say_what_is_what(files, tmp_path):
    read(files).save(tmp_path / "ours.npz")
    with pytest.raises(RecordingError, match="has the names and units itself"):
        load_recording(tmp_path / "ours.npz", mapping=tmp_path / "map.toml")


STATING = "# wrench_source: joint_torque_estimate\n# hand on robot: yes\n# length_unit: mm\n"


def test_what_the_comments_of_the_file_state_holds_where_the_mapping_is_silent(files):
    # They were skipped with all other comments.
    silent = "\n".join(line for line in MAPPING.splitlines() if not line.startswith("wrench_source"))
    recording = read(files, STATING + TABLE, silent.replace('{ column = "X", unit = "mm" }', '"X"'))
    assert (recording.wrench_source, recording.hand_on_robot) == ("joint_torque_estimate", "yes")
    assert recording.length_unit == "mm"
    np.testing.assert_allclose(recording.signals["pos"], [[500.5, 0.0, 250.0], [501.0, 0.0, 250.0]])


def test_a_comment_that_the_mapping_contradicts_is_named(files):
    recording = read(files, STATING + TABLE)
    assert (recording.wrench_source, recording.hand_on_robot) == ("flange_sensor", "yes")
    named = "# wrench_source: joint_torque_estimate, because map.toml states flange_sensor"
    assert named in recording.ignored


def test_a_comment_with_another_value_is_refused(files):
    with pytest.raises(RecordingError, match="hand_on_robot is 'perhaps', expected one of"):
        read(files, "# hand on robot: perhaps\n" + TABLE)


def test_dates_of_other_software_are_seconds_from_the_first(files):
    table = TABLE.replace("1000;", "2026-11-24 18:04:32.25;").replace("1010;", "2026-11-24 18:04:32.26;")
    recording = read(files, table, MAPPING.replace('unit = "ms"\n', "", 1))
    np.testing.assert_allclose(recording.t, [0.0, 0.01])
    assert recording.assumed == (
        "Times are seconds from the first sample, which is at 2026-11-24 18:04:32.25, taken as UTC.",
    )
    assert recording.ignored == ("Temp",)
    with pytest.raises(RecordingError, match=r"map\.toml: \[time\] has a unit.*leave out the unit"):
        read(files, table)


def own_rows(delimiter: str) -> list[str]:
    return [delimiter.join(map(str, row)) for row in ((i / 100, 0.4, 0.001 * i, 0.3) for i in range(50))]


@pytest.mark.parametrize(
    ("header", "delimiter"), [("t px py pz", " "), ("t   px  py  pz", "   "), ("sep=;\nt;px;py;pz", ";")]
)
def test_blanks_divide_columns_and_the_line_of_excel_is_no_row(tmp_path, header, delimiter):
    """UR's own recorder of RTDE divides columns by blanks; Excel states its delimiter above the table."""
    file = tmp_path / "own.csv"
    file.write_text("\n".join([header, *own_rows(delimiter)]), encoding="utf-8")
    found = load_recording(file)
    assert found.t.size == 50
    assert found.signals["pos"][-1] == pytest.approx([0.4, 0.049, 0.3])


def test_a_record_of_rtde_is_read_with_the_mapping_that_is_proposed(tmp_path):
    file = tmp_path / "robot_data.csv"
    header = "timestamp actual_TCP_pose_0 actual_TCP_pose_1 actual_TCP_pose_2"
    file.write_text("\n".join([header, *own_rows(" ")]), encoding="utf-8")
    with pytest.raises(UnknownColumnsError) as error:
        load_recording(file)
    mapping = tmp_path / "log.toml"
    mapping.write_text(error.value.example, encoding="utf-8")
    assert load_recording(file, mapping=mapping).signals["pos"][-1] == pytest.approx([0.4, 0.049, 0.3])


def test_a_blank_within_names_is_no_delimiter(tmp_path):
    file = tmp_path / "log.csv"
    file.write_text("Time (s), X (mm)\n1,5, 2,5\n2,5, 3,5\n", encoding="utf-8")
    with pytest.raises(RecordingError, match=r"has the columns Time \(s\), X \(mm\);"):
        load_recording(file)


def test_rows_that_end_with_a_delimiter_need_none_in_the_header(tmp_path):
    file = tmp_path / "own.csv"
    file.write_text("\n".join(["t,px,py,pz", *(f"{row}," for row in own_rows(","))]), encoding="utf-8")
    assert load_recording(file).t.size == 50


def test_a_column_that_comes_twice_is_refused_with_what_to_do(tmp_path):
    file = tmp_path / "own.csv"
    file.write_text("t,px,py,pz,px\n0,1,2,3,4\n1,1,2,3,4\n", encoding="utf-8")
    with pytest.raises(RecordingError, match="px comes twice: leave one of them out"):
        load_recording(file)


def turned_rows(names: str, unit: str, angles: str, tmp_path: Path) -> tuple[Path, Path]:
    """A csv whose orientation stands as three angles, and its mapping."""
    file, mapping = tmp_path / "log.csv", tmp_path / "log.toml"
    file.write_text(
        "\n".join(["s,x,y,z,a,b,c", *(f"{i / 100},0.4,0.0,0.3,{angles}" for i in range(50))]),
        encoding="utf-8",
    )
    columns = {"px": "x", "py": "y", "pz": "z", **dict(zip(names.split(), "abc", strict=False))}
    lines = [
        f'{name} = {{ column = "{one}", unit = "{unit}" }}' for name, one in columns.items() if one in "abc"
    ]
    lines += [f'{name} = "{one}"' for name, one in columns.items() if one in "xyz"]
    mapping.write_text("\n".join(['[time]\ncolumn = "s"\n[columns]', *lines]), encoding="utf-8")
    return file, mapping


@pytest.mark.parametrize(
    ("names", "unit", "angles"),
    [
        ("rx ry rz", "rad", f"0,{math.pi / 2},0"),
        ("roll pitch yaw", "deg", "0,90,0"),
    ],
)
def test_an_orientation_of_three_angles_becomes_a_quaternion(tmp_path, names, unit, angles):
    """UR has rotation vectors and UFACTORY roll, pitch and yaw: neither has quaternions."""
    file, mapping = turned_rows(names, unit, angles, tmp_path)
    found = load_recording(file, mapping=mapping)
    half = math.sqrt(0.5)
    assert found.signals["quat"][-1] == pytest.approx([0.0, half, 0.0, half])
    assert found.ignored == ()


@pytest.mark.parametrize(
    ("names", "angles", "words"),
    [
        ("roll pitch yaw", "180,0,0", r"turn to 180 rad, at most 6.3 rad are plausible: probably in deg"),
        ("rx ry", "0,0,0", "rotation_vector needs rx, ry, rz; rz is not in"),
        ("rx ry rz roll", "0,0,0", r"as rx ry rz and as roll pitch yaw: leave one out"),
    ],
)
def test_angles_in_degrees_in_part_or_twice_are_refused(tmp_path, names, angles, words):
    file, mapping = turned_rows(
        names.replace(" roll", "") if "rx" in names else names, "rad", angles, tmp_path
    )
    if names.endswith("rz roll"):
        mapping.write_text(mapping.read_text(encoding="utf-8") + '\nroll = "a"', encoding="utf-8")
    with pytest.raises(RecordingError, match=words):
        load_recording(file, mapping=mapping)


@pytest.mark.parametrize(
    ("header", "names", "unit"),
    [
        ("timestamp,x,y,z,actual_TCP_pose_3,actual_TCP_pose_4,actual_TCP_pose_5", "rx ry rz", None),
        ("timestamp,x,y,z,roll,pitch,yaw", "roll pitch yaw", "deg"),
        ("timestamp,x,y,z,rx,ry,rz", "", None),
    ],
)
def test_angles_are_proposed_where_their_names_show_which_they_are(tmp_path, header, names, unit):
    file = tmp_path / "log.csv"
    last = "180" if unit else "1"
    file.write_text("\n".join([header, *(f"{i / 100},0.4,0.0,0.3,{last},0,0" for i in range(50))]))
    layout = read_layout(file)
    guess = with_turns(layout, guessed(layout))
    assert set(guess.columns) == {"t", "px", "py", "pz", *names.split()}
    assert guess.units.get(SIGNAL_OF_COLUMN[(names or "px").split()[0]]) == unit
