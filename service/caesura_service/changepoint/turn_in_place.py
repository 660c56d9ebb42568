"""A turn about a fixed point: the motion of the position while the orientation changes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from caesura_service.changepoint.channel_model import AXES, ModelInput, Rows, append
from caesura_service.changepoint.evidence import known_mean_log_evidence

Array = NDArray[np.float64]

SMALL_ANGLE_RAD = 1e-6  # below which the series of the rotation matrix ends at its second term


@dataclass(frozen=True)
class TurnInPlace:
    """The position turns about an unknown fixed centre.

    With the rotation exp(φ_t) from one observation to the next, E_t = exp(φ_t) − I, and the centre c,

        z_t − z_{t−1} = E_t (z_{t−1} − c) + w_t ε_t,    w_t² = floor² + share² |φ_t|²

    This is linear in c. The innovations ε are isotropic normal; their variance has a scaled inverse
    chi-squared prior with nu0 degrees of freedom and scale 1. The centre is normal about the segment's start,
    with `reach` times the standard deviation of ε: the conjugate prior, under which the evidence of a linear
    regression has a closed form (Bishop 2006, exercise 3.23). The equation holds for every point of the tool;
    the prior and the weight depend on which one is reported.

    Every step is weighed by exp(−|z_t − z_{t−1}|⁴/2 (floor² + reach² |φ_t|²)²), which is at most 1: an arc
    about a centre further away than `reach` is a movement, not a turn in place.

    floor [m]; share [m/rad]; reach [m].
    """

    floor: float
    share: float
    reach: float
    nu0: float = 10.0

    def empty(self) -> Rows:
        """Return empty rows: n, start, last position, last rotation, triangle, Σ log w, Σ log weight.

        The triangle (4, 4) is the R of a QR decomposition of all equations (E c, y)/w, with the prior's: its
        last entry is the root of the residual sum of squares.
        """
        vectors, scalars = np.zeros((0, AXES)), np.zeros(0)
        triangles = np.zeros((0, AXES + 1, AXES + 1))
        return (np.zeros(0, np.int64), vectors, vectors, vectors, triangles, scalars, scalars)

    def extend(self, rows: Rows, observed: ModelInput) -> Rows:
        """Return the rows after one more observation.

        A segment begins at the position before its first one.
        """
        z, rotation, joins = observed.position, observed.rotation, len(rows[0]) > 0
        before, turned = (rows[2][-1], rotation - rows[3][-1]) if joins else (z, np.zeros(AXES))
        e = rotation_matrix(turned) - np.eye(AXES)
        step2, angle2 = float((z - before) @ (z - before)), float(turned @ turned)
        scale2 = self.floor**2 + self.share**2 * angle2
        near = -0.5 * (step2 / (self.floor**2 + self.reach**2 * angle2)) ** 2
        prior = np.diag([1.0 / self.reach] * AXES + [0.0])
        n, log_scales, weights = (append(rows[i], np.zeros(())) for i in (0, 5, 6))
        start, triangles = append(rows[1], before), append(rows[4], prior)
        y = z - before - (before - start) @ e.T  # the centre is counted from each start
        equations = np.concatenate([np.broadcast_to(e, (len(n), AXES, AXES)), y[:, :, None]], axis=2)
        stacked = np.concatenate([triangles, equations / math.sqrt(scale2)], axis=1)
        reduced: Array = np.linalg.qr(stacked, mode="r")  # type: ignore[assignment]
        return (
            n + 1,
            start,
            np.tile(z, (len(n), 1)),
            np.tile(rotation, (len(n), 1)),
            reduced,
            log_scales + 0.5 * math.log(scale2),
            weights + near,
        )

    def log_evidence(self, rows: Rows) -> Array:
        """Return (h,) log evidence of each hypothesis."""
        n, _, _, _, triangles, log_scales, weights = rows
        diagonals = np.abs(np.diagonal(triangles, axis1=1, axis2=2))
        log_root_det = np.log(self.reach * diagonals[:, :AXES]).sum(axis=1)  # over the prior's
        density = known_mean_log_evidence(AXES * n, diagonals[:, AXES] ** 2, self.nu0, 1.0)
        result: Array = density - log_root_det - AXES * log_scales + weights
        return result


def centre_of(
    places: Sequence[Sequence[float]], turns: Sequence[Sequence[float]]
) -> tuple[float, float, float]:
    """Return the point [m] of a turn's axis that is nearest to the start of the turn.

    places: the first position [m], then one for each of `turns`, the rotation vectors [rad] since the first.
    Least squares over displacements across the axis; without a rotation it is the first position.
    """
    first = np.asarray(places[0], float)
    angle = math.sqrt(float(np.dot(turns[-1], turns[-1])))
    axis = np.asarray(turns[-1], float) / angle if angle > SMALL_ANGLE_RAD else np.zeros(AXES)
    across = np.eye(AXES) - np.outer(axis, axis)
    e = np.concatenate([across @ (rotation_matrix(np.asarray(turn, float)) - np.eye(AXES)) for turn in turns])
    moved = np.concatenate([across @ (np.asarray(place, float) - first) for place in places[1:]])
    offset = across @ np.linalg.lstsq(e, -moved, rcond=SMALL_ANGLE_RAD)[0]
    x, y, z = (first + offset).tolist()
    return x, y, z


def rotation_matrix(vector: Array) -> Array:
    """Return the matrix (3, 3) of a rotation vector (3,) [rad]: Rodrigues' formula."""
    angle = math.sqrt(vector @ vector)
    small = angle < SMALL_ANGLE_RAD
    first = 1.0 if small else math.sin(angle) / angle
    second = 0.5 if small else (1.0 - math.cos(angle)) / angle**2
    x, y, z = vector.tolist()
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    matrix: Array = np.eye(AXES) + first * cross + second * (cross @ cross)
    return matrix
