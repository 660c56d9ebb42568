"""A Robotiq gripper on an arm of Universal Robots: its widths in the samples, and errors without them."""

from __future__ import annotations

import json
import logging
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from caesura_clients.bridge.sources import robotiq_urcap
from caesura_clients.bridge.sources.live_arm import LiveArm
from caesura_clients.bridge.sources.registry import ROBOTIQ_NAMES, SourceOptions, open_source
from caesura_clients.cli.commands import register
from caesura_protocol import robots
from caesura_protocol.errors import SourceError
from caesura_protocol.recording import Recording
from caesura_protocol.robots import GripperDescription, GripperError, gripper
from clients.conftest import free_port
from clients.fake_robotiq import Answer, FakeUrcap, fake_urcap, whole_line
from clients.fake_service import DEADLINE_S, eventually
from clients.fake_ur import UrScript, fake_ur, state

HOST = "127.0.0.1"
STATED = SourceOptions(
    host=HOST,
    robot="ur5e",
    tcp_offset="0,0,0,0,0,0",
    wrench_source="none",
    gripper_name="robotiq_2f_85",
)
STATE_S = 0.002
OPEN, HELD, SHUT = 3, 150, 230  # counts
HELD_M = 0.085 * (SHUT - HELD) / (SHUT - OPEN)
OUTAGE_STATES = 250  # half a second of the robot's time


class States:
    """States of an arm without an end; `at` is called once, when a state of that number is read."""

    def __init__(self, pose: Callable[[float], list[float]] | None = None) -> None:
        self.read = 0
        self._pose = pose
        self._hooks: dict[int, Callable[[], None]] = {}
        self._deadline_s = time.monotonic() + DEADLINE_S

    def at(self, number: int, hook: Callable[[], None]) -> None:
        self._hooks[number] = hook

    def __len__(self) -> int:
        return sys.maxsize

    def __getitem__(self, number: int) -> SimpleNamespace:
        assert time.monotonic() < self._deadline_s, "the gripper never answered again"
        self.read = number
        if (hook := self._hooks.pop(number, None)) is not None:
            hook()
        t = STATE_S * number
        return state(5000.0 + t, **({} if self._pose is None else {"pose": self._pose(t)}))


@pytest.fixture
def urcap(monkeypatch: pytest.MonkeyPatch) -> Iterator[FakeUrcap]:
    with fake_urcap() as served:
        monkeypatch.setattr(robotiq_urcap, "PORT", served.port)
        yield served


@pytest.fixture
def play(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., LiveArm]]:
    """Opens the source `ur` on an arm that goes on; closed in the end."""
    opened: list[LiveArm] = []

    def begin(states: Any = None, options: SourceOptions = STATED, **script: Any) -> LiveArm:
        for name, module in fake_ur(UrScript(States() if states is None else states, **script)).items():
            monkeypatch.setitem(sys.modules, name, module)
        source: Any = open_source("ur", options)
        opened.append(source)
        return source

    yield begin
    for source in opened:
        source.close()


@pytest.fixture
def fresh(monkeypatch: pytest.MonkeyPatch) -> None:
    """A width stays known on a machine that is busy."""
    monkeypatch.setattr(robotiq_urcap, "STALE_S", DEADLINE_S)


def move_fingers(urcap: FakeUrcap, source: LiveArm, count: int) -> None:
    """Have the gripper at a position, until the source has read it."""
    urcap.values["POS"] = count
    width = gripper("robotiq_2f_85").width_m(count)
    eventually(lambda: source._gripper.width == width)


@pytest.mark.usefixtures("fresh")
def test_the_newest_width_is_in_the_samples(play, urcap):
    source = play()
    reported = source.chunks()
    assert source.columns[-1] == "gripper"
    assert next(reported)[:, -1].tolist() == [0.085] * 11
    move_fingers(urcap, source, HELD)
    np.testing.assert_allclose(next(reported)[:, -1], HELD_M)
    move_fingers(urcap, source, SHUT)
    assert next(reported)[:, -1].tolist() == [0.0] * 11
    assert set(urcap.asked) == {"STA", "POS"}


def bare(variable: str, value: int) -> bytes:
    return f"{variable} {value}".encode()


