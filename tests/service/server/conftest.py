"""A service with the fake pipeline on a free port, and a peer that is connected to it."""

from collections.abc import Iterator

import pytest

from caesura_service.app import Service
from caesura_service.config import ServiceConfig
from caesura_service.segmentation.fake_pipeline import make_fake_pipeline
from harness.peer import Peer


@pytest.fixture
def config() -> ServiceConfig:
    return ServiceConfig(instance="test-1", listen="tcp/127.0.0.1:0", preset="fake")


@pytest.fixture
def service(config: ServiceConfig) -> Iterator[Service]:
    with Service(config, pipeline_factory=make_fake_pipeline) as running:
        yield running


@pytest.fixture
def peer(service: Service) -> Iterator[Peer]:
    with Peer(service.endpoint) as connected:
        yield connected
