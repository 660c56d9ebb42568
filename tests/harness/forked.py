"""Python processes that start at once: each is forked from one that has imported what most of them need.

A service with an interpreter of its own takes more than a second of CPU to be ready, and the tests start
a hundred. `Forked` is to tests what `subprocess.Popen` is, for `python -m MODULE …` and `python -c CODE …`: a
process with its own id, environment, signals and pipes, which ends as any other. The one that forks has no
threads, opens nothing, and kills what is left when the process that it serves has ended.
"""

from __future__ import annotations

import atexit
import gc
import json
import os
import runpy
import select
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

PIPE, DEVNULL = subprocess.PIPE, subprocess.DEVNULL
LIMIT = 1 << 20  # [bytes] of one order
CAN_FORK = hasattr(os, "pidfd_open")  # on Linux


class Forked:
    """As `subprocess.Popen` of text; raises what it raises."""

    def __init__(
        self,
        command: Sequence[str],
        *,
        stdout: int | IO[str] | None = None,
        stderr: int | IO[str] | None = None,
        env: Mapping[str, str] | None = None,
        text: bool = True,
        imports: Sequence[str] = (),
    ) -> None:
        """imports: modules that more processes like this one need."""
        assert command[0] == sys.executable, f"{command}: expected {sys.executable} first"
        assert command[1] in {"-m", "-c"}, f"{command}: expected -m or -c"
        assert text
        self.args, self.returncode = list(command), None
        self.stdout, out = _end(stdout, 1)
        self.stderr, error = _end(stderr, 2)
        self._status, status = os.pipe()
        order = {"argv": self.args[1:], "env": dict(env or os.environ), "cwd": os.getcwd(), "path": sys.path}
        order["imports"] = list(imports)
        try:
            self.pid = _parent().fork(order, (out, error, status))
        except BaseException:  # else the test that follows fails at pipes that are not closed
            for stream in (self.stdout, self.stderr):
                if stream is not None:
                    stream.close()
            raise
        finally:
            for end in {out, error, status} - {1, 2}:
                os.close(end)

    returncode: int | None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        for stream in (self.stdout, self.stderr):
            if stream is not None:
                stream.close()
        self.wait()

    def __del__(self) -> None:
        if self.returncode is None:
            os.close(self._status)

    def poll(self) -> int | None:
        """The exit code; None while it runs."""
        try:
            return self.wait(0.0)
        except subprocess.TimeoutExpired:
            return None

    def wait(self, timeout: float | None = None) -> int:
        """The exit code, once it has ended."""
        if self.returncode is None:
            if not select.select([self._status], [], [], timeout)[0]:
                raise subprocess.TimeoutExpired(self.args, timeout or 0.0)
            said = os.read(self._status, 16)
            os.close(self._status)
            self.returncode = int(said) if said else -signal.SIGKILL  # with the one that forked it
        return self.returncode

    def communicate(self, timeout: float | None = None) -> tuple[str | None, str | None]:
        """What is left in its pipes, and its end."""
        said: dict[IO[str], str] = {}
        streams = [one for one in (self.stdout, self.stderr) if one is not None and not one.closed]
        readers = [
            threading.Thread(target=lambda s=s: said.update({s: s.read()}), daemon=True) for s in streams
        ]
        for reader in readers:
            reader.start()
        self.wait(timeout)
        for reader in readers:
            reader.join(timeout)
            if reader.is_alive():
                raise subprocess.TimeoutExpired(self.args, timeout or 0.0)
        for stream in streams:
            stream.close()
        return tuple(None if s is None else said.get(s, "") for s in (self.stdout, self.stderr))  # type: ignore[return-value]

    def send_signal(self, number: int) -> None:
        """To a process that has ended: nothing."""
        with suppress(ProcessLookupError):  # it may end, and be waited for, between the two
            if self.poll() is None:
                os.kill(self.pid, number)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)

    def terminate(self) -> None:
        self.send_signal(signal.SIGTERM)


