"""`caesura program`, `check` and `execute` as a user calls them, from a program to a recorded run."""

from __future__ import annotations

import errno
import json
import sys
from pathlib import Path
from xml.etree import ElementTree as Xml

import numpy as np
import pytest
from typer.testing import CliRunner

from caesura_protocol.formats.read import load_recording
from caesura_protocol.programs.apps_by_phase import Group
from harness.commands import application
from harness.programs import as_file, pick_and_place, press


def caesura(*words: object):
    return CliRunner().invoke(application(), [str(word) for word in words])


@pytest.fixture
def program(tmp_path: Path) -> Path:
    path = tmp_path / "press.json"
    path.write_text(as_file(press(), "press").as_json(), encoding="utf-8")
    return path


@pytest.fixture
def spoilt(program: Path) -> Path:
    content = json.loads(program.read_text("utf-8"))
    content["apps"][1]["force"] = [0.0, 0.0, -40.0]
    program.write_text(json.dumps(content), encoding="utf-8")
    return program


def test_a_program_is_written_in_every_format(program: Path, tmp_path: Path) -> None:
    outs = {name: tmp_path / f"out.{name}" for name in ("table", "json", "franky", "urscript", "bt")}
    for name, out in outs.items():
        done = caesura("program", "--file", program, "--format", name, "-o", out)
        assert done.exit_code == 0, done.output
    assert "move to contact" in outs["table"].read_text("utf-8")
    assert json.loads(outs["json"].read_text("utf-8"))["version"] == 2
    assert "MAX_SPEED_M_PER_S" in outs["franky"].read_text("utf-8")
    assert Xml.parse(outs["bt"]).getroot().get("BTCPP_format") == "4"
    assert "apply force" in caesura("program", "--file", program).output


def test_the_table_of_a_file_has_the_name_of_its_program(program: Path) -> None:
    """That of a live session had it alone."""
    content = json.loads(program.read_text("utf-8"))
    program.write_text(json.dumps(content | {"name": "Fill [/] it"}), encoding="utf-8")
    shown = " ".join(caesura("program", "--file", program).output.split())
    assert f"Fill [/] it: {content['station']} / {content['session']}, revision" in shown


