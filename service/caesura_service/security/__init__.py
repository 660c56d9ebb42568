"""Who may do what on the network, and the files that say so to Zenoh. Knows keys, no network."""

from caesura_service.security.roles import ROLES, Access, Identity, Role

__all__ = ["ROLES", "Access", "Identity", "Role"]
