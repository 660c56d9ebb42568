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
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from caesura_ros import running, teaching
from caesura_ros.conversion import as_ros, fields_of
from pydantic import BaseModel

from caesura_protocol.errors import CaesuraError
from caesura_protocol.messages import Changepoint, Changepoints, Description, Program, Segments
from caesura_protocol.programs.export_formats import ProgramWriter
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


def test_an_optional_number_that_ros_2_has_as_an_array_is_one():
    # The generated message refuses a number in its place.
    program = wire(Program)
    app = program.apps[0].model_copy(update={"added": 3})
    values = as_ros(app, lambda name, values: values)
    assert values["added"] == [3]
    assert as_ros(app.model_copy(update={"added": None}), lambda name, values: values)["added"] == []


def test_the_actions_have_what_the_node_uses(store):
    fields = {
        name: {field[0] for field in store.get_msgdef(f"{PACKAGE}/msg/{name}").fields} for name in ACTIONS
    }
    assert fields == ACTIONS


ACTIONS = {
    "TeachGoal": {"station", "session", "task", "operator"},
    "TeachResult": {"success", "message", "session", "program"},
    "TeachFeedback": {"session", "segments"},
    "RunGoal": {"station", "session", "format", "host", "robot", "gripper", "unchecked"},
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


# --- The node and its launch file, with stand-ins for ROS 2 -----------------------------------------------


class Parameter:
    """launch_ros' description of a parameter: without a type its text is read as YAML."""

    def __init__(self, value: str, value_type: type | None = None) -> None:
        self.value = value if value_type is str else yaml.safe_load(value)


def test_the_launch_file_states_its_arguments_as_texts(monkeypatch):
    # The default station is `*`, which is an error as YAML; a station 7 would be a number.
    started: dict[str, Any] = {}
    defaults: dict[str, str] = {}

    def argument(name: str, default_value: str) -> None:
        defaults[name] = default_value

    def node(parameters: list[dict[str, Any]], **stated: Any) -> None:
        for one in parameters:
            started.update(
                {
                    name: (value if isinstance(value, Parameter) else Parameter(value)).value
                    for name, value in one.items()
                }
            )

    modules = {
        "launch": {"LaunchDescription": lambda entities: entities},
        "launch.actions": {"DeclareLaunchArgument": argument},
        "launch.substitutions": {"LaunchConfiguration": lambda name: defaults[name]},
        "launch_ros": {},
        "launch_ros.actions": {"Node": node},
        "launch_ros.parameter_descriptions": {"ParameterValue": Parameter},
    }
    for name, content in modules.items():
        monkeypatch.setitem(sys.modules, name, SimpleNamespace(**content))
    runpy.run_path(str(ROS / "caesura_ros" / "launch" / "caesura.launch.py"))["generate_launch_description"]()
    assert started == {"endpoint": "tcp/127.0.0.1:7447", "station": "*"}


class Goal:
    """A goal of rclpy: what it was asked, whether it is cancelled, its final state."""

    def __init__(self, **asked: Any) -> None:
        self.request, self.is_cancel_requested, self.state = SimpleNamespace(**asked), False, ""

    def publish_feedback(self, feedback: Any) -> None:
        pass

    def succeed(self) -> None:
        self.state = "succeeded"

    def abort(self) -> None:
        self.state = "aborted"

    def canceled(self) -> None:
        assert self.is_cancel_requested, "rcl has no way from executing to canceled"
        self.state = "canceled"


class Served:
    """The servers of the node by their names, and what the service of the node answers."""

    def __init__(self) -> None:
        self.actions: dict[str, Any] = {}
        self.logged: list[str] = []
        self.is_ok = True

    def server(self, node: Any, kind: Any, name: str, execute: Any, **callbacks: Any) -> None:
        self.actions[name] = SimpleNamespace(execute=execute, **callbacks)


@pytest.fixture
def served(monkeypatch):
    """The node of the package, imported with stand-ins for rclpy and the generated messages."""
    found = Served()

    class FakeRosNode:
        def __init__(self, name: str) -> None:
            pass

        def declare_parameter(self, name: str, value: str) -> Any:
            return SimpleNamespace(value=value)

        def create_publisher(self, kind: Any, name: str, qos: Any) -> Any:
            return SimpleNamespace(publish=print)

        def get_logger(self) -> Any:
            return SimpleNamespace(**dict.fromkeys(("warning", "error", "fatal"), found.logged.append))

        def destroy_node(self) -> None:
            pass

    part = SimpleNamespace(Feedback=SimpleNamespace, Result=SimpleNamespace)
    said = SimpleNamespace(ACCEPT="accept", REJECT="reject")
    modules = {
        "rclpy": {"ok": lambda: found.is_ok},
        "rclpy.action": {"ActionServer": found.server, "CancelResponse": said, "GoalResponse": said},
        "rclpy.callback_groups": {"ReentrantCallbackGroup": SimpleNamespace},
        "rclpy.executors": {
            "ExternalShutdownException": RuntimeError,
            "MultiThreadedExecutor": SimpleNamespace,
        },
        "rclpy.node": {"Node": FakeRosNode},
        "rclpy.qos": {
            "DurabilityPolicy": SimpleNamespace(TRANSIENT_LOCAL=1),
            "QoSProfile": SimpleNamespace,
        },
        PACKAGE: {
            "action": SimpleNamespace(Teach=part, Run=part),
            "msg": SimpleNamespace(Changepoints=0, Segments=0, Program=0),
        },
    }
    for name, content in modules.items():
        monkeypatch.setitem(sys.modules, name, SimpleNamespace(**content))
    monkeypatch.delitem(sys.modules, "caesura_ros.node", raising=False)
    module: Any = import_module("caesura_ros.node")

    session = SimpleNamespace(program=wire(Program), segments=wire(Segments))
    service = SimpleNamespace(results=lambda station: (), snapshot=lambda *asked: session, close=lambda: None)
    monkeypatch.setattr(module, "connect", lambda endpoint: service)
    found.module, found.service, found.node = module, service, module.CaesuraNode()
    yield found
    sys.modules.pop("caesura_ros.node", None)


def asked_to_run(host: str = "10.0.0.9") -> Goal:
    return Goal(
        station="cell-1", session="", format="urscript", host=host, robot="", gripper="", unchecked=True
    )


def test_a_script_that_a_controller_has_is_not_said_to_be_cancelled(served, monkeypatch):
    goal = asked_to_run()

    def sends(*asked: Any, **stated: Any) -> running.Ran:
        goal.is_cancel_requested = True  # too late
        return running.Ran(True, "sent to the controller")

    monkeypatch.setattr(served.module, "run", sends)
    served.actions["~/run"].execute(goal)
    assert goal.state == "succeeded"


def test_the_script_that_the_node_runs_has_the_groups_of_the_program(served, monkeypatch):
    """It had none: the phases were left out on the way from the session to its script."""
    made: list[Any] = []
    monkeypatch.setattr(served.module, "run", lambda *_, **__: running.Ran(True, ""))
    monkeypatch.setattr(served.module, "document", lambda program, phases: made.append((program, phases)))
    served.actions["~/run"].execute(asked_to_run())
    assert made == [(wire(Program), wire(Segments).phases)]


def test_the_end_of_the_node_cancels_the_script_that_it_runs(served, monkeypatch):
    def runs(program: Any, script: str, host: str, report: Any, is_cancelled: Any, **_: Any) -> running.Ran:
        served.is_ok = False
        return running.Ran(not is_cancelled(), "")

    monkeypatch.setattr(served.module, "run", runs)
    goal = asked_to_run()
    served.actions["~/run"].execute(goal)
    assert goal.state == "aborted"


def test_a_robot_and_a_station_have_one_goal_at_a_time(served, monkeypatch):
    run = served.actions["~/run"]
    one, other = asked_to_run(), asked_to_run("10.0.0.8")
    assert run.goal_callback(one.request) == "accept"
    assert run.goal_callback(one.request) == "reject"
    assert served.logged == ["goal rejected: the robot 10.0.0.9 has a goal under way"]
    assert run.goal_callback(other.request) == "accept"
    monkeypatch.setattr(served.module, "run", lambda *asked, **stated: running.Ran(True, ""))
    run.execute(one)
    assert run.goal_callback(one.request) == "accept"
    monkeypatch.setattr(served.module, "GOALS", 2)
    assert run.goal_callback(asked_to_run("10.0.0.7").request) == "reject"


def test_a_goal_that_is_cancelled_as_it_starts_is_carried_out_and_leaves_room(served, monkeypatch):
    """rclpy raised between its look at the cancellation and the start, and the robot had no goal any more."""
    run, goal = served.actions["~/run"], asked_to_run()

    def runs(program: Any, script: str, host: str, report: Any, is_cancelled: Any, **_: Any) -> running.Ran:
        return running.Ran(not is_cancelled(), "")

    def execute() -> None:
        if not goal.is_cancel_requested:
            goal.is_cancel_requested = True  # by another thread
            raise RuntimeError("no way from canceling to executing")
        run.execute(goal)

    monkeypatch.setattr(served.module, "run", runs)
    goal.execute = execute
    assert run.goal_callback(goal.request) == "accept"
    run.handle_accepted_callback(goal)
    assert goal.state == "canceled"
    assert run.goal_callback(goal.request) == "accept"


def test_a_goal_that_cannot_start_leaves_room(served):
    run, goal = served.actions["~/run"], asked_to_run()

    def execute() -> None:
        raise RuntimeError("the node is going")

    goal.execute = execute
    assert run.goal_callback(goal.request) == "accept"
    with pytest.raises(RuntimeError):
        run.handle_accepted_callback(goal)
    assert run.goal_callback(goal.request) == "accept"


def test_the_node_has_threads_for_cancellations_beside_all_goals(served, monkeypatch):
    # By default the executor has as many threads as processors: two goals took both, for minutes.
    spun: list[Any] = []
    rclpy = served.module.rclpy
    rclpy.init, rclpy.try_shutdown = (lambda: None), (lambda: None)
    rclpy.spin = lambda node, executor: spun.append(executor)
    served.module.main()
    assert spun[0].num_threads > served.module.GOALS


def test_a_goal_that_fails_says_why(served):
    # Its result was empty: a task that no description can have, and a name that no key can have.
    for asked, words in (({"task": "x" * 1000}, "task"), ({"station": "a/b*"}, "a/b*")):
        goal = Goal(**({"station": "cell-1", "session": "", "task": "", "operator": ""} | asked))
        served.service.transport = None
        result = served.actions["~/teach"].execute(goal)
        assert (goal.state, result.success) == ("aborted", False)
        assert words in result.message


def test_results_that_end_are_logged(served):
    served.service.results = lambda station: (_ for _ in ()).throw(CaesuraError("the service is newer"))
    served.node.follow()
    assert "the service is newer" in served.logged[0]


# --- Teaching, without ROS 2 ------------------------------------------------------------------------------


class ClosingStation:
    """A station whose session closes when it is stopped."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, refused: str | None = None) -> None:
        self.transport, self.stopped, self.refused = self, False, refused
        self.program = wire(Program)
        monkeypatch.setattr(teaching.demonstration_control, "start", self.start)
        monkeypatch.setattr(teaching.demonstration_control, "stop", self.stop)

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
    shown = ClosingStation(monkeypatch)
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


def test_a_demonstration_whose_connection_is_lost_keeps_its_name_and_program(monkeypatch):
    shown = ClosingStation(monkeypatch)

    def results(station: str, session: str, silence_s: float) -> Any:
        yield SimpleNamespace(closed=False, program=shown.program, session=session)
        raise CaesuraError("the router is gone")

    shown.results = results
    done = teaching.teach(shown, "cell-1", "", Description(), lambda update: None, lambda: False)
    assert done == (False, "the router is gone", "made", shown.program)


def test_a_demonstration_that_is_being_stopped_is_followed_once(monkeypatch):
    # It was subscribed and queried anew for every update until it was closed.
    shown = ClosingStation(monkeypatch)
    followed: list[bool] = []

    def results(station: str, session: str, silence_s: float) -> Any:
        followed.append(shown.stopped)
        for closed in (False, False, shown.stopped):
            yield SimpleNamespace(closed=closed, program=shown.program, session=session)

    shown.results = results
    done = teaching.teach(shown, "cell-1", "", Description(), lambda update: None, lambda: True)
    assert (done.message, followed) == ("stopped", [False, True])


def test_a_demonstration_that_cannot_start_says_why(monkeypatch):
    shown = ClosingStation(monkeypatch, refused="no bridge is connected at cell-1")
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


def test_a_program_that_is_cancelled_while_it_is_checked_is_not_run(monkeypatch):
    assert ran(monkeypatch, "print('moved')", cancel_at=0) == ((False, "cancelled"), [])


def test_a_script_has_a_process_group_of_its_own(monkeypatch):
    # Ctrl-C at the node went to the whole group, and again to the script: the second cut its stop short.
    _, lines = ran(monkeypatch, "import os\nprint(os.getpgid(0) == os.getpid())")
    assert lines == ["True"]


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


HOLDS = """
import signal, sys
from pathlib import Path
try:
    sys.stdout.buffer.write(b"app \\xff\\n")
    sys.stdout.flush()
    signal.pause()
except KeyboardInterrupt:
    Path(HELD).touch()
"""


def test_a_line_that_cannot_be_reported_lets_the_script_stop_the_arm(monkeypatch, tmp_path):
    """It was killed at once, by a lost publisher or by a letter that is no UTF-8: the controller goes on."""
    held = tmp_path / "held"
    script = HOLDS.replace("HELD", repr(str(held)))
    monkeypatch.setattr(running, "WRITERS", {"franky": ProgramWriter("", ".py", lambda program: script)})
    lines: list[str] = []

    def report(line: str) -> None:
        lines.append(line)
        raise RuntimeError("the node is going")

    with pytest.raises(RuntimeError):
        running.run(as_file(press()), "franky", "10.0.0.9", report, lambda: False, unchecked=True)
    assert held.exists()
    assert lines == ["app \ufffd"]


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


def test_the_program_of_another_arm_than_the_one_at_the_host_is_refused_by_name():
    # Both arms take URScript: the program of a UR5e was sent to a UR10e.
    taught = as_file(press()).model_copy(update={"robot": "ur5e"})
    done = running.run(taught, "urscript", "h", print, lambda: False, robot="ur10e", unchecked=True)
    assert not done.success
    assert "was taught on ur5e, not on ur10e" in done.message
    unknown = running.run(taught, "urscript", "h", print, lambda: False, robot="ur9", unchecked=True)
    assert "robot 'ur9' is not known" in unknown.message


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
    assert b"".join(received).startswith(b"def caesura_program():\n  # Task program file/example")
    assert b"".join(received).endswith(b"\nend\n")  # without a line feed it is not run
