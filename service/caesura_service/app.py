"""The whole service: journal, registry and network server, as a context manager or until a signal.

>>> with Service(ServiceConfig(listen="tcp/127.0.0.1:0")) as service:  # doctest: +SKIP
...     print(service.endpoint)
"""

from __future__ import annotations

import gc
import logging
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from types import FrameType, TracebackType
from typing import Self

from caesura_protocol.messages import ServiceStatus
from caesura_protocol.package_version_and_extras import installed_version
from caesura_service.config import ServiceConfig
from caesura_service.decimation import SampleReader
from caesura_service.journal import (
    BatchSource,
    FileBatches,
    Journal,
    JournalBatches,
    MemoryJournal,
    PeerJournals,
    SqliteJournal,
)
from caesura_service.malloc_threshold import return_large_blocks
from caesura_service.monitoring.health import http_server_of, liveness
from caesura_service.monitoring.instrumented_registry import InstrumentedRegistry
from caesura_service.monitoring.metrics import MetricsSource
from caesura_service.publishing.events import Owner, PipelineFactory
from caesura_service.segmentation.overflow_file import SPOOL
from caesura_service.server import Join, NetworkError, ZenohServer, certificate_end, join

logger = logging.getLogger(__name__)

# A busy Python thread keeps the network's threads waiting for the interpreter: the 99th percentile of the
# latency was 8.3 ms at the default of 5 ms, and 1.6 ms at this.
SWITCH_INTERVAL_S = 0.0005
_WAKE_S = 0.2  # how often the waiting main thread looks up for a signal


class Service:
    """An instance of the service while the context lasts. Raises NetworkError or JournalError on entry."""

    def __init__(
        self,
        config: ServiceConfig | None = None,
        *,
        pipeline_factory: PipelineFactory | None = None,
        journal: Journal | None = None,
        stop: threading.Event | None = None,
        join: Join = join,
    ) -> None:
        """journal: used instead of the configured one; stop: ends a wait for a router.

        join: as in ZenohServer.
        """
        self.config = config or ServiceConfig()
        owner = Owner(self.config.instance, int(time.time() * 1000))
        self._file = _journal_on_disk(self.config) if journal is None else None
        kept = journal or self._file or MemoryJournal()
        self.registry = InstrumentedRegistry(
            owner=owner,
            pipeline_factory=pipeline_factory or segmenting_pipeline(),
            default_preset=self.config.preset,
            journal=kept,
            limits=self.config.limits,
            peers=PeerJournals(self.config.journal_path if journal is None else None),
        )
        self._edge = ZenohServer(
            self.registry,
            owner,
            self.config.network,
            version=installed_version(),
            samples=SampleReader(self._batches(kept)),
            queue=self.config.queue,
            rates=self.config.rates,
            clock=steady_clock(),
            stop=stop,
            join=join,
            journal=None if self._file is None else _opened(self._file),
        )
        self.ready = False  # joined and declared: it can be found
        self._observed = MetricsSource(
            self.registry,
            self.status,
            lambda: self.ready,
            self._edge.budgets.budgets_of,
            lambda: self._edge.router_fault,
            certificate_end(self.config.network),
        )
        self.web = (
            None if self.config.metrics is None else http_server_of(self.config.metrics, self._observed)
        )
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            if self.web is not None:
                stack.enter_context(self.web)
            stack.enter_context(_switching_often())
            stack.enter_context(self._edge)
            self._stack = stack.pop_all()
        self.ready = True
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.ready = False
        self._stack.close()

    @property
    def endpoint(self) -> str:
        """The endpoint of the service, with its real port once entered."""
        return self._edge.endpoint

    @property
    def is_alive(self) -> bool:
        """Whether the worker completes its loop; True until the service is ready."""
        return liveness(self._observed).healthy

    def _batches(self, kept: Journal) -> BatchSource:
        """Return the source of stored samples: all journals of the directory, or the one in memory."""
        return JournalBatches(kept) if self._file is None else FileBatches(self._file.path.parent, self._file)

    @property
    def certificate_end(self) -> float | None:
        """The time at which the service's certificate expires [s since 1970]; None without a certificate."""
        return self._observed.certificate_end

    def check_link(self, since_s: float) -> None:
        """Raise NetworkError if only a new process can get a link to the router again.

        since_s: [s] since the last call.
        """
        self._edge.check_link(since_s)

    def status(self) -> ServiceStatus:
        """Return the status of the service."""
        return self._edge.status()


def run_service(
    config: ServiceConfig,
    *,
    ready: Callable[[Service], None],
    over: threading.Event,
    pipeline_factory: PipelineFactory | None = None,
) -> None:
    """Run the service until `over` is set (see `stopping`), then leave the network.

    ready: called once clients can reach the service. Raises NetworkError if it cannot join, or the router
    later refuses its link.
    """
    return_large_blocks()
    try:
        with Service(config, pipeline_factory=pipeline_factory, stop=over) as service:
            gc.freeze()  # what is loaded by now stays: looking through it again would hold up every station
            ready(service)
            while not over.wait(_WAKE_S):  # a signal that another thread took does not wake this one
                service.check_link(_WAKE_S)
    except NetworkError:
        if not over.is_set():
            raise


def segmenting_pipeline() -> PipelineFactory:
    """Return the factory of segmentation pipelines, with compiled kernels.

    It imports them when called, so that a service with another pipeline starts without them.
    """
    from caesura_service.numba_support import has_kernels, is_compiled  # noqa: PLC0415
    from caesura_service.prepare import prepare  # noqa: PLC0415
    from caesura_service.segmentation.pipeline import make_pipeline  # noqa: PLC0415

    if has_kernels() and not is_compiled():
        logger.info("compiling the filter, once, for about a minute: no bridge or client can connect before")
    prepare()
    return make_pipeline


def steady_clock() -> Callable[[], float]:
    """Return a clock that reads like the time of day [s] and never steps back."""
    offset = time.time() - time.monotonic()
    return lambda: offset + time.monotonic()


@contextmanager
def _switching_often() -> Iterator[None]:
    before = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    try:
        yield
    finally:
        sys.setswitchinterval(before)


@contextmanager
def stopping(*, with_stdin: bool = False) -> Iterator[threading.Event]:
    """Yield an event that SIGINT and SIGTERM set while the context lasts.

    with_stdin: also set at the end of standard input, which the parent process keeps open.
    """
    over = threading.Event()

    def stop(_number: int, _frame: FrameType | None) -> None:
        over.set()

    if with_stdin:
        threading.Thread(target=_wait_for_stdin, args=(over,), name="stdin", daemon=True).start()
    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield over
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _wait_for_stdin(over: threading.Event) -> None:
    while os.read(0, 1024):  # unbuffered: a buffer that a daemon thread holds would stop the interpreter
        pass
    over.set()


@contextmanager
def _opened(journal: SqliteJournal) -> Iterator[None]:
    """Open a journal, with the overflow file of its sessions beside it. Raises JournalError."""
    with journal, SPOOL.within(journal.path.parent):
        yield


def _journal_on_disk(config: ServiceConfig) -> SqliteJournal | None:
    path = config.journal_path
    return None if path is None else SqliteJournal(path, config.journal_settings)
