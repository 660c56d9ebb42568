"""A forked process is one of its own: its arguments, environment, pipes, signals and end."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from harness.forked import CAN_FORK, PIPE, Forked, _parent
from harness.processes import eventually, started

pytestmark = pytest.mark.skipif(not CAN_FORK, reason="no pidfd_open on this system")
DEADLINE_S = 60.0
WAITS = "import threading; print('ready', flush=True); threading.Event().wait()"


def python(code: str, *words: str, **options) -> Forked:
    return Forked([sys.executable, "-c", code, *words], **options)


def test_it_has_arguments_environment_directory_and_pipes_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code = "import os, sys; print(sys.argv, os.getcwd(), sorted(os.environ)); sys.exit('no')"
    with python(code, "a", "b", stdout=PIPE, stderr=PIPE, env={"ONLY": "this"}) as process:
        assert process.pid != os.getpid()
        said, complaint = process.communicate(timeout=DEADLINE_S)
    assert said == f"['-c', 'a', 'b'] {tmp_path} ['ONLY']\n"
    assert (complaint, process.returncode) == ("no\n", 1)


def test_a_module_is_run_as_the_interpreter_runs_it():
    with Forked([sys.executable, "-m", "caesura_service", "--help"], stdout=PIPE) as process:
        said, _ = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 0
    assert "serve" in said


def test_it_ends_at_the_end_of_its_program_and_of_its_threads():
    thread = "threading.Timer(0.05, print, ['late']).start()"
    code = f"import atexit, threading; atexit.register(print, 'over'); {thread}"
    with python(code, stdout=PIPE) as process:
        assert process.communicate(timeout=DEADLINE_S)[0] == "late\nover\n"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_a_signal_ends_it_as_any_other_process(number):
    with python(WAITS, stdout=PIPE, stderr=subprocess.DEVNULL) as process:
        assert process.stdout.readline() == "ready\n"
        assert process.poll() is None
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(0.01)
        process.send_signal(number)
        assert process.wait(DEADLINE_S) == -number
        process.kill()  # one that has ended is no error


def test_an_answer_that_a_test_did_not_wait_for_is_not_that_of_the_next_order(monkeypatch):
    """A test whose time was over left its answer, and every later process had the id of another one."""
    link = _parent()._link

    class InterruptedLink:
        sendmsg = link.sendmsg

        def recv(self, size: int) -> bytes:
            raise TimeoutError

    with monkeypatch.context() as patch:
        patch.setattr(_parent(), "_link", InterruptedLink())
        with pytest.raises(TimeoutError):
            python(WAITS, stdout=PIPE)
    with python("import os; print(os.getpid())", stdout=PIPE) as process:
        assert process.communicate(timeout=DEADLINE_S)[0] == f"{process.pid}\n"


def test_all_processes_of_a_run_share_the_one_that_forks_and_leave_nothing_to_it():
    parent = "import os, threading; print(os.getppid(), flush=True); threading.Event().wait()"
    other = (
        "import os, sys; from harness.forked import PIPE, Forked\n"
        f"forked = Forked([sys.executable, '-c', {parent!r}], stdout=PIPE)\n"
        "print(forked.pid, forked.stdout.readline(), flush=True); os._exit(0)"
    )
    with python(parent, stdout=PIPE) as process:
        environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
        command = [sys.executable, "-c", other]
        said = subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout
        pid, its_parent = said.split()
        assert process.stdout.readline().split() == [its_parent]
        eventually(lambda: not Path(f"/proc/{pid}").exists())
        assert process.poll() is None
        process.kill()


def test_a_process_of_a_test_that_fails_is_killed():
    with (
        pytest.raises(AssertionError, match="of the test"),
        started([sys.executable, "-c", WAITS], stdout=PIPE) as process,
    ):
        raise AssertionError("of the test")
    assert process.poll() == -signal.SIGKILL
