"""From an occupancy grid to the wall surfaces that bound its free space."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import shapely
from numpy.typing import NDArray

from sgraph_concepts.types import FloatArray, IntArray, OccupancyGrid, SurfaceArrays
from sgraph_core.geometry import Geometries
from sgraph_core.graph import SGraph
from sgraph_core.grid.merging import merged
from sgraph_core.grid.outlines import enclosed_area, free_space, outlines
from sgraph_core.grid.pieces import straight_pieces
from sgraph_core.grid.settings import SurfaceSettings

__all__ = ["extract", "extract_surfaces", "in_world"]

Progress = Callable[[str, int, int], object]
"""Told what is being done, how much of it is done, and of how much."""


def extract(
    grid: OccupancyGrid,
    name: str | None = None,
    settings: SurfaceSettings | None = None,
    progress: Progress = lambda _what, _done, _total: None,
) -> SGraph:
    """Return an S-Graph of a grid's wall surfaces, numbered from 0, with ``graph.grid`` set.

    Args:
        grid: the occupancy grid.
        name: of the S-Graph.
        settings: what counts as a wall surface.
        progress: told after every strip of the grid.
    """
    surfaces = extract_surfaces(grid, settings, progress)
    graph = SGraph(name)
    graph.grid = grid
    heights = np.full((len(surfaces), 2), np.nan)
    graph.extend_wall_surfaces(surfaces.ids, surfaces.segments, surfaces.normals, heights)
    return graph


def extract_surfaces(
    grid: OccupancyGrid,
    settings: SurfaceSettings | None = None,
    progress: Progress = lambda _what, _done, _total: None,
) -> SurfaceArrays:
    """Return the wall surfaces of a grid in the world, M rows, normals towards free space.

    Memory beside the grid: one byte per cell, some 50 MB for the strip that is worked on, and
    what grows with the length of the outlines. Time is linear in cells and outlines.

    Args and steps: see :func:`extract` and docs/grids.md.
    """
    settings = settings or SurfaceSettings()
    cell = grid.resolution
    total = 2 * len(grid.cells)
    free = free_space(grid, settings.narrowest_free_m, lambda n: progress("surfaces", n, total))
    lines = outlines(free, lambda n: progress("surfaces", total // 2 + n, total))
    lines = _of_rooms_and_walls(lines, settings, cell)
    if not lines:
        return SurfaceArrays(np.empty(0, np.int64), np.empty((0, 2, 2)), np.empty((0, 2)))
    tolerance = max(settings.outline_tolerance_m / cell, 1.0)
    pieces = straight_pieces(lines, tolerance)
    segments = merged(
        pieces, free, tolerance, settings.widest_gap_m / cell, settings.front_m / cell
    )
    surfaces = in_world(grid, segments)
    return surfaces.take(surfaces.lengths >= max(settings.shortest_surface_m, 2 * cell))


def in_world(grid: OccupancyGrid, segments: FloatArray) -> SurfaceArrays:
    """Return segments given as (column, row), free space on their right, as surfaces.

    Those without length are left out.
    """
    segments = grid.to_world(segments)
    steps = segments[:, 1] - segments[:, 0]
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    long = lengths > 0
    along = steps[long] / lengths[long, None]
    normals = np.stack([along[:, 1], -along[:, 0]], axis=1)
    return SurfaceArrays(np.arange(len(along)), segments[long], normals)


def _of_rooms_and_walls(
    lines: list[FloatArray], settings: SurfaceSettings, cell: float
) -> list[FloatArray]:
    """Return the outlines without those of small free spaces, and in them, and of small blobs."""
    if not lines:
        return lines
    shapes = np.array([shapely.linestrings(line) for line in lines])
    areas = np.array([enclosed_area(line) for line in lines]) * cell**2
    space = (areas < 0) & (areas > -settings.smallest_free_m2)
    drop = space.copy()
    rings = [shapely.Polygon(lines[n]) for n in np.flatnonzero(space)]
    inside, _ = shapely.STRtree(rings).query(shapes, predicate="covered_by")
    drop[inside] = True
    blobs = np.flatnonzero((areas > 0) & ~drop)
    drop[_lone(shapes, blobs, settings.smallest_blob_m / cell, settings.lone_gap_m / cell)] = True
    return [line for line, dropped in zip(lines, drop.tolist(), strict=True) if not dropped]


def _lone(shapes: Geometries, blobs: IntArray, smallest: float, gap: float) -> IntArray:
    """Return which blobs stay small even together with all that is near, and near that.

    What is not small keeps only those near it that are thin, since walls may be broken into
    pieces; what is not thin is a thing that stands at a wall.
    """
    boxes = shapely.bounds(shapes)
    boxes[:, :2] *= -1  # then a union's box is a maximum
    small = _extents(boxes) < smallest
    blobs = blobs[small[blobs]]
    near, two = shapely.STRtree(shapes).query(shapes[blobs], predicate="dwithin", distance=gap)
    linked = small[two] | _thin(shapes[blobs])[near]
    one, two = blobs[near[linked]], two[linked]
    while True:
        grown = boxes.copy()
        np.maximum.at(grown, one, boxes[two])
        small = _extents(grown) < smallest
        if (grown == boxes)[small].all():
            return np.asarray(blobs[small[blobs]])
        boxes = grown


def _extents(boxes: FloatArray) -> FloatArray:
    return np.asarray((boxes[:, 2:] + boxes[:, :2]).max(axis=1))


def _thin(shapes: Geometries) -> NDArray[np.bool_]:
    """Return which shapes are more than twice as long as wide, [N]."""
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(shapes))
    sides = np.linalg.norm(np.diff(corners.reshape(-1, 5, 2)[:, :3], axis=1), axis=2)
    return np.asarray(sides.max(axis=1) > 2 * sides.min(axis=1))
