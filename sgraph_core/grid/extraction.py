"""From an occupancy grid to the wall surfaces that bound its free space."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sgraph_concepts.types import FloatArray, OccupancyGrid, SurfaceArrays
from sgraph_core.graph import SGraph
from sgraph_core.grid.clutter import without_clutter
from sgraph_core.grid.merging import merged
from sgraph_core.grid.outlines import free_space, outlines
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
    """Return the wall surfaces of a grid, [M], numbered from 0, in the world's frame.

    Normals point to the free side; docs/grids.md has the steps. Memory beside the grid: one byte
    per cell, some 30 MB for the strip that is worked on, and what grows with the length of the
    outlines. Time is linear in cells and outlines.

    Args:
        grid: the occupancy grid.
        settings: what counts as a wall surface.
        progress: told after every strip of the grid.
    """
    settings = settings or SurfaceSettings()
    cell = grid.resolution
    total = 2 * len(grid.cells)
    what = "finding wall surfaces"
    free = free_space(grid, settings.narrowest_free_m, lambda row: progress(what, row, total))
    lines = outlines(free, lambda row: progress(what, total // 2 + row, total))
    lines = without_clutter(lines, settings, cell)
    if not lines:
        return in_world(grid, np.empty((0, 2, 2)))
    tolerance = max(settings.outline_tolerance_m / cell, 1.0)
    pieces = straight_pieces(lines, tolerance)
    segments = merged(
        pieces, free, tolerance, settings.widest_gap_m / cell, settings.front_m / cell
    )
    lengths = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)
    return in_world(grid, segments[lengths >= max(settings.shortest_surface_m / cell, 2.0)])


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
