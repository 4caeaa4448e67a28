"""Where two surfaces are the sides of one wall body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from sgraph_concepts.types import FloatArray, IntArray
from sgraph_core.geometry import dot, lines_of, turn_left

__all__ = ["INTO_ROOM_M", "THICKEST_M", "WallGaps", "wall_gaps"]

THICKEST_M = 0.5
THINNEST_M = 0.02
LEAST_OVERLAP_M = 0.3
OPPOSED = np.cos(np.radians(11.5))
INTO_ROOM_M = 0.03
"""What is taken out of a wall reaches this far into the rooms beside it, so that they join."""


@dataclass(frozen=True, eq=False)
class WallGaps:
    """G wall bodies between surfaces.

    Attributes:
        one, two: rows of the two surfaces, first below second, [G].
        starts, ends: the part of the first surface behind which the second lies, [G, 2].
        inwards: the first surface's direction through the wall body, [G, 2].
        thicknesses: of the wall body in the middle, [G].
    """

    one: IntArray
    two: IntArray
    starts: FloatArray
    ends: FloatArray
    inwards: FloatArray
    thicknesses: FloatArray

    @property
    def lengths(self) -> FloatArray:
        """Lengths of the wall bodies, [G]."""
        return np.asarray(np.linalg.norm(self.ends - self.starts, axis=1))

    def __len__(self) -> int:
        return len(self.one)

    def take(self, rows: IntArray | NDArray[np.bool_]) -> WallGaps:
        """Return the given rows, by index or mask."""
        return WallGaps(
            self.one[rows],
            self.two[rows],
            self.starts[rows],
            self.ends[rows],
            self.inwards[rows],
            self.thicknesses[rows],
        )

    def stretch(self, row: int, share: float, where: float) -> FloatArray:
        """Return both ends of ``share`` of a wall, ``where`` of the way along it, [2, 2]."""
        start, along = self.starts[row], self.ends[row] - self.starts[row]
        first = where * (1 - share)
        return np.stack([start + first * along, start + (first + share) * along])

    def body(self, row: int, stretch: FloatArray, low_m: float, high_m: float) -> Polygon:
        """Return what lies along a stretch of a wall between two depths below its first side."""
        first, last = stretch
        low, high = low_m * self.inwards[row], high_m * self.inwards[row]
        return Polygon([first + low, last + low, last + high, first + high])


def wall_gaps(segments: FloatArray, normals: FloatArray) -> WallGaps:
    """Return where surfaces lie back to back over at least 0.3 m, 0.02 to 0.5 m apart there."""
    lines = lines_of(segments)
    reach = THICKEST_M * np.array([-1, -1, 1, 1])
    one, two = shapely.STRtree(lines).query(shapely.box(*(shapely.bounds(lines) + reach).T))
    opposed = (one < two) & (dot(normals[one], normals[two]) < -OPPOSED)
    one, two = one[opposed], two[opposed]
    tangent, middle = turn_left(normals[one]), segments[one].mean(axis=1)
    along_one = dot(segments[one] - middle[:, None], tangent[:, None])
    along_two = dot(segments[two] - middle[:, None], tangent[:, None])
    low = np.maximum(along_one.min(axis=1), along_two.min(axis=1))
    high = np.minimum(along_one.max(axis=1), along_two.max(axis=1))

    def thickness(along: FloatArray) -> FloatArray:
        share = (along - along_two[:, 0]) / (along_two[:, 1] - along_two[:, 0])
        opposite = segments[two, 0] + share[:, None] * (segments[two, 1] - segments[two, 0])
        return -dot(opposite - middle, normals[one])

    body = high - low > LEAST_OVERLAP_M
    for end in (low, high):
        body &= (thickness(end) > THINNEST_M) & (thickness(end) <= THICKEST_M)
    return WallGaps(
        one[body],
        two[body],
        (middle + low[:, None] * tangent)[body],
        (middle + high[:, None] * tangent)[body],
        -normals[one][body],
        thickness((low + high) / 2)[body],
    )
