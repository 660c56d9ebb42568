"""`caesura serve --instances N`: a router and N instances, each a process that is restarted if it ends.

The instances end with this process, however it ends: each leaves when its standard input closes. Each prints
a heartbeat on its standard output every BEAT_S while its worker runs. An instance without heartbeats, because
it is frozen or its worker hangs, is killed and restarted.
"""

from __future__ import annotations

import logging
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import typer

from caesura_service.server import NetworkSettings
from caesura_service.server.network_join import join
from caesura_service.server.router_probe import RouterProbe, router_probe

logger = logging.getLogger(__name__)

PAUSES_S = (0.2, 30.0)  # before an instance is started again: the first, doubled each time, and the longest
STEADY_S = 60.0  # an instance that lived so long starts with the first pause again
PATIENCE_S = 15.0  # for an instance to end after its standard input has
LOOK_S = 0.2  # how often the main thread looks up for a signal, and after the instances
BEAT_S = 1.0  # how often an instance says that it is alive
SILENCE_S = 30.0  # of one that was ready: longer than freezes that a session survives
STARTING_S = 300.0  # of one that is not ready yet, for compiling the filter leaves no time to say anything
READY = "caesura ready"
ALIVE = "caesura alive"
LEAVES_WITH_STDIN = "--leave-with-stdin"


class InstanceError(Exception):
    """An instance ended before it was ready; its own output states the reason."""


class Instance:
    """A process that a thread keeps running from `start` to `end`.

    It is restarted when it ends, except if it ends before it was ready for the first time.
    """

    def __init__(
        self,
        name: str,
        command: Sequence[str],
        changed: Callable[[], object],
        *,
        silence_s: float = SILENCE_S,
    ) -> None:
        """changed: called from the thread when the process is ready or has failed.

        silence_s: time without a heartbeat after which the process is killed.
        """
        self.name = name
        self.ready = False  # has it been once?
        self.failed: int | None = None  # the exit code with which it ended before it was ready
        self._command = [*command, LEAVES_WITH_STDIN]
        self._changed = changed
        self._over = threading.Event()
        self._guard = threading.Lock()  # of what is started and ended
        self._process: subprocess.Popen[str] | None = None
        self._silence_s = silence_s
        self._limit_s = STARTING_S  # of its silence, now
        self._silent_s = 0.0  # as measured here: time in which this process was frozen does not count
        self._thread = threading.Thread(target=self._keep, name=f"instance {name}", daemon=True)

    def start(self) -> None:
        """Start the instance and return at once."""
        self._thread.start()

    def look(self) -> None:
        """Kill the process if it has been silent for too long. Call this every LOOK_S."""
        with self._guard:
            self._silent_s += LOOK_S
            if self._silent_s < self._limit_s or self._process is None or self._over.is_set():
                return
            logger.error("%s has sent no heartbeat for %g s: killed", self.name, self._limit_s)
            self._process.kill()
            self._silent_s = 0.0

    def end(self) -> None:
        """Terminate the process; kill it if it has not ended within PATIENCE_S."""
        with self._guard:
            self._over.set()
            process = self._process
        if process is not None:
            process.terminate()
            try:
                process.wait(PATIENCE_S)
            except subprocess.TimeoutExpired:
                logger.error("%s does not end: killed", self.name)
                process.kill()
        self._thread.join()

    def _keep(self) -> None:
        pause_s, longest_s = PAUSES_S
        while not self._over.is_set():
            began = time.monotonic()
            code = self._run_once()
            if not self.ready:
                self.failed = code
                self._changed()
                return
            if time.monotonic() - began > STEADY_S:
                pause_s = PAUSES_S[0]
            if not self._over.is_set():
                logger.error("%s ended with %d: started again in %g s", self.name, code, pause_s)
            if self._over.wait(pause_s):
                return
            pause_s = min(2 * pause_s, longest_s)

    def _run_once(self) -> int:
        """Run the process until it ends; return its exit code, 1 where it could not be started."""
        try:
            process = self._begin()
        except OSError as error:  # no memory, process or file for it just now
            logger.error("%s cannot be started: %s", self.name, error.strerror)
            return 1
        return 0 if process is None else self._follow(process)

    def _begin(self) -> subprocess.Popen[str] | None:
        with self._guard:
            if self._over.is_set():
                return None
            self._process = subprocess.Popen(
                self._command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
            )
            self._limit_s, self._silent_s = max(STARTING_S, self._silence_s), 0.0
            return self._process

    def _follow(self, process: subprocess.Popen[str]) -> int:
        """Read the output of a process until it ends; return its exit code."""
        assert process.stdout is not None
        assert process.stdin is not None
        with process.stdin, process.stdout:
            for line in process.stdout:
                self._silent_s = 0.0
                if line.startswith(READY):
                    logger.info("%s is ready, process %d", self.name, process.pid)
                    self.ready, self._limit_s = True, self._silence_s
                    self._changed()
            return process.wait()


