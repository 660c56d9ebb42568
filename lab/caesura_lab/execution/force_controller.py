"""The force of a press along its direction: how hard the arm pushes, and how the force is corrected.

What yields is pushed in by the force alone, and slower towards its bottom, which may be hard. What no longer
yields should resist with the wanted force; the difference is corrected.
"""

from __future__ import annotations

from dataclasses import dataclass

from caesura_lab.execution.simulated_arm import PRESS_DAMPING_NS_PER_M

FORCE_GAIN_PER_S, FORCE_CORRECTION_N = 40.0, 8.0
FORCE_GAIN_SHARE = 0.5  # of the damping of a press, up to which the gain times the mass goes
SURFACE_DAMPING_NS_PER_M = 250.0  # of a stiff surface that is fully pressed
DAMPED_N = 25.0  # force from which on a surface of 50 kN/m has it
BOUNCING_M_PER_S = 0.003  # at the bottom it is no rest, whose force could be corrected, from that speed on
BOTTOM_M_PER_S = 0.012  # with which the bottom of what is pushed in is met: it may be hard
SINKING_PER_S = 6.0  # for each metre that is left to the bottom it may sink so many metres a second faster
SUNK_M = 0.002  # above the bottom
RESISTS_SHARE = 0.85  # of a force, from which on what sinks is pressed and not only pushed aside
URGING_NS_PER_M = 300.0  # by which it is sped up, as long as it resists with less than the force
SINKING_NS_PER_M = 2000.0  # damping of a press that sinks faster than that


def force_gain_per_s(force_n: float, mass_kg: float) -> float:
    """Return the gain of the correction, at which a press of a mass is damped."""
    damping = PRESS_DAMPING_NS_PER_M + SURFACE_DAMPING_NS_PER_M * min(force_n / DAMPED_N, 1.0)
    return min(FORCE_GAIN_PER_S, FORCE_GAIN_SHARE * damping / mass_kg)


@dataclass
class ForceController:
    """Controls the force of one press, tick by tick.

    gain_per_s: of the correction; correction_n: how much more than wanted is pushed; depth_m: by which the
    object yields, None for a stroke, which may lead up or down. sunk_m: way along the press so far.
    """

    gain_per_s: float
    correction_n: float
    depth_m: float | None
    sunk_m: float = 0.0
    _slowest_m_per_s: float = 0.0
    _is_slowed: bool = False

    @property
    def _left_m(self) -> float:
        return max((self.depth_m or 0.0) - self.sunk_m, 0.0)

    @property
    def sinks(self) -> bool:
        """Whether the object still yields."""
        return self.depth_m is not None and self._left_m > SUNK_M

    def push_n(self, want_n: float, speed: float, resists_n: float) -> float:
        """Return the force to push with in a tick [N].

        want_n: the wanted force; speed: [m/s] of the tool along the press; resists_n: the force with which
        the object pushes back. All are those at the beginning of the tick.
        """
        fast = 0.0 if self.depth_m is None else speed - (BOTTOM_M_PER_S + SINKING_PER_S * self._left_m)
        slowed_n = min(SINKING_NS_PER_M * max(fast, 0.0), want_n + self.correction_n)
        spared = max(1.0 - resists_n / want_n, 0.0) if self.sinks and want_n > 0.0 else 0.0
        self._is_slowed = bool(slowed_n)
        return want_n + self.correction_n - slowed_n + URGING_NS_PER_M * max(-fast, 0.0) * spared

    def correct(self, want_n: float, speed: float, resists_n: float, dt: float) -> None:
        """Update the correction after a tick of dt [s].

        want_n, speed and resists_n have the values with which `push_n` was called for this tick.
        """
        bounces = self.depth_m is not None and not self.sinks and abs(speed) > BOUNCING_M_PER_S
        wrong_n, before = want_n - resists_n, self._slowest_m_per_s
        self._slowest_m_per_s = max(speed, 0.0)
        if self._is_slowed or bounces:
            # What was added against the damping of its motion goes with that motion.
            wrong_n, self._slowest_m_per_s = 0.0, min(before, self._slowest_m_per_s)
            self.correction_n -= PRESS_DAMPING_NS_PER_M * (before - self._slowest_m_per_s)
        if self.sinks and resists_n < RESISTS_SHARE * want_n:
            wrong_n = -self.correction_n  # what was added to press on something else
        corrected = self.correction_n + self.gain_per_s * dt * wrong_n
        self.correction_n = min(max(corrected, -FORCE_CORRECTION_N), FORCE_CORRECTION_N)