def test_a_program_onto_a_full_disk_leaves_no_half_script(program, tmp_path, monkeypatch):
    """Half a script may run, as far as it goes."""
    out, write = tmp_path / "program.py", Path.write_text

    def half(path: Path, text: str, **options: str) -> None:
        write(path, text[: len(text) // 2], **options)
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_text", half)
    done = caesura("program", "--file", program, "--format", "franky", "-o", out)
    assert (done.exit_code, done.stderr) == (1, f"error: cannot write {out}: No space left on device\n")
    assert not list(tmp_path.glob("*program*"))


def test_a_program_is_not_written_over_the_file_that_it_is_read_from(program: Path) -> None:
    before = program.read_bytes()
    done = caesura("program", "--file", program, "--speed", 0.5, "--format", "franky", "-o", program)
    assert done.exit_code == 1
    assert done.stderr == f"error: cannot write {program}: it is the file that is read; name another file\n"
    assert program.read_bytes() == before


def test_a_check_says_what_is_wrong_and_exits_with_1(program: Path, tmp_path: Path) -> None:
    assert caesura("check", program, "--scenario", "dispenser").exit_code == 0
    content = json.loads(program.read_text("utf-8"))
    content["apps"][1]["force"] = [0.0, 0.0, -40.0]
    program.write_text(json.dumps(content), encoding="utf-8")
    done = caesura("check", program)
    assert done.exit_code == 0  # no limit is set
    assert "warning: app 2 (apply force): force 40.0 N is above 28.5 N" in done.output
    done = caesura("check", program, "--force-limit", "20")
    assert done.exit_code == 1
    assert "error: app 2 (apply force): force 40 N, expected 1 to 20 N" in done.output
    assert "cannot be run" in done.output
    found = json.loads(caesura("check", program, "--force-limit", "20", "--json").output)
    (finding,) = (one for one in found if one["severity"] == "error")
    assert (finding["index"], finding["value"], finding["limit"]) == (1, 40.0, 20.0)


def test_a_script_for_another_robot_of_the_maker_is_written_where_it_is_retargeted(program: Path) -> None:
    content = json.loads(program.read_text("utf-8"))
    program.write_text(json.dumps(content | {"robot": "ur5e"}), encoding="utf-8")
    command = ("program", "--file", program, "--format", "urscript", "--robot", "ur10e")
    refused = caesura(*command)
    assert (refused.exit_code, "was taught on ur5e, not on ur10e" in refused.output) == (1, True)
    written = caesura(*command, "--retarget")
    assert written.exit_code == 0, written.output
    assert "Universal Robots UR10e" in written.output.splitlines()[1]


@pytest.mark.slow
def test_a_program_is_run_and_what_was_recorded_is_a_recording(program: Path, tmp_path: Path) -> None:
    out = tmp_path / "run.npz"
    done = caesura("execute", program, "--simulated", "--scenario", "dispenser", "-o", out)
    assert done.exit_code == 0, done.output
    assert 20.0 < float(done.output.split("at most ")[1].split(" mm/s")[0]) < 1000.0
    assert load_recording(out).t[-1] > 5.0


@pytest.mark.slow
def test_without_a_scenario_it_runs_in_a_cell_as_taught_within_the_limits_that_are_stated(
    program: Path, tmp_path: Path
) -> None:
    out, cell = tmp_path / "run.npz", tmp_path / "cell.json"
    cell.write_text('{"speed_m_per_s": 0.1}', encoding="utf-8")
    done = caesura("execute", program, "--simulated", "--cell", cell, "-o", out)
    assert done.exit_code == 0, done.output
    assert float(done.output.split("at most ")[1].split(" mm/s")[0]) <= 100.0
    assert "cell as taught: 1 level surface, nothing else" in done.output
    run = load_recording(out)
    taught = max(-app["force"][2] for app in json.loads(program.read_text("utf-8"))["apps"] if app["force"])
    felt = run.signals["force"][:, 2]
    assert np.median(felt[felt > 0.5 * taught]) == pytest.approx(taught, rel=0.15)


def test_a_program_with_more_force_than_is_allowed_is_not_run(program: Path) -> None:
    done = caesura("execute", program, "--simulated", "--force-limit", "2")
    assert (done.exit_code, "N, expected 1 to 2 N" in done.output) == (1, True)


def test_what_is_refused_is_not_run(spoilt: Path, tmp_path: Path) -> None:
    out = tmp_path / "run.npz"
    done = caesura("execute", spoilt, "--simulated", "--scenario", "dispenser", "-o", out)
    assert done.exit_code == 1
    assert "app 2 (apply force): force 40.0 N is above 28.5 N: the robot is stopped at 30 N" in done.output
    assert not out.exists()


def test_a_check_names_the_groups_that_no_format_shows(program: Path) -> None:
    content = json.loads(program.read_text("utf-8"))
    content["groups"] = [{"first": 0, "last": 1, "name": "in"}, {"first": 1, "last": 9, "name": "far"}]
    program.write_text(json.dumps(content), encoding="utf-8")
    named = [line for line in caesura("check", program).output.splitlines() if "is not shown" in line]
    assert [line.split(":")[2].strip() for line in named] == ["group far"]


def test_a_check_reads_times_of_day_as_the_table_does(program: Path) -> None:
    """They were seconds since 1970, to a tenth."""
    content = json.loads(program.read_text("utf-8"))
    begins = 1700000001.5
    later = [
        one | {"t0": begins + k, "tn": begins + k + 1.0, "path": None}
        for k, one in enumerate(content["apps"])
    ]
    notes = [f"Not observed: {begins + 0.25:.2f}–{begins + 0.5:.2f} s (samples were lost)."]
    program.write_text(json.dumps(content | {"apps": later, "notes": notes}), encoding="utf-8")
    said = caesura("check", program).output
    assert said.startswith("times [s] from 2023-11-14 22:13:21 UTC on, the start\n")
    assert "Not observed: 0.25–0.50 s (samples were lost)." in said
    found = json.loads(caesura("check", program, "--json").output)
    assert notes[0] in [one["reason"] for one in found], "--json keeps the clock of the samples"


def test_what_is_wrong_with_a_program_goes_before_what_a_cell_as_taught_lacks(program: Path) -> None:
    """A press that leans has no surface in such a cell; what the check finds is what has to be mended."""
    content = json.loads(program.read_text("utf-8"))
    press = next(one for one in content["apps"] if one["kind"] == "apply_force")
    press["force"] = press["force_taught"] = [9.0, 0.0, 9.0]
    program.write_text(json.dumps(content | {"robot": None}), encoding="utf-8")
    done = caesura("execute", program, "--simulated")
    assert done.exit_code == 1
    assert "robot not stated: simulated on a Panda" in done.output
    assert "app 2 (apply force): pulls on the touched surface" in done.output
    press["force"] = press["force_taught"] = [-9.0, 0.0, -9.0]
    program.write_text(json.dumps(content), encoding="utf-8")
    assert "surfaces of a cell as taught are level" in caesura("execute", program, "--simulated").output


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "only --simulated"),
        (("--simulated", "--scenario", "moon"), "no scenario 'moon'"),
        (("--simulated", "--scenario", "dispenser", "-o", "run.csv"), "expected .npz"),
    ],
)
def test_misuse_is_one_line(words: tuple[str, ...], said: str, program: Path) -> None:
    done = caesura("execute", program, *words)
    assert done.exit_code == 1
    assert said in done.output
    assert len(done.output.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--session", "s1"), "--session is for a program of the service"),
        (("--station", "cell-1"), "--station is for a program of the service"),
        (("--inferred",), "--inferred is for a program of the service"),
        (("--json",), "--json is for a program of the service"),
        (("--against", "other.json", "-o", "differences.txt"), "--against prints the differences"),
    ],
)
def test_an_option_without_effect_is_refused(words: tuple[str, ...], said: str, program: Path) -> None:
    done = caesura("program", "--file", program, *words)
    assert done.exit_code == 1
    assert done.stderr.startswith(f"error: {said}")
    assert done.stdout == ""


