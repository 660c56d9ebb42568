"""Segments grouped into phases, such as reach, wipe, retract: a layer over them with its own posterior."""

from __future__ import annotations

from caesura_service.phases.default import PARAMETERS
from caesura_service.phases.model import Chain, LogNormal, Parameters, PhaseKind
from caesura_service.phases.tracker import PhaseTracker

__all__ = ["PARAMETERS", "Chain", "LogNormal", "Parameters", "PhaseKind", "PhaseTracker"]
