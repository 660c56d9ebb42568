"""How long a robot's loop waits for `send` while everything behind it fails."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from caesura_clients import connect
from faults.suite.outcome import Row
from faults.suite.proxy import Proxy, proxied
from harness.processes import SESSION, Process, Router, ServiceProcess, running, serving

MOST_S = 0.005
BEFORE_S, AFTER_S = 1.0, 3.0


class RobotLoop(Process):
    """`robot_loop` for so long."""

    def __init__(self, endpoint: str, seconds: float) -> None:
        super().__init__([sys.executable, "-m", "faults.suite.robot_loop", endpoint, str(seconds)])

    def outcome(self) -> dict[str, object]:
        """What it says in the end."""
        assert self._process is not None
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        return dict(json.loads(line))


@dataclass(frozen=True)
class Scene:
    """What can be broken."""

    service: ServiceProcess
    router: Router
    proxy: Proxy


def killed_service(scene: Scene) -> None:
    scene.service.kill()
    time.sleep(2.0)
    scene.service.start()


def killed_router(scene: Scene) -> None:
    scene.router.kill()
    time.sleep(2.0)
    scene.router.start()


def frozen_router(scene: Scene) -> None:
    scene.router.freeze()
    time.sleep(10.0)
    scene.router.thaw()


def half_open(scene: Scene) -> None:
    scene.proxy.flows = False
    time.sleep(10.0)
    scene.proxy.flows = True


def forgotten(scene: Scene) -> None:
    """A service without a journal forgets everything: the whole ring is asked for again."""
    scene.service.kill()
    scene.service.command[scene.service.command.index("--journal") + 1] = "memory"
    scene.service.start()


def undisturbed(scene: Scene) -> None:
    del scene


# How it fails → how long that takes [s], at most.
WAYS: dict[str, tuple[Callable[[Scene], None], float]] = {
    "undisturbed": (undisturbed, 0.0),
    "service killed": (killed_service, 5.0),
    "router killed": (killed_router, 5.0),
    "router frozen 10 s": (frozen_router, 11.0),
    "half-open TCP 10 s": (half_open, 11.0),
    "whole ring replayed": (forgotten, 5.0),
}


@contextmanager
def scene(directory: Path) -> Iterator[Scene]:
    """A service behind a router behind a proxy."""
    with (
        running(Router()) as router,
        serving(directory, router=router.endpoint) as service,
        proxied(router.endpoint) as proxy,
    ):
        yield Scene(service, router, proxy)


def robot_waits(way: str, directory: Path) -> Row:
    """The distribution of `send`."""
    disturb, lasts_s = WAYS[way]
    with scene(directory) as broken:
        with running(RobotLoop(broken.proxy.endpoint, BEFORE_S + lasts_s + AFTER_S)) as loop:
            time.sleep(BEFORE_S)
            disturb(broken)
            outcome = loop.outcome()
        with connect(broken.router.endpoint, timeout_s=10.0) as caesura:
            status = caesura.snapshot("cell-1", SESSION).status
    times, late = np.array(outcome["sent"]), np.array(outcome["late"])
    p50, p99, most = 1e6 * np.quantile(times, [0.5, 0.99, 1.0])
    note = f"send: p50 {p50:.0f} µs, p99 {p99:.0f} µs, max {most / 1e3:.2f} ms"
    note += f"; over {1e3 * MOST_S:g} ms: {int((times > MOST_S).sum())}"
    note += f"; loop itself late: max {1e3 * late.max():.1f} ms"
    note += "" if outcome["real_time"] else "; no real-time priority"
    note += f"; not closed: {outcome['why']}" if not outcome["closed"] else ""
    lost = len(times) - status.samples
    met = bool(times.max() <= MOST_S) and outcome["closed"] is True and not lost
    return Row(1, len(times), lost, status.repeats, "–", None, note, met)
