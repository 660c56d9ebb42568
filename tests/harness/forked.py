"""Python processes that start at once: each is forked from one that has imported what most of them need.

A service with an interpreter of its own takes more than a second of CPU to be ready, and the tests start
a hundred. `Forked` is to tests what `subprocess.Popen` is, for `python -m MODULE …` and `python -c CODE …`: a
process with its own id, environment, signals and pipes, which ends as any other. One process forks for all
processes of a test run. It has no threads and opens nothing. When a process of the run has ended, it kills
what that one has left, and it ends with the last of them.
"""

from __future__ import annotations

import atexit
import fcntl
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
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from types import TracebackType
from typing import IO, Any, NamedTuple, Self

RUN = "CAESURA_TEST_RUN"  # of the environment: the folder of a test run, as in `harness/once.py`

PIPE, DEVNULL = subprocess.PIPE, subprocess.DEVNULL
LIMIT = 1 << 20  # [bytes] of one order
LOCK, ADDRESS = "forking.lock", "forking.socket"  # in the folder of the run
TIMES = "processor_time"  # in the same folder, where `harness.processor_time` wants to know
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
        order["test"] = os.environ.get("PYTEST_CURRENT_TEST", "no test")
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
        self._process: subprocess.Popen[bytes] | None = None  # where this process was the first to need it
        self._link = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        folder = Path(os.environ[RUN])
        (folder / LOCK).touch()
        with locked(folder):
            try:
                self._link.connect(str(folder / ADDRESS))
            except (FileNotFoundError, ConnectionRefusedError):
                self._begin(folder)
                self._link.connect(str(folder / ADDRESS))
        self._lock = threading.Lock()
        self._orders = 0
        atexit.register(self.close)

    def _begin(self, folder: Path) -> None:
        (folder / ADDRESS).unlink(missing_ok=True)
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
            listener.bind(str(folder / ADDRESS))
            listener.listen()
            command = [sys.executable, __file__, str(listener.fileno()), str(folder)]
            self._process = subprocess.Popen(command, pass_fds=[listener.fileno()])

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
        if self._process is not None:
            self._process.wait()  # until the last process of the run has closed its link


@cache
def _parent() -> _Parent:
    return _Parent()


# --- in the process that forks --------------------------------------------------------------------------


class Child(NamedTuple):
    """A forked process, where its end is to be written, and whose it is."""

    pid: int
    status: int
    link: socket.socket
    test: str  # which asked for it

    def reap(self, ended: int, folder: Path) -> None:
        """ended: the descriptor that shows its end."""
        _, status, used = os.wait4(self.pid, 0)
        code = os.waitstatus_to_exitcode(status)
        if (folder / TIMES).exists():
            with (folder / TIMES).open("a") as file:
                file.write(json.dumps([self.test, 0.0, used.ru_utime + used.ru_stime]) + "\n")
        with suppress(BrokenPipeError):  # no process waits for it
            os.write(self.status, str(code).encode())
        os.close(self.status)
        os.close(ended)


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Either a process of the run connects, or the one that forks decides whether to end."""
    with (folder / LOCK).open() as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def serve(listener: socket.socket, folder: Path) -> list[str]:
    """Fork for every order until all links are closed. Returns in each forked process: what it is to run."""
    links: list[socket.socket] = []
    living: dict[int, Child] = {}  # by the descriptor that shows the end
    while True:
        watched: list[Any] = [*living, *links, listener]
        ready = select.select(watched, [], [])[0][0]
        if ready is listener:
            links.append(listener.accept()[0])
        elif ready in living:
            living.pop(ready).reap(ready, folder)
        elif (said := received(ready)) is None:
            links.remove(ready)
            leave_nothing(ready, living, folder)
            if not links:
                end_unless_awaited(listener, folder)
        else:
            order, ends = said
            if (pid := os.fork()) == 0:
                for link in (listener, *links):
                    link.close()
                for end in (ends[2], *living, *(child.status for child in living.values())):
                    os.close(end)
                return become(order, ends[0], ends[1])
            living[os.pidfd_open(pid)] = Child(pid, ends[2], ready, order["test"])
            os.close(ends[0])
            os.close(ends[1])
            with suppress(BrokenPipeError, ConnectionResetError):  # its process has ended
                ready.send(f"{order['number']} {pid}".encode())


def received(link: socket.socket) -> tuple[dict[str, Any], list[int]] | None:
    """An order, whose modules are imported, and its descriptors; None when its process has ended."""
    try:
        said, ends, _, _ = socket.recv_fds(link, LIMIT, 3)
    except ConnectionResetError:  # which did not read an answer
        return None
    if not said:
        return None
    order = json.loads(said)
    for module in order["imports"]:
        import_module(module)
    return order, list(ends)


def leave_nothing(link: socket.socket, living: dict[int, Child], folder: Path) -> None:
    """Kill what was forked for a process that has ended."""
    link.close()
    for ended in [ended for ended, child in living.items() if child.link is link]:
        child = living.pop(ended)
        os.kill(child.pid, signal.SIGKILL)
        child.reap(ended, folder)


def end_unless_awaited(listener: socket.socket, folder: Path) -> None:
    """End, unless another process of the run has just connected."""
    with suppress(FileNotFoundError), locked(folder):  # the folder goes with the run
        if select.select([listener], [], [], 0.0)[0]:
            return
        (folder / ADDRESS).unlink(missing_ok=True)
    os._exit(0)


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


def run_and_end(argv: list[str]) -> None:
    """As the interpreter does; one that succeeds ends as those that `multiprocessing` forks.

    All modules of the process that forks are left as they are: to take them apart costs 0.2 s of CPU.
    """
    try:
        run(argv)
    except SystemExit as end:
        if end.code:
            raise
    threading._shutdown()  # type: ignore[attr-defined]  # the stubs leave it out
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)


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
    run_and_end(serve(socket.socket(fileno=int(sys.argv[1])), Path(sys.argv[2])))
