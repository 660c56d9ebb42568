"""The questions about a csv of other software: what is proposed, and the mapping file that they make."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from caesura_clients.cli import recording_file_prompts
from caesura_clients.cli.recording_file_prompts import ask_about
from caesura_protocol.errors import SourceError
from caesura_protocol.formats.csv_layout_detection import guessed, read_layout
from caesura_protocol.formats.mapping_file_write import MappingAnswers, mapping_text
from caesura_protocol.formats.read import load_recording
from caesura_protocol.recording import Recording, RecordingError, UnknownColumnsError
from harness.demonstrations import guided


def odd(path: Path, header: str = "Zeit [ms];X;Y;Z;F 1;F 2;F 3;temp") -> Path:
    """A demonstration in ms and mm, with semicolons, decimal commas and names of its own."""
    scale = np.array([1e3, 1e3, 1e3, 1e3, -1.0, -1.0, -1.0])
    rows = (";".join(f"{value:.6f}" for value in (*row, 20.5)) for row in guided().matrix() * scale)
    path.write_text("\n".join([header, *rows]).replace(".", ","), encoding="utf-8")
    return path


class Terminal:
    """Answers the questions whose words begin so; Enter to others."""

    def __init__(self, **answers: str) -> None:
        self.answers, self.asked = answers, []

    def __call__(self, words: str, default: str | None = None) -> str:
        self.asked.append((words, default))
        given = [answer for start, answer in self.answers.items() if words.startswith(start)]
        assert given or default is not None, f"{words}: has no answer"
        return given[0] if given else default or ""


def assert_same(found: Recording, expected: Recording) -> None:
    np.testing.assert_allclose(found.t, expected.t, atol=1e-8)
    for signal, values in expected.signals.items():
        np.testing.assert_allclose(found.signals[signal], values, atol=1e-6)


def test_answers_become_a_mapping_that_reads_the_file_next_time(tmp_path: Path):
    file = odd(tmp_path / "odd.csv")
    given = {"Force": "5 6,7", "Where": "flange_sensor", "Was": "yes", "Are they": "robot", "Which": "panda"}
    terminal = Terminal(**given)
    answered = ask_about(file, terminal)
    assert answered.mapping == tmp_path / "odd.toml"
    found = load_recording(file, mapping=answered.mapping)
    assert_same(found, guided())
    assert (found.wrench_source, found.hand_on_robot, found.setting.robot) == (
        "flange_sensor",
        "yes",
        "panda",
    )
    assert found.ignored == ("temp",)
    proposed = dict(terminal.asked)
    assert proposed["Time"] == "1", "a name with a blank goes by its number"
    assert proposed["Position of the flange in the base frame"] == "X Y Z"
    assert proposed["Unit of position of the flange in the base frame (m, cm, mm)"] == "mm", "by its values"


def test_a_question_is_asked_again_until_its_answer_is_possible(
    tmp_path: Path, capsys: pytest.CaptureFixture
):
    answers = iter(["X Y", "X Y Q", "X Y Z"])
    terminal = Terminal(Where="flange_sensor")

    def ask(words: str, default: str | None = None) -> str:
        return next(answers) if words.startswith("Position") else terminal(words, default)

    assert ask_about(odd(tmp_path / "odd.csv"), ask).mapping is not None
    said = capsys.readouterr().out
    assert "2 columns, expected 0 or 3, each once" in said
    assert "no column 'Q'" in said


def typed_into(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *answers: str) -> str:
    """What a terminal shows of the questions about a npz, with these answers."""
    guided().save(tmp_path / "demo.npz")
    monkeypatch.setattr(recording_file_prompts, "in_a_terminal", lambda: True)
    app = typer.Typer()
    app.command()(lambda: recording_file_prompts.ask_about(tmp_path / "demo.npz") and None)
    done = CliRunner().invoke(app, [], input="".join(f"{one}\n" for one in answers))
    assert done.exit_code == 0, done.output
    return done.output


def test_after_an_empty_answer_it_states_what_is_expected(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    shown = typed_into(tmp_path, monkeypatch, "", "nonsense", "flange_sensor", "yes", "-")
    assert shown.count("Where was the wrench measured?") == 3
    assert "nothing is assumed here: expected one of flange_sensor, " in shown
    assert "'nonsense', expected one of flange_sensor, " in shown


def test_the_question_whose_the_forces_are_states_how_they_differ(tmp_path: Path):
    terminal = Terminal(Force="5 6 7", Where="flange_sensor", Was="yes")
    ask_about(odd(tmp_path / "odd.csv"), terminal)
    (words,) = [words for words, _ in terminal.asked if words.startswith("Are they")]
    assert "a force that points up then is that of the environment" in words
    assert "positive z on an upright base" in words


def test_which_way_is_up_is_asked_and_written(tmp_path: Path, capsys: pytest.CaptureFixture):
    terminal, answers = Terminal(Force="5 6 7", Where="flange_sensor"), iter(["0,1,1", "down", "-z"])

    def ask(words: str, default: str | None = None) -> str:
        return next(answers) if words.startswith("Up, ") else terminal(words, default)

    file = odd(tmp_path / "odd.csv")
    assert load_recording(file, mapping=ask_about(file, ask).mapping).up == (0.0, 0.0, -1.0)
    said = capsys.readouterr().out
    assert "up is 0,1,1 of length 1.41421, expected 1 ± 0.001" in said
    assert "up is 'down', expected three numbers" in said


def test_an_upright_base_that_is_not_stated_is_not_written(tmp_path: Path):
    file = odd(tmp_path / "odd.csv")
    answered = ask_about(file, Terminal(Force="5 6 7", Where="flange_sensor"))
    assert answered.mapping is not None
    assert "up" not in answered.mapping.read_text().split("[time]")[0].replace("hand_on_robot", "")
    assert load_recording(file, mapping=answered.mapping).up is None
    terminal = Terminal(Force="-")
    assert ask_about(odd(tmp_path / "poses.csv"), terminal).mapping is not None
    assert not [words for words, _ in terminal.asked if words.startswith("Up, ")]


def test_other_formats_are_asked_about_wrench_and_hand_alone(tmp_path: Path):
    guided().save(tmp_path / "demo.npz")
    terminal = Terminal(Where="flange_sensor", Was="no")
    answered = ask_about(tmp_path / "demo.npz", terminal)
    assert ("Where was the wrench measured?", None) in [
        (one.split(" (")[0], two) for one, two in terminal.asked
    ]
    assert answered.mapping is None
    assert answered.options == {"wrench_source": "flange_sensor", "hand_on_robot": "no"}


def test_a_mapping_that_exists_is_kept(tmp_path: Path, capsys: pytest.CaptureFixture):
    """Enter replaced one that had been edited by hand."""
    file, kept, new = odd(tmp_path / "odd.csv"), tmp_path / "odd.toml", tmp_path / "new.toml"
    kept.write_text("# edited by hand\n", encoding="utf-8")
    answers = iter(["", str(kept), str(new)])
    terminal = Terminal(Where="none")

    def ask(words: str, default: str | None = None) -> str:
        return next(answers) if words.startswith("Write") else terminal(words, default)

    assert ask_about(file, ask).mapping == new
    assert kept.read_text("utf-8") == "# edited by hand\n"
    assert f"{kept} exists and is kept" in capsys.readouterr().out


def test_without_a_terminal_nothing_is_asked(tmp_path: Path):
    with pytest.raises(SourceError, match="--ask needs a terminal"):
        ask_about(odd(tmp_path / "odd.csv"))


def test_an_error_lists_the_columns_with_a_mapping_that_works(tmp_path: Path):
    file = odd(tmp_path / "odd.csv")
    with pytest.raises(UnknownColumnsError, match="--mapping FILE") as error:
        load_recording(file)
    assert "has the columns Zeit [ms], X, Y, Z, F 1" in str(error.value)
    (tmp_path / "odd.toml").write_text(error.value.example, encoding="utf-8")
    found = load_recording(file, mapping=tmp_path / "odd.toml")
    np.testing.assert_allclose(found.signals["pos"], guided().signals["pos"], atol=1e-6)


@pytest.mark.parametrize(
    ("opening", "unit"), [("80.0", "mm"), ("0.08", None), ("1", None), ("255", None), ("", None)]
)
def test_a_gripper_is_proposed_in_mm_where_it_cannot_be_in_metres(
    tmp_path: Path, opening: str, unit: str | None
):
    file = tmp_path / "log.csv"
    file.write_text(f"timestamp,x,y,z,width\n0,1,2,3,{opening}\n1,1,2,3,{opening}\n")
    assert guessed(read_layout(file)).units.get("gripper") == unit


def test_options_that_contradict_are_blamed_and_not_the_file(tmp_path: Path):
    guided().save(tmp_path / "demo.npz")
    with pytest.raises(RecordingError, match=r"^--wrench-source \w+ and --hand-on-robot no do not fit"):
        load_recording(tmp_path / "demo.npz", hand_on_robot="no", wrench_source="flange_sensor_with_hand")
    with pytest.raises(RecordingError, match=r"^--mapping log\.toml is for csv files"):
        load_recording(tmp_path / "demo.npz", mapping=Path("log.toml"))


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        (
            "timestamp,actual_TCP_pose_0,actual_TCP_pose_1,actual_TCP_pose_2,actual_q_0,actual_q_1",
            {"t", "px", "py", "pz", "q1", "q2"},
        ),
        ("time_ms,pose.position.x,pos_y,position.z,Gripper [mm],x2", {"t", "px", "py", "pz", "gripper"}),
        ("t,joint_1,joint_2,joint_4,x,y", {"t", "q1", "q2"}),
        ("Zeit;Kraft-X [N];Kraft-Y [N];Kraft-Z [N];Greifer Öffnung [mm]", {"t", "fx", "fy", "fz", "gripper"}),
        ("Zeit;x-Koordinate;y-Koordinate;z-Koordinate", {"t", "px", "py", "pz"}),
        ("Zeit;Drehmoment X;Drehmoment Y;Drehmoment Z;Achse 1;Achse 2", {"t", "mx", "my", "mz", "q1", "q2"}),
        ("t;Sensor X links [N];Sensor Y links [N];Sensor Z links [N]", {"t", "fx", "fy", "fz"}),
        ("Zeit/ms;X/mm;Y/mm;Z/mm;Fx_tool;Fy_tool;Fz_tool", {"t", "px", "py", "pz", "fx", "fy", "fz"}),
        ("t;x in mm;y in mm;z in mm;u m/s;v m/s;w m/s", {"t", "px", "py", "pz"}),
        ("t;load-x [Nm];load-y [Nm];load-z [Nm]", {"t", "mx", "my", "mz"}),
        ("t;spot x_mm;spot y_mm;spot z_mm", {"t", "px", "py", "pz"}),
        ("t;x;y;z;goal x [m];goal y [m];goal z [m]", {"t", "px", "py", "pz"}),
        ("t;tcp_x;tcp_y;tcp_z;flange_x;flange_y;flange_z", {"t", "px", "py", "pz"}),
        ("__time;/ee/pose/position/x;/ee/pose/position/y;/ee/pose/position/z", {"t", "px", "py", "pz"}),
        ("%time;field.wrench.force.x;field.wrench.force.y;field.wrench.force.z", {"t", "fx", "fy", "fz"}),
        ("t;/a/position/x;/a/position/y;/a/position/z;/b/position/x;/b/position/y;/b/position/z", {"t"}),
        ("time;O_T_EE[12];O_T_EE[13];O_T_EE[14];q[0];q[1]", {"t", "px", "py", "pz", "q1", "q2"}),
        ("t;goal x [m];goal y [m];goal z [m];seen x [m];seen y [m];seen z [m]", {"t"}),
        ("t;speed x [m/s];speed y [m/s];speed z [m/s];left x [m];left y [m]", {"t"}),
    ],
)  # fmt: skip
def test_names_of_other_software_are_proposed(tmp_path: Path, header: str, expected: set[str]):
    file = tmp_path / "log.csv"
    mark = ";" if ";" in header else ","
    numbers = mark.join(map(str, range(1, header.count(mark) + 1)))
    file.write_text(f"{header}\n0{mark}{numbers}\n1{mark}{numbers}\n", encoding="utf-8")
    assert set(guessed(read_layout(file)).columns) == expected


@pytest.mark.parametrize("odd_mark", ["", "\x7f"], ids=ascii)
def test_a_name_with_quotes_is_written_so_that_it_is_read(tmp_path: Path, odd_mark: str):
    file = tmp_path / "log.csv"
    file.write_text(
        f'"the ""time""{odd_mark}",x,y,z\n' + "\n".join(f"{i / 100},0.1,0.2,0.3" for i in range(20))
    )
    names = {"t": f'the "time"{odd_mark}', "px": "x", "py": "y", "pz": "z"}
    (tmp_path / "log.toml").write_text(mapping_text(MappingAnswers(columns=names)))
    assert load_recording(file, mapping=tmp_path / "log.toml").t[-1] == 0.19


def test_what_the_comments_of_a_csv_state_is_proposed(tmp_path: Path):
    file = odd(tmp_path / "odd.csv")
    stated = "# wrench_source: flange_sensor\n# hand on robot: no\n# robot: panda\n# up: -z\n"
    file.write_text(stated + file.read_text(encoding="utf-8"), encoding="utf-8")
    answered = ask_about(file, Terminal(Force="5 6 7"))
    found = load_recording(file, mapping=answered.mapping)
    assert (found.wrench_source, found.hand_on_robot, found.setting.robot) == ("flange_sensor", "no", "panda")
    assert found.up == (0.0, 0.0, -1.0)


def arm_log(path: Path) -> Path:
    """As a UFACTORY arm has it: degrees, millimetres, roll, pitch and yaw, and the sensor's forces."""
    header = "time_s,x_mm,y_mm,z_mm,roll,pitch,yaw,j1,j2,ext_fx,ext_fy,ext_fz"
    rows = (f"{i / 100},400,0,300,180,0,0,0.1,0.2,0,0,0.1" for i in range(50))
    path.write_text("\n".join([header, *rows]), encoding="utf-8")
    return path