@pytest.mark.usefixtures("fresh")
@pytest.mark.parametrize("answer", [whole_line, bare])
def test_an_answer_ends_with_its_line_feed_or_without(play, urcap, answer):
    urcap.answer = answer
    source = play()
    move_fingers(urcap, source, HELD)


@pytest.mark.usefixtures("fresh")
def test_an_answer_may_come_in_pieces(play, urcap):
    source = play()
    urcap.in_fragments = True
    move_fingers(urcap, source, HELD)
    read = urcap.count("POS")
    eventually(lambda: urcap.count("POS") > read + 10)
    assert source._gripper.width == pytest.approx(HELD_M)


@pytest.mark.parametrize("name", ROBOTIQ_NAMES)
def test_a_count_is_a_width_on_the_line_from_open_to_shut(name):
    description = gripper(name)
    opening_m = description.opening_m
    assert [description.width_m(count) for count in (0, OPEN, SHUT, 255)] == [opening_m, opening_m, 0.0, 0.0]
    counts = range(OPEN, SHUT + 1)
    assert [description.count(description.width_m(count)) for count in counts] == list(counts)
    with pytest.raises(GripperError, match="has no counts"):
        gripper("franka_hand").width_m(10)
    with pytest.raises(ValueError, match="expected two that differ"):
        GripperDescription.model_validate({**description.model_dump(), "counts": [SHUT, SHUT]})


# --- what the service makes of it -------------------------------------------------------------------------

PICK, PLACE, UP = np.array([0.45, 0.1, 0.1]), np.array([0.45, -0.25, 0.1]), np.array([0.0, 0.0, 0.25])
PARTS = (  # seconds, where the flange is at the end, position of the fingers at the end
    (1.0, PICK + UP, OPEN),
    (1.2, PICK, OPEN),
    (0.6, PICK, HELD),
    (0.5, PICK, HELD),
    (1.0, PICK + UP, HELD),
    (1.2, PLACE + UP, HELD),
    (1.0, PLACE, HELD),
    (0.6, PLACE, OPEN),
    (0.5, PLACE, OPEN),
    (1.2, PLACE + UP, OPEN),
    (0.6, PLACE + UP, OPEN),
)


def taught_at(t: float) -> tuple[np.ndarray, int]:
    """Where the flange and the fingers are in a pick and place."""
    begun_s, place, count = 0.0, PARTS[0][1], OPEN
    for seconds, target, fingers in PARTS:
        share = min((t - begun_s) / seconds, 1.0)
        bell = 10 * share**3 - 15 * share**4 + 6 * share**5
        place, moved = place + bell * (target - place), round(count + share * (fingers - count))
        if share < 1.0:
            return place, moved
        begun_s, place, count = begun_s + seconds, target, fingers
    return place, count


TAUGHT_S = sum(seconds for seconds, _, _ in PARTS)
OUTAGE_AT_S, OUTAGE_S = 2.4, 0.8  # while the fingers close


