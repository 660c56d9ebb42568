"""A service with the fake pipeline and a peer of it, on a network in memory."""

from collections.abc import Iterator

import pytest

from caesura_protocol.transport.memory import MemoryNetwork
from caesura_service.app import Service
from caesura_service.config import ServiceConfig
from caesura_service.server.memory_network import in_memory
from harness.fake_pipeline import make_fake_pipeline
from harness.peer import MemoryPeer


@pytest.fixture
def network() -> MemoryNetwork:
    return MemoryNetwork()


@pytest.fixture
def config() -> ServiceConfig:
    return ServiceConfig(instance="test-1", preset="fake")


@pytest.fixture
def service(config: ServiceConfig, network: MemoryNetwork) -> Iterator[Service]:
    with Service(config, pipeline_factory=make_fake_pipeline, join=in_memory(network)) as running:
        yield running


@pytest.fixture
def peer(service: Service, network: MemoryNetwork) -> Iterator[MemoryPeer]:
    with MemoryPeer(network) as connected:
        yield connected
