"""A service, bridges and the dashboard, each a process of its own, and a demonstration that goes on."""

from __future__ import annotations

import signal
import socket
import subprocess
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import ClassVar

import numpy as np

from caesura_clients import Caesura
from caesura_clients.bridge import Bridge
from caesura_clients.bridge.sources import Chunk
from caesura_clients.bridge.sources.file import FileSource, pieces
from caesura_protocol.errors import CaesuraError
from caesura_protocol.recording import Recording
from caesura_protocol.transport.zenoh_transport import ZenohTransport
from clients.conftest import free_port
from harness.demonstrations import guided
from harness.forked import Forked
from harness.processes import CAESURA, DEADLINE_S, Process, ServiceProcess, environment, running, start

REST_S = 240.0  # for which the hand rests afterwards: longer than the tests of a module take
REST_HZ = 50.0  # of its samples: each is drawn ten times a second, all along the session
KINDS = ("steady", "motion", "contact")  # how the demonstration begins
SERVED_BY = (  # what a server of pages imports when it starts
    *("anyio._backends._asyncio", "uvicorn.loops.auto"),
    *("uvicorn.protocols.http.auto", "uvicorn.protocols.websockets.wsproto_impl"),
)


def patient(seed: int = 0, rest_s: float = REST_S) -> Recording:
    """Reach, press, lift away, go back, and then hold still for long: the demonstration goes on."""
    taught, rng = guided(seed), np.random.default_rng(seed + 100)
    count = round(rest_s * REST_HZ)
    pos = taught.signals["pos"][-20:].mean(axis=0) + 3e-4 * rng.standard_normal((count, 3))
    force = 0.2 * rng.standard_normal((count, 3))
    t = taught.t[-1] + (1 + np.arange(count)) / REST_HZ
    signals = {
        "pos": np.concatenate([taught.signals["pos"], pos]),
        "force": np.concatenate([taught.signals["force"], force]),
    }
    return Recording(
        t=np.concatenate([taught.t, t]), signals=signals, wrench_source="flange_sensor", name="patient"
    )


class Aged(FileSource):
    """A recording that is sent at once up to an age [s], and at the pace of a robot from then on."""

    def __init__(self, recording: Recording, age_s: float) -> None:
        super().__init__(recording)
        self._age_s = age_s

    def chunks(self) -> Iterator[Chunk]:
        """Chunks of samples (k, columns)."""
        began_s = 0.0
        for chunk in pieces(self.recording.matrix()):
            due_s = float(chunk[-1, 0]) - self._age_s
            if due_s > 0.0:
                began_s = began_s or time.monotonic()
                time.sleep(max(0.0, began_s + due_s - time.monotonic()))
            yield chunk


class Pages(Process):
    """A server of pages on the port of one that has ended: the browser has their files in its cache."""

    imports = ("caesura_clients.dashboard.server", *SERVED_BY)
    _ports: ClassVar[list[int]] = []  # of those that have ended

    def __init__(self, command: Sequence[str]) -> None:
        self.port = self._ports.pop() if self._ports else free_port()
        if listens(self.port):  # of another test
            self.port = free_port()
        self.url = f"http://127.0.0.1:{self.port}"
        super().__init__([*command, "--port", str(self.port)])

    def begin(self) -> None:
        if self.port in self._ports:  # it has ended, and is started again
            self._ports.remove(self.port)
        super().begin()

    def kill(self) -> None:
        super().kill()
        self._leave_port()

    def end(self) -> int:
        code = super().end()
        self._leave_port()
        return code

    def _leave_port(self) -> None:
        if self.port not in self._ports:
            self._ports.append(self.port)


def listens(port: int) -> bool:
    """Does a process listen there? Connections of one that has ended do not count."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("", port))
        except OSError:
            return True
        return False


class Dashboard(Pages):
    """`caesura dashboard`."""

    def __init__(self, endpoint: str, *options: str) -> None:
        super().__init__([*CAESURA, "dashboard", "--connect", endpoint, *options])


class Bridges:
    """Bridges of a service, in processes of their own, which are killed in the end."""

    def __init__(self, service: ServiceProcess, folder: Path) -> None:
        self.service, self.folder = service, folder
        self._bridges: dict[str, subprocess.Popen[str] | Forked] = {}

    def teach(
        self, station: str, recording: Recording, *options: str, session: str = "s1", pace: str = "real"
    ) -> None:
        """A bridge in a process of its own, with further options."""
        file = self.folder / f"{station}-{session}.npz"
        recording.save(file)
        command = [
            *CAESURA, "bridge", "--connect", self.service.endpoint, "--station", station,
            "--session", session, "--source", "file", "--file", str(file), "--pace", pace,
            *options,
        ]  # fmt: skip
        self._bridges[station] = start(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    @contextmanager
    def aged(self, station: str, recording: Recording, age_s: float, session: str = "s1") -> Iterator[None]:
        """A session that is so old [s] and goes on while the context lasts, by a bridge in this process."""
        with (
            self.reader() as robot,
            Bridge(robot.transport, station, Aged(recording, age_s), session=session) as bridge,
        ):
            threading.Thread(target=_run, args=(bridge,), daemon=True).start()
            yield

    def wait(self, station: str) -> None:
        """Until its bridge has ended by itself."""
        assert self._bridges[station].wait(DEADLINE_S) == 0

    def freeze(self, station: str) -> None:
        """Its bridge hangs."""
        self._bridges[station].send_signal(signal.SIGSTOP)

    def kill(self, station: str) -> None:
        """−9."""
        self._bridges[station].kill()
        self._bridges[station].wait(DEADLINE_S)

    def close(self) -> None:
        for station in self._bridges:
            self.kill(station)

    @contextmanager
    def reader(self) -> Iterator[Caesura]:
        """A client of its own, which sees what is on the wire."""
        with ZenohTransport(self.service.endpoint, timeout_s=DEADLINE_S) as transport:
            yield Caesura(transport)


def _run(bridge: Bridge) -> None:
    with suppress(CaesuraError):  # closed before its recording is over
        bridge.run()


class Stage(Bridges):
    """Everything that a browser looks at."""

    def __init__(self, service: ServiceProcess, dashboard: Dashboard, folder: Path) -> None:
        super().__init__(service, folder)
        self.dashboard = dashboard


class StandbyBridge(Process):
    """`caesura bridge --standby` of cell-1, in a process of its own."""

    def __init__(self, stage: Stage) -> None:
        file = stage.folder / "taught.npz"
        patient().save(file)
        super().__init__([
            *CAESURA, "bridge", "--standby", "--connect", stage.service.endpoint, "--station", "cell-1",
            "--source", "file", "--file", str(file), "--pace", "4",
        ])  # fmt: skip

    def start(self) -> None:
        """The page states when it is ready."""
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "env": environment()}
        self._process = start(self.command, **quiet)


@contextmanager
def staged(folder: Path) -> Iterator[Stage]:
    """Service and dashboard, ready."""
    with (
        running(ServiceProcess(folder / "journal")) as service,
        running(Dashboard(service.endpoint)) as dashboard,
        closing(Stage(service, dashboard, folder)) as stage,
    ):
        yield stage