def run_instances(
    names: Sequence[str],
    network: NetworkSettings,
    options: Callable[[int, str], Sequence[str]],
    over: threading.Event,
    ready: Callable[[str], None],
    *,
    silence_s: float = SILENCE_S,
) -> None:
    """Keep instances running until `over` is set.

    network: settings of the router, which this process is unless they have `connect`; options: returns the
    options of `caesura serve` for an instance by its index and name; ready: called with the endpoint once all
    are ready; silence_s: time without a heartbeat after which an instance is killed. Raises NetworkError or
    InstanceError if one never became ready.
    """
    with _router(network, over) as (endpoint, probe), ExitStack() as stack:
        wake = threading.Event()
        instances = []
        for place, name in enumerate(names):
            where = ["--connect", reachable(endpoint), "--instance", name]
            command = [sys.executable, "-m", "caesura_service", "serve", *where, *options(place, name)]
            instances.append(Instance(name, command, wake.set, silence_s=silence_s))
        for instance in instances:
            instance.start()
            stack.callback(instance.end)
        if _all_ready(instances, wake, over):
            ready(endpoint)
        while not over.wait(LOOK_S):
            if probe is not None:
                probe.update(LOOK_S)
            for instance in instances:
                instance.look()


def _all_ready(instances: Sequence[Instance], wake: threading.Event, over: threading.Event) -> bool:
    while not over.is_set():
        for instance in instances:
            if instance.failed is not None:
                raise InstanceError(
                    f"instance {instance.name} ended with {instance.failed} before it was ready"
                )
        if all(instance.ready for instance in instances):
            return True
        if not wake.wait(LOOK_S):
            for instance in instances:
                instance.look()
        wake.clear()
    return False


@contextmanager
def beating(is_alive: Callable[[], bool]) -> Iterator[None]:
    """Print heartbeats on the standard output while the context lasts and the instance is alive."""
    over = threading.Event()

    def beat() -> None:
        while not over.wait(BEAT_S):
            if is_alive():
                with suppress(OSError):  # the reader has ended: then the standard input has too
                    os.write(1, f"{ALIVE}\n".encode())

    thread = threading.Thread(target=beat, name="beat", daemon=True)  # which may hang with who reads it
    thread.start()
    try:
        yield
    finally:
        over.set()


@contextmanager
def _router(network: NetworkSettings, over: threading.Event) -> Iterator[tuple[str, RouterProbe | None]]:
    """Yield the endpoint of the configured router, or of the one that this process runs during the
    context, and the probe of the latter.
    """
    if network.connect is not None:
        yield network.connect, None
        return
    session, endpoint = join(network, over)
    try:
        with router_probe(session, "router") as probe:
            yield endpoint, probe
    finally:
        session.close()


def names_of(instance: str, count: int, default: str) -> list[str]:
    """Return instance names numbered from 1, based on the given name, or on the default without its number.

    >>> names_of("west", 2, "caesura-1"), names_of("caesura-1", 2, "caesura-1")
    (['west-1', 'west-2'], ['caesura-1', 'caesura-2'])
    """
    base = default.rpartition("-")[0] if instance == default else instance
    return [f"{base}-{number}" for number in range(1, count + 1)]


def reachable(endpoint: str) -> str:
    """Return the endpoint by which this machine connects to a listener at any address.

    >>> reachable("tcp/0.0.0.0:7447"), reachable("tls/[::]:7447"), reachable("tcp/127.0.0.1:7447")
    ('tcp/127.0.0.1:7447', 'tls/localhost:7447', 'tcp/127.0.0.1:7447')

    An IPv6 address becomes `localhost`, because Zenoh accepts no TLS certificate for an address in brackets.
    Caesura's certificates always name localhost.
    """
    return endpoint.replace("/0.0.0.0:", "/127.0.0.1:").replace("/[::]:", "/localhost:")


def passed_on(context: typer.Context, but: Sequence[str]) -> list[str]:
    """Return the given options of a command as arguments, without those named in `but`."""
    given: list[str] = []
    for parameter in context.command.params:
        source = context.get_parameter_source(parameter.name or "")
        if parameter.name in but or source is None or source.name == "DEFAULT":
            continue
        value = context.params[parameter.name or ""]
        if isinstance(value, bool):
            given += parameter.opts[:1] if value else parameter.secondary_opts[:1]
        elif value is not None:
            given += [parameter.opts[0], str(value)]
    return given


def credentials_of(config: Path | None, name: str) -> list[str]:
    """Return the option for the credentials of an instance; without a config it is empty.

    The option names the file that `caesura certs` writes beside the router's, or else the router's own.
    """
    if config is None:
        return []
    own = config.parent / f"service.{name}.json5"
    return ["--zenoh-config", str(own if own.exists() else config)]


def metrics_of(address: str | None, place: int) -> list[str]:
    """Return the option for the metrics address of an instance: the port plus the instance's index.

    >>> metrics_of("127.0.0.1:9100", 2), metrics_of("127.0.0.1:0", 2), metrics_of(None, 2)
    (['--metrics', '127.0.0.1:9102'], ['--metrics', '127.0.0.1:0'], [])

    Port 0 is a free one for each.
    """
    if address is None:
        return []
    host, _, port = address.rpartition(":")
    moved = str(int(port) + place) if port.isdigit() and int(port) else port
    return ["--metrics", f"{host}:{moved}"]
