"""What a check finds stands in the scripts of all makers: about an app at that app, the rest at the top."""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from shutil import copyfile
from xml.etree.ElementTree import Comment, TreeBuilder, XMLParser, fromstring

import pytest

from caesura_protocol.app_kinds import app_name
from caesura_protocol.messages import App, WrenchReport
from caesura_protocol.programs.apps_by_phase import Group
from caesura_protocol.programs.behaviour_tree import behaviour_tree
from caesura_protocol.programs.checks import document_findings
from caesura_protocol.programs.document import ProgramFile
from caesura_protocol.programs.franky_script import franky_script
from caesura_protocol.programs.ur_script import ur_script
from caesura_protocol.programs.xarm_script import xarm_script
from caesura_protocol.robots import description, robot_description
from harness.programs import as_file, path_from, pick_and_place, press

Writer = Callable[[ProgramFile], str]
SCRIPTS = [
    (franky_script, "panda", "franka_hand"),
    (ur_script, "ur5e", "robotiq_2f_85"),
    (xarm_script, "xarm7", "xarm_gripper"),
]


def grasped_with_a_press() -> tuple[App, ...]:
    """The hand pressed on the table with 13.7 N while the fingers closed."""
    touch, grasp, *rest = pick_and_place()
    return touch, grasp.model_copy(update={"force_taught": (0.0, 0.0, -13.7)}), *rest


def named(apps: tuple[App, ...], name: str) -> tuple[App, ...]:
    """The apps, of which an operator has named the second one."""
    return apps[0], apps[1].model_copy(update={"name": name}), *apps[2:]


def on_robot(apps: tuple[App, ...], robot: str, gripper: str) -> ProgramFile:
    return as_file(apps).model_copy(update={"robot": robot, "gripper": gripper})


def wrench(*, stated: bool, contact_models: bool, note: str = "") -> WrenchReport:
    return WrenchReport(
        source="flange_sensor",
        stated=stated,
        contact_models=contact_models,
        transport_models=True,
        tare=None,
        note=note,
    )


@pytest.mark.parametrize(("write", "robot", "gripper"), SCRIPTS)
def test_an_app_has_the_name_that_an_operator_gave_it(write: Writer, robot: str, gripper: str):
    """A check and the scripts named its kind, the page its name."""
    program = on_robot(named(grasped_with_a_press(), "grip the cup"), robot, gripper)
    found = [str(one) for one in document_findings(program) if one.index == 1]
    assert found
    assert all(": app 2 (grip the cup): " in one for one in found)
    assert "# app 2 (grip the cup)" in write(program)


@pytest.mark.parametrize("name", ['say "go"', "back\\slash", "Ärmel", "رفع 🤖"])
@pytest.mark.parametrize(("write", "robot", "gripper"), SCRIPTS)
def test_no_name_of_an_app_breaks_a_script(write: Writer, robot: str, gripper: str, name: str):
    program = on_robot(named(pick_and_place(), name), robot, gripper)
    text = write(program)
    if write is ur_script:
        assert text.isascii()
        assert 'begin_app("app 2 (grasp)")' in text
    else:
        ast.parse(text)


@pytest.mark.parametrize(("write", "robot", "gripper"), SCRIPTS)
def test_what_a_check_finds_of_an_app_stands_at_that_app(write: Writer, robot: str, gripper: str):
    program = on_robot(grasped_with_a_press(), robot, gripper)
    lines = [line.strip() for line in write(program).splitlines()]
    heads = [
        next(i for i, line in enumerate(lines) if line.startswith(f"# {app_name(index, one.kind)}"))
        for index, one in enumerate(program.apps)
    ]
    found = [one for one in document_findings(program) if one.index is not None]
    assert any("press of 13.7 N, which it does not reproduce" in one.reason for one in found)
    for one in found:
        assert f"# {one.severity}: {one.reason}" in lines[heads[one.index] + 1 :][: len(found)]
        assert lines.count(f"# {one.severity}: {one.reason}") == 1


@pytest.mark.parametrize(("write", "robot", "gripper"), SCRIPTS)
def test_what_a_check_finds_of_the_whole_program_stands_at_the_top(write: Writer, robot: str, gripper: str):
    program = on_robot(pick_and_place(), robot, gripper)
    assumed = wrench(stated=False, contact_models=True)
    text = write(program.model_copy(update={"wrench": assumed}))
    said = "# warning: wrench source flange_sensor is assumed: state it with --wrench-source"
    assert text.index(said) < text.index("MAX_SPEED_M_PER_S")


@pytest.mark.parametrize(("write", "robot", "gripper"), SCRIPTS)
def test_a_finding_is_one_line_of_comment(write: Writer, robot: str, gripper: str):
    program = on_robot(pick_and_place(), robot, gripper)
    noted = wrench(stated=True, contact_models=False, note="first\nimport os")
    lines = write(program.model_copy(update={"wrench": noted})).splitlines()
    assert [line.strip() for line in lines if "import os" in line] == [
        "# warning: contacts were not searched for. first import os"
    ]


