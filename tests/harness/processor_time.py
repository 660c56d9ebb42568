"""What the tests cost: `make test ARGS="-p harness.processor_time"` lists the processor time of each module.

A line has the seconds of the test process and of the processes that it started. Those that `Forked` starts
count for the test that asked for them, others for the test in which they end. `CAESURA_TEST_TIMES` names a
file for the time of each test.
"""

from __future__ import annotations

import json
import os
import time
from collections import defaultdict
from collections.abc import Generator, Iterator
from pathlib import Path

import pytest

from harness.forked import RUN, TIMES

SHOWN = 60
COLLECTING = "collection"


def _used() -> tuple[float, float]:
    """Seconds of this process, and of those that it has waited for."""
    times = os.times()
    return time.process_time(), times.children_user + times.children_system


def _note(test: str, own: float, children: float) -> None:
    with (Path(os.environ[RUN]) / TIMES).open("a") as file:
        file.write(json.dumps([test, own, children]) + "\n")


@pytest.hookimpl(tryfirst=True)
def pytest_sessionstart() -> None:
    (Path(os.environ[RUN]) / TIMES).touch()


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    before = time.process_time()
    _note("start of a process", before, 0.0)
    collected = yield
    _note(COLLECTING, time.process_time() - before, 0.0)
    return collected


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    own, children = _used()
    result = yield
    now, now_children = _used()
    _note(item.nodeid, now - own, now_children - children)
    return result


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    tests: dict[str, list[float]] = defaultdict(lambda: [0.0, 0.0])
    for test, own, children in _noted():
        tests[test][0] += own
        tests[test][1] += children
    if file := os.environ.get("CAESURA_TEST_TIMES"):
        Path(file).write_text(json.dumps(tests))
    modules: dict[str, list[float]] = defaultdict(lambda: [0.0, 0.0, 0])
    for test, times in tests.items():
        module = modules[test.split("::", maxsplit=1)[0]]
        module[:] = [module[0] + times[0], module[1] + times[1], module[2] + 1]
    terminalreporter.section("processor time [s]: of the test process, of its children, tests")
    for name, (own, children, count) in sorted(modules.items(), key=lambda one: -sum(one[1][:2]))[:SHOWN]:
        terminalreporter.write_line(f"{own:8.2f} {children:8.2f} {count:5} {name}")
    own, children = (sum(times[place] for times in tests.values()) for place in (0, 1))
    terminalreporter.write_line(f"{own:8.2f} {children:8.2f} {len(tests):5} all")


def _noted() -> Iterator[tuple[str, float, float]]:
    with (Path(os.environ[RUN]) / TIMES).open() as file:
        for line in file:
            test, own, children = json.loads(line)
            for phase in ("setup", "call", "teardown"):
                test = test.removesuffix(f" ({phase})")
            yield test, own, children