def test_a_file_that_is_no_program_is_named(tmp_path: Path) -> None:
    path = tmp_path / "no.json"
    path.write_text("{}", encoding="utf-8")
    for command in (("check", path), ("program", "--file", path)):
        done = caesura(*command)
        assert done.exit_code == 1
        assert "no.json: " in done.output


def test_groups_are_named_by_their_number_or_name(tmp_path: Path) -> None:
    groups = (Group(first=0, last=0, name="free 1"), Group(first=1, last=2, name="contact 1"))
    file, out = tmp_path / "press.json", tmp_path / "named.json"
    file.write_text(as_file(press()).model_copy(update={"groups": groups}).as_json(), encoding="utf-8")
    command = ("program", "--file", file, "--format", "json", "-o", out)
    done = caesura(*command, "--name-group", "1=reach", "--name-group", "contact 1=pump soap")
    assert done.exit_code == 0, done.output
    assert [one["name"] for one in json.loads(out.read_text("utf-8"))["groups"]] == ["reach", "pump soap"]
    for wrong in ("0=less", "3=more", "reach", "1="):
        refused = caesura(*command, "--name-group", wrong)
        assert refused.exit_code == 1
        assert f"cannot name '{wrong}'" in refused.output
    alike = [{"first": i, "last": i, "name": "wipe"} for i in (0, 1)]
    file.write_text(json.dumps({**json.loads(file.read_text("utf-8")), "groups": alike}), encoding="utf-8")
    ambiguous = caesura(*command, "--name-group", "wipe=polish")  # it named the first of the two
    assert ambiguous.exit_code == 1
    assert "2 groups have that name, use 1 or 2" in " ".join(ambiguous.output.split())
    assert caesura(*command, "--name-group", "2=polish").exit_code == 0
    assert [one["name"] for one in json.loads(out.read_text("utf-8"))["groups"]] == ["wipe", "polish"]
    table = caesura("program", "--file", file, "--name-group", "2=[b]pump").output  # no table had groups
    lines = [line.split()[:3] for line in table.splitlines()]
    assert lines.index(["[b]pump", "app", "2"]) == lines.index(["2", "apply", "force"]) - 1


