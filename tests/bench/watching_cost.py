"""What watching a registry costs a batch, and what a scrape costs: processor time. Prints; asserts nothing.

python tests/bench/watching_cost.py
"""

from __future__ import annotations

import logging
import sys
import time
from pathlib import Path
from statistics import median

sys.path.insert(0, str(Path(__file__).parents[1]))

from prometheus_client import generate_latest

from caesura_protocol.messages import JournalReport, ServiceStatus
from caesura_service.journal import MemoryJournal
from caesura_service.monitoring.instrumented_registry import InstrumentedRegistry
from caesura_service.monitoring.metrics import MetricsSource, metrics_of
from caesura_service.ownership.registry import Registry
from caesura_service.server.budgets import Budgets
from caesura_service.server.rate_limit_settings import RateLimits
from caesura_service.sessions.limits import Limits
from harness.fake_pipeline import make_fake_pipeline
from harness.sessions import OWNER, batches, opening

STATIONS, BATCHES, ROUNDS = 32, 50, 5


def build(kind: type[Registry]) -> Registry:
    return kind(
        owner=OWNER,
        pipeline_factory=make_fake_pipeline,
        default_preset="fake",
        journal=MemoryJournal(),
        limits=Limits(),
    )


def teach(registry: Registry) -> float:
    """[µs] a batch, over all stations in turn."""
    sent = batches(BATCHES)
    names = [f"cell-{number}" for number in range(STATIONS)]
    for name in names:
        registry.handle_command(name, opening(), 0.0)
    began = time.process_time()
    for one in sent:
        for name in names:
            registry.handle_samples(name, one, 0.0)
    return 1e6 * (time.process_time() - began) / (BATCHES * STATIONS)


def scrape(registry: InstrumentedRegistry) -> float:
    """[ms] one scrape."""
    journal = JournalReport(kind="memory", commit_s=0, size=0, size_limit=1)
    status = ServiceStatus(
        instance="bench",
        epoch=0,
        version="0",
        sessions_open=STATIONS,
        sessions_closed=0,
        messages=0,
        refused={},
        last_refusal=None,
        queue=0,
        queue_capacity=1,
        dropped=0,
        journal=journal,
    )
    page = metrics_of(MetricsSource(registry, lambda: status, lambda: True, Budgets(RateLimits()).budgets_of))
    began = time.process_time()
    generate_latest(page)
    return 1e3 * (time.process_time() - began)


def main() -> None:
    logging.basicConfig(level="ERROR")
    plain = [teach(build(Registry)) for _ in range(ROUNDS)]
    watched = []
    for _ in range(ROUNDS):
        registry = build(InstrumentedRegistry)
        watched.append(teach(registry))
    assert isinstance(registry, InstrumentedRegistry)
    scrapes = [scrape(registry) for _ in range(ROUNDS)]
    print(f"a batch, with a pipeline that does next to nothing: {median(plain):.0f} µs, ", end="")
    print(f"watched {median(watched):.0f} µs")
    print(f"a scrape of {STATIONS} stations: {median(scrapes):.1f} ms")


if __name__ == "__main__":
    main()
