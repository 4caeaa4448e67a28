"""Drift between a robot's visits: parts of the map that are shifted and turned as a whole."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.random import Generator
from shapely import Polygon

from sgraph_concepts.types import FloatArray, IntArray
from sgraph_core.geometry import points_of, turn_left
from sgraph_core.synth.config import ViewConfig
from sgraph_core.synth.pieces import Pieces

__all__ = ["Drift"]


@dataclass(frozen=True, eq=False)
class Drift:
    """The motions of V visits.

    Attributes:
        room_visits: in which visit each room is mapped, [R]; facades are mapped in the last visit.
        centres: around which the visits are turned, [V, 2].
        shifts: in metres, [V, 2].
        angles: in radians, [V].
    """

    room_visits: IntArray
    centres: FloatArray
    shifts: FloatArray
    angles: FloatArray

    @classmethod
    def draw(cls, rooms: list[Polygon], rng: Generator, config: ViewConfig) -> Drift:
        """Draw visits of rooms close together; the farther from the first, the more they drift."""
        places = shapely.get_coordinates(shapely.centroid(rooms))
        count = int(np.ceil(len(rooms) / rng.integers(*config.visit_rooms, endpoint=True)))
        centres = places[rng.permutation(len(rooms))[:count]]
        away = np.linalg.norm(centres - centres[0], axis=1)
        growth = np.append(away / max(away.max(), 1.0), 1.0)
        shift, angle = rng.uniform(*config.drift_m), np.radians(rng.uniform(*config.drift_deg))
        return cls(
            shapely.STRtree(points_of(centres)).nearest(points_of(places)),
            np.vstack([centres, places.mean(axis=0)]),
            rng.normal(0, shift, (count + 1, 2)) * growth[:, None],
            rng.normal(0, angle, count + 1) * growth,
        )

    def drifted(self, pieces: Pieces, rooms: list[Polygon]) -> Pieces:
        """Return pieces as the visits map them; clutter and cavities with the nearest room."""
        middles = points_of(pieces.segments.mean(axis=1))
        nearest = shapely.STRtree(rooms).nearest(middles)
        visits = self.room_visits[np.where(pieces.rooms < 0, nearest, pieces.rooms)]
        visits[pieces.facades] = len(self.angles) - 1
        normals = _turned(pieces.normals, self.angles[visits])
        segments = self._moved(pieces.segments, visits[:, None])
        return Pieces(segments, normals, pieces.rooms, pieces.structural)

    def drifted_outline(self, outline: FloatArray, room: int) -> FloatArray:
        """Return a room's outline [K, 2] as the room's visit maps it."""
        return self._moved(outline, np.full(len(outline), self.room_visits[room]))

    def _moved(self, points: FloatArray, visits: IntArray) -> FloatArray:
        centres = self.centres[visits]
        return centres + _turned(points - centres, self.angles[visits]) + self.shifts[visits]


def _turned(vectors: FloatArray, angles: FloatArray) -> FloatArray:
    """Return vectors [..., 2] turned counter-clockwise by angles [...]."""
    cosine, sine = np.cos(angles)[..., None], np.sin(angles)[..., None]
    return np.asarray(cosine * vectors + sine * turn_left(vectors))