def test_a_program_at_half_its_speed_is_written_checked_and_refused_out_of_range(tmp_path: Path) -> None:
    taught, slow = tmp_path / "taught.json", tmp_path / "slow.json"
    done = caesura("segment", Path(__file__).parents[2] / "data" / "dispenser.npz", "--json", taught)
    assert done.exit_code == 0, done.output
    done = caesura("program", "--file", taught, "--speed", "0.5", "--format", "json", "-o", slow)
    assert done.exit_code == 0, done.output
    for output_format in ("franky", "bt", "table"):
        words = ("program", "--file", taught, "--speed", "0.5", "--format", output_format)
        assert caesura(*words).output == caesura("program", "--file", slow, *words[-2:]).output
        assert caesura(*words).output != caesura("program", "--file", taught, *words[-2:]).output
    said = caesura("check", slow, "--scenario", "dispenser").output
    assert "warning: program: re-timed (speed 0.5): apps 1, 3, 4, 6; 10.17 s taught, 15.79 s now" in said
    content = json.loads(slow.read_text("utf-8"))
    content["timing"]["speed"] = 9.0
    slow.write_text(json.dumps(content), encoding="utf-8")
    done = caesura("check", slow)
    assert done.exit_code == 1
    assert "error: program: speed 9, expected optimal or a factor from 0.1 to 2" in done.output
    done = caesura("execute", slow, "--simulated", "--scenario", "dispenser")
    assert "speed 9, expected" in done.output


def test_optimal_without_its_extra_says_in_one_line_what_is_missing(
    program: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [name for name in sys.modules if name.startswith(("toppra", "caesura_lab.retiming"))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "toppra", None)
    done = caesura("program", "--file", program, "--speed", "optimal")
    assert done.exit_code != 0
    missing = "error: the speed optimal needs toppra: pip install '.[retiming]' in a clone of Caesura"
    assert done.output.strip() == missing


@pytest.mark.slow
def test_the_fastest_program_is_written_checked_and_run(tmp_path: Path) -> None:
    taught, fast = tmp_path / "taught.json", tmp_path / "fast.json"
    caesura("segment", Path(__file__).parents[2] / "data" / "pick_and_place.npz", "--json", taught)
    words = ("--speed", "optimal", "--keep-pause", 3, "--format", "json", "-o", fast)
    assert caesura("program", "--file", taught, *words).exit_code == 0
    timing = json.loads(fast.read_text("utf-8"))["timing"]
    assert (timing["speed"], timing["retimed"], timing["keeps_pause"]) == ("optimal", [0, 2, 3, 5], [2])
    assert "re-timed (speed optimal): apps 1, 3, 4, 6" in caesura("check", fast).output
    done = caesura("execute", fast, "--simulated", "--scenario", "pick_and_place")
    assert done.exit_code == 0, done.output
    done = caesura("program", "--file", fast, "--speed", "0.5")
    assert "is re-timed already (speed optimal): begin with the program as it was taught" in done.output


def test_a_script_of_what_the_check_refuses_says_so(tmp_path: Path) -> None:
    # A Hand-E opens to 50 mm: the script that opens it to 80 mm had the error in a comment alone.
    program, out = tmp_path / "pick.json", tmp_path / "pick.script"
    program.write_text(as_file(pick_and_place(), "pick").as_json(), encoding="utf-8")
    words = ("program", "--file", program, "--format", "urscript", "--gripper", "robotiq_hand_e", "-o", out)
    written = caesura(*words)
    assert written.exit_code == 0
    assert out.exists()
    assert "error: app 5 (move gripper): gripper width 80 mm, expected 0 to 5" in written.stderr
    assert "caesura check refuses this program" in written.stderr
