"""How well the wall surfaces found in an occupancy grid match labelled rooms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from sgraph_concepts.errors import InputError
from sgraph_concepts.types import FloatArray, OccupancyGrid, SurfaceArrays
from sgraph_core.geometry import dot, lines_of, points_of
from sgraph_core.grid.extraction import in_world
from sgraph_core.grid.outlines import enclosed_area, outlines
from sgraph_core.grid.pieces import chords

__all__ = ["SurfaceScore", "score_surfaces", "true_surfaces"]

NEAR_M = 0.1
"""A point of a surface is matched if the other set has a surface this close..."""
SAME_WAY_COSINE = np.cos(np.radians(30.0))
"""...whose normal turns away by no more than this."""
SMALLEST_ROOM_M2 = 1.0
"""Fewer labelled cells are no room."""
SMALLEST_SPOT_M2 = 0.25
"""A smaller spot without label in the middle of a room is clutter rather than wall."""
SPACING_M = 0.02
"""Distance between the points of a surface that are looked at."""


@dataclass(frozen=True)
class SurfaceScore:
    """Matched lengths of the surfaces of one map, in metres.

    Attributes:
        found_matched, found: of the surfaces found.
        true_matched, true: of the true ones.
    """

    found_matched: float
    found: float
    true_matched: float
    true: float

    @property
    def precision(self) -> float:
        """Share of the found length that is matched, 0 if nothing was found."""
        return self.found_matched / self.found if self.found else 0.0

    @property
    def recall(self) -> float:
        """Share of the true length that is matched, 0 if there is none."""
        return self.true_matched / self.true if self.true else 0.0


def score_surfaces(found: SurfaceArrays, true: SurfaceArrays) -> SurfaceScore:
    """Return which length of two sets of surfaces has a counterpart in the other set.

    A point of a surface has one if a surface of the other set lies within 10 cm whose normal is
    within 30 degrees of its own.
    """
    return SurfaceScore(
        _matched_length(found, true),
        float(found.lengths.sum()),
        _matched_length(true, found),
        float(true.lengths.sum()),
    )


def true_surfaces(grid: OccupancyGrid, labels: NDArray[np.integer]) -> SurfaceArrays:
    """Return the wall surfaces that labelled rooms have, in the grid's world frame.

    They are the outlines of all rooms together, so two rooms that touch have none between them,
    straightened within one cell (Douglas-Peucker) to get rid of the steps of oblique walls. Where
    the cell behind an outline is free, as at the door to a space without label, there is no
    surface. Nor is there one around less than 1 m2 of labelled cells, which is no room (as in the
    score of rooms), or around a spot without label of less than 0.25 m2: furnished grids are
    labelled on under the furniture, a robot's around it, and neither makes it a wall.

    Args:
        grid: the grid.
        labels: number of the room of each cell, 0 for none, rows as in ``grid.cells``, [H, W].

    Raises:
        InputError: the labels have another shape than the grid.
    """
    if labels.shape != grid.cells.shape:
        raise InputError(
            f"labels have shape {list(labels.shape)}: must be the grid's, {list(grid.cells.shape)}"
        )
    outside = (grid.cells == OccupancyGrid.FREE) & (labels == 0)
    room, spot = (area / grid.resolution**2 for area in (SMALLEST_ROOM_M2, SMALLEST_SPOT_M2))
    lines = [
        run
        for line in outlines(labels > 0, lambda _row: None)
        if (area := enclosed_area(line)) == 0 or not -room < area < spot
        for run in _walls(line, outside)
    ]
    segments = chords(lines, 1.0) if lines else np.empty((0, 2, 2))
    return in_world(grid, segments)


def _walls(line: FloatArray, outside: NDArray[np.bool_]) -> list[FloatArray]:
    """Return the parts of an outline that do not touch free cells outside, [P, 2] each."""
    height, width = outside.shape
    # a point of an outline lies on the edge between two cells
    column, row = (
        np.clip((line[:, axis, None] + [-0.25, 0.25]).astype(np.int64), 0, size - 1)
        for axis, size in ((0, width), (1, height))
    )
    opening = outside[row, column].any(axis=1)
    cuts = np.flatnonzero(np.diff(opening)) + 1
    runs = zip(np.split(line, cuts), np.split(opening, cuts), strict=True)
    return [run for run, open_ in runs if not open_[0] and len(run) > 1]


def _matched_length(surfaces: SurfaceArrays, others: SurfaceArrays) -> float:
    """Return which length of surfaces has a counterpart among others, in metres."""
    counts = np.maximum(np.ceil(surfaces.lengths / SPACING_M).astype(np.int64), 1)
    owner = np.repeat(np.arange(len(surfaces)), counts)
    place = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    share = ((place + 0.5) / counts[owner])[:, None]
    ends = surfaces.segments[owner]
    points = points_of((1 - share) * ends[:, 0] + share * ends[:, 1])
    point, other = shapely.STRtree(lines_of(others.segments)).query(
        points, predicate="dwithin", distance=NEAR_M
    )
    same_way = dot(surfaces.normals[owner[point]], others.normals[other]) >= SAME_WAY_COSINE
    matched = np.zeros(len(owner), bool)
    matched[point[same_way]] = True
    return float((surfaces.lengths / counts)[owner[matched]].sum())
