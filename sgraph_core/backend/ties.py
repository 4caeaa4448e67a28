"""Two planes tied to each other by gtsam's own factors.

An anchor, a Pose3 of its own, stands on the planes; each plane is "observed" from it with an
OrientedPlane3Factor. What the anchor cannot tell (moving along the planes, turning about their
normal) is held by a weak prior. Six equations less the anchor's three observable degrees of
freedom leave three on the planes: the angle between them (2) and their distance (1). Nothing calls
back into Python, so C++ optimisers run at full speed.
"""

from __future__ import annotations

from dataclasses import dataclass

import gtsam
import numpy as np

from sgraph_concepts.types import FactorResult, FloatArray

__all__ = ["TieNoise", "tie_planes"]

FREE_SIGMA = 1e3
"""Of the anchor's observable degrees of freedom: no information to speak of."""
HELD_SIGMA = 1.0
"""Of its unobservable ones; whatever they do, no plane notices."""
WEAK = gtsam.noiseModel.Diagonal.Sigmas(
    np.array([HELD_SIGMA, FREE_SIGMA, FREE_SIGMA, FREE_SIGMA, HELD_SIGMA, HELD_SIGMA])
)


@dataclass(frozen=True)
class TieNoise:
    """Standard deviations of a tie: of the angle between the planes and of their distance."""

    angle_rad: float
    distance_m: float


def tie_planes(
    plane_keys: tuple[int, int],
    anchor_key: int,
    centre: FloatArray,
    normal: FloatArray,
    thickness_m: float | None,
    noise: TieNoise,
) -> FactorResult:
    """Return factors that hold two planes parallel at a distance.

    Args:
        plane_keys: keys of the two OrientedPlane3.
        anchor_key: a new key for the anchor.
        centre: a point halfway between the planes, where the distance holds, [2].
        normal: unit normal of the first plane, [2].
        thickness_m: distance of antiparallel planes through the body between them;
            None for planes that face the same way and coincide.
        noise: how exactly.
    """
    half = 0.0 if thickness_m is None else thickness_m / 2
    side = 1.0 if thickness_m is None else -1.0
    x, y = normal.tolist()
    rotation = gtsam.Rot3(np.array([[x, -y, 0.0], [y, x, 0.0], [0.0, 0.0, 1.0]]))
    anchor = gtsam.Pose3(rotation, np.array([*centre, 0.0]))
    # each of the two observations carries half of the tie's variance
    share = np.array([noise.angle_rad, noise.angle_rad, noise.distance_m]) / np.sqrt(2)
    model = gtsam.noiseModel.Diagonal.Sigmas(share)
    first, second = plane_keys
    return FactorResult(
        factors=[
            gtsam.OrientedPlane3Factor(np.array([1.0, 0, 0, -half]), model, anchor_key, first),
            gtsam.OrientedPlane3Factor(np.array([side, 0, 0, -half]), model, anchor_key, second),
            gtsam.PriorFactorPose3(anchor_key, anchor, WEAK),
        ],
        values=[(anchor_key, anchor)],
    )