@pytest.mark.parametrize(("write", "robot", "gripper"), SCRIPTS)
def test_a_comment_has_no_control_characters(write: Writer, robot: str, gripper: str):
    """A NUL in a note of a file made a script that Python refuses."""
    program = on_robot(pick_and_place(), robot, gripper)
    noted = wrench(stated=True, contact_models=False, note="first\x00second\x1b[31m\x7f \u202ethird")
    text = write(program.model_copy(update={"wrench": noted}))
    assert "# warning: contacts were not searched for. first second [31m third\n" in text
    assert not {ord(character) for character in text if character != "\n"} & {*range(32), 127, 0x202E}


@pytest.mark.parametrize(("write", "robot", "gripper"), SCRIPTS)
def test_a_group_of_apps_has_its_name_above_its_first_app(write: Writer, robot: str, gripper: str):
    # A name that an operator gave to a phase was in no script. It may hold what ends a comment in a file.
    name = "wipe <APPS> the tray\nimport os\u2028import sys\x85halt"
    groups = (Group.model_construct(first=0, last=2, name=name, strokes=3),)
    program = on_robot(pick_and_place(), robot, gripper).model_copy(update={"groups": groups})
    plain, text = write(on_robot(pick_and_place(), robot, gripper)), write(program)
    lines = [line.strip() for line in text.splitlines()]
    (heading,) = [line for line in lines if "import os" in line]
    assert heading.startswith(
        "# === wipe <APPS> the tray import os import sys halt, 3 strokes taught: apps 1"
    )
    after = next(line for line in lines[lines.index(heading) + 1 :] if line not in ("", "#"))
    assert after.startswith("# app 1 (move to contact)")
    code = [line for line in text.splitlines() if line.strip() and not line.strip().startswith("#")]
    assert code == [line for line in plain.splitlines() if line.strip() and not line.strip().startswith("#")]


def test_a_urscript_is_plain_ascii():
    # The controller reads it from a socket; findings have degrees and ranges.
    touch, *rest = grasped_with_a_press()
    off = path_from((-0.014, -0.673, 0.3), touch.t0, touch.tn, 0.2).model_copy(update={"deviation_rad": 0.1})
    text = ur_script(on_robot((touch.model_copy(update={"path": off}), *rest), "ur5e", "robotiq_2f_85"))
    assert "# warning: deviates by up to 5.7 degrees from the taught orientations, the tolerance is" in text
    assert text.isascii()


@pytest.mark.parametrize(("write", "robot", "gripper"), SCRIPTS)
def test_a_carry_that_looks_for_a_surface_says_so(write: Writer, robot: str, gripper: str):
    # A hold that sets down had a call for it, and nothing that said so.
    touch, grasp, lift, carry, let_go, leave = pick_and_place()
    held = carry.model_copy(update={"kind": "hold"})
    program = on_robot((touch, grasp, lift, held, let_go, leave), robot, gripper)
    lines = [line.strip() for line in write(program).splitlines()]
    said = "# sets down: looks for the surface at its end, slowly until it is felt"
    assert lines.count(said) == 1
    assert lines[lines.index(said) - 1].startswith("# app 4 (hold)")


HARD_TO_WRITE = 'Fasten the clamp first! """ */ --> \\u &lt; <APPS> \u6865 #'


@pytest.mark.parametrize(("write", "robot", "gripper"), [*SCRIPTS, (behaviour_tree, "panda", "franka_hand")])
def test_the_name_of_a_program_and_the_notes_of_apps_are_comments(write: Writer, robot: str, gripper: str):
    """They were in the JSON file alone."""
    touch, *rest = pick_and_place()
    noted = touch.model_copy(update={"note": HARD_TO_WRITE})
    program = on_robot((noted, *rest), robot, gripper)
    text = write(program.model_copy(update={"name": f"Fill {HARD_TO_WRITE}"}))
    read = comments_of(text) if write is behaviour_tree else text.splitlines()
    shown = HARD_TO_WRITE.replace("--", "- -") if write is behaviour_tree else HARD_TO_WRITE
    shown = shown.replace("\u6865", "\\u6865") if write is ur_script else shown
    marked = [line.strip().removeprefix("# ") for line in read]
    assert marked.count(f"called: Fill {shown}") == 1
    assert marked.count(f"note: {shown}") == 1
    if write in {franky_script, xarm_script}:
        compile(text, "script", "exec")


def comments_of(xml: str) -> list[str]:
    with_comments = XMLParser(target=TreeBuilder(insert_comments=True))
    return [str(one.text) for one in fromstring(xml, with_comments).iter(Comment)]


@pytest.fixture
def forgets_robots() -> Iterator[None]:
    """A robot that a test reads from a path is known to this test alone."""
    yield
    description._known.cache_clear()
    robot_description.cache_clear()


