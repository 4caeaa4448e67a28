"""Reading ROS map_server maps: a YAML file and the image that it names."""

from __future__ import annotations

import stat
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from sgraph_concepts.errors import MapFileError, MapWarning
from sgraph_concepts.types import OccupancyGrid
from sgraph_core.grid.description import GridDescription, Mode, read_description, shown
from sgraph_core.grid.doubts import doubt
from sgraph_core.grid.image import Progress, read_cells

__all__ = ["grid_files", "read_grid"]

NAMED = 3
"""How many unknown keys are named in a warning."""
MOST_COLOURED = 0.1
"""A map whose share of coloured pixels is larger may be a picture of something else."""


def read_grid(
    path: str | Path, progress: Progress = lambda _what, _done, _total: None
) -> OccupancyGrid:
    """Read a ROS map_server map as nav2_map_server does; see docs/grids.md.

    Memory is bounded by the largest number of pixels, time is linear in pixels.

    Args:
        path: the YAML file. No other file is read but the image that it names.
        progress: told after every part of the image.

    Raises:
        MapFileError: the YAML or the image cannot be read or breaks a rule.

    Warns:
        MapWarning: the map can be read and looks wrong.
    """
    description = read_description(path)
    _check_image(path, description)
    cells, coloured = read_cells(description, progress)
    grid = OccupancyGrid(cells, description.resolution, np.array(description.origin))
    for text in _doubts(description, coloured, grid):
        warnings.warn(f"{path}: {text}", MapWarning, 2)
    return grid


def _doubts(description: GridDescription, coloured: float, grid: OccupancyGrid) -> Iterator[str]:
    if description.unknown:
        names = ", ".join(description.unknown[:NAMED])
        more = ", ..." if len(description.unknown) > NAMED else ""
        yield f"{names}{more}: no key of map_server, not read"
    if coloured > MOST_COLOURED:
        yield f"{coloured:.0%} of the image is coloured; colours count as their mean brightness"
    inverted = f"set negate: {int(not description.negate)} in the YAML"
    doubtful = doubt(grid, "invert the image" if description.mode is Mode.RAW else inverted)
    if doubtful is not None:
        yield doubtful


def grid_files(path: str | Path) -> tuple[Path, Path]:
    """Return the files that a map consists of: its YAML and its image.

    Raises:
        MapFileError: the YAML cannot be read or breaks a rule.
    """
    return Path(path), read_description(path).image


def _check_image(path: str | Path, description: GridDescription) -> None:
    """Check that the image is a file: opening a pipe would wait forever."""
    image = description.image
    try:
        kind = image.stat().st_mode
    except OSError as error:
        rule = f"{shown(str(image))}: cannot be read: {error.strerror}"
        raise MapFileError(path, "image", None, rule) from error
    except ValueError as error:  # characters that no path holds
        raise MapFileError(path, "image", None, "must name a file") from error
    if not stat.S_ISREG(kind):
        raise MapFileError(path, "image", None, f"{shown(str(image))}: must be a file")
