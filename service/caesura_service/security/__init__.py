"""Access rights of each role on the network, and the Zenoh files that enforce them.

The package makes keys, and opens no connection.
"""

from caesura_service.security.roles import ROLES, Access, Identity, Role

__all__ = ["ROLES", "Access", "Identity", "Role"]