@pytest.mark.usefixtures("forgets_robots")
@pytest.mark.parametrize(("write", "robot", "gripper"), SCRIPTS)
def test_the_title_of_a_robot_is_no_code(write: Writer, robot: str, gripper: str, tmp_path: Path):
    """The description of a robot of one's own is written by hand."""
    own = robot_description(robot)
    title = 'Arm """6""" \\u C:\\new\nimport os\x0bhalt'
    described = own.model_dump(mode="json", exclude={"folder"}) | {"name": f"own-{robot}", "title": title}
    (tmp_path / "robot.json").write_text(json.dumps(described), encoding="utf-8")
    copyfile(own.urdf_path, tmp_path / own.urdf)
    robot_description(str(tmp_path))
    text = write(on_robot(pick_and_place(), f"own-{robot}", gripper))
    plain = write(on_robot(pick_and_place(), robot, gripper))
    assert len(text.splitlines()) == len(plain.splitlines())
    if write is not ur_script:
        module = ast.parse(text)
        said = ast.get_docstring(module)
        assert said is not None
        assert 'Arm """6""" \\u C:\\new import os halt' in said


NOT_OBSERVED = "Not observed: after 3.40 s (samples were lost). What was taught then is missing."


@pytest.mark.parametrize(("write", "robot", "gripper"), SCRIPTS)
def test_a_script_of_a_program_without_a_robot_says_so(write: Writer, robot: str, gripper: str):
    # What was taught on an arm of another maker was written for this one, without a word.
    stated = on_robot(pick_and_place(), robot, gripper)
    text = write(stated.model_copy(update={"robot": None}))
    said = "# warning: the program states no robot, so whether these poses are those of this arm is not known"
    assert text.index(said) < text.index("MAX_SPEED_M_PER_S")
    assert said not in write(stated)


DAY_S = 1700000000.0  # a time of day: 2023-11-14 22:13:20 UTC


@pytest.mark.parametrize(("write", "robot", "gripper"), SCRIPTS)
def test_times_of_day_read_from_the_first_app_on(write: Writer, robot: str, gripper: str):
    """As in the table; they were seconds since 1970."""
    later = [one.model_copy(update={"t0": one.t0 + DAY_S, "tn": one.tn + DAY_S}) for one in pick_and_place()]
    begins = later[0].t0
    note = f"Not observed: after {begins + 3.25:.2f} s (samples were lost)."
    text = write(on_robot(tuple(later), robot, gripper).model_copy(update={"notes": (note,)}))
    assert "# in comments, times [s] from 2023-11-14 22:13:20 UTC on, the start" in text
    assert "# warning: Not observed: after 3.25 s (samples were lost)." in text


ON_SOURCE = "Wrench source flange_sensor: contact and load are on."


@pytest.mark.parametrize(("write", "robot", "gripper"), SCRIPTS)
def test_the_notes_of_a_program_stand_at_the_top(write: Writer, robot: str, gripper: str):
    program = on_robot(pick_and_place(), robot, gripper)
    text = write(program.model_copy(update={"notes": (NOT_OBSERVED,)}))
    assert text.index(f"# warning: {NOT_OBSERVED}") < text.index("MAX_SPEED_M_PER_S")


def test_forces_that_were_not_zeroed_are_named_and_the_note_on_the_source_is_not_repeated():
    why = "Not tared: the force varied by 1.14 N at the start (limit 0.5 N)."
    taught = wrench(stated=True, contact_models=True, note=f"{ON_SOURCE} {why}")
    program = as_file(pick_and_place()).model_copy(update={"wrench": taught, "notes": (ON_SOURCE,)})
    assert of_tare(program) == [why]
    tared = taught.model_copy(update={"tare": (0.1, 0.0, 0.2), "note": f"{ON_SOURCE} Tared at the start."})
    assert of_tare(program.model_copy(update={"wrench": tared})) == []


def of_tare(program: ProgramFile) -> list[str]:
    return [one.reason for one in document_findings(program) if "tared" in one.reason.lower()]


@pytest.mark.parametrize(("write", "robot", "gripper"), [*SCRIPTS, (behaviour_tree, "panda", "franka_hand")])
def test_a_program_that_was_still_being_taught_says_so(write: Writer, robot: str, gripper: str):
    # A script of half a demonstration looked like that of a whole one.
    program = on_robot(pick_and_place(), robot, gripper)
    said = "was still being taught at"
    assert said not in write(program)
    assert said in write(program.model_copy(update={"complete": False, "t": 12.0}))


@pytest.mark.parametrize(("write", "robot", "gripper"), [one for one in SCRIPTS if one[0] is not ur_script])
def test_a_name_that_cannot_be_printed_ends_no_script(
    write: Writer, robot: str, gripper: str, tmp_path: Path
):
    apps = (press()[0].model_copy(update={"name": "greifen – 抓取"}),)
    script = tmp_path / "made.py"
    script.write_text(write(on_robot(apps, robot, gripper)), encoding="utf-8")
    command = [sys.executable, str(script), "--dry-run"]
    printed = {**os.environ, "PYTHONIOENCODING": "cp1252"}
    done = subprocess.run(command, env=printed, capture_output=True, check=True)
    assert "greifen – \\u6293\\u53d6".encode("cp1252") in done.stdout
