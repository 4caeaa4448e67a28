"""How two surfaces lie back to back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sgraph_concepts.types import FloatArray, IntArray, SurfaceArrays
from sgraph_core.geometry import dot, in_frames

__all__ = ["BackToBack", "back_to_back"]


@dataclass(frozen=True, eq=False)
class BackToBack:
    """P pairs of surfaces, seen along the direction halfway between theirs.

    Attributes:
        opposed: cosine of the angle between one normal and the other reversed, [P].
        overlap: length along which the two lie side by side, negative for a gap, [P].
        thickness: distance from one to the other through the wall body at the middle of the
            overlap, negative where they face each other, [P].
        end_thicknesses: the same at both ends of the overlap, [P, 2].
        centres: that middle, halfway between the two, [P, 2].
    """

    opposed: FloatArray
    overlap: FloatArray
    thickness: FloatArray
    end_thicknesses: FloatArray
    centres: FloatArray

    def physical(self, thickest_m: float, least_overlap_m: float) -> NDArray[np.bool_]:
        """Return which pairs can be the sides of a wall of at most this thickness, [P]."""
        return np.asarray(
            (self.opposed > OPPOSED)
            & (self.overlap >= least_overlap_m)
            & (self.thickness > 0)
            & (self.thickness <= thickest_m)
        )


OPPOSED = np.cos(np.radians(20.0))


def back_to_back(surfaces: SurfaceArrays, one: IntArray, two: IntArray) -> BackToBack:
    """Return how the surfaces in rows ``one`` lie behind those in rows ``two``, [P] each."""
    normals = surfaces.normals
    axis = normals[one] - normals[two]
    size = np.linalg.norm(axis, axis=1)
    axis = np.where(size[:, None] > 1e-6, axis / np.maximum(size, 1e-6)[:, None], normals[one])
    tangent = np.stack([-axis[:, 1], axis[:, 0]], axis=1)
    middle = (surfaces.midpoints[one] + surfaces.midpoints[two]) / 2

    def interval(rows: IntArray) -> tuple[FloatArray, FloatArray]:
        reach = dot(surfaces.segments[rows] - middle[:, None], tangent[:, None])
        return np.minimum(reach[:, 0], reach[:, 1]), np.maximum(reach[:, 0], reach[:, 1])

    (low_one, high_one), (low_two, high_two) = interval(one), interval(two)
    low, high = np.maximum(low_one, low_two), np.minimum(high_one, high_two)
    places = np.stack([low, (low + high) / 2, high], axis=1)
    points = middle[:, None] + places[..., None] * tangent[:, None]

    def depth(rows: IntArray) -> FloatArray:
        """Return how far the points lie in front of a surface, measured along the axis, [P, 3]."""
        _, in_front = in_frames(surfaces, rows, points)
        slant = dot(normals[rows], axis)[:, None]
        return in_front / np.where(np.abs(slant) > 0.1, slant, np.inf)

    behind_one, behind_two = -depth(one), depth(two)
    thickness = behind_one + behind_two
    shift = (behind_one - behind_two)[:, 1] / 2
    return BackToBack(
        opposed=-dot(normals[one], normals[two]),
        overlap=high - low,
        thickness=thickness[:, 1],
        end_thicknesses=thickness[:, [0, 2]],
        centres=points[:, 1] + shift[:, None] * axis,
    )
