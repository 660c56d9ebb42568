"""Hints from the signals alone, which no correction changes."""

from __future__ import annotations

from functools import partial

from caesura_protocol.messages import Hint
from caesura_service.coaching.hint_log import HintLog
from caesura_service.coaching.measures import CoachingSetup, Meter, MotionState
from caesura_service.coaching.observed_pose import ObservedPose
from caesura_service.coaching.rules import RULES

SHOWN_S = 10.0  # so long a part that is to be shown again is hinted at


class SignalCoach:
    """Applies the table of rules to a session's observations, and reports gaps."""

    def __init__(self, setup: CoachingSetup) -> None:
        self.log = HintLog()
        self._meter = Meter(setup)
        self._motion = MotionState()
        self._again_until = 0.0  # [s]

    def observe(self, pose: ObservedPose) -> None:
        """Process one observation: raise and clear hints by every rule."""
        self._motion, measured = self._meter.advance(self._motion, pose)
        setup = self._meter.setup_of(self._motion)
        for rule in RULES:
            level = rule.level(measured, setup)
            if level >= 1.0 or rule.trigger.kind in self.log.stirred:
                self.log.step(rule.trigger, pose.t, level, partial(rule.words, measured, setup))
        if pose.t >= self._again_until:
            self.log.clear("show_again", pose.t)

    def report_gap(self, t0: float, tn: float) -> None:
        """Raise a hint to demonstrate the part again in which samples are missing, t0 to tn [s]."""
        self.log.clear("show_again", tn)
        self._again_until = tn + SHOWN_S
        self.log.raise_hint(
            Hint(
                kind="show_again",
                since=tn,
                text=f"Nothing was recorded from {t0:.1f} to {tn:.1f} s.",
                advice=f"Teach the part from {t0:.1f} to {tn:.1f} s again.",
                t0=t0,
                tn=tn,
            )
        )
