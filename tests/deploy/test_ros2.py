"""The packages for ROS 2, without ROS 2: definitions that equal the wire, teaching, running."""

from __future__ import annotations

import ast
import json
import math
import runpy
import socket
import sys
import threading
import xml.etree.ElementTree as ET
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from caesura_ros import running, teaching
from caesura_ros.conversion import as_ros, fields_of
from pydantic import BaseModel

from caesura_protocol.errors import CaesuraError
from caesura_protocol.messages import Changepoint, Changepoints, Description, Program, Segments
from caesura_protocol.programs.formats import ProgramWriter
from harness.programs import as_file, pick_and_place, press

rosbags = pytest.importorskip("rosbags.typesys", reason="rosbags is not installed")
TOP = Path(__file__).resolve().parents[2]
ROS = TOP / "deploy" / "ros2"
VECTORS = TOP / "tests" / "vectors"
PACKAGE = "caesura_interfaces"


@pytest.fixture(scope="module")
def store():
    """A type store of ROS 2 with all definitions of the package, those of its actions too."""
    found = rosbags.get_typestore(rosbags.Stores.ROS2_HUMBLE)
    types: dict[str, Any] = {}
    for file in (ROS / PACKAGE / "msg").glob("*.msg"):
        types |= rosbags.get_types_from_msg(file.read_text(), f"{PACKAGE}/msg/{file.stem}")
    for file in (ROS / PACKAGE / "action").glob("*.action"):
        for part, text in zip(("Goal", "Result", "Feedback"), file.read_text().split("---\n"), strict=True):
            types |= rosbags.get_types_from_msg(text, f"{PACKAGE}/msg/{file.stem}{part}")
    found.register(types)
    return found


def test_the_definitions_are_those_of_the_wire():
    wanted = runpy.run_path(str(TOP / "scripts" / "write_ros_messages.py"))["definitions"]()
    there = {file.name: file.read_text() for file in (ROS / PACKAGE / "msg").glob("*.msg")}
    assert there == wanted


def wire(model: type[BaseModel]) -> Any:
    """The example of a message on the wire."""
    vector = json.loads((VECTORS / f"{model.__name__}.json").read_text())
    return model.model_validate(vector["fields"])


def back(message: Any, model: type[BaseModel]) -> dict[str, Any]:
    """The wire's fields of a message of ROS 2."""
    found = {}
    for field in fields_of(model):
        value = getattr(message, field.name)
        if field.model is not None and "[" in field.type:
            value = [back(one, field.model) for one in value]
            value = value if field.type.endswith("[]") else value[0] if value else None
        elif field.model is not None:
            value = back(value, field.model)
        elif isinstance(value, np.ndarray | list):
            value = None if field.optional and len(value) == 0 else np.asarray(value).tolist()
        elif field.optional and (value == "" or (isinstance(value, float) and math.isnan(value))):
            value = None
        elif isinstance(value, str) and value.startswith("{"):
            value = json.loads(value)
        found[field.name] = value
    return found


@pytest.mark.parametrize("model", [Changepoints, Segments, Program])
def test_a_message_of_the_wire_is_the_same_after_ros_2(store, model):
    sent = wire(model)

    def make(name: str, values: dict[str, Any]) -> Any:
        kind = store.types[f"{PACKAGE}/msg/{name}"]
        arrays = {key: _array(value) for key, value in values.items()}
        return kind(**arrays)

    name = f"{PACKAGE}/msg/{model.__name__}"
    received = store.deserialize_cdr(store.serialize_cdr(as_ros(sent, make), name), name)
    assert model.model_validate(back(received, model)) == sent


def _array(value: Any) -> Any:
    """rosbags wants arrays of numpy where ROS 2 takes lists."""
    if isinstance(value, list) and all(isinstance(one, int | float) for one in value):
        return np.array(value, dtype=np.int64 if value and isinstance(value[0], int) else np.float64)
    return value


def test_an_optional_text_and_number_are_empty_and_nan():
    point = Changepoint(t=1.0, probability=0.5, certainty="final")
    values = as_ros(point, lambda name, values: values)
    assert math.isnan(values["t_low"])
    assert values["certainty"] == "final"


def test_the_actions_have_what_the_node_uses(store):
    fields = {
        name: {field[0] for field in store.get_msgdef(f"{PACKAGE}/msg/{name}").fields} for name in ACTIONS
    }
    assert fields == ACTIONS


ACTIONS = {
    "TeachGoal": {"station", "session", "task", "operator"},
    "TeachResult": {"success", "message", "session", "program"},
    "TeachFeedback": {"session", "segments"},
    "RunGoal": {"station", "session", "format", "host", "gripper", "unchecked"},
    "RunResult": {"success", "message"},
    "RunFeedback": {"line"},
}


def test_the_packages_name_what_they_use():
    for name, build in ((PACKAGE, "ament_cmake"), ("caesura_ros", "ament_python")):
        manifest = ET.parse(ROS / name / "package.xml").getroot()
        assert manifest.findtext("name") == name
        assert manifest.findtext("export/build_type") == build
    setup = ast.parse((ROS / "caesura_ros" / "setup.py").read_text())
    assert "caesura_node = " in ast.unparse(setup)
    assert (ROS / "caesura_ros" / "resource" / "caesura_ros").exists()
    node = ast.parse((ROS / "caesura_ros" / "caesura_ros" / "node.py").read_text())
    used = {one.module.partition(".")[0] for one in ast.walk(node) if isinstance(one, ast.ImportFrom)}
    stated = {one.text for one in ET.parse(ROS / "caesura_ros" / "package.xml").getroot().iter("exec_depend")}
    assert used & {"rclpy", PACKAGE} <= stated


