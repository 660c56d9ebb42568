"""Signal conditioning: from a robot's samples to observations. Pure: NumPy and SciPy only."""

from caesura_service.signals.conditioning import Conditioned, Conditioner, ConditioningParameters
from caesura_service.signals.gripper import GripperEvent, GripperParameters
from caesura_service.signals.layout import Layout
from caesura_service.signals.observation import Observation
from caesura_service.signals.tare import Tare, baseline
from caesura_service.signals.wrench import WRENCH_SOURCES, WrenchCapabilities, wrench_capabilities

__all__ = [
    "WRENCH_SOURCES",
    "Conditioned",
    "Conditioner",
    "ConditioningParameters",
    "GripperEvent",
    "GripperParameters",
    "Layout",
    "Observation",
    "Tare",
    "WrenchCapabilities",
    "baseline",
    "wrench_capabilities",
]
