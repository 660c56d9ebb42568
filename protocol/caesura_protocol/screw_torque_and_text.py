"""A screw motion as numbers and text, shared by reports, tables and exporters."""

from __future__ import annotations

import math

from caesura_protocol.messages import ScrewMotion
from caesura_protocol.number_words import fixed

TIGHT, LEAST_TORQUE_NM = 1.5, 0.1  # share of the torque taught at which a turn ends; the least torque


def exerted(screw: ScrewMotion | None) -> ScrewMotion | None:
    """Return the motion with the torque that the robot exerts: the opposite of the measured one."""
    if screw is None or screw.torque is None:
        return screw
    x, y, z = screw.torque
    return screw.model_copy(update={"torque": (-x, -y, -z)})


def torque_about_axis(screw: ScrewMotion) -> float | None:
    """Return the torque [Nm] about the axis, above 0 in the direction of the turn; None where unknown."""
    if screw.torque is None:
        return None
    return sum(a * b for a, b in zip(screw.torque, screw.axis, strict=True))


def stop_torque_nm(screw: ScrewMotion | None) -> float | None:
    """Return the torque [Nm] about the axis at which a turn ends; None where none was taught.

    screw: with the torque that the robot exerts.
    """
    taught_nm = None if screw is None else torque_about_axis(screw)
    return None if taught_nm is None or taught_nm < LEAST_TORQUE_NM else TIGHT * taught_nm


def screw_in_words(screw: ScrewMotion) -> str:
    """Format angle, axis, advance in one turn and torque about the axis, with units.

    >>> about_z = {"axis": (0.0, 0.0, -1.0), "point": (0.4, 0.0, 0.3), "angle": 2.0, "pitch_m": 0.0015}
    >>> screw_in_words(ScrewMotion(**about_z, pitch_sd_m=0.00001, torque=(0.1, 0.0, -0.9)))
    '115° about (0.00, 0.00, -1.00), 1.50 ± 0.01 mm a turn, 0.90 Nm'
    """
    axis = ", ".join(fixed(round(x, 2) + 0.0, 2) for x in screw.axis)
    advance = f"{fixed(1000 * screw.pitch_m, 2)} ± {fixed(1000 * screw.pitch_sd_m, 2)} mm a turn"
    torque = torque_about_axis(screw)
    felt = "" if torque is None else f", {fixed(abs(torque), 2)} Nm"
    return f"{fixed(math.degrees(screw.angle), 0)}° about ({axis}), {advance}{felt}"
