"""What the action `Run` does, without ROS 2: write a program as a script, check it, run it on its robot.

A script in Python runs as a process here. A cancellation interrupts it as Ctrl-C does, and it stops its
robot: a controller of UFACTORY goes on with what it has received where the connection is lost. URScript runs
on the controller, which is sent the text: its end is not reported, and it is stopped at the pendant.
"""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from caesura_protocol.errors import CaesuraError
from caesura_protocol.programs.document import ProgramFile, on_robot
from caesura_protocol.programs.export_formats import WRITERS
from caesura_protocol.programs.program_gripper import with_gripper

UR_PORT = 30002  # the secondary interface, which takes a program
CONNECT_S = 5.0
READ_S = 1.0  # that the controller has to read a program before the connection is closed
LOOK_S = 0.1  # between two looks at a cancellation
STOPS_S = 10.0  # that a script has to stop its robot before it is killed

Report = Callable[[str], None]
IsCancelled = Callable[[], bool]


class Ran(NamedTuple):
    """The result of a run."""

    success: bool
    message: str


def run(
    program: ProgramFile,
    script: str,
    host: str,
    report: Report,
    is_cancelled: IsCancelled,
    *,
    robot: str = "",
    gripper: str = "",
    unchecked: bool = False,
    check: Sequence[str] = ("caesura", "check"),
) -> Ran:
    """Run a program as a script on the robot at `host`; `report` gets each line of it.

    robot: the arm at `host`, by its name; a program of another one is refused. Empty: the program's.
    check: the command that is given the program's file first; a program that it refuses is not run.
    """
    if script not in RUNNERS:
        return Ran(False, f"format is {script!r}, expected one of {', '.join(RUNNERS)}")
    try:
        program = with_gripper(on_robot(program, robot or None), gripper or None)
        text = WRITERS[script].write(program)
    except (CaesuraError, ValueError) as error:
        return Ran(False, str(error))
    with tempfile.TemporaryDirectory(prefix="caesura-run-") as folder:
        if refusal := _refusal(program, Path(folder), check, unchecked=unchecked):
            return Ran(False, refusal)
        if is_cancelled():  # while it was checked
            return Ran(False, "cancelled")
        try:
            return RUNNERS[script](text, Path(folder), host, report, is_cancelled)
        except OSError as error:
            return Ran(False, f"{host}: {error}")


def _refusal(program: ProgramFile, folder: Path, check: Sequence[str], *, unchecked: bool) -> str:
    """Why the check refuses a program; empty where it does not, or where it is not asked for."""
    if unchecked:
        return ""
    file = folder / "program.json"
    file.write_text(program.as_json(), "utf-8")
    try:
        done = subprocess.run([*check, str(file)], capture_output=True, text=True, check=False)
    except FileNotFoundError:
        return f"{check[0]} is not installed here: install Caesura's service, or state unchecked"
    return "" if done.returncode == 0 else (done.stdout + done.stderr).strip()


def _run_python(text: str, folder: Path, host: str, report: Report, is_cancelled: IsCancelled) -> Ran:
    file = folder / "script.py"
    file.write_text(text, "utf-8")
    command = [sys.executable, "-u", str(file), "--robot", host]
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        errors="replace",
        start_new_session=True,  # Ctrl-C at the node reaches it once: a second one would cut its stop short
    ) as child:
        over, failed, last = threading.Event(), threading.Event(), ""
        watching = threading.Thread(
            target=_end_if_cancelled, args=(child, lambda: failed.is_set() or is_cancelled(), over)
        )
        watching.start()
        try:
            for line in child.stdout or ():
                last = line.rstrip()
                report(last)
            code = child.wait()
        except BaseException:  # it still moves its robot
            failed.set()
            with suppress(subprocess.TimeoutExpired):
                child.communicate(timeout=LOOK_S + STOPS_S)
            raise
        finally:
            over.set()
            child.kill()
            watching.join()
    if code < 0:
        return Ran(False, "cancelled" if is_cancelled() else f"ended by signal {-code}")
    return Ran(code == 0, "done" if code == 0 else last)


def _end_if_cancelled(child: subprocess.Popen[str], is_cancelled: IsCancelled, over: threading.Event) -> None:
    while not over.wait(LOOK_S):
        if is_cancelled():
            child.send_signal(signal.SIGINT)
            if not over.wait(STOPS_S):
                child.kill()
            return


def _read_state(controller: socket.socket) -> None:
    """Read what the controller sends all the time: a connection that is closed with it unread is reset."""
    ends_s = time.monotonic() + READ_S
    with suppress(OSError):
        while (left_s := ends_s - time.monotonic()) > 0.0:
            controller.settimeout(left_s)
            if not controller.recv(65536):
                return


def _send_to_ur(text: str, folder: Path, host: str, report: Report, is_cancelled: IsCancelled) -> Ran:
    with socket.create_connection((host, UR_PORT), timeout=CONNECT_S) as controller:
        controller.sendall(text.encode())
        _read_state(controller)
    return Ran(True, "sent to the controller, which does not report the end of a program")


Runner = Callable[[str, Path, str, Report, IsCancelled], Ran]
RUNNERS: Mapping[str, Runner] = {"franky": _run_python, "xarm": _run_python, "urscript": _send_to_ur}
