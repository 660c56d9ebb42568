"""The loop of `caesura bridge --standby`, which executes `caesura start` and `stop`."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

import typer

from caesura_clients.bridge import BridgeSettings, Source
from caesura_clients.bridge.sessions_on_demand import Standby
from caesura_clients.client import Caesura
from caesura_protocol.messages import BridgeStatus


def stand_by(
    caesura: Caesura,
    station: str,
    open_source: Callable[[], AbstractContextManager[Source]],
    *,
    source: str,
    preset: str | None,
    settings: BridgeSettings,
    released_s: float | None = None,
) -> None:
    """Serve starts and stops until Ctrl-C or SIGTERM; a second signal ends it at once.

    released_s: as in `Standby`.
    """
    standby = Standby(
        caesura.transport,
        station,
        open_source,
        source_name=source,
        preset=preset,
        settings=settings,
        say=_StatusPrinter(),
        released_s=released_s,
    )
    with _ended_by_signals(standby):
        standby.run()


@contextmanager
def _ended_by_signals(standby: Standby) -> Iterator[None]:
    def end(number: int, _frame: object) -> None:
        signal.signal(number, signal.default_int_handler)
        standby.end()

    before = {number: signal.signal(number, end) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class _StatusPrinter:
    """Prints a line for each state of a bridge, and the outcome of each session."""

    def __init__(self) -> None:
        self._line = ""
        self._outcome: tuple[str | None, str | None] = (None, None)

    def __call__(self, status: BridgeStatus) -> None:
        if (status.last_session, status.outcome) != self._outcome:
            self._outcome = (status.last_session, status.outcome)
            typer.echo(f"{status.station}/{status.last_session} {status.outcome}")
        what = "; ".join(filter(None, (status.session, status.problem))) or "waits for a start"
        line = f"{status.station} {status.state}: {what}"
        if line != self._line:
            self._line = line
            typer.echo(line, err=True)
