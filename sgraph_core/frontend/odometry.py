"""Odometry that drifts: noise on the motions between true or corrected poses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from sgraph_concepts.types import FloatArray
from sgraph_core.frontend.planar import as_rows, between

__all__ = ["DRIFT", "Drift", "drifting_odometry"]

PLANAR_SIGMA = 1e-3
"""Of roll, pitch (rad) and z (m), which motion in the plane does not change."""


@dataclass(frozen=True)
class Drift:
    """How odometry errs, as standard deviations of one motion.

    Attributes:
        distance_share: of the distance, in x and in y.
        heading_deg: of the heading, per square root of a metre.
        least_m, least_deg: of a motion on the spot.
    """

    distance_share: float = 0.02
    heading_deg: float = 1.0
    least_m: float = 0.002
    least_deg: float = 0.1


DRIFT = Drift()


def drifting_odometry(
    poses: FloatArray, drift: Drift, rng: Generator
) -> tuple[FloatArray, FloatArray]:
    """Return noisy motions between consecutive planar poses [K, 3], and their sigmas.

    The errors are independent normal draws with the sigmas that are returned.

    Returns:
        Motions as x, y, z, qx, qy, qz, qw, [K - 1, 7], and sigmas rx, ry, rz, x, y, z, [K - 1, 6].
    """
    motions = between(poses[:-1], poses[1:])
    distance = np.linalg.norm(motions[:, :2], axis=1)
    shift = np.maximum(drift.distance_share * distance, drift.least_m)
    turn = np.radians(np.maximum(drift.heading_deg * np.sqrt(distance), drift.least_deg))
    noise = np.stack([shift, shift, turn], axis=1)
    flat = np.full(len(motions), PLANAR_SIGMA)
    sigmas = np.column_stack([flat, flat, turn, shift, shift, flat])
    return as_rows(motions + rng.normal(0, 1, noise.shape) * noise), sigmas
