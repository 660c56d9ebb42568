"""The network side of the service, and its only zenoh importer."""

from caesura_service.edge.edge import Edge
from caesura_service.edge.network import NetworkError, NetworkSettings

__all__ = ["Edge", "NetworkError", "NetworkSettings"]
