"""The surfaces of a map that some keyframe observed: those that have planes and may get factors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
import shapely

from sgraph_concepts.types import FloatArray, IntArray, SurfaceArrays
from sgraph_core.geometry import boxes_of, lines_of
from sgraph_core.graph import SGraph

__all__ = ["Observed", "observed_in"]


@dataclass(frozen=True, eq=False)
class Observed:
    """The observed surfaces of a map.

    Attributes:
        surfaces: all of them, [N].
        first_seen: the row of the first keyframe that observed each, [N].
        rows: theirs in ``surfaces``, by id.
        rows_near: returns the rows, ascending, whose bounding boxes meet a box x, y, x, y.
    """

    surfaces: SurfaceArrays
    first_seen: IntArray
    rows: Mapping[int, int]
    rows_near: Callable[[FloatArray], IntArray]

    def near(self, box: FloatArray) -> SurfaceArrays:
        """Return the surfaces whose bounding boxes meet a box x, y, x, y."""
        return self.surfaces.take(self.rows_near(box))


def observed_in(graph: SGraph) -> Observed:
    """Return the observed surfaces of an S-Graph, by id."""
    table = graph.observations
    ids, which = np.unique(table.surface_ids, return_inverse=True)
    by = np.array([graph.keyframe_row(i) for i in table.keyframe_ids.tolist()], np.int64)
    first = np.full(len(ids), len(graph.keyframes.ids))
    np.minimum.at(first, which, by)
    rows = np.array([graph.surface_row(i) for i in ids.tolist()], np.int64)
    surfaces = graph.wall_surfaces.ordered().take(rows)

    @cache
    def index() -> shapely.STRtree:  # which not every concept asks
        return shapely.STRtree(lines_of(surfaces.segments))

    def rows_near(box: FloatArray) -> IntArray:
        return np.sort(index().query(boxes_of(box.reshape(1, 2, 2))[0]))

    of = {surface: row for row, surface in enumerate(ids.tolist())}
    return Observed(surfaces, first, of, rows_near)