# --- Teaching, without ROS 2 ------------------------------------------------------------------------------


class Demonstration:
    """A station whose session closes when it is stopped."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, refused: str | None = None) -> None:
        self.transport, self.stopped, self.refused = self, False, refused
        self.program = wire(Program)
        monkeypatch.setattr(teaching.describing, "start", self.start)
        monkeypatch.setattr(teaching.describing, "stop", self.stop)

    def start(self, transport: Any, station: str, description: Description, session: str | None) -> Any:
        if self.refused is not None:
            raise CaesuraError(self.refused)
        self.started = (station, description.task, session)
        return SimpleNamespace(session=session or "made")

    def stop(self, transport: Any, station: str, session: str) -> None:
        self.stopped = True

    def results(self, station: str, session: str, silence_s: float) -> Any:
        yield SimpleNamespace(closed=self.stopped, program=self.program, session=session)


def test_a_demonstration_is_started_followed_and_stopped_where_it_is_cancelled(monkeypatch):
    shown = Demonstration(monkeypatch)
    seen: list[Any] = []
    done = teaching.teach(shown, "cell-1", "", Description(task="wipe"), seen.append, lambda: len(seen) > 1)
    assert (done.success, done.message, done.session, done.program) == (
        True,
        "stopped",
        "made",
        shown.program,
    )
    assert shown.started == ("cell-1", "wipe", None)
    assert [one.closed for one in seen] == [False, False, True]


def test_a_demonstration_that_cannot_start_says_why(monkeypatch):
    shown = Demonstration(monkeypatch, refused="no bridge is connected at cell-1")
    done = teaching.teach(shown, "cell-1", "x", Description(), print, lambda: False)
    assert (done.success, done.message) == (False, "no bridge is connected at cell-1")


# --- Running, without ROS 2 -------------------------------------------------------------------------------


def ran(
    monkeypatch: pytest.MonkeyPatch, script: str, check: str = "pass", cancel_at: int = 99, **stated: Any
) -> Any:
    """A run whose script in Python is `script`, and whose check is a program too."""
    monkeypatch.setattr(running, "WRITERS", {"franky": ProgramWriter("", ".py", lambda program: script)})
    lines: list[str] = []
    done = running.run(
        as_file(press()), "franky", "10.0.0.9", lines.append, lambda: len(lines) >= cancel_at,
        check=(sys.executable, "-c", check), **stated,
    )  # fmt: skip
    return done, lines


def test_a_script_runs_and_its_lines_are_reported(monkeypatch):
    done, lines = ran(monkeypatch, "import sys\nprint('app 1')\nprint(sys.argv[1:])")
    assert done == (True, "done")
    assert lines == ["app 1", "['--robot', '10.0.0.9']"]


def test_a_script_that_stops_says_why(monkeypatch):
    done, _ = ran(monkeypatch, "import sys\nsys.exit('stopped: no contact')")
    assert done == (False, "stopped: no contact")


def test_a_program_that_the_check_refuses_is_not_run(monkeypatch):
    refuses = "import sys\nprint('app 1: too far', open(sys.argv[1]).read()[:1])\nsys.exit(1)"
    done, lines = ran(monkeypatch, "print('moved')", refuses)
    assert (done.success, done.message, lines) == (False, "app 1: too far {", [])
    assert ran(monkeypatch, "print('moved')", refuses, unchecked=True)[1] == ["moved"]


def test_a_run_that_is_cancelled_lets_its_script_stop_the_arm(monkeypatch):
    # It was terminated: UFACTORY's controller goes on with the legs and the force that it has received.
    script = """
import signal
try:
    print("app 1", flush=True)
    signal.pause()
except KeyboardInterrupt:
    print("the arm holds", flush=True)
    raise
"""
    done, lines = ran(monkeypatch, script, cancel_at=1)
    assert (done, lines[:2]) == ((False, "cancelled"), ["app 1", "the arm holds"])


def test_a_script_that_does_not_end_where_it_is_cancelled_is_killed(monkeypatch):
    monkeypatch.setattr(running, "STOPS_S", 0.1)
    script = """
import signal
signal.signal(signal.SIGINT, signal.SIG_IGN)
print("app 1", flush=True)
signal.pause()
"""
    assert ran(monkeypatch, script, cancel_at=1) == ((False, "cancelled"), ["app 1"])


def test_what_cannot_be_written_is_refused():
    said = [
        running.run(as_file(pick_and_place()), one, "h", print, lambda: False).message
        for one in ("bt", "urscript")
    ]
    assert said[0] == "format is 'bt', expected one of franky, xarm, urscript"
    assert "no gripper is stated" in said[1]


def test_urscript_is_sent_to_the_controller(monkeypatch):
    # A controller sends its state all the time: a connection that was closed with it unread was reset.
    received: list[bytes] = []
    with socket.create_server(("127.0.0.1", 0)) as listener:
        monkeypatch.setattr(running, "UR_PORT", listener.getsockname()[1])

        def take() -> None:
            client, _ = listener.accept()
            with client:
                client.sendall(b"state")
                is_sent.wait(0.2)  # it reads when it comes to it
                while part := client.recv(65536):
                    received.append(part)

        is_sent = threading.Event()
        monkeypatch.setattr(running, "READ_S", 0.5)
        controller = threading.Thread(target=take)
        controller.start()
        done = running.run(as_file(press()), "urscript", "127.0.0.1", print, lambda: False, unchecked=True)
        is_sent.set()
        controller.join(10.0)
    assert done.success
    assert b"".join(received).startswith(b"# Task program file/example")
    assert b"".join(received).endswith(b"\nend\n")  # without a line feed it is not run