def test_three_angles_are_asked_which_they_are(tmp_path: Path):
    terminal = Terminal(Where="flange_sensor", Was="yes", Which_robot="xarm7")
    answered = ask_about(arm_log(tmp_path / "log.csv"), terminal)
    asked = dict(terminal.asked)
    assert asked["Orientation of the flange, a quaternion x y z w, or three angles"] == "roll pitch yaw"
    assert asked["Unit of the angles (rad, deg)"] == "deg", "by their values"
    assert asked["Force"] == "ext_fx ext_fy ext_fz"
    found = load_recording(tmp_path / "log.csv", mapping=answered.mapping)
    np.testing.assert_allclose(np.abs(found.signals["quat"][0]), [1.0, 0.0, 0.0, 0.0], atol=1e-12)


def test_torques_of_joints_are_as_many_as_the_joints(tmp_path: Path, capsys: pytest.CaptureFixture):
    """Three torques of seven joints were taken, and the command failed after all questions."""
    answers = iter(["ext_fx ext_fy ext_fz", "-"])
    terminal = Terminal(Where="flange_sensor", Was="yes")

    def ask(words: str, default: str | None = None) -> str:
        return next(answers) if words.startswith("External") else terminal(words, default)

    ask_about(arm_log(tmp_path / "log.csv"), ask)
    assert "3 columns, expected 0 or 2, each once" in capsys.readouterr().out


