"""The network side of the service, and its only zenoh importer."""

from caesura_service.server.network import NetworkError, NetworkSettings
from caesura_service.server.zenoh_server import ZenohServer

__all__ = ["NetworkError", "NetworkSettings", "ZenohServer"]
