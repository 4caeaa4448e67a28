"""The two ways in which a floor gets onto its grid: drawn from the plan, or scanned by a robot."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from shapely import Polygon

from sgraph_concepts.types import FloatArray, OccupancyGrid
from sgraph_core.synth.config import GridConfig, ViewConfig
from sgraph_core.synth.grid_scene import GridScene
from sgraph_core.synth.pieces import Pieces
from sgraph_core.synth.raster import cells_along, covered
from sgraph_core.synth.scans import Obstacles, Scanner, scan
from sgraph_core.synth.trajectory import OUTSIDE_M, draw_poses

__all__ = ["draw_cells", "scan_cells", "speckle"]

FREE, OCCUPIED, UNKNOWN = OccupancyGrid.FREE, OccupancyGrid.OCCUPIED, OccupancyGrid.UNKNOWN
BEHIND_CELLS = 0.5
"""Faces are drawn this far inside the wall body."""


def draw_cells(scene: GridScene, rng: Generator, config: GridConfig) -> NDArray[np.uint8]:
    """Return the cells of a grid that is drawn from the plan, windows closed, [H, W]."""
    walls, furniture = rng.choice(config.drawn_walls), rng.choice(config.drawn_furniture)
    floor, shape = scene.floor, scene.shape
    building = _covered(scene, floor.outlines)
    free = (scene.rooms > 0) | _covered(scene, [Polygon(corners) for corners in floor.doors])
    if floor.pieces.facades.any():
        around = [outline.buffer(OUTSIDE_M) for outline in floor.outlines]
        free |= _covered(scene, around) & ~building
    cells = np.full(shape, UNKNOWN)
    if walls == "solid":
        cells[building] = OCCUPIED
    cells[free] = FREE
    if walls == "faces":
        faces = Pieces.joined(floor.shell, floor.panes)
        behind = _segments(scene, faces, -BEHIND_CELLS * scene.grid.resolution)
        face = cells_along(behind, shape)
        cells.flat[face[~free.flat[face]]] = OCCUPIED
    cells.flat[cells_along(_segments(scene, floor.leaves), shape)] = OCCUPIED
    cells[_covered(scene, floor.furniture)] = OCCUPIED if furniture == "occupied" else UNKNOWN
    return cells


def scan_cells(
    scene: GridScene, rng: Generator, config: GridConfig, view: ViewConfig
) -> NDArray[np.uint8]:
    """Return the cells that a robot's scans leave on its way through the building, [H, W]."""
    cell = scene.grid.resolution
    way = view.model_copy(update={"pose_spacing_m": config.pose_spacing_m})
    poses = scene.in_cells(draw_poses(scene.floor, rng, way))
    scanner = Scanner(
        beams=int(rng.choice(config.beams)),
        reach=rng.uniform(*view.sensor_range_m) / cell,
        range_noise=rng.choice(config.range_noise_m) / cell,
        pose_noise=rng.choice(config.pose_noise_m) / cell,
        angle_noise=np.radians(rng.choice(config.pose_noise_deg)),
        clearing=bool(rng.random() < config.clearing_share),
        occupied_from=config.occupied_from,
    )
    return scan(poses, _obstacles(scene, rng, config), scanner, scene.shape, rng)


def speckle(cells: NDArray[np.uint8], rng: Generator, density: float) -> None:
    """Let single known cells become something else.

    Args:
        cells: of a grid; they are changed.
        rng: where from.
        density: how many of the known cells.
    """
    known = np.flatnonzero(cells != UNKNOWN)
    chosen = rng.choice(known, int(density * len(known)), replace=False)
    cells.flat[chosen] = (cells.flat[chosen] + rng.integers(1, 3, len(chosen))) % 3


def _obstacles(scene: GridScene, rng: Generator, config: GridConfig) -> Obstacles:
    """Return what may stop rays: walls with their doors' and windows' reveals, glass, clutter."""
    floor = scene.floor
    openings = np.concatenate([floor.doors, floor.windows])
    reveals = np.concatenate([openings[:, [1, 2]], openings[:, [3, 0]]])
    walls, dark = _darkened(
        np.concatenate([floor.shell.segments, reveals]), rng, rng.choice(config.dark_share), config
    )
    parts = [walls, scene.clutter.segments, floor.panes.segments]
    segments = np.concatenate(parts)
    stopping, returns_not = np.ones(len(segments)), np.zeros(len(segments), bool)
    stopping[len(segments) - len(floor.panes) :] = rng.choice(config.glass_share)
    returns_not[: len(walls)] = dark
    return Obstacles(scene.in_cells(segments), stopping, returns_not)


def _darkened(
    segments: FloatArray, rng: Generator, share: float, config: GridConfig
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Cut a dark stretch out of some segments; return all parts, and which are dark."""
    lengths = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)
    stretch = np.minimum(rng.uniform(*config.dark_m, len(segments)) / np.maximum(lengths, 1e-9), 1)
    chosen = rng.random(len(segments)) < share
    low = np.where(chosen, rng.random(len(segments)) * (1 - stretch), 1.0)
    high = np.where(chosen, low + stretch, 1.0)

    def part(start: FloatArray, end: FloatArray) -> FloatArray:
        shares = np.stack([start, end], axis=1)[..., None]
        return np.asarray(segments[:, :1] + shares * (segments[:, 1:] - segments[:, :1]))

    parts = np.concatenate([part(0 * low, low), part(low, high), part(high, 1 + 0 * high)])
    dark = np.repeat([False, True, False], len(segments))
    there = np.linalg.norm(parts[:, 1] - parts[:, 0], axis=1) > 0
    return parts[there], dark[there]


def _segments(scene: GridScene, pieces: Pieces, forward_m: float = 0.0) -> FloatArray:
    """Return pieces in cells, moved along their normals."""
    return scene.in_cells(pieces.segments + forward_m * pieces.normals[:, None])


def _covered(scene: GridScene, polygons: list[Polygon]) -> NDArray[np.bool_]:
    return covered([scene.polygon_in_cells(polygon) for polygon in polygons], scene.shape)