def table(path: Path, header: str, row: str) -> Path:
    rows = (f"{i / 100},0.4,0,0.3,{row}" for i in range(50))
    path.write_text("\n".join([f"t,x,y,z,{header}", *rows]), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("header", "row", "expected"),
    [
        ("Q0,Q1,Q2,Q3", "0.5,0.5,0.5,0.5", {"qw": "Q0", "qx": "Q1", "qy": "Q2", "qz": "Q3"}),
        ("q1,q2,q3,q4", "0,1,0,0", {}),
        ("q1,q2,q3,q4", "0,1,0,0.3", {"q1": "q1", "q2": "q2", "q3": "q3", "q4": "q4"}),
        ("joint_0,joint_1,joint_2", "1,2,3", {"q1": "joint_0", "q2": "joint_1", "q3": "joint_2"}),
        ("j0,j1,tau_J0,tau_J1", "1,2,3,4", {"q1": "j0", "q2": "j1", "tau1": "tau_J0", "tau2": "tau_J1"}),
    ],
)  # fmt: skip
def test_joints_that_are_counted_from_zero_and_quaternions_are_distinguished(
    tmp_path: Path, header: str, row: str, expected: dict[str, str]
):
    """`Q0 Q1 Q2 Q3` were proposed as three joints, and `joint_1` of `joint_0` on as the first one."""
    found = dict(guessed(read_layout(table(tmp_path / "log.csv", header, row))).columns)
    assert {
        column: name for column, name in found.items() if column not in ("t", "px", "py", "pz")
    } == expected


