"""Signal conditioning: from a robot's samples to observations. Pure: NumPy and SciPy only."""

from caesura_service.signals.conditioning import Conditioner, ConditioningOutput, ConditioningParameters
from caesura_service.signals.gripper_events import GripperEvent, GripperParameters
from caesura_service.signals.observation import Observation
from caesura_service.signals.sample_layout import SampleLayout
from caesura_service.signals.tare import Tare, baseline
from caesura_service.signals.wrench_capabilities import (
    WRENCH_SOURCES,
    WrenchCapabilities,
    wrench_capabilities,
)

__all__ = [
    "WRENCH_SOURCES",
    "Conditioner",
    "ConditioningOutput",
    "ConditioningParameters",
    "GripperEvent",
    "GripperParameters",
    "Observation",
    "SampleLayout",
    "Tare",
    "WrenchCapabilities",
    "baseline",
    "wrench_capabilities",
]