def silence(urcap: FakeUrcap, source: LiveArm, states: States, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have the gripper silent for OUTAGE_S of the robot's time; the robot stands still until it is back."""
    end = states.read + round(OUTAGE_S / STATE_S)

    def restore() -> None:
        urcap.values["POS"] = taught_at(STATE_S * end)[1]
        urcap.answer = whole_line
        monkeypatch.setattr(robotiq_urcap, "STALE_S", DEADLINE_S)
        eventually(lambda: source._gripper.width == gripper("robotiq_2f_85").width_m(urcap.values["POS"]))

    monkeypatch.setattr(robotiq_urcap, "STALE_S", 0.0)
    urcap.answer = silent
    asked = len(urcap.asked)
    eventually(lambda: len(urcap.asked) > asked)
    assert source._gripper.width is None
    states.at(end, restore)


@pytest.mark.slow
@pytest.mark.usefixtures("fresh")
@pytest.mark.parametrize("is_silenced", [False, True], ids=["whole", "silent_for_a_while"])
def test_a_pick_and_place_has_its_grasp_and_its_release(play, urcap, monkeypatch, is_silenced):
    offline = pytest.importorskip(
        "caesura_service.offline_segmentation", reason="the install of a robot has no service"
    )
    states = States(lambda t: [*taught_at(t)[0], np.pi, 0.0, 0.0])
    source = play(states)
    chunks: list[np.ndarray] = []
    reported, expected_gaps = source.chunks(), int(is_silenced)
    while not chunks or chunks[-1][-1, 0] < TAUGHT_S:
        if is_silenced and chunks and chunks[-1][-1, 0] >= OUTAGE_AT_S:
            silence(urcap, source, states, monkeypatch)
            is_silenced = False
        else:
            move_fingers(urcap, source, taught_at(STATE_S * states.read)[1])
        chunks.append(next(reported))
    rows = np.concatenate(chunks)
    signals = {"pos": rows[:, 1:4], "quat": rows[:, 4:8], "gripper": rows[:, -1:]}
    view = offline.segment_recording(
        Recording(t=rows[:, 0], signals=signals, wrench_source="none", hand_on_robot="yes", name="taught")
    )
    assert len(view.gaps) == expected_gaps
    fingers = [app for app in view.apps if app.kind in {"grasp", "gripper_move"}]
    assert [app.kind for app in fingers] == ["grasp", "gripper_move"]
    assert fingers[0].gripper_width == pytest.approx(HELD_M, abs=5e-4)
    assert fingers[1].gripper_width == pytest.approx(0.085, abs=5e-4)


# --- a gripper that cannot be read ------------------------------------------------------------------------


def answers(text: bytes, to: str = "POS") -> Answer:
    """What answers one variable with a text, and the others rightly."""
    return lambda variable, value: text if variable == to else whole_line(variable, value)


def silent(variable: str, value: int) -> None:
    """No answer."""


def closing(variable: str, value: int) -> bytes:
    raise ConnectionAbortedError


UNREADABLE: tuple[tuple[Answer, str], ...] = (
    (silent, r"no answer to GET STA within 0\.5 s"),
    (closing, "the connection was lost"),
    (answers(b"hello\n"), r"GET POS was answered 'hello\\n', expected POS and a number"),
    (answers(b"POS ?\n"), "GET POS was answered 'POS"),
    (answers(b"\xff" * 200), "GET POS was answered"),
    (answers(b"POS 256\n"), "POS is 256, expected 0 to 255"),
    (answers(b"POS -1\n"), "GET POS was answered 'POS -1"),
    (answers(b"STA 1\n", "STA"), "it is not activated: STA is 1, expected 3; FLT is 0"),
)
KINDS = ("silent", "closed", "nonsense", "unknown", "long", "too_large", "negative", "not_activated")


@pytest.mark.parametrize(("answer", "said"), UNREADABLE, ids=KINDS)
def test_a_gripper_that_cannot_be_read_at_the_start_says_where_why_and_what_to_do(play, urcap, answer, said):
    urcap.answer = answer
    where = rf"ur5e at 127\.0\.0\.1: its Robotiq 2F-85 at 127\.0\.0\.1:{urcap.port}: "
    with pytest.raises(SourceError, match=rf"{where}{said}.*activate the gripper.*or state --no-gripper"):
        play()
    eventually(lambda: urcap.clients == 0)


def test_a_controller_without_the_urcap_is_named(play, monkeypatch):
    monkeypatch.setattr(robotiq_urcap, "PORT", port := free_port())
    with pytest.raises(SourceError, match=rf":{port}: cannot connect: .*refused\. Install Robotiq's URCap"):
        play()


@pytest.mark.slow
@pytest.mark.parametrize("answer", [answer for answer, _ in UNREADABLE], ids=KINDS)
def test_while_the_width_is_unknown_the_robot_goes_on_and_no_sample_states_one(play, urcap, caplog, answer):
    states = States()
    source = play(states)
    reported = source.chunks()
    before = next(reported)
    urcap.answer = answer
    eventually(lambda: logged(caplog))  # on a busy machine the width may be unknown before any such answer
    assert source._gripper.width is None
    urcap.values["POS"] = HELD
    states.at(states.read + OUTAGE_STATES, lambda: setattr(urcap, "answer", whole_line))
    after = next(reported)
    assert after[0, 0] - before[-1, 0] > (OUTAGE_STATES - 0.5) * STATE_S
    np.testing.assert_allclose(after[:, -1], HELD_M)  # none that is out of date
    eventually(lambda: len(logged(caplog)) >= 2)
    lost, back, *_ = logged(caplog)  # it may be lost once more there
    assert f"127.0.0.1:{urcap.port}: " in lost
    assert lost.endswith("No samples until it answers again")
    assert back.endswith("answers again")


def test_a_urcap_that_ends_and_begins_anew_is_connected_again(play, urcap, caplog):
    states = States()
    source = play(states)
    reported = source.chunks()
    next(reported)
    urcap.close()
    eventually(lambda: logged(caplog))
    urcap.values["POS"] = SHUT
    states.at(states.read + OUTAGE_STATES, urcap.open)
    assert next(reported)[0, -1] == 0.0
    eventually(lambda: len(logged(caplog)) >= 2)


def logged(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [one.getMessage() for one in caplog.records if one.levelno >= logging.WARNING]


# --- the end ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("answer", [whole_line, silent], ids=["answers", "silent"])
def test_a_source_that_closes_ends_its_thread_and_its_connection(play, urcap, caplog, answer):
    source = play()
    urcap.answer = answer
    asked = len(urcap.asked)
    eventually(lambda: len(urcap.asked) > asked)
    source.close()
    assert not source._gripper._thread.is_alive()
    eventually(lambda: urcap.clients == 0)
    assert not logged(caplog)


def test_a_source_closes_while_its_gripper_is_gone(play, urcap):
    source = play()
    urcap.close()
    eventually(lambda: source._gripper.width is None)
    source.close()
    assert not source._gripper._thread.is_alive()
    urcap.open()  # for the fixture's end
    eventually(lambda: urcap.clients == 0)


def test_where_the_arm_cannot_be_opened_the_gripper_is_read_no_more(play, urcap):
    with pytest.raises(SourceError, match="the controller did not execute it"):
        play(options=replace(STATED, teach_mode=True), fails="teachMode")
    eventually(lambda: urcap.clients == 0)


# --- which gripper ----------------------------------------------------------------------------------------


def own_robot(folder: Path, fingers: object) -> str:
    """A ur5e whose description states a gripper."""
    shutil.copytree(Path(robots.__file__).with_name("ur5e"), folder / "mine")
    file = folder / "mine" / "robot.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), "name": "mine", "gripper": fingers}))
    return str(file)


@pytest.mark.usefixtures("fresh")
def test_a_gripper_of_the_robots_description_is_read_with_its_own_counts(play, urcap, tmp_path):
    own = {**gripper("robotiq_2f_85").model_dump(), "counts": [10, 210]}
    options = replace(STATED, robot=own_robot(tmp_path, own), gripper_name=None)
    urcap.values["POS"] = 110
    source = play(options=options)
    assert source._gripper.width == pytest.approx(0.0425)
    assert "gripper" not in play(options=replace(options, gripper=False)).columns


def test_without_a_gripper_there_is_no_column_and_no_connection(play, urcap):
    assert "gripper" not in play(options=replace(STATED, gripper_name=None)).columns
    assert urcap.clients == 0


@pytest.mark.parametrize(
    ("source", "name", "said"),
    [
        ("ur", "suction", "gripper is 'suction', expected one of robotiq_2f_85"),
        ("ur", "hand", "gripper is 'hand', expected one of robotiq_2f_85"),
        ("franky", "robotiq_2f_85", "gripper is 'robotiq_2f_85', which the source ur takes, not franky"),
        ("file", "robotiq_2f_85", "which the source ur takes, not file"),
    ],
)
def test_a_gripper_that_a_source_does_not_read_is_refused(play, source, name, said):
    play(options=replace(STATED, gripper_name=None))
    with pytest.raises(SourceError, match=said):
        open_source(source, replace(STATED, gripper_name=name))


def test_a_gripper_and_none_are_refused():
    app = typer.Typer()
    register(app)
    stated = ["bridge", "--gripper", "robotiq_2f_85"]
    result = CliRunner().invoke(app, [*stated, "--no-gripper"])
    assert result.exit_code == 2
    assert "state --gripper or --no-gripper" in result.output
    assert "which the source ur takes, not file" in CliRunner().invoke(app, stated).output
