"""The surfaces that some keyframe observed, as arrays that grow with the map."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sgraph_concepts.types import IntArray, SurfaceArrays
from sgraph_core.slam.pool import Pool

__all__ = ["ObservedSurfaces"]


class ObservedSurfaces:
    """The observed surfaces where they are now; each keeps its row."""

    def __init__(self) -> None:
        self._pool = Pool(
            id=np.empty(0, np.int64),
            segment=np.empty((0, 2, 2)),
            normal=np.empty((0, 2)),
            first_seen=np.empty(0, np.int64),
        )
        self._rows: dict[int, int] = {}

    @property
    def rows(self) -> Mapping[int, int]:
        """The row of each in ``surfaces``, by id."""
        return self._rows

    @property
    def surfaces(self) -> SurfaceArrays:
        """All of them, in the order in which they were first observed."""
        return SurfaceArrays(self._pool["id"], self._pool["segment"], self._pool["normal"])

    @property
    def first_seen(self) -> IntArray:
        """The row of the first keyframe that observed each, in the same order."""
        return self._pool["first_seen"]

    def add(self, surfaces: SurfaceArrays, first_seen: IntArray) -> None:
        """Take in surfaces that are observed for the first time, by keyframes of given rows."""
        rows = self._pool.add(
            len(surfaces),
            id=surfaces.ids,
            segment=surfaces.segments,
            normal=surfaces.normals,
            first_seen=first_seen,
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
