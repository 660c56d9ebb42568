"""Live coaching: hints to the teacher while a demonstration goes on.

`measures` reduces an observation to the few numbers that the rules compare with their limits. `rules` is the
table of rules. `hint_log` raises and clears hints by them. All of it is pure and O(1) an observation.
"""

from caesura_service.coaching.boundaries import BoundaryCoach
from caesura_service.coaching.hint_log import HintLog, all_hints
from caesura_service.coaching.measures import ArmLimits, CoachingSetup
from caesura_service.coaching.observed_pose import ObservedPose
from caesura_service.coaching.signal_coach import SignalCoach

__all__ = [
    "ArmLimits",
    "BoundaryCoach",
    "CoachingSetup",
    "HintLog",
    "ObservedPose",
    "SignalCoach",
    "all_hints",
]
