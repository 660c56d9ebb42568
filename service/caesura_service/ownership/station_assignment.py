"""Which instance serves which station: rendezvous hashing (highest random weight; Thaler & Ravishankar 1998).

Every instance that sees the same tokens computes the same assignment, without messages. When an instance
leaves, its stations move, evenly, and no others; when one joins, it takes its share, and no more.
"""

from __future__ import annotations

from collections.abc import Iterable
from hashlib import blake2b


def rendezvous_weight(instance: str, station: str) -> int:
    """Return the hash of an instance and a station, equal in every process and on every machine."""
    digest = blake2b(f"{instance}/{station}".encode(), digest_size=8).digest()
    return int.from_bytes(digest, "big")


def owner_of(station: str, instances: Iterable[str]) -> str:
    """Return the instance that owns a station. Raises ValueError without instances.

    >>> [owner_of(f"cell-{number}", ["west", "east"]) for number in range(1, 5)]
    ['east', 'west', 'east', 'east']
    """
    return max(instances, key=lambda instance: (rendezvous_weight(instance, station), instance))


def stations_of(me: str, instances: Iterable[str], stations: Iterable[str]) -> frozenset[str]:
    """Return the stations that an instance owns among the given ones."""
    known = frozenset(instances)
    return frozenset(station for station in stations if owner_of(station, known) == me)