def test_a_quaternion_with_the_names_of_joints_is_refused(tmp_path: Path):
    file = table(tmp_path / "own.csv", "q1,q2,q3,q4", "0,1,0,0")
    file.write_text(file.read_text(encoding="utf-8").replace("x,y,z", "px,py,pz"), encoding="utf-8")
    with pytest.raises(RecordingError, match="norm 1 in every sample, as a quaternion has"):
        load_recording(file)


def test_the_flange_is_proposed_before_a_tool_centre_point(tmp_path: Path):
    file = tmp_path / "log.csv"
    file.write_text("t,tcp_x,tcp_y,tcp_z,flange_x,flange_y,flange_z\n0,1,2,3,4,5,6\n1,1,2,3,4,5,6\n")
    assert guessed(read_layout(file)).columns["px"] == "flange_x"


def test_the_frame_of_the_force_is_asked_without_an_orientation_too(tmp_path: Path):
    """It was answered with base in silence, and the mapping stated it."""
    terminal = Terminal(Force="5 6 7", Where="flange_sensor", Was="yes")
    ask_about(odd(tmp_path / "odd.csv"), terminal)
    (words,) = [words for words, _ in terminal.asked if words.startswith("In which frame")]
    assert "need an orientation, which is missing here" in words


def test_a_proposed_mapping_states_no_frame_of_the_force(tmp_path: Path):
    """An operator who took it as it was stated a frame without a look at it."""
    file = table(tmp_path / "log.csv", "fx,fy,fz", "1,2,3")
    with pytest.raises(UnknownColumnsError) as error:
        load_recording(file)
    (tmp_path / "log.toml").write_text(error.value.example, encoding="utf-8")
    assert "force_frame" not in error.value.example
    found = load_recording(file, mapping=tmp_path / "log.toml", wrench_source="flange_sensor")
    assert any("Frame of the force: base, assumed" in one for one in found.assumed)
