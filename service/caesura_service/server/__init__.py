"""The network side of the service, over Zenoh or in memory."""

from caesura_service.server.network_interface import NetworkError
from caesura_service.server.network_join import Join, NetworkSettings, certificate_end, join
from caesura_service.server.zenoh_server import ZenohServer

__all__ = ["Join", "NetworkError", "NetworkSettings", "ZenohServer", "certificate_end", "join"]
