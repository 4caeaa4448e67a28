"""A synthetic grid as files: a ROS map_server map with its room labels."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from sgraph_concepts.types import OccupancyGrid
from sgraph_core.files import write_whole
from sgraph_core.synth.robot_grid import GridBuilding

__all__ = ["write_grid"]

PIXELS = np.zeros(3, np.uint8)
PIXELS[[OccupancyGrid.FREE, OccupancyGrid.OCCUPIED, OccupancyGrid.UNKNOWN]] = 254, 0, 205
"""Brightness of the cells, as map_server's map_saver writes them."""
DESCRIPTION = {"negate": 0, "occupied_thresh": 0.65, "free_thresh": 0.196}


def write_grid(building: GridBuilding, folder: Path) -> None:
    """Write ``map.yaml``, ``map.png`` and ``rooms.png``, 16-bit labels on the same pixels.

    Args:
        building: the grid and its truth.
        folder: where to write; it is made if need be.

    Raises:
        OSError: a file cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    grid = building.grid
    _write_image(folder / "map.png", PIXELS[grid.cells])
    _write_image(folder / "rooms.png", building.labels)
    described = {"image": "map.png", "resolution": grid.resolution, "origin": grid.origin.tolist()}
    lines = [f"{key}: {json.dumps(value)}\n" for key, value in {**described, **DESCRIPTION}.items()]
    write_whole(folder / "map.yaml", lambda temporary: temporary.write_text("".join(lines)))


def _write_image(path: Path, cells: NDArray[Any]) -> None:
    image = Image.fromarray(np.ascontiguousarray(cells[::-1]))  # an image's first row is the top
    write_whole(path, image.save)
