"""Where a building lies in its map's world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from sgraph_concepts.types import FloatArray

__all__ = ["Placement"]


@dataclass(frozen=True, eq=False)
class Placement:
    """A rotation, perhaps with a mirror, and a translation.

    Attributes:
        matrix: what turns and mirrors, [2, 2].
        offset: where the building's (0, 0) comes to lie, [2].
        angle: of the rotation, in radians.
    """

    matrix: FloatArray
    offset: FloatArray
    angle: float

    @classmethod
    def draw(cls, rng: Generator) -> Placement:
        """Draw any rotation, and a translation of up to 50 m."""
        angle = rng.uniform(0, 2 * np.pi)
        cosine, sine = np.cos(angle), np.sin(angle)
        turn = np.array([[cosine, -sine], [sine, cosine]])
        mirror = np.diag([rng.choice([-1.0, 1.0]), 1.0])
        return cls(turn @ mirror, rng.uniform(-50, 50, 2), angle)

    def points(self, points: FloatArray) -> FloatArray:
        """Return where points [..., 2] of the building lie."""
        return np.asarray(points @ self.matrix.T + self.offset)

    def directions(self, vectors: FloatArray) -> FloatArray:
        """Return where vectors [..., 2] of the building point."""
        return np.asarray(vectors @ self.matrix.T)
