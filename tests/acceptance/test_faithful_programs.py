"""What a person taught comes out in the program, or the check says that it does not: as a user sees it."""

from __future__ import annotations

import json
import math
import re
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from caesura_clients.cli.result_tables import apps_table
from caesura_protocol.messages import MAX_VIA_POINTS, App, Gap
from caesura_protocol.programs.document import ProgramFile, read_document
from caesura_protocol.programs.safety import CellSettings
from caesura_protocol.recording import Recording
from caesura_protocol.reproduced_path import curve_of
from caesura_service.segmentation.input_notes import NO_GRIPPER
from harness.commands import application

Array = NDArray[np.float64]

DOWN = Rotation.from_quat([-0.70710678, 0.70710678, 0.0, 0.0])
T = np.arange(0.0, 10.0, 0.005)
HELD_N = 20.7


def eased(t0: float, tn: float) -> Array:
    """A share that goes from 0 to 1 between two times, at minimum jerk."""
    s = np.clip((T - t0) / (tn - t0), 0.0, 1.0)
    share: Array = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    return share


def recording(position: Array, turn: Array | None = None, force_z: Array | None = None) -> Recording:
    """A demonstration at 200 Hz with a sensor's noise; turn: (n,) [rad] about the vertical."""
    rng = np.random.default_rng(7)
    angles = np.zeros(T.size) if turn is None else turn
    force = np.column_stack([np.zeros((T.size, 2)), np.zeros(T.size) if force_z is None else force_z])
    signals = {
        "pos": position + rng.normal(scale=5e-5, size=(T.size, 3)),
        "quat": (Rotation.from_rotvec(np.outer(angles, (0.0, 0.0, 1.0))) * DOWN).as_quat(),
        "force": force + rng.normal(scale=0.1, size=(T.size, 3)),
    }
    panda = CellSettings(robot="panda")
    return Recording(T, signals, wrench_source="flange_sensor", name="taught", setting=panda)


def segmented(tmp_path: Path, taught: Recording, *options: str) -> Path:
    taught.save(tmp_path / "taught.npz")
    out = tmp_path / "taught.json"
    run("segment", str(tmp_path / "taught.npz"), "--json", str(out), *options)
    return out


def run(*arguments: str, code: int = 0) -> str:
    result = CliRunner().invoke(application(), arguments)
    assert result.exit_code == code, result.output
    return result.output


def findings(program: Path, *options: str) -> list[dict[str, Any]]:
    """What a check finds; no recording here has a gripper, and the check says so each time."""
    found = json.loads(run("check", str(program), "--json", *options))
    return [one for one in found if one["reason"] != NO_GRIPPER]


def written(program: Path, tmp_path: Path, *options: str) -> ProgramFile:
    out = tmp_path / "program.json"
    run("program", "--file", str(program), "--format", "json", "-o", str(out), *options)
    return read_document(out)


def place(*xyz: float) -> Array:
    return np.tile(xyz, (T.size, 1))


def test_two_circles_come_out_as_two_circles_with_the_length_of_the_way(tmp_path: Path) -> None:
    angle = 2.0 * math.tau * eased(1.0, 9.0)
    circle = place(0.45, 0.0, 0.3) + 0.1 * np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    (moved,) = written(segmented(tmp_path, recording(circle)), tmp_path).apps
    assert moved.kind == "cartesian_motion"
    assert moved.path is not None
    assert moved.path.length_m == pytest.approx(2.0 * math.tau * 0.1, rel=0.01)
    places = curve_of(moved).sampled(50)[:, :3] - (0.45, 0.0, 0.3)
    np.testing.assert_allclose(np.linalg.norm(places[:, :2], axis=1), 0.1, atol=0.0025)
    turned = np.unwrap(np.arctan2(places[:, 1], places[:, 0]))
    assert turned[-1] - turned[0] == pytest.approx(2.0 * math.tau, abs=0.05)
    assert findings(tmp_path / "program.json") == []


def test_a_turn_in_place_is_an_app(tmp_path: Path) -> None:
    way = place(0.4, 0.0, 0.3)
    way[:, 1] += 0.2 * eased(6.0, 9.0)
    program = written(segmented(tmp_path, recording(way, math.pi / 2 * eased(3.1, 4.0))), tmp_path)
    turned, moved = program.apps
    assert turned.kind == "cartesian_motion"
    assert (turned.t0, turned.tn) == pytest.approx((3.1, 4.0), abs=0.15)
    assert turned.path is not None
    assert turned.orientation is not None
    assert angle_of(turned.path.start.orientation, turned.orientation) == pytest.approx(90.0, abs=1.5)
    assert (moved.path is not None, moved.path and moved.path.via) == (True, ())  # a straight line has none
    (fast,) = findings(tmp_path / "program.json")  # 90° within a second
    assert "rad/s at joint 7 in its" in fast["reason"]
    lost = tmp_path / "lost.json"
    lost.write_text(program.model_copy(update={"apps": (without_turn(turned), moved)}).as_json())
    assert re.search(r"rotation of (89|90)\.\d° taught at [34]\.", said(lost))


