"""The bridge of one robot: it numbers samples, publishes them, and replays lost ones."""

from caesura_clients.bridge.bridge import Bridge, new_session_name
from caesura_clients.bridge.settings import BridgeSettings
from caesura_clients.bridge.sources import Source

__all__ = ["Bridge", "BridgeSettings", "Source", "new_session_name"]
