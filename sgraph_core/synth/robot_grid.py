"""A synthetic building as an occupancy grid, with its truth cell by cell and surface by surface.

Either a robot scans the building on its way through it, or the grid is drawn from the plan.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.random import Generator
from numpy.typing import NDArray

from sgraph_concepts.errors import InputError
from sgraph_concepts.types import BuildingTruth, FloatArray, OccupancyGrid, SurfaceArrays
from sgraph_core.synth.config import BuildingConfig
from sgraph_core.synth.grid_drawing import draw_cells, scan_cells, speckle
from sgraph_core.synth.grid_scene import GridScene
from sgraph_core.synth.grid_truth import surface_truth
from sgraph_core.synth.pieces import Pieces
from sgraph_core.synth.plan import draw_plan
from sgraph_core.synth.surfaces import Floor, draw_surfaces

__all__ = ["GridBuilding", "draw_grid_building", "render"]

MOST_ATTEMPTS = 50


@dataclass(frozen=True, eq=False)
class GridBuilding:
    """A floor's occupancy grid with its truth.

    Attributes:
        grid: the map.
        labels: 1 + the room that each cell's centre lies in, [H, W]; 0 in none. In a scanned grid
            only free cells have a label, in a drawn one also those under furniture.
        pieces: what surfaces of the map may lie on: the walls' faces, glass, clutter.
        polygons: outline of each room's free space, [K_r, 2] each.
    """

    grid: OccupancyGrid
    labels: NDArray[np.uint16]
    pieces: Pieces
    polygons: list[FloatArray]

    def truth(self, surfaces: SurfaceArrays) -> BuildingTruth:
        """Return the truth of surfaces that were extracted from the grid and preprocessed."""
        return surface_truth(surfaces, self.pieces, self.polygons)


def draw_grid_building(rng: Generator, config: BuildingConfig) -> GridBuilding:
    """Draw a building of which the grid knows some part of a room.

    Raises:
        InputError: the configuration practically never yields one.
    """
    for _ in range(MOST_ATTEMPTS):
        plan = draw_plan(rng, config.plan)
        if plan is None:
            continue
        building = render(draw_surfaces(plan, rng, config.fittings), rng, config)
        if building.labels.any():
            return building
    raise InputError(f"no grid came out of {MOST_ATTEMPTS} attempts: check the configuration")


def render(floor: Floor, rng: Generator, config: BuildingConfig) -> GridBuilding:
    """Return the grid of a floor, drawn or scanned."""
    scene = GridScene.draw(floor, rng, config.grid)
    if rng.random() < config.grid.drawn_share:
        cells = draw_cells(scene, rng, config.grid)
        labelled = scene.rooms > 0
    else:
        cells = scan_cells(scene, rng, config.grid, config.view)
        labelled = cells == OccupancyGrid.FREE
    density = rng.choice(config.grid.speckles_per_m2) * scene.grid.resolution**2
    speckle(cells, rng, density)
    outlines = [shapely.get_coordinates(room.exterior)[:-1] for room in floor.rooms]
    return GridBuilding(
        replace(scene.grid, cells=cells),
        np.where(labelled, scene.rooms, 0).astype(np.uint16),
        scene.in_world(Pieces.joined(floor.shell, floor.panes, scene.clutter)),
        [scene.placement.points(outline) for outline in outlines],
    )