def without_turn(app: Any) -> Any:
    return app.model_copy(update={"orientation": app.path.start.orientation, "path": None})


def angle_of(one: Sequence[float] | None, other: Sequence[float]) -> float:
    assert one is not None
    return math.degrees((Rotation.from_quat(one).inv() * Rotation.from_quat(other)).magnitude())


def said(program: Path, *options: str) -> str:
    return "\n".join(f"{one['severity']}: {one['reason']}" for one in findings(program, *options))


def pressed() -> Recording:
    down, up = eased(1.0, 2.5), eased(6.0, 7.5)
    way = place(0.4, 0.0, 0.3)
    way[:, 2] -= 0.1 * (down - up)
    return recording(way, force_z=HELD_N * (eased(2.5, 2.9) - eased(5.6, 6.0)))


def test_a_press_is_as_it_was_taught_and_a_cut_one_shows_it_everywhere(tmp_path: Path) -> None:
    segments = segmented(tmp_path, pressed())
    forces = [np.linalg.norm(one.force) for one in written(segments, tmp_path).apps if one.force is not None]
    assert forces == [pytest.approx(HELD_N, abs=0.15)]
    assert findings(tmp_path / "program.json") == []
    (force,) = forces
    cut = f"10.0 N of {force:.1f} N taught"
    limited = tmp_path / "limited.json"
    run("program", "--file", str(segments), "--format", "json", "-o", str(limited), "--force-limit", "10")
    assert said(limited) == f"warning: force limited: {cut}"
    assert cut in run_script(limited, tmp_path)
    assert cut == force_in_table(tmp_path, limited)
    refused = json.loads(run("check", str(segments), "--json", "--force-limit", "10", code=1))
    assert [one["limit"] for one in refused if one["severity"] == "error"] == [10.0]


def test_the_limit_of_the_cell_is_kept_where_it_is_taught(tmp_path: Path) -> None:
    program = written(segmented(tmp_path, pressed(), "--force-limit", "8"), tmp_path)
    (press,) = (one for one in program.apps if one.force is not None)
    assert np.linalg.norm(press.force or ()) == pytest.approx(8.0)
    assert program.safety.force_n == 8.0


def test_a_wrench_whose_source_is_not_stated_is_named_and_so_is_what_it_does_not_show(tmp_path: Path) -> None:
    taught = pressed()
    unstated = replace(taught, wrench_source=None)
    reported = said(segmented(tmp_path, unstated))
    assert "wrench source flange_sensor_with_hand is assumed" in reported
    assert "contacts were not searched for" in reported


def test_a_gap_reaches_the_check_as_data(tmp_path: Path) -> None:
    program = written(segmented(tmp_path, pressed()), tmp_path)
    holed = program.model_copy(update={"gaps": (Gap(t0=1.5, tn=1.75, reason="evicted"),), "notes": ()})
    path = tmp_path / "holed.json"
    path.write_text(holed.as_json())
    assert said(path) == "warning: was not observed at 1.50–1.75 s: check its motion before a run"


def test_a_path_that_cannot_be_kept_within_its_tolerance_says_so(tmp_path: Path) -> None:
    angle = 2.0 * math.tau * eased(1.0, 9.0)
    circle = place(0.45, 0.0, 0.3) + 0.1 * np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    shaken = circle + 0.004 * np.sin(12.0 * T)[:, None] * (eased(1.0, 2.0) - eased(8.0, 9.0))[:, None]
    program = segmented(tmp_path, recording(shaken), "--path-tolerance", "0.1")
    assert max(len(one.path.via) for one in read_document(program).apps if one.path) == MAX_VIA_POINTS
    assert "from the taught path, the tolerance is 0.1 mm" in said(program)


