"""The surfaces that some keyframe observed, as arrays that grow with the map."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from sgraph_concepts.types import FloatArray, IntArray, SurfaceArrays
from sgraph_core.backend.observed import Observed
from sgraph_core.graph import SGraph
from sgraph_core.slam.pool import Pool, boxes_around

__all__ = ["ObservedSurfaces", "surfaces_of"]


class ObservedSurfaces:
    """The observed surfaces where they are now; each keeps its row."""

    def __init__(self) -> None:
        self._pool = Pool(
            id=np.empty(0, np.int64),
            segment=np.empty((0, 2, 2)),
            normal=np.empty((0, 2)),
            first_seen=np.empty(0, np.int64),
            box=np.empty((0, 4)),
        )
        self._rows: dict[int, int] = {}

    def __contains__(self, surface: int) -> bool:
        """Whether a surface, by id, is observed."""
        return surface in self._rows

    @property
    def all(self) -> Observed:
        """All of them, in the order in which they were first observed."""
        pool = self._pool
        surfaces = SurfaceArrays(pool["id"], pool["segment"], pool["normal"])
        return Observed(surfaces, pool["first_seen"], self._rows, self._rows_near)

    def _rows_near(self, box: FloatArray) -> IntArray:
        return self._pool.meeting("box", box[None], 0.0)

    def add(self, surfaces: SurfaceArrays, first_seen: IntArray) -> None:
        """Take in surfaces that are observed for the first time, by keyframes of given rows."""
        rows = self._pool.add(
            len(surfaces),
            id=surfaces.ids,
            segment=surfaces.segments,
            normal=surfaces.normals,
            first_seen=first_seen,
            box=boxes_around(surfaces.segments),
        )
        self._rows.update(zip(surfaces.ids.tolist(), rows.tolist(), strict=True))

    def see(self, surface: int, keyframe: int) -> bool:
        """Take note that a keyframe, by row, observed one; return whether it is now the first."""
        first, row = self._pool["first_seen"], self._rows[surface]
        earlier = bool(keyframe < first[row])
        first[row] = min(first[row], keyframe)
        return earlier

    def move(self, surfaces: SurfaceArrays) -> None:
        """Put those of some surfaces that are observed where they are now."""
        which = [k for k, i in enumerate(surfaces.ids.tolist()) if i in self._rows]
        moved = surfaces.take(np.array(which, np.int64))
        rows = [self._rows[i] for i in moved.ids.tolist()]
        self._pool["segment"][rows] = moved.segments
        self._pool["normal"][rows] = moved.normals
        self._pool["box"][rows] = boxes_around(moved.segments)


def surfaces_of(graph: SGraph, ids: Iterable[int]) -> SurfaceArrays:
    """Return wall surfaces of a map as they are now, by id."""
    rows = np.array([graph.surface_row(i) for i in ids], np.int64)
    return graph.wall_surfaces.take(rows).ordered()
