"""A furnished floor on an empty grid: what scans and drawings start from."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.random import Generator
from numpy.typing import NDArray
from shapely import Polygon

from sgraph_concepts.types import FloatArray, OccupancyGrid
from sgraph_core.synth.config import GridConfig
from sgraph_core.synth.grid_clutter import stand_cupboards, stand_tables
from sgraph_core.synth.pieces import NO_ROOM, Pieces
from sgraph_core.synth.placement import Placement
from sgraph_core.synth.polygons import all_edges
from sgraph_core.synth.raster import filled
from sgraph_core.synth.surfaces import Floor
from sgraph_core.synth.trajectory import OUTSIDE_M

__all__ = ["GridScene"]


@dataclass(frozen=True, eq=False)
class GridScene:
    """A furnished floor on an empty grid.

    Attributes:
        floor: with all its furniture, in the coordinates that it was drawn in; its facades may be
            mapped only if the space around it is known.
        placement: where it lies in the world.
        grid: around it, in the world; all cells are unknown.
        rooms: 1 + the room that each cell's centre lies in, 0 for none, [H, W].
    """

    floor: Floor
    placement: Placement
    grid: OccupancyGrid
    rooms: NDArray[np.int32]

    @classmethod
    def draw(cls, built: Floor, rng: Generator, config: GridConfig) -> GridScene:
        """Furnish a floor and lay a grid around it."""
        standing = [*built.furniture, *stand_cupboards(built, rng, config)]
        legs = stand_tables(built.rooms, standing, rng, config)
        outside_known = built.pieces.facades.any() and rng.random() < config.outside_share
        pieces = built.pieces
        floor = replace(
            built,
            furniture=[*standing, *legs],
            pieces=pieces if outside_known else pieces.take(~pieces.facades),
        )
        placement = Placement.draw(rng)
        yaw = placement.angle if rng.random() < config.aligned_share else 0.0
        margin = rng.uniform(*config.margin_m) + (OUTSIDE_M if outside_known else 0.0)
        corners = placement.points(floor.shell.segments.reshape(-1, 2))
        grid = _empty_grid(corners, yaw, float(rng.choice(config.resolution_m)), margin)
        rooms = [
            shapely.transform(room, lambda points: grid.to_cells(placement.points(points)))
            for room in floor.rooms
        ]
        numbers = 1 + np.arange(len(rooms))
        return cls(floor, placement, grid, filled(rooms, numbers, _shape(grid)))

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the grid."""
        return _shape(self.grid)

    @property
    def clutter(self) -> Pieces:
        """The faces of furniture and door leaves."""
        segments, inwards, _ = all_edges(self.floor.furniture)
        none, no = np.full(len(segments), NO_ROOM), np.zeros(len(segments), bool)
        return Pieces.joined(self.floor.leaves, Pieces(segments, -inwards, none, no))

    def in_cells(self, points: FloatArray) -> FloatArray:
        """Return points of the floor [..., 2] as (column, row), in cells."""
        return self.grid.to_cells(self.placement.points(points))

    def polygon_in_cells(self, polygon: Polygon) -> Polygon:
        """Return a polygon of the floor with corners as (column, row), in cells."""
        return shapely.transform(polygon, self.in_cells)

    def in_world(self, pieces: Pieces) -> Pieces:
        """Return pieces of the floor in the world."""
        place = self.placement
        return Pieces(
            place.points(pieces.segments),
            place.directions(pieces.normals),
            pieces.rooms,
            pieces.structural,
        )


def _shape(grid: OccupancyGrid) -> tuple[int, int]:
    height, width = grid.cells.shape
    return height, width


def _empty_grid(
    points: FloatArray, yaw: float, resolution: float, margin_m: float
) -> OccupancyGrid:
    """Return a grid of unknown cells around points, with rows turned by a yaw."""
    axes = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    turned = points @ axes.T
    low, high = turned.min(axis=0) - margin_m, turned.max(axis=0) + margin_m
    width, height = np.ceil((high - low) / resolution).astype(int)
    cells = np.full((height, width), OccupancyGrid.UNKNOWN, np.uint8)
    return OccupancyGrid(cells, resolution, np.array([*(low @ axes), yaw]))