@pytest.mark.slow
def test_what_is_lost_stands_in_every_table_page_and_script(tmp_path: Path) -> None:
    # A hand at rest drifted by 25 mm between two movements. Only check and scripts said so.
    way = place(0.4, 0.0, 0.3)
    way[:, 1] += 0.1 * eased(0.8, 1.8) + 0.025 * np.clip((T - 2.2) / 5.0, 0.0, 1.0) + 0.1 * eased(8.0, 9.2)
    program = segmented(tmp_path, recording(way))
    taught, page = str(tmp_path / "taught.npz"), tmp_path / "page.html"
    run("report", taught, "--out", str(page))
    outputs = {
        "segment": run("segment", taught),
        "table": run("program", "--file", str(program)),
        "franky": run("program", "--file", str(program), "--format", "franky"),
        "tree": run("program", "--file", str(program), "--format", "bt"),
        "check": said(program),
        "report": page.read_text("utf-8"),
    }
    lost = re.compile(r"2\d mm of motion taught at [0-9.]+–[0-9.]+ s are in no app")
    assert [name for name, text in outputs.items() if not lost.search(" ".join(text.split()))] == []


def there_and_back(t0: float, tn: float) -> Array:
    middle = 0.5 * (t0 + tn)
    return eased(t0, middle) * (1.0 - eased(middle, tn))


@pytest.mark.parametrize(
    ("up_m", "turn", "named"),
    [
        (0.004 * there_and_back(4.8, 5.8), None, []),
        (0.03 * there_and_back(5.0, 5.4), None, ["30.2 mm off the straight line and back at 5.1–5.3 s"]),
        (0.008 * there_and_back(4.0, 6.8), None, ["8.0 mm off the straight line and back at 4.8–6.0 s"]),
        (None, math.radians(4.5) * there_and_back(4.8, 5.8), ["4.5° off the straight line and back"]),
        (None, math.radians(1.5) * eased(4.5, 5.5), []),
        (None, math.radians(2.4) * eased(4.5, 5.5), ["rotation of 2.4° taught at 3"]),
        (None, math.radians(2.4) * eased(9.0, 9.6), ["2.4° at 8", "after the path of the last app"]),
    ],
)
def test_a_way_that_no_app_has_is_named(
    tmp_path: Path, up_m: Array | None, turn: Array | None, named: list[str]
) -> None:
    """A hand that shook by 30 mm in a rest, or turned the tool by 4.5° and back: nothing was said of it."""
    way = place(0.4, 0.0, 0.3)
    way[:, 1] += 0.2 * eased(1.5, 3.5) + 0.2 * eased(7.0, 8.8)
    way[:, 2] += 0.0 if up_m is None else up_m
    found = said(segmented(tmp_path, recording(way, turn)))
    assert [text for text in named if text not in found] == []
    assert bool(named) == ("no app" in found)


@pytest.mark.parametrize("moving", [True, False])
def test_fingers_that_open_in_motion_are_named_with_the_speed(tmp_path: Path, moving: bool) -> None:
    """A release in the middle of a way was a stop there, and a check said that all could be run."""
    way = place(0.4, 0.0, 0.3)
    way[:, 1] += 0.4 * eased(4.0, 8.0) if moving else 0.2 * eased(2.0, 4.5) + 0.2 * eased(7.5, 9.5)
    closed, opened = (np.clip((T[:, None] - t0) / 0.4, 0.0, 1.0) for t0 in (1.0, 6.0))
    opening = 0.08 - 0.05 * (closed - opened)
    taught = recording(way)
    taught = replace(taught, signals=taught.signals | {"gripper": opening})
    named = re.findall(
        r"at 6\.\d s the flange moved with (\d+) mm/s while the f", said(segmented(tmp_path, taught))
    )
    assert [float(speed) for speed in named] == [pytest.approx(188.0, abs=6.0)] * moving


def test_a_file_of_version_1_is_read_and_lacks_its_paths(tmp_path: Path) -> None:
    content = json.loads(written(segmented(tmp_path, pressed()), tmp_path).as_json())
    content["version"] = 1
    for name in ("gaps", "wrench"):
        del content[name]
    for one in content["apps"]:
        del one["path"]
    old = tmp_path / "old.json"
    old.write_text(json.dumps(content))
    assert "the taught path is unknown" in said(old)


def run_script(program: Path, tmp_path: Path) -> str:
    """What the script for franky says that it would do."""
    script = tmp_path / "script.py"
    run("program", "--file", str(program), "--format", "franky", "-o", str(script))
    done = subprocess.run(
        [sys.executable, script, "--dry-run"], check=True, capture_output=True, text=True, timeout=30
    )
    return done.stdout


def force_in_table(tmp_path: Path, program: Path) -> str:
    """The words for the press in the table, whose cells wrap."""
    apps: tuple[App, ...] = read_document(program).apps
    cells = [list(column.cells) for column in apps_table(apps, "").columns]
    return next(str(cell) for column in cells for cell in column if "taught" in str(cell))
