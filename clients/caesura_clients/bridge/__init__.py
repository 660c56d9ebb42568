"""A bridge: takes samples from one robot, numbers them, and sees to it that none is lost."""

from caesura_clients.bridge.bridge import Bridge, new_session_name
from caesura_clients.bridge.settings import BridgeSettings
from caesura_clients.bridge.sources import Source

__all__ = ["Bridge", "BridgeSettings", "Source", "new_session_name"]