def _end(wanted: int | IO[str] | None, inherited: int) -> tuple[IO[str] | None, int]:
    """What is read here, and the descriptor that is the other process'."""
    if wanted is None:
        return None, inherited
    if wanted == PIPE:
        here, there = os.pipe()
        return os.fdopen(here), there
    return None, os.open(os.devnull, os.O_WRONLY) if wanted == DEVNULL else os.dup(wanted.fileno())  # type: ignore[union-attr]


class _Parent:
    """The one that forks, as its tests see it."""

    def __init__(self) -> None:
        self._link, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        command = [sys.executable, __file__, str(there.fileno())]
        with there:
            self._process = subprocess.Popen(command, pass_fds=[there.fileno()])
        self._lock = threading.Lock()
        self._orders = 0
        atexit.register(self.close)

    def fork(self, order: Mapping[str, Any], ends: Sequence[int]) -> int:
        with self._lock:
            self._orders += 1
            socket.send_fds(self._link, [json.dumps({**order, "number": self._orders}).encode()], list(ends))
            while True:
                number, pid = map(int, self._link.recv(32).split())
                if number == self._orders:
                    return pid
                with suppress(ProcessLookupError):  # of a test whose time was over before the answer came
                    os.kill(pid, signal.SIGKILL)

    def close(self) -> None:
        self._link.close()
        self._process.wait()


@cache
def _parent() -> _Parent:
    return _Parent()


# --- in the process that forks --------------------------------------------------------------------------


def serve(link: socket.socket) -> list[str]:
    """Fork for every order until the link is closed. Returns in each forked process: what it is to run."""
    living: dict[int, tuple[int, int]] = {}  # by the descriptor that shows the end: id, where to tell it
    while True:
        for ready in select.select([link, *living], [], [])[0]:
            if ready is not link:
                pid, status = living.pop(ready)
                code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
                with suppress(BrokenPipeError):  # nobody waits for it
                    os.write(status, str(code).encode())
                os.close(status)
                os.close(ready)
                continue
            said, ends, _, _ = socket.recv_fds(link, LIMIT, 3)
            if not said:
                for pid, _ in living.values():
                    os.kill(pid, signal.SIGKILL)
                    os.waitpid(pid, 0)
                os._exit(0)
            order = json.loads(said)
            for module in order["imports"]:
                import_module(module)
            if (pid := os.fork()) == 0:
                for end in (link.detach(), ends[2], *living, *(status for _, status in living.values())):
                    os.close(end)
                return become(order, ends[0], ends[1])
            living[os.pidfd_open(pid)] = pid, ends[2]
            os.close(ends[0])
            os.close(ends[1])
            link.send(f"{order['number']} {pid}".encode())


def become(order: Mapping[str, Any], out: int, error: int) -> list[str]:
    """Take over everything that is the new process' own."""
    for end, number in ((out, 1), (error, 2)):
        os.dup2(end, number)
        os.close(end)
    os.chdir(order["cwd"])
    os.environ.clear()
    os.environ.update(order["env"])
    sys.path[:] = order["path"]
    signal.signal(signal.SIGINT, signal.default_int_handler)
    gc.enable()
    return list(order["argv"])


def run(argv: list[str]) -> None:
    """As the interpreter does."""
    option, what, *rest = argv
    if option == "-m":
        sys.argv = [what, *rest]
        runpy.run_module(what, run_name="__main__", alter_sys=True)
    else:
        sys.argv = ["-c", *rest]
        exec(compile(what, "<string>", "exec"), {"__name__": "__main__"})


def import_everything() -> None:
    """What a service, a bridge and a router need, with the kernels."""
    import typer  # noqa: PLC0415

    from caesura_clients.cli import build  # noqa: PLC0415
    from caesura_service.prepare import prepare  # noqa: PLC0415
    from caesura_service.segmentation import pipeline  # noqa: F401, PLC0415
    from harness.commands import every_command  # noqa: PLC0415

    list(every_command(typer.main.get_command(build())))
    prepare()
    assert threading.active_count() == 1, "a process with threads cannot be forked"


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    sys.path[0] = str(Path(__file__).parents[1])  # not of this file: `harness` has modules of other names
    import_everything()
    gc.collect()
    gc.freeze()
    run(serve(socket.socket(fileno=int(sys.argv[1]))))
